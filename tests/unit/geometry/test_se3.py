"""A worked example by hand, and what counts as a rigid transform."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from debrisgrasp.errors import InputError, ShapeError
from debrisgrasp.geometry import SE3, so3


def test_worked_example_of_twist_wrench_and_power():
    T_a_b = SE3.from_parts(so3.from_rpy(np.array([0.3, -0.2, 0.9])), [0.4, -0.1, 0.25])
    twist_b = np.array([0.1, -0.2, 0.05, 0.3, 0.4, -0.5])
    wrench_a = np.array([10.0, -4.0, 25.0, 1.5, -0.7, 0.2])
    twist_a = T_a_b.map_twist(twist_b)
    wrench_b = T_a_b.inverse().map_wrench(wrench_a)
    expected_twist_a = [0.0989235485946, 0.0206780795926, 0.236220095946]
    expected_twist_a += [-0.187923556784, 0.615641864727, -0.292694091503]
    expected_wrench_b = [7.98807471883, -2.79905078732, 25.8719148301]
    expected_wrench_b += [7.20703808852, 1.60262273444, -1.17055643252]
    assert_allclose(twist_a, expected_twist_a, atol=1e-9)
    assert_allclose(wrench_b, expected_wrench_b, atol=1e-9)
    assert_allclose(wrench_a @ twist_a, 6.04065210744, atol=1e-9)
    assert_allclose(wrench_b @ twist_b, 6.04065210744, atol=1e-9)


def test_roll_pitch_yaw_are_applied_about_fixed_axes_in_that_order():
    quarter = np.pi / 2
    R = so3.from_rpy(np.array([quarter, 0.0, quarter]))
    assert_allclose(R @ [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], atol=1e-15)
    assert_allclose(R @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)


@pytest.mark.parametrize("axis", np.eye(3))
def test_half_turns_have_logarithms_of_length_pi(axis):
    rotvec = so3.log(so3.exp(np.pi * axis))
    assert_allclose(np.abs(rotvec), np.pi * axis, atol=1e-12)


def test_rounded_matrices_are_projected_onto_rotations(rng):
    exact = SE3.from_parts(so3.exp(rng.normal(size=3)), rng.normal(size=3))
    taken = SE3.from_matrix(exact.matrix.astype(np.float32))
    assert_allclose(taken.R @ taken.R.T, np.eye(3), atol=1e-14)
    assert_allclose(taken.matrix, exact.matrix, atol=1e-6)


def matrix_with(**changes: object) -> np.ndarray:
    matrix = np.eye(4)
    for place, value in changes.items():
        matrix[int(place[1]), int(place[2])] = value
    return matrix


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (matrix_with(_00=1.1), "orthonormality"),
        (matrix_with(_00=-1.0), "left-handed"),
        (matrix_with(_30=0.5), "last row"),
        (matrix_with(_03=np.nan), "NaN"),
        (matrix_with(_03=np.inf), "infinite"),
        (np.zeros((4, 4)), "last row"),
    ],
)
def test_matrices_that_are_not_rigid_are_refused(matrix, message):
    with pytest.raises(InputError, match=message):
        SE3.from_matrix(matrix, "T_base_camera")


@pytest.mark.parametrize("shape", [(3, 3), (3, 4), (16,), (4, 5)])
def test_matrices_of_another_shape_are_refused(shape):
    with pytest.raises(ShapeError, match="T_base_camera"):
        SE3.from_matrix(np.zeros(shape), "T_base_camera")


@pytest.mark.parametrize("method", ["apply", "rotate", "map_twist", "map_wrench"])
def test_arrays_with_a_wrong_last_axis_are_refused(method):
    with pytest.raises(ShapeError):
        getattr(SE3.identity(), method)(np.zeros(4))


def test_a_whole_cloud_is_mapped_like_its_parts(rng):
    T = SE3.exp(rng.normal(size=6))
    points = rng.normal(size=(40_001, 3))
    parts = np.concatenate([T.apply(part) for part in np.array_split(points, 7)])
    assert_allclose(T.apply(points), parts, rtol=0, atol=1e-12)
    assert T.apply(points[:0]).shape == (0, 3)


def test_what_is_a_rigid_transform_is_taken_as_it_is(rng):
    R = so3.exp(rng.normal(size=(50, 3)))
    T = SE3.from_parts(R, rng.normal(size=(50, 3))).matrix
    assert_array_equal(SE3.from_matrix(T).matrix, T)


@pytest.mark.parametrize("make", [so3.exp, so3.from_rpy])
@pytest.mark.parametrize("values", [0.3, [0.1, 0.2], np.zeros((2, 4))])
def test_turns_have_three_numbers(make, values):
    with pytest.raises(ShapeError, match=r"trailing axes \(3\)"):
        make(values)


@pytest.mark.parametrize("quaternion", [[0, 0, 0, 0], [np.nan, 0, 0, 1]])
def test_a_quaternion_that_is_none_makes_no_rotation(quaternion):
    with pytest.raises(InputError, match="all zero, NaN"):
        so3.from_quat_wxyz([[1, 0, 0, 0], quaternion])


def test_matrices_and_quaternions_of_other_shapes_are_refused():
    with pytest.raises(ShapeError, match="rotation matrix"):
        so3.log(np.eye(4))
    with pytest.raises(ShapeError, match="quaternion"):
        so3.from_quat_wxyz([0, 0, 1])


def test_what_becomes_of_the_matrix_given_does_not_move_the_pose():
    matrix = np.eye(4)
    pose = SE3(matrix)
    matrix[0, 3] = 5.0
    assert_array_equal(pose.p, [0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="read-only"):
        pose.matrix[0, 3] = 5.0


@pytest.mark.parametrize("other", [np.zeros(3), np.eye(4), [0.0, 0.0, 1.0]])
def test_a_product_with_an_array_names_the_two_ways_to_write_it(other):
    with pytest.raises(InputError, match=r"T\.apply\(points\).*SE3\.from_matrix"):
        SE3.identity() @ other


@pytest.mark.parametrize("index", [0, (0, 3), slice(0, 3)])
def test_an_index_into_one_transform_is_refused_in_words(index):
    with pytest.raises(InputError, match=r"0 leading axes.*T\.R and T\.p"):
        SE3.identity()[index]
    assert SE3.identity()[None].batch == (1,)
    three = SE3.from_parts(p=np.eye(3))
    assert [T.p.tolist() for T in three] == np.eye(3).tolist()


@pytest.mark.parametrize(
    "meet",
    [
        lambda T: T.apply(np.zeros((7, 3))),
        lambda T: T.rotate(np.zeros((7, 3))),
        lambda T: T.map_twist(np.zeros((7, 6))),
        lambda T: T.map_wrench(np.zeros((7, 6))),
        lambda T: T @ SE3(np.tile(np.eye(4), (7, 1, 1))),
        lambda T: SE3.from_parts(T.R, np.zeros((7, 3))),
    ],
)
def test_batches_that_do_not_fit_together_are_refused_with_the_way_out(meet):
    T = SE3(np.tile(np.eye(4), (5, 1, 1)))
    words = r"\(7,\), expected some that broadcast with \(5,\)\. T\[:, None\]"
    with pytest.raises(ShapeError, match=words):
        meet(T)
    with pytest.raises(ShapeError, match=r"\(6, 7\).*\(5, 1\)"):
        T[:, None].apply(np.zeros((6, 7, 3)))
    assert T[:, None].apply(np.zeros((7, 3))).shape == (5, 7, 3)
