from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.kinematics import (
    ArmReach,
    KinematicChain,
    PostureCost,
    ReachConfig,
    RobotModel,
    dexterity,
    mobility,
)
from debrisgrasp.kinematics.posture import self_motions

from .robots import JointText, written

COST = PostureCost(
    limit_weight=1.0, singularity_weight=1.0, free_dexterity=0.04, scene_weight=0.5
)


def test_dexterity_is_the_slowest_motion_of_the_tip(
    arm: KinematicChain, rng: np.random.Generator
) -> None:
    q = arm.sampled(20, rng=rng)
    J = arm.jacobian(q)
    J[:, 3:] *= 0.3
    least = np.linalg.svd(J, compute_uv=False)[:, -1]
    np.testing.assert_allclose(dexterity(arm, q), least, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("turn", [1.57, 1.5707963])
def test_mobility_counts_ways_and_not_joints(
    arm: KinematicChain, tmp_path: Path, turn: float
) -> None:
    assert mobility(arm) == 6
    scara = [JointText(), JointText(xyz=(0.4, 0.0, 0.0))]
    scara += [JointText("prismatic", xyz=(0.3, 0.0, 0.0)), JointText()]
    rail = JointText("prismatic", xyz=(0.0, 0.0, 0.0), axis=(1.0, 0.0, 0.0))
    tilted = JointText(rpy=(0.0, turn, 0.0), axis=(-1.0, 0.0, 0.0))
    for joints in (scara, [rail, *scara], [*scara, tilted]):
        path = written(tmp_path, joints)
        chain = KinematicChain.from_urdf(path, "link0", f"link{len(joints)}")
        assert mobility(chain) == 4


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_postures_that_are_not_finite_have_no_dexterity(
    arm: KinematicChain, bad: float
) -> None:
    with pytest.raises(InputError, match="joint values"):
        dexterity(arm, np.full((2, arm.n_joints), bad))


def test_self_motions_leave_the_tip_in_place_to_first_order(
    arm: KinematicChain, rng: np.random.Generator
) -> None:
    q = arm.sampled(10, rng=rng)
    small, large = (
        np.linalg.norm(arm.fk(q + self_motions(arm, q, step)).p - arm.fk(q).p, axis=-1)
        for step in (1e-4, 1e-2)
    )
    assert self_motions(arm, q, 0.1).shape == (4, 10, 8)
    assert small.max() < 1e-7
    assert large.max() < 1e-2 * 0.1
    assert not len(self_motions(arm, q, 0.1)[:, :0][0])


def test_cost_grows_with_travel_limits_and_nearness_to_the_scene(
    arm: KinematicChain,
) -> None:
    present = np.full(8, 0.3)
    clear, close = np.array(0.1), np.array(0.01)
    here = COST(arm, present, present, clear)
    assert COST(arm, present, present, close) > here
    assert COST(arm, present + 0.1, present, clear) > here
    at_limit = present.copy()
    at_limit[2] = arm.upper[2]
    travel = abs(at_limit[2] - present[2])
    assert COST(arm, at_limit, present, clear) >= here + travel


def test_a_singular_posture_costs_more(roman: RobotModel) -> None:
    seven = roman.chain("right", {"torso_joint": 0.0})
    straight = np.zeros(7)
    assert dexterity(seven, straight) < 1e-6
    bent = seven.vector(roman.posture("right", "ready"))
    assert dexterity(seven, bent) > 0.04
    only = replace(COST, limit_weight=0.0, scene_weight=0.0)
    cost = only(seven, straight, straight, np.array(1.0))
    assert cost == pytest.approx(1.0, abs=1e-4)
    assert only(seven, bent, bent, np.array(1.0)) == 0.0


def test_sliding_along_the_nullspace_makes_postures_cheaper_and_keeps_the_pose(
    roman: RobotModel, rng: np.random.Generator
) -> None:
    def nothing(points: np.ndarray) -> np.ndarray:
        return np.full(points.shape[:-1], 0.1)

    arms = [ArmReach(roman, "right", ReachConfig(slides=n)) for n in (0, 2)]
    q = arms[0].chain.sampled(90, rng=rng)
    T = arms[0].chain.fk(q[~arms[0].collision.hits_itself(q)][:25])
    first, slid = (a.reach(T, nothing, rng=np.random.default_rng(3)) for a in arms)
    both = first.is_reached & slid.is_reached
    assert both.sum() > 15

    def cost(joints: np.ndarray) -> np.ndarray:
        return COST(arms[0].chain, joints, arms[0].q_present, np.full(len(joints), 0.1))

    before, after = cost(first.joints[both]), cost(slid.joints[both])
    assert (after <= before + 1e-3).all()
    assert after.mean() < before.mean() - 0.1
    T_reached = arms[0].chain.fk(slid.joints[both])
    np.testing.assert_allclose(T_reached.matrix, T.matrix[both], atol=2e-3)
    assert not arms[0].collision.hits_itself(slid.joints[both]).any()


def test_settings_are_checked() -> None:
    with pytest.raises(ConfigError, match="slides"):
        ReachConfig(slides=-1)
    with pytest.raises(ConfigError, match="singularity_weight"):
        ReachConfig(singularity_weight=-1.0)
    with pytest.raises(ConfigError, match="scene_weight"):
        ReachConfig(scene_weight=np.inf)
    with pytest.raises(ConfigError, match="margin"):
        ReachConfig(margin=10.0)
