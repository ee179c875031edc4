"""How many objects a mark of one covers."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.geometry import PointCloud
from debrisgrasp.segmentation import segment_cloud
from debrisgrasp.segmentation.marked import covered_shares


def shares(marked, size):
    return covered_shares(np.array(marked, float), np.array(size, float)).tolist()


def test_what_is_only_touched_is_not_covered():
    assert shares([96, 4], [100, 100]) == [0.96]
    assert shares([70, 30], [80, 200]) == [0.7, 0.3]
    assert shares([0, 0], [10, 10]) == []


def test_every_whole_object_counts_but_no_crumbs():
    marked = [160] * 6 + [8, 2]
    assert shares(marked, marked) == pytest.approx([160 / 970] * 6 + [8 / 970])


def test_what_no_camera_saw_is_counted_as_it_was_divided():
    x, y = np.meshgrid(np.linspace(0, 0.2, 41), np.linspace(0, 0.1, 21))
    top = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 0.3)])
    both = np.concatenate([top, top + np.array([0.5, 0.0, 0.1])])
    cloud = PointCloud(
        points=both,
        normals=np.broadcast_to([0.0, 0.0, 1.0], both.shape),
        viewpoint=np.array([0, 0, 1.5]),
    )
    assert segment_cloud(cloud).marked_shares is None
    everything = np.ones(len(both), dtype=bool)
    found = segment_cloud(cloud, of_interest=everything)
    assert found.method == "lccp"
    assert found.marked_shares.tolist() == [0.5, 0.5]
    one = segment_cloud(cloud, of_interest=everything & (both[:, 0] < 0.3))
    assert one.marked_shares.tolist() == [1.0]
