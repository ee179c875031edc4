"""Segmentations of labels that somebody else gave."""

from __future__ import annotations

import numpy as np
import pytest

import debrisgrasp
from debrisgrasp.errors import InputError, ShapeError
from debrisgrasp.io import Capture, data_path
from debrisgrasp.segmentation import PointKind, segmentation_of_labels


@pytest.fixture(scope="module")
def pile() -> Capture:
    return Capture.load(data_path("captures", "pile.npz"))


@pytest.fixture(scope="module")
def cloud(pile):
    return pile.cloud()


def test_labels_of_an_image_are_renamed_by_size_and_nothing_else(pile, cloud):
    found = segmentation_of_labels(cloud, pile.labels)
    given = pile.labels.ravel()[cloud.pixels]
    assert found.method == "given"
    np.testing.assert_array_equal(found.labels > 0, given > 0)
    sizes = [segment.n_points for segment in found.segments]
    assert sizes == sorted(sizes, reverse=True)
    for segment in found.segments:
        (name,) = np.unique(given[found.points_of(segment.label)])
        assert np.count_nonzero(given == name) == segment.n_points


def test_ground_is_found_among_what_is_no_object(pile, cloud):
    found, own = segmentation_of_labels(cloud, pile.labels), debrisgrasp.segment(pile)
    np.testing.assert_array_equal(found.ground.plane, own.ground.plane)
    assert (found.ground.kinds[found.labels > 0] == PointKind.STANDING).all()
    is_other = found.labels == 0
    np.testing.assert_array_equal(
        found.ground.kinds[is_other], own.ground.kinds[is_other]
    )


def test_labels_of_a_segmentation_give_its_objects_again(pile, cloud):
    own = debrisgrasp.segment(pile)
    again = segmentation_of_labels(cloud, own.labels)
    np.testing.assert_array_equal(again.labels, own.labels)
    for a, b in zip(again.segments, own.segments, strict=True):
        np.testing.assert_array_equal(a.axes, b.axes)


def test_few_points_are_an_object_too_and_none_are_no_fault(cloud):
    labels = np.zeros(len(cloud), dtype=np.int64)
    assert segmentation_of_labels(cloud, labels).segments == ()
    labels[:3] = 10**9
    (segment,) = segmentation_of_labels(cloud, labels).segments
    assert (segment.label, segment.n_points) == (1, 3)


@pytest.mark.parametrize(
    ("change", "kind", "words"),
    [
        (lambda labels: labels[:5], ShapeError, r"\(5, 640\).*\(480, 640\)"),
        (lambda labels: [labels[0], [1]], ShapeError, "labels: .*equal lengths"),
        (
            lambda labels: np.ma.masked_less(labels, 2),
            InputError,
            r"labels: got a masked array.*filled\(0\)",
        ),
        (lambda labels: labels.astype(float), InputError, "float64.*integers"),
        (lambda labels: labels - 1, InputError, "got -2.*0 or -1"),
    ],
)
def test_what_are_no_labels_is_refused(pile, cloud, change, kind, words):
    with pytest.raises(kind, match=words):
        segmentation_of_labels(cloud, change(pile.labels))
