"""Points of a grid along three axes."""

from __future__ import annotations

import numpy as np

from debrisgrasp.geometry import lattice


def test_a_lattice_holds_every_combination_of_places_in_the_order_of_its_axes():
    x, y, z = [0.0, 1.0], [5.0], [2.0, 3.0, 4.0]
    points = lattice(x, y, z)
    assert points.shape == (2, 1, 3, 3)
    for i, j, k in np.ndindex(2, 1, 3):
        assert points[i, j, k].tolist() == [x[i], y[j], z[k]]


def test_a_lattice_without_places_along_an_axis_is_empty():
    assert lattice([], [1.0], [2.0]).shape == (0, 1, 1, 3)
