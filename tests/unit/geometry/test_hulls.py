"""Convex hulls: of what, and of what not."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.errors import InputError, ShapeError
from debrisgrasp.geometry import hull_of, hull_volume, lattice

CUBE = lattice([0, 2], [0, 1], [0, 1]).reshape(-1, 3)


def test_a_box_has_its_volume_corners_and_outward_planes():
    corners, faces, planes = hull_of(CUBE.tolist())
    assert hull_volume(CUBE) == pytest.approx(2.0)
    assert len(corners) == 8
    assert faces.shape == (12, 3)
    assert (planes[:, :3] @ CUBE.mean(axis=0) + planes[:, 3] < 0).all()


def test_flat_points_have_no_volume():
    assert hull_volume(CUBE[CUBE[:, 0] == 0]) == 0.0
    assert hull_volume(np.zeros((0, 3))) == 0.0


@pytest.mark.parametrize("hull", [hull_of, hull_volume])
def test_points_in_the_order_of_an_image_are_refused(hull):
    with pytest.raises(ShapeError, match=r"\(2, 2, 2, 3\), expected \(n, 3\).*reshape"):
        hull(lattice([0, 2], [0, 1], [0, 1]))
    with pytest.raises(ShapeError, match=r"points of a hull.*\(3,\)"):
        hull([0, 1, 2])


@pytest.mark.parametrize("hull", [hull_of, hull_volume])
def test_points_that_are_nowhere_are_not_flat(hull):
    with pytest.raises(InputError, match="NaN"):
        hull(np.where(CUBE > 1, np.nan, CUBE))
