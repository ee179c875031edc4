"""Grasps whose arm can't give way are left out, unless there are no others."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.geometry import SE3
from debrisgrasp.planning import Grasp, GraspPlanner, PlannerConfig
from debrisgrasp.planning.ledger import Ledger
from debrisgrasp.prototypes import PrototypeLibrary

NAME = "cylinder_060_tip"


class Arm:
    """Gives way in each posture by what its only joint says."""

    joint_names = ("j",)

    def __init__(self, name: str) -> None:
        self.name = name
        self.seen: list[np.ndarray] = []

    def leeway(self, joints, T_base_hand, Ts_base_away, **_) -> np.ndarray:
        assert T_base_hand.matrix.shape == (len(joints), 4, 4)
        self.seen.append(Ts_base_away.matrix[..., 2, 3])
        return joints[:, 0]


@pytest.fixture(scope="module")
def planner() -> GraspPlanner:
    return GraspPlanner(PrototypeLibrary.load().select(names=[NAME]), PlannerConfig())


def grasp(arm: str, share: float) -> Grasp:
    return Grasp(
        T_base_hand=SE3.from_parts(p=(share, 0.0, 0.3)),
        T_base_pregrasp=SE3.from_parts(p=(share, 0.0, 0.4)),
        gripper="robotiq_3f",
        preshape="pinch",
        opening=0.1,
        width=0.06,
        prototype=NAME,
        S=1.0,
        C=1.0,
        R=1.0,
        coverage=1.0,
        support=1,
        expected=1.0,
        score=0.5,
        arm=arm,
        joints={"j": share},
    )


def left(planner, shares, ledger) -> tuple[list[float], list[Arm]]:
    """Shares of the grasps that stay, of two arms in turn."""
    arms = [Arm("left"), Arm("right")]
    given = tuple(grasp(arms[i % 2].name, share) for i, share in enumerate(shares))
    found = planner._yielding(given, arms, np.random.default_rng(0), ledger)
    return [one.joints["j"] for one in found], arms


def test_grasps_that_cannot_give_way_are_left_out_with_a_reason(planner):
    ledger = Ledger()
    found, arms = left(planner, [1.0, 0.5, 0.95, 0.97, 0.2], ledger)
    assert found == [1.0, 0.95, 0.97]
    assert ledger.closed().counts() == {
        "right arm: no room to give way to a push": 1,
        "left arm: no room to give way to a push": 1,
    }
    # At the pre-grasp, and lifted by 15 cm.
    assert arms[0].seen[0] == pytest.approx(np.array([[0.4, 0.45]] * 3))


def test_where_no_grasp_gives_way_all_stay(planner):
    ledger = Ledger()
    assert left(planner, [0.5, 0.1], ledger)[0] == [0.5, 0.1]
    assert not ledger.closed().counts()
    assert left(planner, [], ledger)[0] == []
