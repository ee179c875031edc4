"""How likely segments are parts of one object: chains, and what scenes say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.errors import UnknownNameError
from debrisgrasp.geometry import SE3, Intrinsics, so3
from debrisgrasp.io import Capture
from debrisgrasp.segmentation import (
    LccpConfig,
    SegmentationConfig,
    SingulationConfig,
    segment_cloud,
)
from debrisgrasp.worlds import World, draw_body, look_at, render

from .clouds import STACK, TWO_BOXES, cloud_of, labelled, plate, scene_cloud

CAMERA = Intrinsics(fx=180.0, fy=180.0, cx=119.5, cy=89.5, width=240, height=180)
VIEW = look_at([0.1, 0.0, 1.2], [0.95, 0.0, 0.1])


def three_plates(kinship: np.ndarray | None):
    parts = [plate((x, x + 0.1), (0.0, 0.1)) for x in (0.0, 0.2, 0.4)]
    labels = np.repeat([1, 2, 3], [len(part) for part in parts])
    return replace(labelled(cloud_of(np.concatenate(parts)), labels), kinship=kinship)


def test_belonging_is_that_of_the_best_chain():
    kinship = np.array([[0.0, 0.8, 0.1], [0.8, 0.0, 0.5], [0.1, 0.5, 0.0]])
    found = three_plates(kinship)
    assert found.belonging(1) == pytest.approx([0.0, 1.0, 0.8, 0.4])
    assert found.belonging(3) == pytest.approx([0.0, 0.4, 0.5, 1.0])
    for none in (4, 0, -1, 1.5, "a", None):
        with pytest.raises(UnknownNameError):
            found.belonging(none)


def test_without_kinship_every_segment_is_alone():
    for none in (None, np.zeros((3, 3))):
        assert three_plates(none).belonging(2).tolist() == [0.0, 0.0, 1.0, 0.0]


def test_certain_kin_are_one():
    assert three_plates(np.ones((3, 3))).belonging(2).tolist() == [0.0, 1.0, 1.0, 1.0]


@pytest.mark.parametrize("solids", [TWO_BOXES, STACK])
def test_kinship_is_a_doubt_about_what_was_kept_apart(solids):
    config = SingulationConfig()
    found = segment_cloud(scene_cloud(solids), SegmentationConfig(method=config))
    kinship, n = found.kinship, len(found.segments)
    assert kinship is not None
    assert kinship.shape == (n, n)
    assert (kinship == kinship.T).all()
    assert not kinship.diagonal().any()
    # Somewhat more than the score, by which pairs were kept apart.
    assert ((kinship >= 0.0) & (kinship < 0.5 + 0.5 * config.min_score)).all()
    for (a, b), score in zip(found.edges.labels, found.edges.score, strict=True):
        assert kinship[a - 1, b - 1] == pytest.approx(score, abs=0.3)


def test_pieces_of_one_body_are_rather_kin_than_boxes_are():
    kin = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        body = draw_body("barrier", rng=rng)
        R = so3.from_rpy(np.array([0.0, 0.0, rng.uniform(0, 2 * np.pi)]))
        low = (body.mesh()[0] @ R.T)[:, 2].min()
        world = World((body.at(SE3.from_parts(R, [0.95, 0.0, -low])),))
        picture = render(world, CAMERA, VIEW)
        capture = Capture(
            depth=picture.depth, intrinsics=CAMERA, T_base_camera=VIEW, name="barrier"
        )
        found = segment_cloud(capture.cloud())
        kin += found.belonging(1)[2:].tolist()
    assert len(kin) > 4
    assert np.mean(kin) > 0.2
    assert segment_cloud(scene_cloud(TWO_BOXES)).belonging(1)[2] < 0.1


def test_local_convexity_tells_no_kinship():
    found = segment_cloud(scene_cloud(STACK), SegmentationConfig(method=LccpConfig()))
    assert found.kinship is None
    assert found.belonging(1)[1] == 1.0
