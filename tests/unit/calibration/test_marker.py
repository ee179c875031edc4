"""The LED is found to a fraction of a pixel, and nothing where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.calibration import (
    MarkerConfig,
    MarkerFound,
    MarkerMissing,
    find_marker,
)
from debrisgrasp.errors import InputError, ShapeError
from tests.benchmarks.led_views import LedView, led_view


def found_in(view: LedView, *, has_off: bool = True, **settings: object) -> object:
    return find_marker(
        view.on,
        view.depth,
        view.intrinsics,
        view.expected,
        rgb_off=view.off if has_off else None,
        config=MarkerConfig(**settings),  # type: ignore[arg-type]  # passed on
    )


def test_a_lit_led_is_found_in_random_views(rng):
    for _ in range(15):
        view = led_view(rng)
        found = found_in(view)
        assert isinstance(found, MarkerFound), found
        assert np.linalg.norm(found.pixel - view.pixel) < 0.3
        uv, _ = view.intrinsics.project(found.point_camera)
        assert uv == pytest.approx(found.pixel)


def test_its_depth_is_that_of_its_seat(rng):
    gaps = []
    for _ in range(15):
        view = led_view(rng)
        found = found_in(view)
        assert isinstance(found, MarkerFound)
        gaps.append(found.point_camera[2] - view.point[2])
    assert np.median(np.abs(gaps)) < 0.004


@pytest.mark.parametrize("has_off", [True, False])
@pytest.mark.parametrize("settings", [{"is_lit": False}, {"is_hidden": True}])
def test_nothing_is_found_when_it_is_off_or_hidden(rng, has_off, settings):
    for _ in range(10):
        found = found_in(led_view(rng, **settings), has_off=has_off)
        assert isinstance(found, MarkerMissing)
        assert len(found.reason) > 10


def test_by_colour_alone_it_is_right_or_silent(rng):
    n_found = 0
    for _ in range(15):
        view = led_view(rng)
        found = found_in(view, has_off=False)
        if isinstance(found, MarkerFound):
            n_found += 1
            assert np.linalg.norm(found.pixel - view.pixel) < 1.5
    assert n_found > 7


def blank(depth: float = 1.0) -> LedView:
    """Grey wall and one blue disc."""
    view = led_view(np.random.default_rng(0))
    side = view.intrinsics.height
    grey = np.full((side, side, 3), 90, dtype=np.uint8)
    v, u = np.indices((side, side))
    on = grey.copy()
    on[np.hypot(u - 70, v - 80) < 4] = (60, 110, 255)
    point = np.array(
        [
            (70 - view.intrinsics.cx) / view.intrinsics.fx * depth,
            (80 - view.intrinsics.cy) / view.intrinsics.fy * depth,
            depth,
        ]
    )
    return LedView(
        on=on,
        off=grey,
        depth=np.full((side, side), depth),
        intrinsics=view.intrinsics,
        pixel=np.array([70.0, 80.0]),
        point=point,
        expected=point,
    )


def changed(view: LedView, **fields: object) -> LedView:
    names = ("on", "off", "depth", "intrinsics", "pixel", "point", "expected")
    return LedView(**({n: getattr(view, n) for n in names} | fields))  # type: ignore[arg-type]


def test_a_plain_disc_is_found_exactly():
    found = found_in(blank())
    assert isinstance(found, MarkerFound)
    assert found.pixel == pytest.approx([70.0, 80.0], abs=0.02)
    assert found.point_camera == pytest.approx(blank().point, abs=1e-4)


@pytest.mark.parametrize(
    ("spoiled", "word"),
    [
        ("twin", "look alike"),
        ("long", "as long as wide"),
        ("large", "at most"),
        ("behind", "behind"),
        ("no_depth", "depths around it"),
        ("outside", "outside the picture"),
        ("dim", "brightest"),
    ],
)
def test_a_refusal_says_why(spoiled, word):
    view = blank()
    on, depth, expected = view.on.copy(), view.depth.copy(), view.expected
    v, u = np.indices(depth.shape)
    if spoiled == "twin":
        on[np.hypot(u - 95, v - 80) < 4] = (60, 110, 255)
    elif spoiled == "long":
        on[78:82, 60:84] = (60, 110, 255)
    elif spoiled == "large":
        on[np.hypot(u - 70, v - 80) < 24] = (60, 110, 255)
    elif spoiled == "behind":
        depth += 0.4
    elif spoiled == "no_depth":
        depth[:] = 0.0
    elif spoiled == "outside":
        expected = expected + np.array([3.0, 0.0, 0.0])
    elif spoiled == "dim":
        on[np.hypot(u - 70, v - 80) < 4] = (90, 90, 150)
    found = found_in(changed(view, on=on, depth=depth, expected=expected))
    assert isinstance(found, MarkerMissing)
    assert word in found.reason


def test_bad_input_is_refused():
    view = blank()
    with pytest.raises(ShapeError, match="depth"):
        found_in(changed(view, depth=view.depth[:-1]))
    with pytest.raises(ShapeError, match="rgb_off"):
        found_in(changed(view, off=view.off[:-1]))
    with pytest.raises(InputError, match="in front"):
        found_in(changed(view, expected=np.array([0.0, 0.0, -1.0])))
    with pytest.raises(InputError, match="millimetres"):
        found_in(changed(view, expected=1000.0 * view.expected))
    with pytest.raises(InputError, match="expected place of the marker"):
        found_in(changed(view, expected=np.array([0.0, np.nan, 1.0])))
    with pytest.raises(ShapeError, match="expected place of the marker"):
        found_in(changed(view, expected=view.expected[:2]))
    with pytest.raises(InputError, match="color"):
        MarkerConfig(color=(1.0, 1.0, 1.0))


@pytest.mark.parametrize("name", ["on", "off"])
def test_a_picture_of_another_type_is_refused(name):
    """In numbers from 0 to 1 nothing would shine, and nothing be said of why."""
    view = blank()
    picture = getattr(view, name) / 255.0
    with pytest.raises(InputError, match=r"rgb.* float64, expected uint8.*255 \*"):
        found_in(changed(view, **{name: picture}))
