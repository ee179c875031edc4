from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, ShapeError
from debrisgrasp.geometry import SE3, Box, Intrinsics
from debrisgrasp.worlds import Body, StereoNoise, World, look_at, render

CAMERA = Intrinsics(fx=615.0, fy=615.0, cx=320.0, cy=240.0, width=640, height=480)
WALL = np.full((480, 640), 1.6)
SCALE = 615.0 * 0.05
QUIET = StereoNoise(
    sigma=0.0,
    disparity_step=0.0,
    depth_step=0.0,
    growth_share=0.0,
    flying_share=0.0,
    edge_loss=0.0,
    grazing=90.0,
    specks=0.0,
)


def step_image():
    """A near square before a far wall."""
    depth = WALL.copy()
    depth[140:340, 250:400] = 1.0
    return depth


def test_the_spread_grows_with_depth_squared(rng):
    for distance in (1.0, 2.0):
        seen = StereoNoise(sigma=0.002).noisy(WALL * 0 + distance, CAMERA, rng=rng)
        valid = seen.depth > 0
        spread = np.std(seen.depth[valid])
        # Rounding of the disparity adds step^2 / 12 to its variance.
        rounding = distance**2 / SCALE / 32 / np.sqrt(12)
        expected = np.hypot(0.002 * distance**2, rounding)
        assert spread == pytest.approx(expected, rel=0.03)


def test_neighbouring_errors_are_alike_and_distant_ones_are_not(rng):
    seen = StereoNoise(specks=0.0, edge_loss=0.0).noisy(WALL, CAMERA, rng=rng).depth
    error = seen[:, 30:] - 1.6
    power = (error**2).mean()
    alike = [(error[:, k:] * error[:, :-k]).mean() / power for k in (1, 2, 8)]
    assert alike == pytest.approx([0.56, 0.4, 0.0], abs=0.05)


def test_depths_are_millimetres_of_disparities_that_are_steps(rng):
    depth = StereoNoise(depth_step=0.0).noisy(WALL, CAMERA, rng=rng).depth
    steps = SCALE / depth[depth > 0] * 32
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    depth = StereoNoise().noisy(WALL, CAMERA, rng=rng).depth * 1e3
    np.testing.assert_allclose(depth, np.rint(depth), atol=1e-6)


def test_the_left_border_is_blind_as_far_as_the_disparity_reaches(rng):
    seen = QUIET.noisy(WALL, CAMERA, rng=rng)
    blind = int(np.ceil(SCALE / 1.6))
    assert (seen.depth[:, :blind] == 0).all()
    np.testing.assert_allclose(seen.depth[:, blind:], 1.6)


def test_the_shadow_lies_left_of_near_edges_and_is_as_wide_as_disparities_differ(rng):
    seen = QUIET.noisy(step_image(), CAMERA, rng=rng)
    lost = np.flatnonzero(seen.depth[240, 40:] == 0) + 40
    width = SCALE / 1.0 - SCALE / 1.6
    assert lost.max() == 249
    assert len(lost) == pytest.approx(width, abs=1)


def test_edges_lose_grow_and_fly(rng):
    depth = step_image()
    seen = StereoNoise(grazing=90.0, specks=0.0).noisy(depth, CAMERA, rng=rng)
    beside = seen.depth[145:335, 399:402]
    assert 0.2 < (beside == 0).mean() < 0.55
    grown = (np.abs(seen.depth[145:335, 400] - 1.0) < 0.02) & ~seen.is_flying[
        145:335, 400
    ]
    assert 0.05 < grown.mean() < 0.5
    flying = seen.is_flying & (seen.depth > 0)
    assert 40 < flying.sum() < 600
    between = (seen.depth[flying] > 0.98) & (seen.depth[flying] < 1.63)
    assert between.all()
    inside = seen.depth[150:330, 260:390]
    assert (inside > 0).all()


def test_the_share_of_holes_is_that_of_a_d435_before_a_pile(rng):
    box = Body("box", "box", (Box(np.array([0.2, 0.3, 0.1])),), 1.0,
               SE3.from_parts(p=[1.4, 0.0, 0.1]))  # fmt: skip
    exact = render(World((box,)), CAMERA, look_at((0.1, 0.0, 1.2), (1.4, 0.0, 0.1)))
    share = (StereoNoise().noisy(exact.depth, CAMERA, rng=rng).depth == 0).mean()
    assert 0.015 < share < 0.1


def test_grazing_surfaces_are_lost(rng):
    noise = StereoNoise(specks=0.0)
    row = (np.arange(480) - 240.0)[:, None] / 615.0
    # A floor seen from 3 mm above its plane, and one from above.
    grazed = np.where(row > 0.05, 0.1 / np.maximum(row, 0.05), 0.0) * np.ones((1, 640))
    steep = np.full((480, 640), 1.5)
    lost = (noise.noisy(grazed, CAMERA, rng=rng).depth[300:, 200:] == 0).mean()
    kept = (noise.noisy(steep, CAMERA, rng=rng).depth[300:, 200:] == 0).mean()
    assert lost > 0.05 > kept


def test_the_same_generator_gives_the_same_image_and_inputs_stay():
    depth = step_image()
    before = depth.copy()
    one = StereoNoise().noisy(depth, CAMERA, rng=np.random.default_rng(3))
    two = StereoNoise().noisy(depth, CAMERA, rng=np.random.default_rng(3))
    np.testing.assert_array_equal(one.depth, two.depth)
    np.testing.assert_array_equal(one.is_flying, two.is_flying)
    np.testing.assert_array_equal(depth, before)


def test_an_empty_image_stays_empty(rng):
    seen = StereoNoise().noisy(np.zeros((480, 640)), CAMERA, rng=rng)
    assert (seen.depth == 0).all()
    assert not seen.is_flying.any()


def test_wrong_settings_and_shapes_are_refused(rng):
    with pytest.raises(ConfigError, match="sigma"):
        StereoNoise(sigma=-1.0)
    with pytest.raises(ConfigError, match="flying_share"):
        StereoNoise(flying_share=1.5)
    with pytest.raises(ShapeError, match="depth"):
        StereoNoise().noisy(np.ones((48, 64)), CAMERA, rng=rng)
