"""The selection report, as a picture and as a page."""

import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from debrisgrasp.errors import InputError
from debrisgrasp.segmentation import (
    Candidate,
    SupportAware,
    segment_cloud,
    support_graph,
)
from debrisgrasp.viz import (
    SelectionReport,
    segmentation_png,
    selection_html,
    selection_png,
)
from debrisgrasp.viz.overlay import DOUBT_COLOR
from debrisgrasp.viz.page import Page, write_order
from debrisgrasp.viz.support_layer import SupportLayer
from tests.scenes import capture_of
from tests.unit.segmentation.clouds import STACK


@pytest.fixture(scope="module")
def report() -> SelectionReport:
    capture = capture_of(STACK)
    cloud = capture.cloud()
    segmentation = segment_cloud(cloud)
    return SelectionReport(
        capture=capture,
        cloud=cloud,
        segmentation=segmentation,
        support=support_graph(segmentation, cloud),
        order=SupportAware().order(segmentation, cloud),
    )


def test_the_upper_block_has_an_arrow_to_the_lower(report):
    layer = SupportLayer.of(report)
    upper = report.order[0].label
    (arrow,) = layer.arrows
    assert arrow.above.label == upper
    assert arrow.above.v < arrow.below.v
    assert arrow.below.is_on_ground
    assert not arrow.above.is_on_ground
    assert layer.nodes[upper].place == 1


def test_a_doubtful_border_is_dashed(report):
    def marked(score):
        edges = report.segmentation.edges
        scored = replace(edges, score=np.full(len(edges), score))
        segmentation = replace(report.segmentation, edges=scored)
        layer = SupportLayer.of(replace(report, segmentation=segmentation))
        return (layer.colors == DOUBT_COLOR).all(axis=2).sum()

    assert len(report.segmentation.edges)
    assert marked(0.0) == 0
    assert marked(0.45) > 20


def test_the_picture_of_the_segments_shows_what_is_in_doubt(report, tmp_path):
    def shown(score, certainty):
        edges = report.segmentation.edges
        segmentation = replace(
            report.segmentation,
            edges=replace(edges, score=np.full(len(edges), score)),
            segments=tuple(
                replace(segment, certainty=certainty)
                for segment in report.segmentation.segments
            ),
        )
        path = tmp_path / "a.png"
        segmentation_png(path, report.capture, report.cloud, segmentation)
        return np.asarray(Image.open(path).convert("RGB"))

    def n_dashed(picture):
        return (np.abs(picture - 255.0 * np.array(DOUBT_COLOR)).max(axis=2) < 3).sum()

    plain = shown(0.0, 1.0)
    assert n_dashed(plain) == 0
    assert n_dashed(shown(0.45, 1.0)) > 20
    assert (shown(0.0, 0.5) != plain).any()


def test_the_picture_is_complete(report, tmp_path):
    path = tmp_path / "order.png"
    selection_png(path, report)
    with Image.open(path) as picture:
        assert picture.size == (1720, 960)


def test_the_page_names_every_object_and_fetches_nothing(report, tmp_path):
    path = tmp_path / "order.html"
    selection_html(path, report)
    page = path.read_text()
    for item in report.order:
        assert f'<tr data-node="{item.label}"' in page
        assert item.reason.split(";")[0] in page
    assert "rests on" in page
    assert "{{" not in page
    assert not re.findall(r'(?:src|href)="(?!data:)', page)


def test_a_doubt_about_the_camera_pose_is_said(report, tmp_path):
    ground = replace(report.segmentation.ground, pose_doubt="the camera < the ground")
    segmentation = replace(report.segmentation, ground=ground)
    doubtful = replace(report, segmentation=segmentation)
    page, picture = tmp_path / "order.html", tmp_path / "order.png"
    selection_html(page, doubtful)
    assert "Camera pose in doubt: the camera &lt; the ground" in page.read_text()
    selection_png(picture, doubtful)
    with Image.open(picture) as image:
        assert image.height > 960


def test_a_long_order_ends_with_the_number_of_those_left_out():
    page = Page(600, 400)
    order = [Candidate(k, 1.0, f"reason {k}") for k in range(1, 41)]
    write_order(page, 20, 50, order)
    texts = [text.get_text() for text in page.figure.texts]
    n_written = sum(text.startswith("reason") for text in texts)
    assert texts[-1] == f"and {40 - n_written} more"
    renderer = page.figure.canvas.get_renderer()
    assert all(t.get_window_extent(renderer).y0 > 0 for t in page.figure.texts)


def test_names_are_escaped(report, tmp_path):
    path = tmp_path / "order.html"
    capture = replace(report.capture, name="<script>alert(1)</script>")
    selection_html(path, replace(report, capture=capture))
    assert "<script>alert" not in path.read_text()


def test_a_scene_without_objects_is_shown_too(tmp_path):
    capture = capture_of(())
    cloud = capture.cloud()
    segmentation = segment_cloud(cloud)
    bare = SelectionReport(
        cloud=cloud,
        segmentation=segmentation,
        support=support_graph(segmentation, cloud),
        order=(),
    )
    selection_png(tmp_path / "bare.png", bare)
    selection_html(tmp_path / "bare.html", bare)


def test_labels_of_another_cloud_are_refused(report):
    with pytest.raises(InputError, match="one label for each"):
        replace(report, cloud=report.cloud.selected(np.arange(5)))
