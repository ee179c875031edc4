from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from debrisgrasp.errors import OutputError
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.segmentation import Candidate
from debrisgrasp.viz import Report, report_html
from tests import browser

from .conftest import grasp_at

DATA = re.compile(
    r'<script type="application/json" id="data">(.*?)</script>', re.DOTALL
)


def page(report: Report, tmp_path: Path) -> tuple[str, dict[str, Any]]:
    """The page as it was written, and the data in it."""
    report_html(tmp_path / "a.html", report)
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    (data,) = DATA.findall(text)
    return text, json.loads(data)


def decoded(text: str, dtype: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype=dtype)


def points(packed: dict[str, Any]) -> np.ndarray:
    steps = decoded(packed["at"], "<u2").reshape(-1, 3)
    return np.array(packed["low"]) + packed["step"] * steps


def test_the_page_refers_to_nothing_outside_itself(
    report: Report, tmp_path: Path
) -> None:
    text, _ = page(report, tmp_path)
    markup = DATA.sub("", text)
    assert not re.search(r"https?:|<[^>]*\ssrc\s*=|<link|@import|url\(", markup)
    assert "default-src 'none'" in markup
    assert "{{" not in markup


def test_the_table_holds_the_plan(report: Report, tmp_path: Path) -> None:
    _, data = page(report, tmp_path)
    assert len(data["grasps"]) == len(report.plan.grasps)
    for rank, (row, grasp) in enumerate(
        zip(data["grasps"], report.plan.grasps, strict=True), start=1
    ):
        assert row["rank"] == rank
        assert row["prototype"] == grasp.prototype
        assert row["Q"] == pytest.approx(grasp.Q, abs=1e-4)
        assert row["score"] == pytest.approx(grasp.score, abs=1e-4)
        np.testing.assert_allclose(row["pose"], grasp.T_base_hand.matrix, atol=1e-6)
        assert row["hand"] in data["hands"]
    assert data["chosen"] == 1
    assert data["rejections"][0] == ["the palm would hit something", 30]
    assert [label for label, _ in data["order"]] == [2, 1]


def test_a_doubt_about_the_camera_pose_is_in_the_page(
    report: Report, tmp_path: Path
) -> None:
    assert page(report, tmp_path)[1]["doubt"] == ""
    ground = replace(report.segmentation.ground, pose_doubt="gravity disagrees")
    segmentation = replace(report.segmentation, ground=ground)
    doubtful = replace(report, segmentation=segmentation)
    said = page(doubtful, tmp_path)[1]["doubt"]
    assert said == "Camera pose in doubt: gravity disagrees"


def test_points_keep_their_place_and_kind(report: Report, tmp_path: Path) -> None:
    _, data = page(report, tmp_path)
    cloud = data["cloud"]
    np.testing.assert_allclose(points(cloud), report.cloud.points, atol=2e-5)
    kinds = decoded(cloud["kinds"], "u1")
    expected = np.array([0, 2, 1])[report.labels]
    np.testing.assert_array_equal(kinds, expected)
    assert len(decoded(cloud["colors"], "u1")) == 3 * len(report.cloud)


def test_hands_are_drawn_where_the_gripper_is(
    report: Report, hand: GripperModel, tmp_path: Path
) -> None:
    _, data = page(report, tmp_path)
    mesh = data["hands"][data["grasps"][0]["hand"]]
    corners = [s.mesh()[0] for s in hand.solids("basic", 0.12)]
    np.testing.assert_allclose(points(mesh), np.concatenate(corners), atol=1e-5)
    faces = decoded(mesh["faces"], "<u4")
    assert faces.max() == len(points(mesh)) - 1


def test_each_posture_moves_the_parts_of_the_robot_to_their_place(
    report: Report, roman: RobotModel, tmp_path: Path
) -> None:
    joints = roman.posture("right", "ready")
    grasp = grasp_at(1.0, 0.9, arm="right", joints=joints)
    plan = replace(report.plan, grasps=(grasp,), robot="roman")
    _, data = page(replace(report, robot=roman, plan=plan), tmp_path)
    robot = data["robot"]
    local, owners = points(robot), decoded(robot["owners"], "<u2")
    poses = decoded(robot["postures"], "<f4").reshape(2, robot["nLinks"], 3, 4)
    parts = poses[:, owners]
    moved = (parts[..., :3] @ local[:, :, None])[..., 0] + parts[..., 3]

    rest = np.concatenate([s.mesh()[0] for _, s in roman.links_solids()])
    np.testing.assert_allclose(moved[0], rest, atol=1e-4)
    hidden = roman.tree.links_below(roman.arm("right").hand)
    solids = roman.links_solids(joints)
    in_place = np.concatenate([s.mesh()[0] for _, s in solids])
    is_hidden = np.concatenate(
        [np.full(len(s.mesh()[0]), link in hidden) for link, s in solids]
    )
    np.testing.assert_allclose(moved[1][~is_hidden], in_place[~is_hidden], atol=1e-4)
    np.testing.assert_array_equal(moved[1][is_hidden], 0.0)
    assert data["lines"]["reach"]["right"]["at"]


def test_names_can_not_become_markup(report: Report, tmp_path: Path) -> None:
    evil = "</script><img src=x onerror=alert(1)>{{data}}<!--"
    plan = replace(
        report.plan,
        grasps=(grasp_at(1.0, 0.9, prototype=evil),),
        rejections={evil: 3},
    )
    order = (Candidate(1, 0.1, evil),)
    text, data = page(replace(report, plan=plan, title=evil, order=order), tmp_path)
    assert "<img src=x" not in text
    assert data["grasps"][0]["prototype"] == evil
    assert data["title"] == evil
    assert "&lt;/script&gt;" in text


def test_the_script_never_sets_markup_from_data() -> None:
    from importlib.resources import files

    folder = files("debrisgrasp.viz") / "assets"
    for name in ("report.js", "viewer.js"):
        code = (folder / name).read_text()
        assert not re.search(
            r"innerHTML|outerHTML|insertAdjacent|document\.write", code
        )


def test_equal_reports_are_equal_pages(report: Report, tmp_path: Path) -> None:
    assert page(report, tmp_path)[0] == page(report, tmp_path)[0]


def test_an_empty_plan_says_why(empty_report: Report, tmp_path: Path) -> None:
    _, data = page(empty_report, tmp_path)
    assert data["grasps"] == []
    assert data["headline"].startswith("No grasp: 1 object considered")
    assert data["passedOver"] == ["Object 2 passed over: too small"]


def test_a_cloud_without_an_image_is_shown(bare_report: Report, tmp_path: Path) -> None:
    _, data = page(bare_report, tmp_path)
    assert not data["image"]["fromCamera"]
    assert {label for label, *_ in data["image"]["labels"]} == {1, 2}


def test_a_hand_that_is_not_given_leaves_its_arrow(
    report: Report, tmp_path: Path
) -> None:
    _, data = page(replace(report, grippers={}), tmp_path)
    assert data["hands"] == {}
    assert len(points(data["grasps"][0]["arrow"])) > 0


def test_a_failed_write_leaves_the_old_file_whole(
    report: Report, tmp_path: Path
) -> None:
    target = tmp_path / "missing" / "a.html"
    with pytest.raises(OutputError):
        report_html(target, report)
    assert not target.parent.exists()
    folder = tmp_path / "b.html"
    folder.mkdir()
    with pytest.raises(OutputError):
        report_html(folder, report)
    assert folder.is_dir()


@pytest.mark.skipif(browser.chromium() is None, reason="needs Chromium and playwright")
def test_long_names_and_many_labels_keep_to_a_small_screen(
    report: Report, tmp_path: Path
) -> None:
    grasps = tuple(replace(g, prototype="a_long_name_" * 9) for g in report.plan.grasps)
    report_html(
        tmp_path / "a.html", replace(report, plan=replace(report.plan, grasps=grasps))
    )
    with browser.opened(390, 844) as view:
        view.goto((tmp_path / "a.html").as_uri())
        view.evaluate(
            """() => {
                const mark = find("picture").querySelector("span");
                find("picture").append(mark.cloneNode(true));
                thinLabels();
            }"""
        )
        assert view.evaluate("document.documentElement.scrollWidth") <= 390
        shown = (
            "[...find('picture').querySelectorAll('span')].map(s => s.style.visibility)"
        )
        assert view.evaluate(shown)[-1] == "hidden"
        assert view.evaluate(shown)[0] == ""


@pytest.mark.skipif(browser.chromium() is None, reason="needs Chromium and playwright")
def test_a_page_without_grasps_offers_no_next_one(
    report: Report, empty_report: Report, tmp_path: Path
) -> None:
    with browser.opened() as view:
        for some, is_offered in ((report, True), (empty_report, False)):
            report_html(tmp_path / "a.html", some)
            view.goto((tmp_path / "a.html").as_uri())
            assert view.get_by_text("next grasp").is_visible() == is_offered


@pytest.mark.skipif(browser.chromium() is None, reason="needs Chromium and playwright")
def test_a_browser_without_webgl_is_offered_nothing_that_needs_it(
    report: Report, tmp_path: Path
) -> None:
    report_html(tmp_path / "a.html", report)
    with browser.opened() as view:
        view.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
        view.goto((tmp_path / "a.html").as_uri())
        assert view.get_by_text("This browser offers no WebGL 2").is_visible()
        for name in ("bar", "hint", "canvas"):
            assert view.locator(f"#{name}").is_hidden()


@pytest.mark.skipif(browser.chromium() is None, reason="needs Chromium and playwright")
def test_all_objects_in_the_order_are_printed(report: Report, tmp_path: Path) -> None:
    report_html(tmp_path / "a.html", report)
    with browser.opened() as view:
        view.goto((tmp_path / "a.html").as_uri())
        view.evaluate(
            "find('order').append(...[...Array(60)].map(() =>"
            " find('order').rows[0].cloneNode(true)))"
        )
        view.emulate_media(media="print")
        box = "find('order-box').scrollHeight - find('order-box').clientHeight"
        assert view.evaluate(box) <= 1
