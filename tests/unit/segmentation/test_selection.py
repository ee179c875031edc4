import numpy as np
import pytest

from debrisgrasp.errors import InputError, UnknownNameError
from debrisgrasp.segmentation import PriorityPoint, region_of_interest, segment_cloud

from .clouds import cloud_of, plate

UP = np.array([0.0, 0.0, 1.0])
NEAR = plate((0.5, 0.6), (0.0, 0.1))
LONG = plate((0.5, 1.2), (0.3, 0.4))


@pytest.fixture
def scene():
    cloud = cloud_of(np.concatenate([NEAR, LONG]), UP)
    return cloud, segment_cloud(cloud)


def test_the_object_with_the_nearest_point_comes_first(scene):
    cloud, segmentation = scene
    # The long plate reaches right to the point, though its centroid is farther.
    order = PriorityPoint.at(0.9, 0.28, 0.3).order(segmentation, cloud)
    assert [c.label for c in order] == [1, 2]
    assert order[0].cost == pytest.approx(0.02, abs=1e-3)
    assert "0.02" in order[0].reason


def test_costs_are_distances_to_the_nearest_point(scene):
    cloud, segmentation = scene
    point = np.array([0.2, 0.1, 0.5])
    for candidate in PriorityPoint(point).order(segmentation, cloud):
        own = cloud.points[segmentation.points_of(candidate.label)]
        distance = np.linalg.norm(own - point, axis=1).min()
        assert candidate.cost == pytest.approx(distance)


def test_no_objects_no_candidates():
    cloud = cloud_of([[0.5, 0.0, 0.3]])
    assert PriorityPoint.at(0, 0, 0).order(segment_cloud(cloud), cloud) == ()


def test_another_cloud_is_refused(scene):
    cloud, segmentation = scene
    with pytest.raises(InputError, match="segmented"):
        PriorityPoint.at(0, 0, 0).order(segmentation, cloud.selected(np.arange(5)))


@pytest.mark.parametrize("point", [[np.nan, 0, 0], [0, 0], [[0, 0, 0]]])
def test_priority_points_that_are_none_are_refused(point):
    with pytest.raises(InputError):
        PriorityPoint(np.array(point))


def test_region_holds_the_object_and_the_margin(scene):
    cloud, segmentation = scene
    points = cloud.points[segmentation.points_of(1)]
    region = region_of_interest(points, margin=0.05)
    assert region.contains(points).all()
    size = segmentation.segment(1).bounds.size
    np.testing.assert_allclose(region.size, size + 0.1, atol=0.02)
    with pytest.raises(InputError):
        region_of_interest(points, margin=-0.01)


def test_flying_pixels_do_not_blow_the_region_up(scene):
    cloud, segmentation = scene
    points = cloud.points[segmentation.points_of(1)]
    flying = np.concatenate([points, points[:1] + 5.0, points[:1] - 5.0])
    region = region_of_interest(flying, margin=0.05)
    np.testing.assert_allclose(
        region.size, region_of_interest(points, margin=0.05).size, atol=0.02
    )


def test_unknown_labels_name_the_known(scene):
    with pytest.raises(UnknownNameError, match="1, 2"):
        scene[1].segment(7)
