import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, InputError, UnknownNameError
from debrisgrasp.segmentation import (
    Candidate,
    OperatorPick,
    PriorityPoint,
    SupportAware,
    ordered,
    region_of_interest,
    segment_cloud,
)

from .clouds import STACK, cloud_of, labelled, plate, scene_cloud

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
    for share in (-0.1, 0.5, np.nan):
        with pytest.raises(InputError, match="outliers"):
            region_of_interest(points, outliers=share)
    with pytest.raises(InputError, match="none"):
        region_of_interest(points[:0])
    with pytest.raises(InputError, match="NaN"):
        region_of_interest(np.array([[0.0, np.nan, 0.0]]))


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


class ByLabel:
    """The simplest policy there is."""

    def order(self, segmentation, _cloud):
        return tuple(Candidate(s.label, 0.0, "why") for s in segmentation.segments)


class Returning:
    """A policy that returns what it is told to."""

    def __init__(self, given):
        self.given = given

    def order(self, _segmentation, _cloud):
        return self.given


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([2, 1], r"order of Returning: got \[2, 1\].*Candidate\(label, cost, reason\)"),
        (None, "order of Returning: got None"),
        ("12", "order of Returning: got '12'"),
        ((Candidate(99, 0.0, "why"),), "segment label: got 99"),
        ((Candidate(1, 0.0, "a"), Candidate(1, 1.0, "b")), "each label once"),
        ((Candidate(1, np.inf, "why"),), "cost of object 1.*a finite number"),
    ],
)
def test_what_is_no_order_is_refused_with_the_name_of_the_policy(scene, given, words):
    with pytest.raises(InputError, match=words):
        ordered(Returning(given), *scene[::-1])
    with pytest.raises(InputError, match=words):
        OperatorPick(1, Returning(given)).order(*scene[::-1])


def test_an_order_may_be_a_list_with_numbers_of_numpy(scene):
    given = [Candidate(np.int64(2), np.float32(0.5), "why", "beware")]
    (candidate,) = ordered(Returning(given), *scene[::-1])
    assert candidate == Candidate(2, 0.5, "why", "beware")
    assert (type(candidate.label), type(candidate.cost)) == (int, float)


@pytest.mark.parametrize("fields", [("1", 0.0, ""), (1, np.nan, ""), (1, 0.0, None)])
def test_a_candidate_has_a_label_a_cost_and_a_reason(fields):
    with pytest.raises(InputError, match=r"label|cost|reason"):
        Candidate(*fields)


def picked(scene, pick):
    return [c.label for c in OperatorPick(pick, ByLabel()).order(*scene[::-1])]


def test_a_picked_label_comes_first_and_the_rest_follow(scene):
    assert picked(scene, 2) == [2, 1]
    assert picked(scene, 1) == [1, 2]
    first = OperatorPick(2, ByLabel()).order(*scene[::-1])[0]
    assert first.reason == "picked by the operator; why"


@pytest.mark.parametrize("label", [np.int64(2), np.uint8(2)])
def test_a_picked_label_may_be_a_number_of_numpy(scene, label):
    assert picked(scene, label) == [2, 1]


@pytest.mark.parametrize(
    "pick",
    [
        *(None, True, "2", 1.5, (1,), (1, 2, 3, 4), ("a", "b"), np.zeros((2, 3))),
        *((100, 24.5), (np.nan, 1), np.array([100.0, 24.0])),
    ],
)
def test_a_pick_of_another_kind_is_refused_at_once(pick):
    with pytest.raises(InputError, match=r"pick: got .*a label, a pixel .*a point"):
        OperatorPick(pick, ByLabel())


def test_a_pick_before_no_policy_is_told(scene):
    cloud, segmentation = scene
    with pytest.raises(InputError, match=r"policy: got None, .*SelectionPolicy"):
        OperatorPick(1, None).order(segmentation, cloud)


def test_a_picked_point_in_millimetres_is_refused_at_once():
    with pytest.raises(ConfigError, match=r"pick.*900.*millimetres"):
        OperatorPick((900.0, 100.0, 300.0), ByLabel())


def test_a_picked_point_takes_the_nearest_object(scene):
    assert picked(scene, (0.55, 0.05, 0.33)) == [2, 1]
    with pytest.raises(InputError, match="of one"):
        picked(scene, (0.55, 0.05, 0.9))


def test_a_pick_of_nothing_is_refused(scene):
    with pytest.raises(UnknownNameError, match="1, 2"):
        picked(scene, 5)
    with pytest.raises(InputError, match="without an image"):
        picked(scene, (10, 10))
    with pytest.raises(InputError):
        picked(scene, (np.nan, 0.0, 0.0))


def test_a_picked_pixel_takes_what_was_measured_there():
    cloud = scene_cloud(STACK)
    segmentation = segment_cloud(cloud)
    pixel = int(cloud.pixels[segmentation.points_of(2)[0]])
    row, column = divmod(pixel, cloud.image_shape[1])
    assert picked((cloud, segmentation), (column, row))[0] == 2
    narrow = (np.int16(column), np.int16(row))
    assert picked((cloud, segmentation), narrow)[0] == 2
    for pixel, expected in (((0, 0), "no object"), ((9999, 0), "0 to 319")):
        with pytest.raises(InputError, match=expected):
            picked((cloud, segmentation), pixel)


def test_a_blocked_way_out_is_said_and_costs():
    low, roof = plate((0.9, 1.1), (-0.1, 0.1), z=0.1), plate((0.4, 1.5), (-0.4, 0.4))
    cloud = cloud_of(np.concatenate([low, roof]), UP)
    labels = np.repeat([1, 2], [len(low), len(roof)])
    order = SupportAware().order(labelled(cloud, labels), cloud)
    below = next(c for c in order if c.label == 1)
    assert "100 % of its way out blocked by object 2" in below.reason
    free = SupportAware(blocked=0.0).order(labelled(cloud, labels), cloud)
    assert below.cost - next(c.cost for c in free if c.label == 1) == pytest.approx(
        0.15
    )


def test_an_object_wider_than_the_hands_costs_more_and_says_so():
    cloud = scene_cloud(STACK)
    segmentation = segment_cloud(cloud)
    narrow = SupportAware(openings=(0.02,)).order(segmentation, cloud)
    wide = SupportAware(openings=(1.0,)).order(segmentation, cloud)
    assert "hands open 2 cm" in narrow[0].reason
    assert narrow[0].cost > wide[0].cost


@pytest.mark.parametrize(
    "setting",
    [
        {"openings": ()},
        {"openings": (0.0,)},
        {"load": -1.0},
        {"encumbrance": float("inf")},
        {"distance": 1e7},
    ],
)
def test_costs_that_make_no_sense_are_refused(setting):
    with pytest.raises(ConfigError):
        SupportAware(**setting)


@pytest.mark.parametrize(
    "setting",
    [{"openings": 0.1}, {"openings": ("a",)}, {"load": True}, {"support": "coarse"}],
)
def test_weights_of_another_type_are_refused(setting):
    with pytest.raises(InputError, match=f"{next(iter(setting))}.*: got"):
        SupportAware(**setting)
