from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.geometry import Bounds, PointCloud
from debrisgrasp.viz import Report
from debrisgrasp.viz.colors import (
    BACKGROUND_COLOR,
    CHOSEN_COLOR,
    GROUND_COLOR,
    label_colors,
)
from debrisgrasp.viz.outline import reach_outline
from debrisgrasp.viz.overlay import label_anchors, label_image, painted
from debrisgrasp.viz.page import plain, short_name, shortened, wrapped
from debrisgrasp.viz.scene import (
    approach_arrow,
    box_edges,
    ground_grid,
    shown_ranks,
    thinned,
)
from debrisgrasp.viz.words import (
    headline,
    object_doubt,
    object_reason,
    percent,
    rejection_rows,
)

from .conftest import grasp_at


def seen_without_green(colors: np.ndarray) -> np.ndarray:
    """What remains of colours for an eye without the green receptor (Viénot 1999)."""
    to_deutan = np.array(
        [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]]
    )
    return np.clip(colors**2.2 @ to_deutan.T, 0, 1) ** (1 / 2.2)


def test_consecutive_labels_stay_apart_also_for_the_colour_blind() -> None:
    colors = label_colors(np.arange(1, 40))
    for seen in (colors, seen_without_green(colors)):
        steps = np.linalg.norm(np.diff(seen, axis=0), axis=1)
        assert steps.min() > 0.15


def test_no_label_but_the_chosen_one_is_orange() -> None:
    colors = label_colors(np.arange(0, 60), chosen=7)
    np.testing.assert_array_equal(colors[7], CHOSEN_COLOR)
    np.testing.assert_array_equal(colors[0], GROUND_COLOR)
    others = np.delete(colors, 7, axis=0)
    assert np.linalg.norm(others - CHOSEN_COLOR, axis=1).min() > 0.3


def test_every_label_is_written_inside_its_object(report: Report) -> None:
    image = label_image(report.cloud, report.labels, None)
    anchors = label_anchors(image.labels)
    assert set(anchors) == {1, 2}
    for label, (u, v) in anchors.items():
        assert image.labels[int(v), int(u)] == label


def test_objects_of_a_few_pixels_get_no_label() -> None:
    labels = np.zeros((40, 40), dtype=int)
    labels[3:5, 3:5] = 1
    assert label_anchors(labels) == {}


def test_the_chosen_object_is_outlined_and_the_ground_left_alone(
    report: Report,
) -> None:
    image = label_image(report.cloud, report.labels, None)
    out = painted(image, chosen=1)
    assert (out == CHOSEN_COLOR).all(axis=-1).sum() > 50
    np.testing.assert_array_equal(out[55], image.base[55])


def test_a_rendered_cloud_keeps_the_labels_in_place(bare_report: Report) -> None:
    image = label_image(bare_report.cloud, bare_report.labels, None)
    assert not image.from_camera
    # Seen from above the block (1) lies left of the slab (2) in both pictures.
    anchors = label_anchors(image.labels)
    assert set(anchors) == {1, 2}
    share = (image.labels == 1).sum() / (image.labels == 2).sum()
    assert share == pytest.approx(2.0 * 1.11, rel=0.2)


@pytest.mark.parametrize("n", [2, 3])
def test_a_cloud_of_a_few_points_is_rendered(n: int) -> None:
    points = np.random.default_rng(n).uniform(0.5, 1.0, (n, 3))
    cloud = PointCloud(points, np.full_like(points, np.nan), np.zeros(3))
    image = label_image(cloud, np.zeros(n, dtype=int), None)
    assert (image.base != BACKGROUND_COLOR).any()


def test_names_that_are_no_text_are_written_all_the_same() -> None:
    assert plain("$cost$ of \udcff") == r"\$cost\$ of ?"


def test_thinning_keeps_what_is_named_and_spreads_the_rest(report: Report) -> None:
    cloud = report.cloud
    keep = np.flatnonzero(report.labels == 1)
    index = thinned(cloud, 1500, keep)
    assert np.isin(keep, index).all()
    assert (np.diff(index) > 0).all()
    assert len(index) < 1700
    counts, _ = np.histogram(index, bins=8)
    assert counts.min() > 0.5 * counts.mean()


def test_a_box_has_twelve_edges_along_its_axes() -> None:
    edges = box_edges(Bounds(np.zeros(3), np.array([1.0, 2.0, 3.0])))
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    np.testing.assert_allclose(np.sort(lengths), [1] * 4 + [2] * 4 + [3] * 4)


def test_the_grid_surrounds_the_points() -> None:
    points = np.array([[0.13, -0.21, 0.4], [0.52, 0.07, 0.1]])
    ends = ground_grid(points, 0.1).reshape(-1, 3)
    np.testing.assert_allclose(ends.min(axis=0), [0.1, -0.3, 0.0], atol=1e-9)
    np.testing.assert_allclose(ends.max(axis=0), [0.6, 0.1, 0.0], atol=1e-9)


def test_the_arrow_leads_from_the_start_of_the_approach_to_the_palm() -> None:
    grasp = grasp_at(1.0, 0.9)
    arrow = approach_arrow(grasp, (0, 0, 0))
    np.testing.assert_allclose(arrow.vertices[-1], grasp.T_base_hand.p, atol=1e-9)
    np.testing.assert_allclose(arrow.vertices[0], grasp.T_base_pregrasp.p, atol=1e-9)
    # Outward winding: the enclosed volume is positive.
    a, b, c = np.moveaxis(arrow.vertices[arrow.faces], 1, 0)
    assert (a * np.cross(b, c)).sum() > 0


def test_an_approach_of_no_length_draws_no_arrow() -> None:
    grasp = grasp_at(1.0, 0.9)
    still = replace(grasp, T_base_pregrasp=grasp.T_base_hand)
    assert len(approach_arrow(still, (0, 0, 0)).faces) == 0


def test_only_grasps_that_look_different_are_drawn_together() -> None:
    places = (1.0, 1.02, 1.3, 1.31, 1.6, 2.0)
    assert shown_ranks([grasp_at(x, 0.5) for x in places]) == (0, 2, 4)
    assert shown_ranks([]) == ()


def test_the_outline_of_a_disc_is_its_circle(rng: np.random.Generator) -> None:
    xy = rng.uniform(-1, 1, size=(40_000, 2))
    xy = xy[np.hypot(*xy.T) < 0.8]
    reach = np.column_stack([xy, rng.uniform(0.2, 0.6, len(xy))])
    (line,) = reach_outline(reach, 0.4)
    np.testing.assert_array_equal(line[:, 2], 0.4)
    radius = np.hypot(line[:, 0], line[:, 1])
    np.testing.assert_allclose(radius, 0.8, atol=0.06)


def test_a_height_that_is_not_reached_has_no_outline(rng: np.random.Generator) -> None:
    assert reach_outline(rng.uniform(0, 1, size=(5000, 3)), 3.0) == []


def test_the_words_name_object_reasons_and_shares(
    report: Report, empty_report: Report
) -> None:
    assert "object 1" in headline(report)
    assert object_reason(report).startswith("Object 1, number 2 in the order")
    assert headline(empty_report) == "No grasp: 1 object considered, none offers one"
    none_tried = replace(empty_report.plan, passed_over=())
    assert "every pose would collide" in headline(
        replace(empty_report, plan=none_tried)
    )
    assert [n for _, n in rejection_rows(report.plan)] == [30, 10]
    assert percent(1, 1000).startswith("<1")
    assert percent(0, 0).startswith("0")


def test_the_words_tell_what_an_object_may_be_part_or_made_of(report: Report) -> None:
    assert "may be" not in object_reason(report)
    known = report.segmentation
    edges = replace(
        known.edges,
        labels=np.array([[1, 2], [1, 3], [2, 3]]),
        score=np.array([0.3, 0.4, 0.24]),
    )
    unsure = replace(known.segments[0], certainty=0.45)
    in_doubt = replace(known, edges=edges, segments=(unsure, *known.segments[1:]))
    assert object_reason(replace(report, segmentation=in_doubt)).endswith(
        "It may be several objects (certainty 0.45)"
        " and may be one with object 3 (0.40) or 2 (0.30)."
    )
    assert not object_doubt(replace(in_doubt, edges=known.edges), 2)


def test_long_text_is_cut_with_an_ellipsis() -> None:
    assert shortened("abcdef", 4) == "abc…"
    assert shortened("abcd", 4) == "abcd"
    assert short_name("pipe_040_end", 7) == "pip…end"
    assert short_name("pipe_04", 7) == "pipe_04"
    text = wrapped(["one two three", "four five six"], 8, 3)
    assert len(text.splitlines()) == 3
    assert text.endswith("…")
