from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from debrisgrasp.errors import (
    ConfigError,
    FrameMismatchError,
    InputError,
    OutputError,
)
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.prototypes import GripperModel, PrototypeLibrary
from debrisgrasp.viz import (
    Report,
    prototype_png,
    report_html,
    report_png,
    segmentation_png,
)
from debrisgrasp.viz.colors import CHOSEN_COLOR, HAND_COLORS

from .conftest import grasp_at, segmentation_of


def pixels(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path).convert("RGB"), dtype=float) / 255.0


def share_of_hue(image: np.ndarray, color: tuple[float, float, float]) -> float:
    """Share of pixels of the direction of a colour, whatever their brightness."""
    length = np.linalg.norm(image, axis=-1)
    cosine = image @ np.array(color) / np.maximum(length, 1e-9)
    close = (cosine / np.linalg.norm(color) > 0.99) & (length > 0.25)
    return float(close.mean())


def test_the_report_shows_the_object_and_the_hand(
    report: Report, tmp_path: Path
) -> None:
    report_png(tmp_path / "a.png", report)
    image = pixels(tmp_path / "a.png")
    assert image.shape == (1200, 1800, 3)
    assert share_of_hue(image[132:690, 30:774], CHOSEN_COLOR) > 0.002
    assert share_of_hue(image[132:690, 794:], CHOSEN_COLOR) > 0.02
    assert share_of_hue(image[132:690, 1292:], HAND_COLORS[0]) > 0.02


@pytest.mark.parametrize(
    ("rows", "columns"),
    [((8, 53), (0, 80)), ((1, 60), (5, 64)), ((10, 50), (15, 65)), ((20, 40), (0, 80))],
    ids=["16:9", "square", "5:4", "4:1"],
)
def test_the_segments_have_no_bars_beside_or_above_them(
    report: Report, tmp_path: Path, rows: tuple[int, int], columns: tuple[int, int]
) -> None:
    report_png(tmp_path / "a.png", cut_out(report, rows, columns))
    image = pixels(tmp_path / "a.png")
    # The corner that the picture takes at least, its frame aside.
    corner = image[134:316, 32:328]
    is_dark = np.abs(corner - np.array([0x21, 0x26, 0x2D]) / 255.0).max(axis=-1) < 0.02
    assert is_dark.mean() < 0.02


def cut_out(report: Report, rows: tuple[int, int], columns: tuple[int, int]) -> Report:
    """The same report from a part of the image."""
    cloud = report.cloud
    assert cloud.pixels is not None
    assert cloud.image_shape is not None
    v, u = np.divmod(cloud.pixels, cloud.image_shape[1])
    kept = (v >= rows[0]) & (v < rows[1]) & (u >= columns[0]) & (u < columns[1])
    shape = rows[1] - rows[0], columns[1] - columns[0]
    part = replace(
        cloud,
        points=cloud.points[kept],
        normals=cloud.normals[kept],
        pixels=((v - rows[0]) * shape[1] + u - columns[0])[kept],
        image_shape=shape,
    )
    segmentation = segmentation_of(report.labels[kept])
    return replace(report, cloud=part, segmentation=segmentation)


def test_equal_reports_are_equal_files(report: Report, tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        report_png(tmp_path / name, report)
    content = (tmp_path / "a.png").read_bytes()
    assert content == (tmp_path / "b.png").read_bytes()
    assert b"matplotlib" not in content.lower()


def test_an_empty_plan_shows_the_object_and_no_hand(
    empty_report: Report, tmp_path: Path
) -> None:
    report_png(tmp_path / "a.png", empty_report)
    image = pixels(tmp_path / "a.png")
    assert share_of_hue(image[132:690, 794:], CHOSEN_COLOR) > 0.02
    assert share_of_hue(image[132:690, 794:], HAND_COLORS[0]) < 1e-4


def test_a_cloud_without_an_image_is_seen_from_its_viewpoint(
    bare_report: Report, tmp_path: Path
) -> None:
    report_png(tmp_path / "a.png", bare_report)
    image = pixels(tmp_path / "a.png")
    assert share_of_hue(image[132:690, 30:774], CHOSEN_COLOR) > 0.002


def test_nothing_but_ground_can_be_drawn(empty_report: Report, tmp_path: Path) -> None:
    plan = replace(empty_report.plan, object_label=0, region=None)
    labels = np.zeros(len(empty_report.cloud), dtype=np.int32)
    report = replace(
        empty_report, plan=plan, segmentation=segmentation_of(labels), order=()
    )
    report_png(tmp_path / "a.png", report)
    assert pixels(tmp_path / "a.png").std() > 0.01


def test_the_robot_stands_where_there_is_one(
    report: Report, roman: RobotModel, tmp_path: Path
) -> None:
    joints = roman.posture("right", "ready")
    grasp = grasp_at(1.0, 0.9, arm="right", joints=joints)
    with_robot = replace(
        report, robot=roman, plan=replace(report.plan, grasps=(grasp,), robot="roman")
    )
    report_png(tmp_path / "a.png", report)
    report_png(tmp_path / "b.png", with_robot)
    first, second = pixels(tmp_path / "a.png"), pixels(tmp_path / "b.png")
    changed = np.abs(first - second).max(axis=-1)[732:1172, 30:774] > 0.1
    assert changed.mean() > 0.1


def test_names_are_never_read_as_formulas(report: Report, tmp_path: Path) -> None:
    grasps = (grasp_at(1.0, 0.9, prototype=r"$\frac{1}$ <b> & long " * 9),)
    plan = replace(report.plan, grasps=grasps, rejections={"$x_{$": 3})
    report_png(tmp_path / "a.png", replace(report, plan=plan, title="$\\bad{$"))
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_a_failed_write_leaves_the_old_file_whole(
    report: Report, tmp_path: Path
) -> None:
    target = tmp_path / "a.png"
    target.mkdir()
    (target / "inside").write_text("kept")
    with pytest.raises(OutputError):
        report_png(target, report)
    assert (target / "inside").read_text() == "kept"


def test_a_failed_drawing_leaves_the_old_file_whole(
    report: Report, tmp_path: Path
) -> None:
    target = tmp_path / "a.png"
    target.write_text("kept")
    plan = replace(report.plan, grasps=(grasp_at(1.0, 0.9, preshape="unknown"),))
    with pytest.raises(InputError, match="preshape"):
        report_png(target, replace(report, plan=plan))
    assert target.read_text() == "kept"


def test_a_picture_replaces_no_depth_image(report: Report, tmp_path: Path) -> None:
    path = tmp_path / "depth.png"
    Image.fromarray(np.ones((4, 5), np.uint16)).save(path)
    before = path.read_bytes()
    with pytest.raises(OutputError, match="depth image"):
        report_png(path, report)
    assert path.read_bytes() == before


def test_a_picture_and_a_page_are_called_so(report: Report, tmp_path: Path) -> None:
    for write in (report_png, report_html):
        with pytest.raises(ConfigError, match="a name that ends in"):
            write(tmp_path / "api.pdf", report)
    assert list(tmp_path.iterdir()) == []


def test_labels_of_another_cloud_are_refused(report: Report) -> None:
    labels = np.zeros(3, dtype=np.int32)
    with pytest.raises(InputError, match="one label for each"):
        replace(report, segmentation=segmentation_of(labels))


def test_segments_of_another_cloud_are_not_drawn(
    report: Report, tmp_path: Path
) -> None:
    other = report.cloud.selected(np.arange(5))
    with pytest.raises(InputError, match="one label for each of the 5 points"):
        segmentation_png(tmp_path / "a.png", None, other, report.segmentation)
    assert list(tmp_path.iterdir()) == []


def test_a_cloud_of_another_frame_is_refused(report: Report) -> None:
    with pytest.raises(FrameMismatchError):
        replace(report, cloud=replace(report.cloud, frame="cam"))


@pytest.mark.parametrize("n_ordered", [0, 2])
def test_the_segments_alone_can_be_drawn(
    report: Report, tmp_path: Path, n_ordered: int
) -> None:
    path = tmp_path / "a.png"
    order = report.order[:n_ordered]
    segmentation_png(path, None, report.cloud, report.segmentation, order=order)
    share = share_of_hue(pixels(path), CHOSEN_COLOR)
    assert (share > 0.002) == (n_ordered > 0)


def test_the_picture_of_segments_has_the_shape_of_its_image(
    report: Report, tmp_path: Path
) -> None:
    assert report.cloud.image_shape is not None
    rows, columns = report.cloud.image_shape
    wide = replace(report.cloud, image_shape=(rows, 2 * columns))
    heights = []
    for cloud in (report.cloud, wide):
        segmentation_png(tmp_path / "a.png", None, cloud, report.segmentation)
        heights.append(len(pixels(tmp_path / "a.png")))
    shown = [min(810, 1080 * rows // width) for width in (columns, 2 * columns)]
    assert heights[0] - heights[1] == shown[0] - shown[1] > 0


def test_a_sheet_of_prototypes_shows_hand_and_shape(
    hand: GripperModel, tmp_path: Path
) -> None:
    library = PrototypeLibrary.load()
    shown = [p for p in library if p.gripper == "robotiq_3f"][:7]
    prototype_png(tmp_path / "a.png", shown, {"robotiq_3f": hand})
    image = pixels(tmp_path / "a.png")
    assert share_of_hue(image, CHOSEN_COLOR) > 0.005
    assert share_of_hue(image, HAND_COLORS[0]) > 0.02


def test_a_sheet_of_no_prototypes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="prototypes to draw"):
        prototype_png(tmp_path / "a.png", [], {})
    assert not (tmp_path / "a.png").exists()
