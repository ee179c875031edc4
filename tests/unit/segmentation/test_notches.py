import numpy as np
import pytest

from debrisgrasp.segmentation import segment_cloud
from tests.benchmarks.segmentation_scores import scores

from .clouds import box_at, scene_cloud, truth_of


def bar(y: float, x: float = 1.0, length: float = 0.5, yaw: float = 0.0):
    """Box 9 cm wide along y and 9 cm high, turned about the middle of the scene."""
    c, s = np.cos(yaw), np.sin(yaw)
    place = (1.0 + c * (x - 1.0) - s * y, s * (x - 1.0) + c * y)
    return box_at(*place, 0.045, (length, 0.09, 0.09), yaw=yaw)


@pytest.mark.parametrize("yaw", [0.0, 0.5, 1.4])
def test_flush_bars_of_which_one_goes_on_alone_come_apart(yaw):
    solids = (bar(-0.045, 0.95, yaw=yaw), bar(0.045, 1.05, yaw=yaw))
    cloud = scene_cloud(solids)
    result = segment_cloud(cloud)
    assert len(result.segments) == 2
    assert scores(result.labels, truth_of(cloud, solids)).wov > 0.88
    # What outlines alone tell stays a doubt.
    assert 0.0 < result.edges.score[0] < 0.5


def test_the_outer_ones_of_three_flush_bars_are_not_joined_across_the_middle():
    solids = (bar(-0.09, 0.94), bar(0.0, 1.06), bar(0.09, 0.94))
    cloud = scene_cloud(solids)
    result = segment_cloud(cloud)
    assert len(result.segments) == 3
    assert scores(result.labels, truth_of(cloud, solids)).wov > 0.9


def test_what_something_in_front_cuts_out_of_a_face_is_no_notch():
    plank = box_at(1.0, 0.0, 0.02, (0.5, 0.24, 0.04))
    post = box_at(0.82, 0.06, 0.15, (0.06, 0.1, 0.3))
    cloud = scene_cloud((plank, post))
    result = segment_cloud(cloud)
    truth = truth_of(cloud, (plank, post))
    on_plank = result.labels[(truth == 1) & (result.labels > 0)]
    assert np.bincount(on_plank).max() > 0.95 * len(on_plank)


@pytest.mark.parametrize("size", [(0.5, 0.3, 0.1), (0.4, 0.2, 0.12)])
def test_faces_without_a_notch_stay_whole(size):
    solids = (box_at(1.0, 0.0, size[2] / 2, size, yaw=0.4),)
    cloud = scene_cloud(solids)
    assert len(segment_cloud(cloud).segments) == 1
