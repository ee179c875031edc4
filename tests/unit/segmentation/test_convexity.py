import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from debrisgrasp.segmentation.convexity import (
    extended_convexity,
    is_convex,
    is_singular,
    is_step,
    normal_angle,
)

UP, FRONT = np.array([0.0, 0.0, 1.0]), np.array([-1.0, 0.0, 0.0])
TEN_DEGREES = np.deg2rad(10)


def test_top_and_front_of_a_box_are_convex():
    top, front = np.array([0.05, 0.0, 0.1]), np.array([0.0, 0.0, 0.05])
    assert is_convex(top, front, UP, FRONT, TEN_DEGREES)


def test_floor_and_front_of_a_box_are_concave():
    floor, front = np.array([-0.05, 0.0, 0.0]), np.array([0.0, 0.0, 0.05])
    assert not is_convex(floor, front, UP, FRONT, TEN_DEGREES)


@pytest.mark.parametrize(("angle", "joins"), [(8, True), (12, False)])
def test_concave_borders_pass_below_the_tolerance(angle, joins):
    bent = np.array([-np.sin(np.deg2rad(angle)), 0.0, np.cos(np.deg2rad(angle))])
    assert is_convex(np.zeros(3), np.array([0.1, 0, 0]), UP, bent, TEN_DEGREES) == joins


def test_criterion_is_symmetric_and_batched(rng):
    x_1, x_2 = rng.normal(size=(2, 50, 3))
    n_1, n_2 = (
        v / np.linalg.norm(v, axis=1)[:, None] for v in rng.normal(size=(2, 50, 3))
    )
    there = is_convex(x_1, x_2, n_1, n_2, 0.2)
    np.testing.assert_array_equal(there, is_convex(x_2, x_1, n_2, n_1, 0.2))
    one = is_convex(x_1[7], x_2[7], n_1[7], n_2[7], 0.2)
    assert there[7] == one


def test_unknown_normals_are_never_convex():
    with np.errstate(invalid="ignore"):
        assert not is_convex(np.zeros(3), np.ones(3), UP, np.full(3, np.nan), 0.2)


def test_normal_angle_is_exact_near_zero_and_pi():
    tiny = np.array([np.sin(1e-9), 0.0, np.cos(1e-9)])
    assert normal_angle(UP, tiny) == pytest.approx(1e-9, rel=1e-6)
    assert normal_angle(UP, -UP) == pytest.approx(np.pi)


@pytest.mark.parametrize(
    ("theta", "limit"), [(15, 4.6), (25, 30.0), (35, 55.4), (80, 60.0)]
)
def test_singular_below_the_limit_that_grows_with_the_angle(theta, limit):
    turned = np.array([0.0, -np.sin(np.deg2rad(theta)), np.cos(np.deg2rad(theta))])
    crease = np.array([1.0, 0.0, 0.0])
    across = np.array([0.0, 1.0, 0.0])
    for phi, expected in ((limit - 0.5, True), (limit + 0.5, False)):
        phi = np.deg2rad(phi)
        d = crease * np.cos(phi) + across * np.sin(phi)
        assert is_singular(d, np.zeros(3), UP, turned) == expected


@pytest.mark.parametrize("d", [(0.02, 0, 0), (0, 0, 0.02), (0.01, -0.01, 0.01)])
def test_patches_with_equal_normals_meet_along_no_crease(d):
    assert not is_singular(np.array(d), np.zeros(3), UP, UP)


def test_parallel_patches_step_beyond_the_allowance():
    for height, expected in ((0.004, False), (0.006, True)):
        step = is_step(
            np.zeros(3),
            np.array([0.02, 0.0, height]),
            UP,
            UP,
            seed_resolution=0.03,
            allowance=0.005,
        )
        assert step == expected


def test_extended_convexity_cuts_a_bridge_between_two_cliques():
    clique = [(0, 1), (0, 2), (1, 2)]
    edges = np.array([*clique, *[(a + 3, b + 3) for a, b in clique], (2, 3)])
    valid = extended_convexity(edges, np.ones(len(edges), bool), 6, 1)
    np.testing.assert_array_equal(valid, [True] * 6 + [False])


def flags_by_angles(x_1, x_2, n_1, n_2, tolerance, step, seed_resolution):
    """Convex, smooth and sane as the point cloud library states them, in degrees."""

    def degrees(a, b):
        cosine = a @ b / (np.linalg.norm(a) * np.linalg.norm(b))
        return np.degrees(np.arccos(np.clip(cosine, -1, 1)))

    d, s = x_1 - x_2, np.cross(n_1, n_2)
    theta = degrees(n_1, n_2)
    convex = degrees(d, n_1) - degrees(d, n_2) <= 0 or theta < np.degrees(tolerance)
    smooth = min(abs(d @ n_1), abs(d @ n_2)) <= (
        seed_resolution * np.linalg.norm(s) + step
    )
    phi = min(degrees(s, d), degrees(s, -d))
    sane = phi >= 60 / (1 + np.exp(-0.25 * (theta - 25)))
    return convex, smooth, sane


@given(seed=st.integers(0, 10**6), bend=st.floats(0.02, 2.0))
@settings(max_examples=40)
def test_flags_are_those_of_the_angle_formulas(seed, bend):
    rng = np.random.default_rng(seed)
    x = rng.normal(0, 0.03, (2, 30, 3))
    base = rng.normal(size=(30, 3))
    n_1 = base / np.linalg.norm(base, axis=1)[:, None]
    turned = n_1 + bend * rng.normal(size=(30, 3))
    n_2 = turned / np.linalg.norm(turned, axis=1)[:, None]
    expected = np.array(
        [
            flags_by_angles(*ends, TEN_DEGREES, 0.002, 0.03)
            for ends in zip(*x, n_1, n_2, strict=True)
        ]
    )
    np.testing.assert_array_equal(is_convex(*x, n_1, n_2, TEN_DEGREES), expected[:, 0])
    step = is_step(*x, n_1, n_2, seed_resolution=0.03, allowance=0.002)
    np.testing.assert_array_equal(~step, expected[:, 1])
    np.testing.assert_array_equal(~is_singular(*x, n_1, n_2), expected[:, 2])


def test_extended_convexity_equals_a_count_of_triangles(rng):
    edges = np.array([(a, b) for a in range(12) for b in range(a + 1, 12)])
    edges = edges[rng.random(len(edges)) < 0.4]
    convex = rng.random(len(edges)) < 0.7
    joined = {frozenset(edge) for edge in edges[convex].tolist()}
    for k in (1, 2):
        expected = [
            is_joined
            and sum({a, c} in joined and {b, c} in joined for c in range(12)) >= k
            for (a, b), is_joined in zip(edges.tolist(), convex, strict=True)
        ]
        np.testing.assert_array_equal(
            extended_convexity(edges, convex, 12, k), expected
        )
