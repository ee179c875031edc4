"""What speaks for one object bearing on another."""

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.geometry import PointCloud
from debrisgrasp.segmentation import SupportConfig
from debrisgrasp.segmentation.bearing import (
    BEARING,
    CONTACT,
    bearing_evidence,
    contact_evidence,
    contact_features,
    context_evidence,
    in_context,
    judged_relations,
)
from debrisgrasp.segmentation.burden import BURDEN, burden_evidence, burden_features
from debrisgrasp.segmentation.seen import Columns, Seen
from debrisgrasp.segmentation.support import labelled_surface
from debrisgrasp.segmentation.surface import LabelledSurface

from .clouds import box_at, labelled, scene_cloud, truth_of

# A small block on a large one, and a third beside them that touches nothing.
SOLIDS = (
    box_at(1.0, 0.0, 0.1, (0.3, 0.3, 0.2), yaw=0.6),
    box_at(1.0, 0.0, 0.26, (0.14, 0.14, 0.12), yaw=0.2),
    box_at(1.0, 0.6, 0.1, (0.2, 0.2, 0.2)),
)


@pytest.fixture(scope="module")
def seen() -> Seen:
    cloud = scene_cloud(SOLIDS)
    config = SupportConfig()
    segmentation = labelled(cloud, truth_of(cloud, SOLIDS))
    surface = labelled_surface(segmentation, cloud, config)
    return Seen.of(segmentation, cloud, surface, config.reach)


def test_each_contact_is_looked_at_from_both_ends(seen):
    relations, features = contact_features(seen)
    assert relations.tolist() == [[1, 2], [2, 1]]
    low, high = (dict(zip(CONTACT, row, strict=True)) for row in features)
    assert high["slope_above"] == low["slope_below"] > 0 > high["slope_below"]
    for turned in ("front", "normal_up", "rise", "apart", "middle_rise"):
        assert high[turned] == pytest.approx(-low[turned])
    for common in ("log_length", "convexity", "gap", "noise", "upright"):
        assert high[common] == low[common]
    assert high["overlap"] == pytest.approx(1.0)
    assert high["overlap_back"] < 0.6
    assert high["normal_up"] > 0.8
    assert high["rise"] > 0.3
    assert high["drop"] == -low["drop"] > 0.0
    assert high["share_above"] == low["share_below"] > high["share_below"] > 0.0
    assert high["log_columns"] == low["log_columns"] > 0.0
    assert -0.02 < high["least_clearance"] <= high["clearance"] < 0.02
    assert low["clearance"] < -0.1
    assert high["low_down_below"] > 0.0 == high["low_down_above"]
    low, high = contact_evidence().probability(features)
    assert low < 0.5 < high


def test_columns_are_those_in_which_both_were_seen(rng):
    points = rng.uniform(0.0, [0.06, 0.06, 0.2], (600, 3))
    labels = np.sort(rng.integers(1, 5, 600))
    labels[labels == 4] = 5  # one label was not seen at all
    points[labels == 3] += 1.0
    cloud = PointCloud(points=points, normals=points * np.nan, viewpoint=np.zeros(3))
    surface = LabelledSurface.of(cloud, labels, None, size=0.01, noise=0.0)
    pairs = np.array([[1, 2], [1, 5], [2, 3]])
    columns = Columns.of(pairs, surface)
    place = np.floor(surface.points[:, :2] / 0.015)
    for k, (a, b) in enumerate(pairs):
        over = [[], []]
        for column in np.unique(place, axis=0):
            here = (place == column).all(axis=1)
            z_a, z_b = (
                surface.points[here & (surface.labels == of), 2] for of in (a, b)
            )
            if len(z_a) and len(z_b):
                over[0].append(z_a.min() - z_b.max())
                over[1].append(z_b.min() - z_a.max())
        assert columns.number[k] == len(over[0])
        if over[0]:
            np.testing.assert_allclose(columns.least[k], np.min(over, axis=1))
            np.testing.assert_allclose(columns.middle[k], np.median(over, axis=1))
    assert columns.number[0] > 0 == columns.number[2]
    assert np.isnan(columns.middle[2]).all()


@pytest.mark.parametrize("tilt", [0.0, 0.3, -0.8])
def test_a_bar_is_told_by_its_axis_and_where_it_is_touched(tilt, rng):
    """A bar across a beam: the contact runs along the beam's edge, off the middle."""
    along = rng.uniform(-0.4, 0.4, 3000)
    axis = np.array([np.cos(tilt), 0.0, np.sin(tilt)])
    bar = along[:, None] * axis + rng.uniform(-0.02, 0.02, (3000, 3))
    place = 0.2 * axis
    beam = place + rng.uniform([-0.02, -0.3, -0.06], [0.02, 0.3, -0.03], (3000, 3))
    points = np.concatenate([bar, beam]) + np.array([2.0, 0.0, 1.0])
    labels = np.repeat([1, 2], 3000)
    up = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    cloud = PointCloud(points=points, normals=up, viewpoint=np.array([0.0, 0.0, 2.0]))
    segmentation = labelled(cloud, labels)
    surface = labelled_surface(segmentation, cloud, SupportConfig())
    _, features = contact_features(Seen.of(segmentation, cloud, surface, 0.015))
    high = dict(zip(CONTACT, features[0], strict=True))
    assert high["tilt_above"] == pytest.approx(abs(np.sin(tilt)), abs=0.03)
    assert high["tilt_below"] == pytest.approx(0.0, abs=0.05)
    assert high["place_along_above"] == pytest.approx(0.25, abs=0.05)
    assert high["place_along_below"] < 0.05
    assert high["share_above"] < 0.3


def test_relations_are_judged_among_the_others():
    relations = np.array([[1, 2], [1, 3], [2, 1], [3, 1]])
    features = np.zeros((4, len(CONTACT)))
    alone = np.array([0.6, 0.9, 0.1, 0.2])
    among = in_context(relations, features, alone, np.zeros((4, 4)))
    first, second = (dict(zip(BEARING, row, strict=True)) for row in among[:2])
    assert first["alone"] == 0.6
    assert first["back"] == 0.1
    assert first["other_support"] == first["other_supports"] == 0.9
    assert first["others_on_above"] == second["others_on_above"] + 0.1 == 0.2
    assert first["lead"] == pytest.approx(-0.3)
    assert first["others_on_below"] == first["kin_support"] == 0.0


def test_what_may_be_the_same_object_speaks_for_both(seen):
    """1 and 4 are likely one: what 4 rests on, and what rests on 4, tells of 1."""
    relations = np.array(
        [[1, 2], [4, 3], [2, 1], [3, 4], [5, 4], [4, 5], [4, 1], [1, 4]]
    )
    alone = np.array([0.6, 0.5, 0.1, 0.1, 0.4, 0.1, 0.9, 0.9])
    kinship = np.zeros((6, 6))
    kinship[1, 4] = kinship[4, 1] = 0.5
    features = np.zeros((8, len(CONTACT)))
    among = in_context(relations, features, alone, kinship)
    first, _, back, *_ = (dict(zip(BEARING, row, strict=True)) for row in among)
    assert first["kin_support"] == pytest.approx(0.5 * 0.5)
    assert back["kin_carries"] == pytest.approx(0.5 * 0.4)
    kinship = np.zeros((3, 3))
    kinship[1, 2] = kinship[2, 1] = 0.3
    _, features = contact_features(replace(seen, kinship=kinship))
    low, high = (dict(zip(CONTACT, row, strict=True)) for row in features)
    assert low["kinship"] == low["kin_above"] == low["kin_below"] == 0.3
    assert high["kin_lowest_below"] == high["lowest_above"]
    _, features = contact_features(seen)
    assert np.isnan(features[:, CONTACT.index("kin_lowest_above")]).all()


def test_heights_are_those_over_the_ground(seen):
    relations, features = contact_features(seen)
    high = dict(zip(CONTACT, features[1], strict=True))
    assert relations[1].tolist() == [2, 1]
    assert high["contact_height"] == pytest.approx(0.2, abs=0.02)
    assert high["lowest_above"] == pytest.approx(0.2, abs=0.02)
    assert high["highest_above"] == pytest.approx(0.32, abs=0.02)
    assert high["contact_share_below"] == pytest.approx(0.9, abs=0.15)
    assert high["contact_share_above"] == pytest.approx(0.0, abs=0.15)


def test_a_burden_is_told_from_what_was_seen_to_lie_on_it(seen):
    relations, confidence = judged_relations(seen)
    burden = burden_features(relations, confidence, seen)
    assert burden.shape == (3, len(BURDEN))
    carries = burden[:, BURDEN.index("carries")]
    assert carries[0] == pytest.approx(confidence[1])
    assert carries[2] == 0.0
    encumbrance = burden_evidence().probability(burden)
    assert encumbrance[0] > 0.8
    assert encumbrance[1:].max() < 0.4


def test_objects_without_contacts_have_no_relations():
    cloud = scene_cloud(SOLIDS[2:])
    config = SupportConfig()
    segmentation = labelled(cloud, truth_of(cloud, SOLIDS[2:]))
    surface = labelled_surface(segmentation, cloud, config)
    seen = Seen.of(segmentation, cloud, surface, config.reach)
    relations, confidence = judged_relations(seen)
    assert relations.shape == (0, 2)
    assert confidence.shape == (0,)
    assert burden_features(relations, np.zeros(0), seen).shape == (1, len(BURDEN))


@pytest.mark.parametrize(
    ("evidence", "names"),
    [
        (contact_evidence, CONTACT),
        (context_evidence, BEARING),
        (bearing_evidence, BEARING),
        (burden_evidence, BURDEN),
    ],
)
def test_shipped_evidence_stays_doubtful_when_nothing_is_known(evidence, names):
    assert evidence().features.max() < len(names)
    assert np.isfinite(evidence().log_odds).all()
    nothing = np.full((1, len(names)), np.nan)
    assert 0.0 < evidence().probability(nothing)[0] < 1.0
