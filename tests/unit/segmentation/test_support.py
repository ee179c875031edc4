"""Who rests on whom in scenes whose answer is known."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from debrisgrasp.errors import (
    ConfigError,
    FrameMismatchError,
    InputError,
    ShapeError,
    UnknownNameError,
)
from debrisgrasp.geometry import SE3, Box, PointCloud, Solid, so3
from debrisgrasp.segmentation import (
    GROUND,
    PriorityPoint,
    Segmentation,
    SupportAware,
    SupportConfig,
    SupportGraph,
    segment_cloud,
    support_graph,
)

from .clouds import box_at, cloud_of, labelled, plate, scene_cloud, truth_of

BLOCK_ON_BLOCK = (
    box_at(1.0, 0.0, 0.1, (0.3, 0.3, 0.2), yaw=0.6),
    box_at(1.0, 0.0, 0.26, (0.14, 0.14, 0.12), yaw=0.2),
)
PLANK_ON_TWO = (
    box_at(1.0, 0.3, 0.1, (0.2, 0.2, 0.2)),
    box_at(1.0, -0.3, 0.1, (0.2, 0.2, 0.2)),
    box_at(1.0, 0.0, 0.22, (0.12, 0.9, 0.04)),
)
SIDE_BY_SIDE = (
    box_at(1.0, 0.105, 0.1, (0.2, 0.2, 0.2)),
    box_at(1.0, -0.105, 0.1, (0.2, 0.2, 0.2)),
)
TALL_BEHIND_LOW = (
    box_at(1.0, 0.0, 0.08, (0.2, 0.3, 0.16)),
    box_at(1.16, 0.0, 0.2, (0.1, 0.5, 0.4)),
)
TOWER = (*BLOCK_ON_BLOCK, box_at(1.0, 0.0, 0.36, (0.08, 0.08, 0.08)))


def slanted(x: float, z: float, size: tuple[float, ...], pitch: float, y=0.0) -> Box:
    R = so3.from_rpy(np.array([0.0, pitch, 0.0]))
    return Box(np.array(size) / 2, SE3.from_parts(R, [x, y, z]))


# The board stands on the ground beside the block, and leans on its upper edge.
LEANING = (
    box_at(1.0, 0.25, 0.14, (0.5, 0.2, 0.28)),
    Box(
        np.array([0.07, 0.22, 0.01]),
        SE3.from_parts(so3.from_rpy(np.array([0.98, 0.0, 0.0])), [1.0, 0.073, 0.185]),
    ),
)
# A beam on the ground, and a cinder block that stands on it with one edge (Fig. 7).
COVERED_BEAM = (
    box_at(0.85, 0.0, 0.05, (0.1, 0.9, 0.1)),
    slanted(0.98, 0.155, (0.4, 0.19, 0.19), pitch=-0.32, y=0.2),
)


@cache
def scene(solids: tuple[Solid, ...]) -> tuple[Segmentation, PointCloud]:
    """Segmentation by the truth: label k is solid k."""
    cloud = scene_cloud(solids)
    return labelled(cloud, truth_of(cloud, solids)), cloud


def confidence(graph: SupportGraph, above: int, below: int) -> float:
    labels, confidences = graph.supports_of(above)
    return float(confidences[labels == below].sum())


def graph_of(solids: tuple[Solid, ...]) -> SupportGraph:
    return support_graph(*scene(solids))


def test_a_block_rests_on_the_block_under_it():
    graph = graph_of(BLOCK_ON_BLOCK)
    assert confidence(graph, 2, 1) > 0.8
    assert confidence(graph, 1, 2) < 0.2
    assert confidence(graph, 1, GROUND) > 0.8
    assert confidence(graph, 2, GROUND) < 0.3
    assert graph.removal_order.tolist() == [2, 1]
    assert not graph.is_leaning[(graph.relations == [2, 1]).all(axis=1)].any()


def test_a_plank_rests_on_both_blocks_and_each_carries_a_part():
    graph = graph_of(PLANK_ON_TWO)
    assert confidence(graph, 3, 1) > 0.6
    assert confidence(graph, 3, 2) > 0.6
    assert graph.removal_order[0] == 3
    assert graph.load[2].tolist() == [0.0, 0.0]
    assert 0 < graph.load[0, 1] <= graph.weight[2, 1]


@pytest.mark.parametrize("solids", [SIDE_BY_SIDE, TALL_BEHIND_LOW])
def test_what_stands_beside_bears_on_nothing(solids):
    graph = graph_of(solids)
    assert confidence(graph, 1, 2) < 0.5
    assert confidence(graph, 2, 1) < 0.5
    assert confidence(graph, 1, GROUND) > 0.7


def test_what_lies_apart_far_away_does_not_touch():
    plates = [plate((14.0, 14.3), y, spacing=0.01) for y in ((0.1, 0.4), (-0.4, -0.1))]
    cloud = cloud_of(np.concatenate(plates), np.array([0.0, 0.0, 1.0]))
    labels = np.repeat([1, 2], [len(points) for points in plates])
    assert not len(support_graph(labelled(cloud, labels), cloud).contacts)


def test_a_leaning_board_leans_and_stands_on_the_ground():
    graph = graph_of(LEANING)
    assert confidence(graph, 2, 1) > 0.5
    assert confidence(graph, 2, GROUND) > 0.3
    assert confidence(graph, 1, 2) < 0.2


@pytest.mark.parametrize("label", [3, -1, 1.0, "1"])
def test_who_bears_on_an_object_that_is_none_is_no_answer(label):
    """An empty one would say that nothing does."""
    graph = graph_of(LEANING)
    for asked in (graph.resting_on, graph.supports_of):
        with pytest.raises(UnknownNameError, match="label of an object"):
            asked(label)
    assert len(graph.resting_on(GROUND)[0])
    assert not len(graph.supports_of(GROUND)[0])


def test_support_out_of_sight_is_unknown():
    cloud = scene_cloud((box_at(1.0, 0.0, 0.5, (0.3, 0.3, 0.1)),))
    graph = support_graph(
        labelled(cloud, (cloud.points[:, 2] > 0.2).astype(int)), cloud
    )
    assert graph.hidden[0] > 0.5
    assert graph.supports_of(1)[1].sum() < 0.5
    reason = SupportAware().order(labelled(cloud, cloud.points[:, 2] > 0.2), cloud)
    assert "what holds it is not seen" in reason[0].reason


def test_support_aware_takes_what_the_nearest_object_carries():
    segmentation, cloud = scene(COVERED_BEAM)
    nearest = PriorityPoint.at(0.7, -0.3, 0.2).order(segmentation, cloud)
    aware = SupportAware(point=np.array([0.7, -0.3, 0.2])).order(segmentation, cloud)
    assert nearest[0].label == 1
    assert aware[0].label == 2
    beam = next(item for item in aware if item.label == 1)
    assert "of object 2; take 2 first" in beam.reason
    assert beam.warning == "object 2 may fall: it lies on object 1"


def test_a_tower_carries_what_is_above_down_to_the_ground():
    graph = graph_of(TOWER)
    assert graph.removal_order.tolist() == [3, 2, 1]
    assert graph.load[0, 1] == pytest.approx(graph.weight[1:, 1].sum(), rel=0.05)
    assert graph.load[2].tolist() == [0.0, 0.0]
    assert (graph.load[:, 0] <= graph.load[:, 1]).all()


def test_weights_hold_the_true_one_of_a_wooden_block():
    graph = graph_of(BLOCK_ON_BLOCK)
    true = 500 * 9.81 * 0.3 * 0.3 * 0.2
    assert graph.weight[0, 0] < true < graph.weight[0, 1]


def test_names_of_labels_mean_nothing(rng):
    segmentation, cloud = scene(TOWER)
    new = np.append(0, 1 + rng.permutation(3))
    before = support_graph(segmentation, cloud)
    after = support_graph(labelled(cloud, new[segmentation.labels]), cloud)
    for above in (1, 2, 3):
        for below in (0, 1, 2, 3):
            assert confidence(after, new[above], new[below]) == pytest.approx(
                confidence(before, above, below), abs=0.1
            )
    np.testing.assert_allclose(after.load[new[1:] - 1], before.load, rtol=1e-6)


@pytest.mark.parametrize("yaw", [0.4, 2.0])
def test_turning_the_scene_about_gravity_changes_nothing(yaw):
    segmentation, cloud = scene(TOWER)
    T = SE3.from_parts(so3.from_rpy(np.array([0, 0, yaw])), [0.3, -0.2, 0.0])
    before = support_graph(segmentation, cloud)
    after = support_graph(segmentation, cloud.in_frame(T, "base"))
    assert after.removal_order.tolist() == before.removal_order.tolist()
    for above, below in ((2, 1), (3, 2)):
        assert confidence(after, above, below) == pytest.approx(
            confidence(before, above, below), abs=0.1
        )


def test_an_object_on_top_adds_to_every_load_below():
    low, high = graph_of(BLOCK_ON_BLOCK), graph_of(TOWER)
    assert (high.load[:2, 1] > low.load[:2, 1]).all()


def test_contacts_say_where_and_how_two_blocks_meet():
    contacts = graph_of(BLOCK_ON_BLOCK).contacts
    assert contacts.labels.tolist() == [[1, 2]]
    assert contacts.upper.tolist() == [2]
    assert contacts.place[0, 2] == pytest.approx(0.2, abs=0.02)
    # The normal points from the second to the first: downwards.
    assert contacts.normal[0, 2] < -0.8
    assert contacts.convexity[0] < -0.2
    # Two visible edges of 14 cm.
    assert contacts.length[0] == pytest.approx(0.28, rel=0.4)


def test_borders_at_which_one_hides_the_other_are_no_contacts():
    solids = (
        box_at(0.8, 0.0, 0.2, (0.1, 0.2, 0.4)),
        box_at(1.3, 0.0, 0.1, (0.2, 0.6, 0.2)),
    )
    assert len(graph_of(solids).contacts) == 0


def test_what_is_hidden_behind_another_may_carry_it():
    graph = graph_of(COVERED_BEAM)
    assert graph.occluded[0] > graph.occluded[1]
    assert graph.encumbrance[0] > 0.5 > graph.encumbrance[1]


def test_no_objects_and_one_object():
    cloud = cloud_of(plate((0.5, 1.0), (-0.2, 0.2), z=0.0), np.array([0.0, 0, 1]))
    graph = support_graph(labelled(cloud, np.zeros(len(cloud), int)), cloud)
    assert len(graph.relations) == len(graph.contacts) == len(graph.load) == 0
    assert repr(graph) == "<SupportGraph of 0 objects, to remove in the order none>"
    segmentation, cloud = scene(BLOCK_ON_BLOCK[:1])
    graph = support_graph(segmentation, cloud)
    assert graph.relations.tolist() == [[1, GROUND]]
    assert repr(graph) == "<SupportGraph of 1 object, to remove in the order 1>"


def test_a_cloud_without_image_is_judged_too():
    segmentation, cloud = scene(BLOCK_ON_BLOCK)
    bare = PointCloud(cloud.points, cloud.normals, cloud.viewpoint)
    graph = support_graph(segmentation, bare)
    assert confidence(graph, 2, 1) > 0.8
    assert graph.occluded.tolist() == [0.0, 0.0]


def test_labels_of_another_cloud_are_refused():
    segmentation, cloud = scene(BLOCK_ON_BLOCK)
    with pytest.raises(ShapeError, match="one label for each of the 5 points"):
        support_graph(segmentation, cloud.selected(np.arange(5)))
    with pytest.raises(FrameMismatchError):
        support_graph(segmentation, cloud.in_frame(SE3.identity(), "camera"))


def test_labels_without_a_segment_are_refused():
    segmentation, cloud = scene(BLOCK_ON_BLOCK)
    with pytest.raises(InputError, match="0 to 2, the number of segments"):
        support_graph(_with_label(segmentation, 9), cloud)


def _with_label(segmentation: Segmentation, label: int) -> Segmentation:
    labels = segmentation.labels.copy()
    labels[-1] = label
    return replace(segmentation, labels=labels)


@pytest.mark.parametrize(
    "setting",
    [
        {"cell": 0.0},
        {"reach": np.nan},
        {"noise": -0.1},
        {"density": (900.0, 80.0)},
        {"thickness": (0.0, 0.05)},
        {"gravity": 0.0},
        {"gravity": np.inf},
    ],
)
def test_settings_out_of_range_are_refused(setting):
    with pytest.raises(ConfigError):
        SupportConfig(**setting)


@pytest.mark.filterwarnings("error")
def test_contacts_are_sought_across_gaps_with_one_side_far_away():
    segmentation, cloud = scene(TOWER)
    graph = support_graph(segmentation, cloud, SupportConfig(reach=0.2))
    assert len(graph.contacts)
    assert np.isfinite(graph.confidence).all()


def test_what_segments_itself_is_ordered_from_the_top():
    cloud = scene_cloud(BLOCK_ON_BLOCK)
    segmentation = segment_cloud(cloud)
    truth = truth_of(cloud, BLOCK_ON_BLOCK)
    first = SupportAware().order(segmentation, cloud)[0].label
    assert np.bincount(truth[segmentation.labels == first]).argmax() == 2


def test_what_surely_lies_on_an_object_is_taken_before_it_whatever_the_cost():
    segmentation, cloud = scene(TOWER)
    below = SupportAware(point=np.array([1.0, 0.0, -1.0]), distance=100.0)
    order = below.order(segmentation, cloud)
    assert [candidate.label for candidate in order] == [3, 2, 1]
    assert order[0].cost > order[-1].cost
