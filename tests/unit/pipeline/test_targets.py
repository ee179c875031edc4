"""What is sought where a mask or a region says where to grip."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import debrisgrasp
from debrisgrasp.errors import CaptureError, ConfigError
from debrisgrasp.geometry import Bounds
from debrisgrasp.io import data_path
from debrisgrasp.pipeline import PipelineConfig
from debrisgrasp.pipeline.targets import choose_targets, whole_of, with_crumbs


def divided(kinship):
    """Four points of three objects, and one of the ground."""
    return SimpleNamespace(
        labels=np.array([0, 1, 1, 2, 3]),
        segments=[None] * 3,
        kinship=None if kinship is None else np.array(kinship),
    )


CHOSEN = np.array([False, True, False, False, False])


def test_the_rest_of_a_marked_object_is_lifted_with_it_and_no_neighbour():
    # A sliver (2) at the edge of the mask is of the object, and of its neighbour (3).
    chain = [[0.0, 0.9, 0.0], [0.9, 0.0, 0.9], [0.0, 0.9, 0.0]]
    whole = whole_of(divided(chain), 1, CHOSEN)
    assert whole.tolist() == [False, True, True, True, False]
    assert whole_of(divided(None), 1, CHOSEN).tolist() == [0, 1, 1, 0, 0]


def test_crumbs_of_what_is_lifted_are_lifted_and_neither_ground_nor_neighbours():
    plane = np.array([0.0, 0.0, 1.0, 0.1])  # the ground lies at -0.1
    own = [[0.0, 0.0, 0.0], [0.2, 0.0, 0.1]]
    crumbs = [[0.21, 0.0, 0.1], [0.1, 0.0, 0.1], [0.0, 0.015, -0.09]]
    neighbour = [[0.0, 0.03, 0.0], [0.0, 0.018, 0.0]]
    points = np.array([*own, *crumbs, *neighbour])
    labels = np.array([1, 1, 0, 0, 0, 2, 0])
    whole = with_crumbs(points, labels, labels == 1, plane)
    assert whole.tolist() == [True, True, True, False, False, False, False]
    for unchanged in (
        with_crumbs(points, labels, labels == 1, None),
        with_crumbs(points, np.maximum(labels, 1), labels == 1, plane),
    ):
        np.testing.assert_array_equal(unchanged, labels == 1)
    nothing = np.zeros(7, dtype=bool)
    assert not with_crumbs(points, labels, nothing, plane).any()


def test_in_a_region_counts_what_lies_in_it():
    whole = whole_of(divided(None), 0, CHOSEN)
    assert whole.tolist() == [False, True, True, False, False]


def test_a_mask_on_exactly_one_object_weighs_as_that_object():
    capture = debrisgrasp.Capture.load(data_path("captures", "pile.npz"))
    cloud, found = capture.cloud(), debrisgrasp.segment(capture)
    for label in (1, 2):
        mask = np.zeros(capture.depth.shape, dtype=bool)
        mask.ravel()[cloud.pixels[found.labels == label]] = True
        marked = debrisgrasp.Capture(
            depth=capture.depth,
            intrinsics=capture.intrinsics,
            T_base_camera=capture.T_base_camera,
            mask=mask,
        )
        alone = debrisgrasp.plan(marked, seed=0).plan
        among = debrisgrasp.plan(capture, object_label=label, seed=0).plan
        assert not any("holds" in note for note in alone.notes)
        assert alone.grasps[0].load.mass == pytest.approx(
            among.grasps[0].load.mass, rel=0.15
        )


def test_a_region_in_millimetres_is_named():
    region = Bounds(np.array([700.0, -300.0, 0.0]), np.array([1300.0, 300.0, 600.0]))
    with pytest.raises(ConfigError, match="divide by 1000"):
        choose_targets(
            None, divided(None), [], region=region, object_label=None,
            is_marked=None, margin=0.05,
        )  # fmt: skip


def test_a_label_of_what_the_mask_does_not_show_is_refused():
    found = divided(None)
    found.points_of = lambda label: np.flatnonzero(found.labels == label)
    cloud = SimpleNamespace(points=np.arange(15.0).reshape(5, 3) / 15)
    given = {"region": None, "is_marked": CHOSEN, "margin": 0.05}
    with pytest.raises(CaptureError, match="mask: got no measured point of object 2"):
        choose_targets(cloud, found, [], object_label=2, **given)
    (target,) = choose_targets(cloud, found, [], object_label=1, **given)
    assert target.is_object.tolist() == CHOSEN.tolist()


@pytest.mark.parametrize("margin", [-0.01, 5.0, np.inf, np.nan])
def test_a_margin_with_which_every_region_is_too_large_is_refused(margin):
    with pytest.raises(ConfigError, match="region_margin"):
        PipelineConfig(region_margin=margin)
