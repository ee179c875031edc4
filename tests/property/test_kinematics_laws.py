"""Laws of the kinematics, on arms drawn at random."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from debrisgrasp.geometry import SE3, random_rotations
from debrisgrasp.kinematics import IkConfig, KinematicChain, solve
from tests.unit.kinematics.robots import JointText, PinocchioOracle, written

FOLDER = tempfile.TemporaryDirectory()  # removed when the tests end
SIDES = st.sampled_from([(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, -1, 0), (1, 2, -1)])
LENGTHS = st.floats(0.05, 0.4)
ANGLES = st.sampled_from([0.0, 0.5 * np.pi, -0.5 * np.pi, 1e-5, 0.4])
SEEDS = st.integers(0, 2**32 - 1)


@st.composite
def joints(draw: st.DrawFn) -> JointText:
    kind = draw(st.sampled_from(["revolute"] * 4 + ["continuous", "prismatic"]))
    return JointText(
        kind=kind,
        xyz=(draw(LENGTHS), draw(st.sampled_from([0.0, 0.1])), draw(LENGTHS)),
        rpy=(draw(ANGLES), draw(ANGLES), draw(ANGLES)),
        axis=draw(SIDES),
        lower=-0.2 if kind == "prismatic" else -draw(st.floats(1.0, 3.1)),
        upper=0.3 if kind == "prismatic" else draw(st.floats(1.0, 3.1)),
    )


def _arm(parts: list[JointText]) -> tuple[KinematicChain, Path]:
    path = written(Path(FOLDER.name), parts)
    return KinematicChain.from_urdf(path, "link0", f"link{len(parts)}"), path


ARMS = st.lists(joints(), min_size=5, max_size=8)


@given(ARMS, SEEDS)
@settings(max_examples=25)
def test_kinematics_equal_pinocchio(parts: list[JointText], seed: int) -> None:
    chain, path = _arm(parts)
    oracle = PinocchioOracle(path, chain)
    for q in chain.sampled(3, rng=np.random.default_rng(seed)):
        T, J = oracle(q)
        np.testing.assert_allclose(chain.fk(q).matrix, T, atol=1e-9)
        np.testing.assert_allclose(chain.jacobian(q), J, atol=1e-9)


@given(ARMS, SEEDS)
@settings(max_examples=25)
def test_jacobian_is_the_derivative_of_the_pose(
    parts: list[JointText], seed: int
) -> None:
    chain, _ = _arm(parts)
    q, h = chain.sampled(1, rng=np.random.default_rng(seed))[0], 1e-6
    steps = h * np.eye(chain.n_joints)
    forth, back = chain.fk(q + steps), chain.fk(q - steps)
    derivative = (back.inverse() @ forth).log() / (2 * h)
    np.testing.assert_allclose(chain.jacobian(q).T, derivative, atol=1e-7)


@given(ARMS, SEEDS)
@settings(max_examples=25)
def test_what_ik_calls_solved_is_reached_within_limits(
    parts: list[JointText], seed: int
) -> None:
    chain, _ = _arm(parts)
    rng = np.random.default_rng(seed)
    T = chain.fk(chain.sampled(20, rng=rng))
    found = solve(chain, T, rng=rng)
    assert ((found.q >= chain.lower) & (found.q <= chain.upper)).all()
    q, T = found.q[found.is_solved], T[found.is_solved]
    gap = chain.fk(q).inverse() @ T
    assert np.linalg.norm(gap.p, axis=-1).max(initial=0) <= 1e-4
    turn = np.linalg.norm(gap.log()[..., 3:], axis=-1)
    assert turn.max(initial=0) <= 1e-3
    assert found.is_solved.mean() >= 0.8


@given(ARMS, SEEDS)
@settings(max_examples=25)
def test_residuals_are_those_of_the_postures_returned(
    parts: list[JointText], seed: int
) -> None:
    chain, _ = _arm(parts)
    rng = np.random.default_rng(seed)
    T = SE3.from_parts(random_rotations(5, rng=rng), rng.normal(0, 0.5, (5, 3)))
    few = IkConfig(attempts=2, max_iterations=10)
    found = solve(chain, T, rng=rng, config=few)
    reached = chain.fk(found.q)
    np.testing.assert_allclose(
        np.linalg.norm(reached.p - T.p, axis=-1), found.position_error, atol=1e-9
    )
    turn = np.linalg.norm((reached.inverse() @ T).log()[..., 3:], axis=-1)
    np.testing.assert_allclose(turn, found.rotation_error, atol=1e-6)


@given(ARMS, SEEDS)
@settings(max_examples=20)
def test_one_pose_is_treated_like_one_of_a_batch(
    parts: list[JointText], seed: int
) -> None:
    chain, _ = _arm(parts)
    rng = np.random.default_rng(seed)
    q_seed = 0.8 * chain.sampled(6, rng=rng)
    near = q_seed + rng.uniform(-0.02, 0.02, q_seed.shape)
    T = chain.fk(chain.clipped(near))
    batch = solve(chain, T, q_seed=q_seed, rng=np.random.default_rng(0))
    for i in range(6):
        alone = solve(chain, T[i], q_seed=q_seed[i], rng=np.random.default_rng(0))
        assert alone.status == batch.status[i]
        np.testing.assert_allclose(alone.q, batch.q[i], atol=1e-3)


@given(ARMS, SEEDS)
@settings(max_examples=20)
def test_moving_base_and_target_together_changes_nothing(
    parts: list[JointText], seed: int
) -> None:
    chain, _ = _arm(parts)
    fixed = JointText("fixed", xyz=(0.3, -0.2, 0.5), rpy=(0.4, -0.8, 1.9))
    moved = KinematicChain.from_urdf(
        written(Path(FOLDER.name), [fixed, *parts]), "link0", f"link{len(parts) + 1}"
    )
    rng = np.random.default_rng(seed)
    q = chain.sampled(5, rng=rng)
    T_new_old = moved.fk(q[0]) @ chain.fk(q[0]).inverse()
    np.testing.assert_allclose(
        moved.fk(q).matrix, (T_new_old @ chain.fk(q)).matrix, atol=1e-9
    )
    seeds = 0.9 * q
    here = solve(chain, chain.fk(q), q_seed=seeds, rng=np.random.default_rng(0))
    there = solve(moved, moved.fk(q), q_seed=seeds, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(here.is_solved, there.is_solved)
