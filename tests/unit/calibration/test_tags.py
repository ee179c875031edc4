"""Tags are found by the library of the extra ``tags``, where it is installed."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest
from scipy import ndimage

from debrisgrasp.calibration import find_tags
from debrisgrasp.errors import (
    ConfigError,
    InputError,
    MissingExtraError,
    ShapeError,
    UnknownNameError,
)
from debrisgrasp.geometry import SE3, Intrinsics, so3

CAMERA = Intrinsics(fx=600.0, fy=600.0, cx=319.5, cy=239.5, width=640, height=480)
BITS = np.array(
    [
        [0, 0, 0, 0, 0, 0, 0, 0],
        [0, 0, 0, 1, 1, 0, 1, 0],
        [0, 0, 1, 1, 1, 0, 0, 0],
        [0, 1, 1, 0, 1, 0, 1, 0],
        [0, 0, 1, 1, 0, 1, 1, 0],
        [0, 1, 0, 0, 0, 1, 1, 0],
        [0, 0, 0, 1, 1, 1, 1, 0],
        [0, 0, 0, 0, 0, 0, 0, 0],
    ][::-1]
)[:, ::-1]
"""Tag 5 of the family 36h11, black border included."""
SIZE = 0.12
POSE = SE3.from_parts(so3.exp(np.array([0.5, 0.3, 0.2])), [0.05, -0.03, 0.7])


def seen_tag() -> np.ndarray:
    """Picture of the tag on a white sheet, traced ray by ray."""
    rays = CAMERA.deproject(np.ones((CAMERA.height, CAMERA.width)))
    normal = POSE.R[:, 2]
    points = rays * ((normal @ POSE.p) / (rays @ normal))[..., None]
    local = POSE.inverse().apply(points)[..., :2] / SIZE * len(BITS)
    cell = np.floor(local + len(BITS) / 2).astype(int)
    inside = ((cell >= 0) & (cell < len(BITS))).all(axis=-1)
    cell = np.clip(cell, 0, len(BITS) - 1)
    on_tag = np.where(BITS[cell[..., 1], cell[..., 0]], 230.0, 20.0)
    sheet = (np.abs(local) < 0.75 * len(BITS)).all(axis=-1)
    picture = np.where(inside, on_tag, np.where(sheet, 230.0, 90.0))
    return np.rint(ndimage.gaussian_filter(picture, 0.7)).astype(np.uint8)


@pytest.mark.skipif(find_spec("pupil_apriltags") is None, reason="needs extra tags")
def test_a_tag_is_found_where_it_is():
    (tag,) = find_tags(seen_tag(), CAMERA, size=SIZE)
    assert tag.number == 5
    assert tag.T_camera_tag.p == pytest.approx(POSE.p, abs=0.003)
    turn = so3.log(tag.T_camera_tag.R.T @ POSE.R)
    assert np.linalg.norm(turn) < 0.05
    rgb = np.repeat(seen_tag()[..., None], 3, axis=-1)
    assert len(find_tags(rgb, CAMERA, size=SIZE)) == 1
    assert not find_tags(seen_tag(), CAMERA, size=SIZE, min_margin=250.0)


@pytest.mark.skipif(find_spec("pupil_apriltags") is not None, reason="extra is there")
def test_the_missing_extra_is_named():
    with pytest.raises(MissingExtraError, match=r"debrisgrasp\[tags\]"):
        find_tags(seen_tag(), CAMERA, size=SIZE)


def test_bad_input_is_refused():
    with pytest.raises(UnknownNameError, match="tag36h11"):
        find_tags(seen_tag(), CAMERA, size=SIZE, family="tag36h12")
    with pytest.raises(ConfigError):
        find_tags(seen_tag(), CAMERA, size=-1.0)
    with pytest.raises(ShapeError):
        find_tags(seen_tag()[:-2], CAMERA, size=SIZE)
    with pytest.raises(ShapeError, match=r"\(480, 640, 4\)"):
        find_tags(np.repeat(seen_tag()[..., None], 4, axis=-1), CAMERA, size=SIZE)
    with pytest.raises(InputError, match="float64, expected uint8"):
        find_tags(seen_tag() / 255.0, CAMERA, size=SIZE)
