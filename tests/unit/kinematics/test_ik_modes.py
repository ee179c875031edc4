"""Inverse kinematics near a posture, with free turns, and for few or many poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from debrisgrasp.errors import ConfigError, InputError, ShapeError
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.kinematics import (
    Freedom,
    IkConfig,
    IkResult,
    IkStatus,
    KinematicChain,
    ReachMap,
    solve,
    solve_distinct,
    solve_nearest,
)

from .robots import JointText, written

seeds = st.integers(0, 2**32 - 1)


def errors(chain: KinematicChain, q: np.ndarray, T: SE3) -> np.ndarray:
    """Distance [m] and angle [rad] between what is reached and what was asked."""
    reached = chain.fk(q)
    turn = so3.log(reached.inverse().R @ T.R)
    distance = np.linalg.norm(reached.p - T.p, axis=-1)
    return np.stack([distance, np.linalg.norm(turn, axis=-1)], axis=-1)


def assert_solves(chain: KinematicChain, found: IkResult, T: SE3) -> None:
    assert found.is_solved.all()
    assert (errors(chain, found.q, T) <= (1e-4, 1e-3)).all()
    assert (found.q >= chain.lower).all()
    assert (found.q <= chain.upper).all()


@settings(max_examples=15)
@given(seed=seeds, n=st.sampled_from([1, 5, 12, 13, 40]))
def test_what_kinematics_reaches_is_reached_again(
    arm: KinematicChain, arm_map: ReachMap, seed: int, n: int
) -> None:
    rng = np.random.default_rng(seed)
    T = arm.fk(arm.sampled(n, rng=rng))
    assert_solves(arm, solve(arm, T, reach_map=arm_map, rng=rng), T)


@pytest.mark.parametrize("batch", [(0,), (0, 3), (2, 0)])
def test_of_no_poses_there_are_no_distinct_postures(
    arm: KinematicChain, arm_map: ReachMap, rng: np.random.Generator, batch
) -> None:
    none = SE3(np.zeros((*batch, 4, 4)))
    for reach_map in (None, arm_map):
        found = solve_distinct(arm, none, 3, reach_map=reach_map, rng=rng)
        assert found.q.shape == (*batch, 3, arm.n_joints)
        assert found.is_solved.shape == found.position_error.shape == (*batch, 3)


@settings(max_examples=8)
@given(seed=seeds)
def test_many_poses_are_solved_as_each_alone(
    arm: KinematicChain, arm_map: ReachMap, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    reachable = arm.fk(arm.sampled(30, rng=rng)).matrix
    beyond = SE3.from_parts(p=rng.uniform(1.5, 2.5, (5, 3))).matrix
    T = SE3(np.concatenate([reachable, beyond]))
    together = solve(arm, T, reach_map=arm_map, rng=rng)
    for i in range(35):
        alone = solve(arm, T[i], reach_map=arm_map, rng=rng)
        assert alone.status == together.status[i]
        if alone.is_solved:
            both = np.stack([alone.q, together.q[i]])
            assert (errors(arm, both, T[[i, i]]) <= (1e-4, 1e-3)).all()


@settings(max_examples=10)
@given(seed=seeds)
def test_moving_base_and_target_together_changes_nothing(
    arm: KinematicChain, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    moved_by = SE3.from_parts(so3.exp(rng.normal(0, 1, 3)), rng.uniform(-2, 2, 3))
    moved = KinematicChain(
        base="elsewhere",
        tip=arm.tip,
        joint_names=arm.joint_names,
        is_revolute=arm.is_revolute,
        lower=arm.lower,
        upper=arm.upper,
        axes=moved_by.rotate(arm.axes),
        points=moved_by.apply(arm.points),
        T_base_tip_at_zero=moved_by @ arm.T_base_tip_at_zero,
    )
    T = arm.fk(arm.sampled(5, rng=rng))
    q_seed = arm.sampled(5, rng=rng)
    here = solve(arm, T, q_seed=q_seed, rng=np.random.default_rng(0))
    there = solve(moved, moved_by @ T, q_seed=q_seed, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(here.status, there.status)
    np.testing.assert_allclose(here.q, there.q, atol=1e-4)


@settings(max_examples=15)
@given(seed=seeds, n=st.sampled_from([1, 20]))
def test_limits_hold_whatever_is_asked(
    arm: KinematicChain, arm_map: ReachMap, seed: int, n: int
) -> None:
    rng = np.random.default_rng(seed)
    R = so3.exp(rng.normal(0, 2, (n, 3)))
    T = SE3.from_parts(R, rng.uniform(-1.5, 1.5, (n, 3)))
    found = solve(arm, T, q_seed=rng.normal(0, 9, (n, 8)), reach_map=arm_map, rng=rng)
    assert (found.q >= arm.lower).all()
    assert (found.q <= arm.upper).all()
    np.testing.assert_allclose(
        np.stack([found.position_error, found.rotation_error], axis=-1),
        errors(arm, found.q, T),
        atol=1e-6,
    )


def test_tolerances_far_below_single_precision_are_kept(
    arm: KinematicChain, arm_map: ReachMap, rng: np.random.Generator
) -> None:
    fine = IkConfig(position_tolerance=1e-9, rotation_tolerance=1e-9)
    for n in (3, 50):
        T = arm.fk(arm.sampled(n, rng=rng))
        found = solve(arm, T, reach_map=arm_map, rng=rng, config=fine)
        assert found.is_solved.all()
        assert errors(arm, found.q, T).max() < 2e-9


class TestFreedom:
    @pytest.mark.parametrize("axis", [(0, 0, 1), (1, 0, 0), (0.3, -2.0, 0.5)])
    def test_a_free_axis_is_aligned_and_the_turn_about_it_is_not(
        self, arm: KinematicChain, rng: np.random.Generator, axis: tuple[float, ...]
    ) -> None:
        T = arm.fk(arm.sampled(100, rng=rng))
        config = IkConfig(freedom=Freedom.spin(axis))
        found = solve(arm, T, rng=rng, config=config)
        assert found.is_solved.mean() >= 0.99
        T, reached = T[found.is_solved], arm.fk(found.q[found.is_solved])
        assert np.linalg.norm(reached.p - T.p, axis=-1).max() <= 1e-4
        unit = np.array(axis) / np.linalg.norm(axis)
        cosine = np.sum(reached.rotate(unit) * T.rotate(unit), axis=-1)
        assert np.arccos(cosine.clip(-1, 1)).max() <= 1.1e-3
        assert found.rotation_error[found.is_solved].max() <= 1e-3
        turn = np.linalg.norm(so3.log(reached.inverse().R @ T.R), axis=-1)
        assert np.median(turn) > 0.05

    def test_position_only_ignores_every_turn(
        self, arm: KinematicChain, arm_map: ReachMap, rng: np.random.Generator
    ) -> None:
        p = arm.fk(arm.sampled(100, rng=rng)).p
        T = SE3.from_parts(so3.exp(rng.normal(0, 2, (100, 3))), p)
        config = IkConfig(freedom=Freedom.position_only())
        found = solve(arm, T, reach_map=arm_map, rng=rng, config=config)
        assert found.is_solved.all()
        assert np.linalg.norm(arm.fk(found.q).p - T.p, axis=-1).max() <= 1e-4

    def test_freedom_reaches_what_a_whole_pose_does_not(
        self, arm: KinematicChain, arm_map: ReachMap, rng: np.random.Generator
    ) -> None:
        p = rng.uniform((0.7, -0.6, 0.2), (1.3, 0.2, 1.0), (200, 3))
        T = SE3.from_parts(so3.exp(rng.normal(0, 2, (200, 3))), p)
        shares = [
            solve(
                arm,
                T,
                reach_map=arm_map,
                rng=rng,
                config=IkConfig(attempts=8, freedom=freedom),
            ).is_solved.mean()
            for freedom in (Freedom(), Freedom.spin((1, 0, 0)), Freedom.position_only())
        ]
        assert shares[0] < shares[1] < shares[2]

    def test_points_beyond_the_arm_stay_unreachable(
        self, arm: KinematicChain, rng: np.random.Generator
    ) -> None:
        config = IkConfig(freedom=Freedom.position_only())
        T = SE3.from_parts(p=[9.0, 0, 0])
        assert solve(arm, T, rng=rng, config=config).status == IkStatus.UNREACHABLE

    @pytest.mark.parametrize(
        "make",
        [
            lambda: Freedom(2),
            lambda: Freedom.spin((0, 0, 0)),
            lambda: Freedom.spin((np.nan, 0, 1)),
            lambda: Freedom.spin((1, 0)),
        ],
    )
    def test_freedoms_that_are_none_are_refused(self, make: object) -> None:
        with pytest.raises(ConfigError, match="Freedom"):
            make()  # type: ignore[operator]  # a callable by construction


class TestNearest:
    @pytest.mark.parametrize("bound", [0.2, 0.8, 2.0])
    def test_a_posture_within_the_bound_is_found_where_there_is_one(
        self, arm: KinematicChain, rng: np.random.Generator, bound: float
    ) -> None:
        q = arm.sampled(150, rng=rng)
        q_near = (q + rng.uniform(-0.5 * bound, 0.5 * bound, q.shape)).clip(
            arm.lower, arm.upper
        )
        T = arm.fk(q)
        found = solve_nearest(arm, T, q_near, bound=bound, rng=rng)
        assert found.is_solved.mean() >= 0.98
        kept = found.is_solved
        assert np.abs(found.q - q_near)[kept].max() <= bound
        assert (errors(arm, found.q, T)[kept] <= (1e-4, 1e-3)).all()

    def test_what_needs_more_is_called_far_and_shown(
        self, arm: KinematicChain, arm_map: ReachMap, rng: np.random.Generator
    ) -> None:
        q, q_near = arm.sampled(40, rng=rng), arm.sampled(40, rng=rng)
        T = arm.fk(q)
        found = solve_nearest(arm, T, q_near, bound=0.05, reach_map=arm_map, rng=rng)
        assert (found.status == IkStatus.FAR).all()
        assert (errors(arm, found.q, T) <= (1e-4, 1e-3)).all()
        assert np.abs(found.q - q_near).max(axis=-1).min() > 0.05
        best = solve(arm, T, reach_map=arm_map, rng=rng).q
        assert np.mean(arm.travel(found.q, q_near)) < np.mean(arm.travel(best, q_near))

    def test_what_nothing_reaches_is_not_called_far(
        self, arm: KinematicChain, rng: np.random.Generator
    ) -> None:
        T = SE3.from_parts(p=[[9.0, 0, 0]])
        found = solve_nearest(arm, T, np.zeros(8), bound=1.0, rng=rng)
        assert found.status.tolist() == [IkStatus.UNREACHABLE]

    def test_fine_tolerances_and_leading_axes_are_kept(
        self, arm: KinematicChain, rng: np.random.Generator
    ) -> None:
        q = 0.9 * arm.sampled(6, rng=rng).reshape(2, 3, 8)
        fine = IkConfig(position_tolerance=1e-9, rotation_tolerance=1e-9)
        found = solve_nearest(arm, arm.fk(q), q, bound=0.1, rng=rng, config=fine)
        assert found.q.shape == (2, 3, 8)
        assert found.is_solved.all()

    def test_bad_bounds_and_postures_are_refused(
        self, arm: KinematicChain, rng: np.random.Generator
    ) -> None:
        T = arm.fk(np.zeros(8))
        for bound in (0.0, -1.0, np.nan):
            with pytest.raises(ConfigError, match="bound"):
                solve_nearest(arm, T, np.zeros(8), bound=bound, rng=rng)
        with pytest.raises(ShapeError, match="q_near"):
            solve_nearest(arm, T, np.zeros(7), bound=1.0, rng=rng)
        with pytest.raises(InputError, match="q_near"):
            solve_nearest(arm, T, np.full(8, np.nan), bound=1.0, rng=rng)


@pytest.fixture
def winding(tmp_path: Path) -> KinematicChain:
    """Six joints that may each make two whole turns, or any number."""
    axes = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    joints = [
        JointText(axis=axis, xyz=(0.05, 0.03, 0.2), lower=-6.28, upper=6.28)
        for axis in axes
    ]
    joints[5] = JointText("continuous", axis=(0, 0, 1), xyz=(0.05, 0.03, 0.2))
    path = written(tmp_path, joints)
    return KinematicChain.from_urdf(path, "link0", "link6")


@pytest.mark.parametrize("n", [3, 30])
def test_joints_that_turn_more_than_once_stay_on_their_turn(
    winding: KinematicChain, rng: np.random.Generator, n: int
) -> None:
    q = rng.uniform(3.5, 6.0, (n, 6)) * rng.choice([-1, 1], (n, 6))
    q[:, 5] += 20.0
    found = solve(winding, winding.fk(q), q_seed=q + 0.01, rng=rng)
    np.testing.assert_allclose(found.q, q, atol=0.05)


def test_chains_of_sliding_ends_are_solved_one_by_one_and_together(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    axes = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0)]
    joints = [
        JointText("prismatic", axis=(0, 0, 1), lower=0.0, upper=0.4),
        *(JointText(axis=axis, xyz=(0.05, 0.03, 0.2)) for axis in axes),
    ]
    chain = KinematicChain.from_urdf(written(tmp_path, joints), "link0", "link7")
    assert not chain.has_turning_ends
    T = chain.fk(chain.sampled(60, rng=rng))
    assert_solves(chain, solve(chain, T, rng=rng), T)
    assert_solves(chain, solve(chain, T[0], rng=rng), T[0])


def test_poses_behind_the_limits_of_the_first_joint_are_ruled_out(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    axes = [(0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0)]
    joints = [
        JointText(axis=(0, 0, 1), lower=-0.5, upper=0.5),
        *(
            JointText(axis=axis, xyz=(0.25, 0, 0.02), lower=-1, upper=1)
            for axis in axes
        ),
    ]
    chain = KinematicChain.from_urdf(written(tmp_path, joints), "link0", "link6")
    reach_map = ReachMap.build(chain)
    T = chain.fk(chain.sampled(5000, rng=rng))
    in_front = solve(chain, T, reach_map=reach_map, rng=rng)
    assert not (in_front.status == IkStatus.UNREACHABLE).any()
    about_first = chain.points[0]
    behind = SE3.from_parts(so3.exp(np.array([0, 0, np.pi]))) @ SE3.from_parts(
        p=-about_first
    )
    turned = SE3.from_parts(p=about_first) @ behind @ T
    status = solve(chain, turned[:2000], reach_map=reach_map, rng=rng).status
    assert np.mean(status == IkStatus.UNREACHABLE) > 0.9
    assert solve(chain, turned[0], reach_map=reach_map, rng=rng).status == status[0]


def test_a_pose_with_a_wrong_last_row_is_refused(
    arm: KinematicChain, rng: np.random.Generator
) -> None:
    for n in (1, 50):
        T = np.tile(np.eye(4), (n, 1, 1))
        T[-1, 3, :3] = 0.1
        for call in (solve, lambda *a, **k: solve_distinct(*a, 2, **k)):
            with pytest.raises(InputError, match="last row"):
                call(arm, SE3(T), rng=rng)
