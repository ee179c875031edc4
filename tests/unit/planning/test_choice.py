"""Which grasps are offered: distinct ones, from all over the object."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3, random_rotations
from debrisgrasp.planning import PlannerConfig
from debrisgrasp.planning.choice import choose, is_half_turn_symmetric
from debrisgrasp.prototypes import GripperModel

HALF_TURN = SE3.from_matrix(np.diag([-1.0, -1.0, 1.0, 1.0]))


def chosen(Ts, value, *, symmetric=False, places=None, hands=None, shapes=None, **kw):
    k = len(Ts)
    return choose(
        Ts,
        Ts[:, :3, 3] if places is None else places,
        hands or ["claw"] * k,
        shapes or ["pipe"] * k,
        np.full(k, symmetric),
        np.array(value, dtype=float),
        PlannerConfig(**kw),
    ).tolist()


def apart(n: int, step: float) -> np.ndarray:
    Ts = np.tile(np.eye(4), (n, 1, 1))
    Ts[:, 0, 3] = step * np.arange(n)
    return Ts


def test_half_a_turn_is_the_same_grasp_for_a_symmetric_hand_only(rng):
    for R in random_rotations(20, rng=rng):
        T = SE3.from_parts(R, [0.5, 0.1, 0.3])
        Ts = np.stack([T.matrix, (T @ HALF_TURN).matrix])
        assert chosen(Ts, [0.4, 0.6], symmetric=True) == [1]
        assert chosen(Ts, [0.4, 0.6], symmetric=False) == [1, 0]


def test_the_claw_is_symmetric_and_the_hand_with_a_thumb_is_not():
    assert is_half_turn_symmetric(GripperModel.load("camhand"), "claw")
    assert not is_half_turn_symmetric(GripperModel.load("robotiq_3f"), "basic")


def test_the_best_of_each_region_is_offered_before_the_second_best_of_any():
    Ts = np.concatenate([apart(5, 0.01), apart(3, 0.01) + 0.0])
    Ts[5:, 1, 3] = 0.5
    value = [0.9, 0.85, 0.8, 0.75, 0.7, 0.3, 0.2, 0.1]
    found = chosen(Ts, value, n_best=4)
    assert found == [0, 1, 5, 6]


def test_what_is_offered_is_sorted_by_its_value(rng):
    Ts, value = apart(30, 0.05), rng.random(30)
    found = chosen(Ts, value, n_best=12)
    assert (np.diff(value[found]) <= 0).all()
    assert found[0] == np.argmax(value)


def test_hands_and_prototypes_can_be_capped():
    Ts, value = apart(8, 0.3), np.linspace(1, 0.3, 8)
    hands = ["claw", "claw", "claw", "pinch"] * 2
    shapes = ["pipe", "bar"] * 4
    assert chosen(Ts, value, hands=hands, n_per_hand=2) == [0, 1, 3, 7]
    assert chosen(Ts, value, shapes=shapes, n_per_prototype=1) == [0, 1]
    assert chosen(Ts, value, n_best=3) == [0, 1, 2]
    assert chosen(Ts[:0], []) == []


def test_caps_below_one_are_refused():
    with pytest.raises(ConfigError, match="n_per_hand"):
        PlannerConfig(n_per_hand=0)
