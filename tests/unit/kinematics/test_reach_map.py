from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import (
    IkConfig,
    IkStatus,
    KinematicChain,
    ReachMap,
    ReachMapConfig,
    RobotModel,
    solve,
)
from debrisgrasp.kinematics.descent import Goals
from debrisgrasp.kinematics.formulas import AxisGoals

from .robots import JointText, written


@pytest.mark.parametrize("locked", [None, {"torso_joint": 0.0}])
def test_what_kinematics_reaches_is_never_called_unreachable(
    roman: RobotModel, rng: np.random.Generator, locked: dict[str, float] | None
) -> None:
    chain = roman.chain("left", locked)
    reach_map = ReachMap.build(chain)
    T = chain.fk(chain.sampled(50_000, rng=rng)).matrix
    assert reach_map.may_reach(Goals.from_matrices(chain.form, T)).all()


def test_arms_that_move_in_a_plane_have_a_map(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    row = [JointText(), JointText(xyz=(0.3, 0, 0)), JointText(xyz=(0.2, 0, 0))]
    chain = KinematicChain.from_urdf(written(tmp_path, row), "link0", "link3")
    reach_map = ReachMap.build(chain)
    T = chain.fk(chain.sampled(5_000, rng=rng))
    assert reach_map.may_reach(Goals.from_matrices(chain.form, T.matrix)).all()
    above = SE3.from_parts(T.R, T.p + np.array([0.0, 0.0, 0.1])).matrix
    assert not reach_map.may_reach(Goals.from_matrices(chain.form, above)).any()


def test_far_poses_are_ruled_out_without_descent(
    arm: KinematicChain, arm_map: ReachMap, rng: np.random.Generator
) -> None:
    R = arm.fk(arm.sampled(500, rng=rng)).R
    T = SE3.from_parts(R, rng.uniform((1.2, -0.3, 1.4), (1.6, 0.3, 1.8), (500, 3)))
    hurried = IkConfig(attempts=1, max_iterations=1)
    found = solve(arm, T, reach_map=arm_map, rng=rng, config=hurried)
    unreachable = found.status == IkStatus.UNREACHABLE
    assert unreachable.mean() > 0.5
    thorough = solve(arm, T[unreachable], rng=rng, config=IkConfig(attempts=60))
    assert not thorough.is_solved.any()


def test_seeds_start_near_their_goals(
    arm: KinematicChain, arm_map: ReachMap, rng: np.random.Generator
) -> None:
    T = arm.fk(arm.sampled(500, rng=rng))
    goals = Goals.from_matrices(arm.form, T.matrix)
    q = arm_map.starts(arm, goals, np.zeros(500, dtype=int)).T
    gap = np.linalg.norm(arm.fk(q).p - T.p, axis=-1)
    random = np.linalg.norm(arm.fk(arm.sampled(500, rng=rng)).p - T.p, axis=-1)
    assert np.median(gap) < 0.5 * np.median(random)
    assert ((q >= arm.lower - 1e-6) & (q <= arm.upper + 1e-6)).all()


def test_one_target_gets_what_many_get(
    arm: KinematicChain, arm_map: ReachMap, rng: np.random.Generator
) -> None:
    R = arm.fk(arm.sampled(200, rng=rng)).R
    T = SE3.from_parts(R, rng.uniform((-0.5, -1.0, -0.2), (1.5, 1.0, 1.5), (200, 3)))
    columns = Goals.from_matrices(arm.form, T.matrix).columns
    many = AxisGoals.from_columns(columns)
    is_open = arm_map.admits(many)
    assert 0.1 < is_open.mean() < 0.9
    ranks = np.arange(arm_map.config.n_seeds)
    for i in range(200):
        one = AxisGoals.of_one(columns[:, :, i].ravel().tolist())
        starts = arm_map.middles_of_one(*one)
        assert bool(starts) == is_open[i]
        if starts:
            expected = arm_map.middles(many.picked(np.full(len(ranks), i)), ranks)
            np.testing.assert_allclose(np.transpose(starts), expected, atol=1e-6)


def test_building_twice_gives_the_same_map(arm: KinematicChain) -> None:
    config = ReachMapConfig(n_samples=20_000)
    once, again = (ReachMap.build(arm, config) for _ in range(2))
    np.testing.assert_array_equal(once.seeds, again.seeds)
    np.testing.assert_array_equal(once.azimuths, again.azimuths)


def test_a_map_of_another_chain_is_refused(
    roman: RobotModel, arm_map: ReachMap, rng: np.random.Generator
) -> None:
    left = roman.chain("left")
    with pytest.raises(ConfigError, match="build it again"):
        solve(left, SE3.identity(), reach_map=arm_map, rng=rng)


def test_a_chain_with_a_prismatic_end_has_no_map(tmp_path: Path) -> None:
    joints = [JointText("prismatic"), JointText(), JointText(axis=(0, 1, 0))]
    chain = KinematicChain.from_urdf(written(tmp_path, joints), "link0", "link3")
    with pytest.raises(ConfigError, match="prismatic"):
        ReachMap.build(chain)


def test_a_chain_of_one_joint_has_no_map(tmp_path: Path) -> None:
    path = written(tmp_path, [JointText()])
    with pytest.raises(ConfigError, match="got revolute, expected two joints"):
        ReachMap.build(KinematicChain.from_urdf(path, "link0", "link1"))


def test_sizes_below_one_are_refused() -> None:
    with pytest.raises(ConfigError, match="n_seeds"):
        ReachMapConfig(n_seeds=0)


def test_a_chain_its_limits_and_its_map_show_themselves_in_a_line(
    roman: RobotModel, arm: KinematicChain, arm_map: ReachMap
) -> None:
    limits = roman.limits("right").hardware
    assert repr(arm) == "<KinematicChain of 8 joints from base_link to right_hand>"
    assert repr(limits) == f"<LimitSet {limits.hash} of 8 joints: 150 N, 40 N m>"
    assert repr(arm_map) == f"<ReachMap of chain {arm.hash}: 35840 cells>"
