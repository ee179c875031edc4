"""The search settles only where an arm has a posture."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from debrisgrasp.geometry import SE3
from debrisgrasp.planning.annealing import Walkers
from debrisgrasp.planning.postures import Postures

HANDS = np.array(["left_hand", "right_hand"])
GOOD, POOR = np.log(0.6), np.log(0.001)


@dataclass
class SlidingArm:
    """Takes every pose with x below its length; its joints are the pose's x and y."""

    name: str
    gripper: str
    length: float = 1.0
    seeds: list[np.ndarray] = field(default_factory=list)
    joint_names = ("x", "y")

    def follow(self, T_base_hand: SE3, q_before: np.ndarray, *, rng) -> np.ndarray:
        assert isinstance(rng, np.random.Generator)
        self.seeds.append(q_before.copy())
        q = T_base_hand.p[:, :2].copy()
        q[q[:, 0] > self.length] = np.nan
        return q


def at(x, value) -> Walkers:
    x = np.asarray(x, dtype=float)
    Ts = np.tile(np.eye(4), (len(x), 1, 1))
    Ts[:, 0, 3] = x
    return Walkers.at(Ts, np.broadcast_to(value, x.shape).astype(float))


@pytest.fixture
def right() -> SlidingArm:
    return SlidingArm("right", "right_hand")


@pytest.fixture
def postures(right, rng) -> Postures:
    return Postures((SlidingArm("left", "left_hand", 3.0), right), HANDS, rng)


def test_walkers_that_no_arm_reaches_go_back_to_where_they_were(postures):
    before = postures.unknown(at([0.0, 0.0, 0.0], POOR))
    now = at([0.5, 2.0, 2.0], GOOD)
    settled = postures.settled(before, now, np.array([1, 1, 0]))
    assert settled.walkers.best_Ts_base_hand[:, 0, 3].tolist() == [0.5, 0.0, 2.0]
    assert settled.walkers.log_quality.tolist() == [GOOD, POOR, GOOD]
    # Left arm's joints first, then the right one's.
    assert settled.joints[0, 2] == 0.5
    assert np.isnan(settled.joints[1]).all()
    assert settled.joints[2, 0] == 2.0
    Ts, prototype, value = postures.missed()
    assert Ts[:, 0, 3].tolist() == [2.0]
    assert (prototype.tolist(), value.tolist()) == ([1], [GOOD])


def test_joints_are_followed_over_a_step_but_not_over_a_jump(postures, right):
    which = np.array([1, 1])
    start = postures.unknown(at([0.1, 0.1], POOR))
    first = postures.settled(start, at([0.2, 0.2], np.log(0.3)), which)
    moved = first.walkers.with_rows(np.arange(2), at([0.23, 0.8], GOOD))
    postures.settled(first, moved, which)
    assert right.seeds[-1][0].tolist() == [0.2, 0.0]
    assert np.isnan(right.seeds[-1][1]).all()


def test_nobody_is_asked_about_states_that_are_no_grasp_or_not_new(postures, right):
    which = np.array([1, 1])
    start = postures.unknown(at([0.1, 0.1], POOR))
    poor = at([9.0, 0.4], [np.log(0.005), GOOD])
    settled = postures.settled(start, poor, which)
    assert [len(seeds) for seeds in right.seeds] == [1]
    postures.settled(settled, settled.walkers, which)
    assert len(right.seeds) == 1


def test_what_has_no_joints_yet_is_solved_in_the_end(postures):
    found = postures.unknown(at([0.5, 2.0], POOR))
    holds, settled = postures.completed(found, np.array([1, 1]))
    assert holds.tolist() == [True, False]
    assert settled.joints[0, 2] == 0.5


def test_without_arms_every_state_holds(rng):
    postures = Postures((), HANDS, rng)
    before = postures.unknown(at([0.0, 0.0], POOR))
    settled = postures.settled(before, at([9.0, 9.0], GOOD), np.array([0, 1]))
    assert settled.walkers.best_log_quality.tolist() == [GOOD, GOOD]
    assert settled.joints.shape == (2, 0)
    holds, _ = postures.completed(settled, np.array([0, 1]))
    assert holds.all()
    assert len(postures.missed()[0]) == 0
