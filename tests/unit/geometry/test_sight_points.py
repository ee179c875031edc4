"""Points on lines of sight begin outside the camera and end where they are told to."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.geometry import sight_points


@pytest.mark.parametrize("short", [0.0, 0.03])
def test_they_lead_from_the_housing_to_short_of_what_is_seen(rng, short):
    camera, points = np.array([0.1, 0.2, 1.0]), rng.uniform(1.5, 2.0, (5, 3))
    rays = sight_points(camera, points, short=short)
    from_camera = np.linalg.norm(rays - camera, axis=-1)
    assert from_camera[:, 0] == pytest.approx(0.1)
    length = np.linalg.norm(points - camera, axis=-1)
    assert from_camera[:, -1] == pytest.approx(length - short)
    # All on the line, so what is left of each adds up.
    left = np.linalg.norm(points[:, None] - rays, axis=-1)
    assert from_camera + left == pytest.approx(
        np.broadcast_to(length[:, None], (5, 48))
    )


def test_it_does_not_matter_which_end_moves(rng):
    cameras, point = rng.uniform(1.5, 2.0, (5, 3)), np.array([0.1, 0.2, 0.3])
    rays = sight_points(cameras, point, short=0.03)
    for camera, ray in zip(cameras, rays, strict=True):
        assert ray == pytest.approx(sight_points(camera, point[None], short=0.03)[0])
