"""Laws of rotations, rigid transforms and their action on points, twists, wrenches."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from debrisgrasp.geometry import SE3, perturbed, random_rotations, so3
from tests.strategies import batches, points, poses, rotvecs, twists, vectors

seeds = st.integers(0, 2**32 - 1)


def batch_of_poses(shape: tuple[int, ...], seed: int) -> SE3:
    rng = np.random.default_rng(seed)
    n = int(np.prod(shape))
    Ts = SE3.from_parts(random_rotations(n, rng=rng), rng.normal(size=(n, 3)))
    return SE3(Ts.matrix.reshape(*shape, 4, 4))


@given(poses, poses, poses)
def test_composition_is_associative(a, b, c):
    assert_allclose(((a @ b) @ c).matrix, (a @ (b @ c)).matrix, atol=1e-12)


@given(poses)
def test_identity_and_inverse_are_neutral(T):
    assert_array_equal((T @ SE3.identity()).matrix, T.matrix)
    assert_allclose((T @ T.inverse()).matrix, np.eye(4), atol=1e-12)
    assert_allclose((T.inverse() @ T).matrix, np.eye(4), atol=1e-12)


@given(poses, poses, points)
def test_a_product_acts_as_one_transform_after_the_other(a, b, p):
    assert_allclose((a @ b).apply(p), a.apply(b.apply(p)), atol=1e-11)
    assert_allclose(a.inverse().apply(a.apply(p)), p, atol=1e-11)


@given(rotvecs)
def test_rotation_survives_log_and_exp(rotvec):
    R = so3.exp(rotvec)
    assert_allclose(R @ R.T, np.eye(3), atol=1e-13)
    assert_allclose(so3.exp(so3.log(R)), R, atol=1e-12)


@given(rotvecs.filter(lambda w: np.linalg.norm(w) < np.pi - 1e-7))
def test_rotation_vector_survives_exp_and_log(rotvec):
    assert_allclose(so3.log(so3.exp(rotvec)), rotvec, atol=1e-9)


@given(rotvecs)
def test_tiny_rotation_vectors_keep_their_digits(rotvec):
    tiny = rotvec * 1e-7
    assert_allclose(so3.log(so3.exp(tiny)), tiny, rtol=1e-9, atol=1e-22)


@given(rotvecs)
def test_quaternions_describe_the_same_rotation(rotvec):
    R = so3.exp(rotvec)
    assert_allclose(so3.from_quat_wxyz(so3.to_quat_wxyz(R)), R, atol=1e-13)


@given(twists.filter(lambda t: np.linalg.norm(t[3:]) < np.pi - 1e-7))
def test_twist_survives_exp_and_log(twist):
    assert_allclose(SE3.exp(twist).log(), twist, atol=1e-8)


@given(poses)
def test_pose_survives_log_and_exp(T):
    assert_allclose(SE3.exp(T.log()).matrix, T.matrix, atol=1e-11)


@given(twists, st.floats(-1, 1), st.floats(-1, 1))
def test_exponentials_of_one_twist_add_up(twist, s, t):
    product = SE3.exp(s * twist) @ SE3.exp(t * twist)
    assert_allclose(product.matrix, SE3.exp((s + t) * twist).matrix, atol=1e-12)


@given(poses, poses, vectors(6))
def test_adjoint_is_a_homomorphism(a, b, twist):
    assert_allclose((a @ b).adjoint(), a.adjoint() @ b.adjoint(), atol=1e-11)
    assert_allclose(a.inverse().map_twist(a.map_twist(twist)), twist, atol=1e-10)


@given(poses, twists)
def test_adjoint_conjugates_the_exponential(T, twist):
    conjugated = T @ SE3.exp(twist) @ T.inverse()
    assert_allclose(SE3.exp(T.map_twist(twist)).matrix, conjugated.matrix, atol=1e-10)


@given(poses, vectors(6), vectors(6))
def test_power_is_the_same_in_every_frame(T, twist, wrench):
    power = T.map_wrench(wrench) @ T.map_twist(twist)
    assert_allclose(power, wrench @ twist, atol=1e-9)


@given(batches, seeds)
def test_a_batch_equals_its_members_stacked(shape, seed):
    rng = np.random.default_rng(seed)
    Ts = batch_of_poses(shape, seed)
    p, twist = rng.normal(size=(*shape, 3)), rng.normal(size=(*shape, 6))
    whole = {
        "inverse": Ts.inverse().matrix,
        "log": Ts.log(),
        "adjoint": Ts.adjoint(),
        "apply": Ts.apply(p),
        "rotate": Ts.rotate(p),
        "twist": Ts.map_twist(twist),
        "wrench": Ts.map_wrench(twist),
        "exp": SE3.exp(twist).matrix,
        "product": (Ts @ Ts.inverse()).matrix,
    }
    for index in np.ndindex(shape):
        T = Ts[index]
        single = {
            "inverse": T.inverse().matrix,
            "log": T.log(),
            "adjoint": T.adjoint(),
            "apply": T.apply(p[index]),
            "rotate": T.rotate(p[index]),
            "twist": T.map_twist(twist[index]),
            "wrench": T.map_wrench(twist[index]),
            "exp": SE3.exp(twist[index]).matrix,
            "product": (T @ T.inverse()).matrix,
        }
        for name, value in single.items():
            assert_allclose(whole[name][index], value, atol=1e-12, err_msg=name)
    cloud = rng.normal(size=(5, 3))
    every = batch_of_poses((*shape, 1), seed).apply(cloud)
    assert every.shape == (*shape, 5, 3)
    assert_allclose(every[..., 2, :], Ts.apply(cloud[2]), atol=1e-12)


@given(poses, twists, points)
def test_inputs_stay_untouched(T, twist, p):
    copies = T.matrix.copy(), twist.copy(), p.copy()
    T.apply(p), T.rotate(p), T.map_twist(twist), T.map_wrench(twist), T.log()
    SE3.exp(twist), T.inverse(), T.adjoint(), SE3.from_matrix(T.matrix)
    for now, before in zip((T.matrix, twist, p), copies, strict=True):
        assert_array_equal(now, before)
    with pytest.raises(ValueError, match="read-only"):
        T.matrix[0, 0] = 2.0


@given(poses, twists)
def test_pinocchio_agrees(T, twist):
    pin = pytest.importorskip("pinocchio")
    assert_allclose(SE3.exp(twist).matrix, pin.exp6(twist).homogeneous, atol=1e-9)
    theirs = pin.SE3(T.matrix.copy())
    assert_allclose(T.adjoint(), theirs.action, atol=1e-12)
    assert_allclose(T.inverse().adjoint().T, theirs.dualAction, atol=1e-12)
    angle = np.linalg.norm(so3.log(T.R))
    if angle < np.pi - 1e-3:  # nearer to pi pinocchio loses digits
        assert_allclose(T.log(), pin.log6(theirs).vector, atol=1e-8)


@given(seeds)
def test_zero_spread_perturbs_nothing(seed):
    Ts = batch_of_poses((5,), seed)
    same = perturbed(Ts, 0.0, 0.0, rng=np.random.default_rng(seed))
    assert_allclose(same.matrix, Ts.matrix, atol=1e-15)
