from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, DebrisGraspError, InputError, ShapeError
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import (
    IkConfig,
    IkStatus,
    KinematicChain,
    ReachMap,
    ReachMapConfig,
    follow,
    solve,
    solve_distinct,
    solve_nearest,
)

from .robots import JointText, written


def _assert_reaches(chain: KinematicChain, q: np.ndarray, T: SE3) -> None:
    """By the chain's own kinematics, within default tolerances and the limits."""
    error = (chain.fk(q).inverse() @ T).log()
    assert np.linalg.norm(chain.fk(q).p - T.p, axis=-1).max(initial=0) <= 1e-4
    assert np.linalg.norm(error[..., 3:], axis=-1).max(initial=0) <= 1e-3
    assert (q >= chain.lower).all()
    assert (q <= chain.upper).all()


@pytest.mark.parametrize("seeds", ["of the map", "at random"])
def test_every_reachable_pose_is_solved(
    arm: KinematicChain, arm_map: ReachMap, rng: np.random.Generator, seeds: str
) -> None:
    T = arm.fk(arm.sampled(2000, rng=rng))
    reach_map = arm_map if seeds == "of the map" else None
    found = solve(arm, T, reach_map=reach_map, rng=rng)
    assert np.mean(found.is_solved) >= 0.999
    _assert_reaches(arm, found.q[found.is_solved], T[found.is_solved])
    assert found.position_error[found.is_solved].max() <= 1e-4
    assert found.rotation_error[found.is_solved].max() <= 1e-3


def test_a_result_tells_what_became_of_its_poses(
    arm: KinematicChain, rng: np.random.Generator
) -> None:
    far = SE3.from_parts(p=[0.0, 0.0, 9.0])
    T = SE3(np.stack([far.matrix, *arm.fk(arm.sampled(2, rng=rng)).matrix]))
    told = "<IkResult of 3 poses: 2 SOLVED, 1 UNREACHABLE>"
    assert repr(solve(arm, T, rng=rng)) == told
    assert repr(solve(arm, far, rng=rng)) == "<IkResult of 1 pose: 1 UNREACHABLE>"
    assert repr(solve(arm, T[:0], rng=rng)) == "<IkResult of 0 poses: none>"


@pytest.mark.parametrize("seed", [0, np.random])
def test_a_seed_is_no_generator(arm: KinematicChain, seed: object) -> None:
    T = arm.fk(np.zeros(arm.n_joints))
    for call in (
        lambda: arm.sampled(3, rng=seed),
        lambda: solve(arm, T, rng=seed),
        lambda: solve_distinct(arm, T, 2, rng=seed),
        lambda: solve_nearest(arm, T, np.zeros(arm.n_joints), bound=1.0, rng=seed),
        lambda: follow(arm, T[None], np.zeros((1, arm.n_joints)), rng=seed),
    ):
        with pytest.raises(InputError, match=r"rng: got .*default_rng\(seed\)"):
            call()


@pytest.mark.parametrize("n_joints", [5, 6])
def test_chains_of_five_and_six_joints_are_solved(
    tmp_path: Path, rng: np.random.Generator, n_joints: int
) -> None:
    axes = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    joints = [JointText(axis=axis, xyz=(0.05, 0.03, 0.2)) for axis in axes]
    path = written(tmp_path, joints[:n_joints])
    chain = KinematicChain.from_urdf(path, "link0", f"link{n_joints}")
    T = chain.fk(chain.sampled(200, rng=rng))
    found = solve(chain, T, rng=rng)
    assert np.mean(found.is_solved) >= 0.99
    _assert_reaches(chain, found.q[found.is_solved], T[found.is_solved])


def test_prismatic_and_continuous_joints_are_solved(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    joints = [
        JointText("prismatic", axis=(0, 1, 0), lower=-0.5, upper=0.5),
        JointText("continuous", axis=(0, 0, 1)),
        JointText(axis=(0, 1, 0)),
        JointText(axis=(0, 1, 0), xyz=(0, 0, 0.4)),
        JointText("continuous", axis=(0, 0, 1)),
        JointText(axis=(0, 1, 0)),
        JointText("continuous", axis=(0, 0, 1)),
    ]
    chain = KinematicChain.from_urdf(written(tmp_path, joints), "link0", "link7")
    T = chain.fk(chain.sampled(200, rng=rng))
    found = solve(chain, T, rng=rng)
    assert np.mean(found.is_solved) >= 0.99
    _assert_reaches(chain, found.q[found.is_solved], T[found.is_solved])


def test_the_posture_itself_is_found_from_a_seed_at_it(
    arm: KinematicChain, rng: np.random.Generator
) -> None:
    q = 0.9 * arm.sampled(20, rng=rng)
    found = solve(arm, arm.fk(q), q_seed=q, rng=rng)
    np.testing.assert_allclose(found.q, q, atol=1e-3)


def test_a_seed_outside_the_limits_still_gives_postures_within(
    arm: KinematicChain, rng: np.random.Generator
) -> None:
    T = arm.fk(arm.sampled(50, rng=rng))
    found = solve(arm, T, q_seed=np.full(8, 40.0), rng=rng)
    assert found.is_solved.all()
    _assert_reaches(arm, found.q, T)


def test_a_pose_beyond_the_arm_is_unreachable(
    arm: KinematicChain, rng: np.random.Generator
) -> None:
    T = SE3.from_parts(p=[[5.0, 0.0, 0.0], [0.9, -0.3, 0.5]])
    found = solve(arm, T, rng=rng)
    assert found.status[0] == IkStatus.UNREACHABLE
    assert found.position_error[0] > 3.0
    assert (found.q >= arm.lower).all()


def test_a_pose_that_needs_more_than_a_limit_allows_says_limit(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    axes = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0)]
    wide = [JointText(axis=axis, lower=-3, upper=3) for axis in axes]
    chain = KinematicChain.from_urdf(written(tmp_path, wide), "link0", "link6")
    T = chain.fk([2.5, 0.5, 0.4, 0.3, 0.6, 0.2])
    narrow = [JointText(axis=axis, lower=-0.7, upper=0.7) for axis in axes]
    chain = KinematicChain.from_urdf(written(tmp_path, narrow), "link0", "link6")
    found = solve(chain, T, rng=rng)
    assert found.status == IkStatus.LIMIT
    assert (np.abs(found.q) <= 0.7).all()
    assert np.isfinite(found.position_error)


def test_equal_generators_give_equal_results(
    arm: KinematicChain, rng: np.random.Generator
) -> None:
    T = arm.fk(arm.sampled(100, rng=rng))
    once = solve(arm, T, rng=np.random.default_rng(3))
    again = solve(arm, T, rng=np.random.default_rng(3))
    np.testing.assert_array_equal(once.q, again.q)


def test_leading_axes_are_kept_and_may_be_empty(
    arm: KinematicChain, rng: np.random.Generator
) -> None:
    T = arm.fk(arm.sampled(6, rng=rng).reshape(2, 3, 8))
    found = solve(arm, T, rng=rng)
    assert found.q.shape == (2, 3, 8)
    assert found.status.shape == found.position_error.shape == (2, 3)
    single = solve(arm, T[0, 0], rng=rng)
    assert single.q.shape == (8,)
    assert single.is_solved.shape == ()
    none = solve(arm, T[:, :0], rng=rng)
    assert none.q.shape == (2, 0, 8)


def test_a_narrow_engine_solves_what_a_wide_one_does(
    arm: KinematicChain, arm_map: ReachMap, rng: np.random.Generator
) -> None:
    T = arm.fk(arm.sampled(300, rng=rng))
    for width in (1, 7, 64):
        config = IkConfig(width=width)
        found = solve(arm, T[: 10 * width], reach_map=arm_map, rng=rng, config=config)
        assert found.is_solved.all()


def test_distinct_solutions_differ_and_come_first(
    arm: KinematicChain, arm_map: ReachMap, rng: np.random.Generator
) -> None:
    T = arm.fk(arm.sampled(20, rng=rng))
    found = solve_distinct(arm, T, 5, reach_map=arm_map, rng=rng)
    assert found.q.shape == (20, 5, 8)
    assert (np.diff(found.is_solved.astype(int), axis=1) <= 0).all()
    assert found.is_solved.sum(axis=1).min() >= 2
    for q, is_solved, pose in zip(found.q, found.is_solved, T.matrix, strict=True):
        good = q[is_solved]
        _assert_reaches(arm, good, SE3(np.broadcast_to(pose, (len(good), 4, 4))))
        gap = np.abs(arm.difference(good[:, None], good[None])).max(axis=-1)
        assert gap[~np.eye(len(good), dtype=bool)].min() >= 0.3


def test_seeds_already_used_are_passed_over(
    arm: KinematicChain, arm_map: ReachMap
) -> None:
    T = arm.fk(arm.sampled(10, rng=np.random.default_rng(2)))
    first, later = (
        solve_distinct(
            arm,
            T,
            3,
            reach_map=arm_map,
            n_seeds_used=n,
            rng=np.random.default_rng(0),
        )
        for n in (0, 3)
    )
    gap = np.abs(arm.difference(first.q[:, :, None], later.q[:, None])).max(axis=-1)
    assert np.mean(gap > 0.3) > 0.7


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda T: T * np.nan, "NaN"),
        (lambda T: T * np.array([1, 1, -1, 1])[:, None], "mirrored"),
        (lambda T: T * 1.2, "orthonormal"),
    ],
)
def test_targets_that_are_no_poses_are_refused(
    arm: KinematicChain, rng: np.random.Generator, change: object, words: str
) -> None:
    matrix = change(np.eye(4))  # type: ignore[operator]  # a callable by construction
    with pytest.raises(InputError, match=words):
        solve(arm, SE3(matrix), rng=rng)


def test_bad_seeds_are_refused(arm: KinematicChain, rng: np.random.Generator) -> None:
    T = arm.fk(arm.sampled(3, rng=rng))
    for seed in (np.zeros(7), np.zeros((2, 8))):
        with pytest.raises(ShapeError):
            solve(arm, T, q_seed=seed, rng=rng)
    with pytest.raises(InputError, match="q_seed"):
        solve(arm, T, q_seed=np.full(8, np.nan), rng=rng)


@pytest.mark.parametrize(
    "setting",
    [
        {"rotation_weight": 1e9},
        {"rotation_weight": 1e-9},
        {"rotation_weight": np.inf},
        {"damping": 1e9},
        {"damping": np.inf},
    ],
)
def test_weights_by_which_nothing_is_solved_are_refused(
    setting: dict[str, float],
) -> None:
    with pytest.raises(ConfigError, match=f"IkConfig.{next(iter(setting))}"):
        IkConfig(**setting)


def test_settings_out_of_range_are_refused() -> None:
    with pytest.raises(DebrisGraspError, match=r"IkConfig\.attempts"):
        IkConfig(attempts=0)


@pytest.mark.parametrize(
    ("n_solutions", "n_seeds_used", "words"),
    [
        (0, 0, "n_solutions: got 0, expected an integer, 1 or more"),
        (2.5, 0, "n_solutions: got 2.5"),
        (2, -1, "n_seeds_used: got -1, expected an integer, 0 or more"),
    ],
)
def test_counts_that_are_none_are_refused(
    arm: KinematicChain, rng: np.random.Generator, n_solutions, n_seeds_used, words
) -> None:
    with pytest.raises(InputError, match=words):
        solve_distinct(
            arm,
            SE3.identity(),
            n_solutions,
            n_seeds_used=n_seeds_used,
            rng=rng,
        )
    with pytest.raises(InputError, match=r"number of postures: got -1"):
        arm.sampled(-1, rng=rng)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"chain": "right"}, r"chain: got str, expected KinematicChain.*\.chain\("),
        ({"chain": None}, "chain: got NoneType"),
        ({"reach_map": ReachMapConfig()}, r"reach_map: got ReachMapConfig.*build"),
        ({"config": {"attempts": 3}}, "config: got dict, expected IkConfig"),
        ({"config": {}}, "config: got dict"),
    ],
    ids=str,
)
@pytest.mark.parametrize("function", [solve, solve_distinct, solve_nearest, follow])
def test_what_is_no_chain_no_map_and_no_settings_is_refused(
    arm: KinematicChain, rng: np.random.Generator, wrong, words: str, function
) -> None:
    others = {
        solve: {},
        solve_distinct: {"n_solutions": 2},
        solve_nearest: {"q_near": np.zeros(8), "bound": 1.0},
        follow: {"q_before": np.zeros((1, 8))},
    }[function]
    right = {"chain": arm, "T_base_tip": arm.fk(np.zeros(8)), "rng": rng, **others}
    with pytest.raises(InputError, match=words):
        function(**{**right, **wrong})
