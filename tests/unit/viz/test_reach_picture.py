from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from debrisgrasp.errors import OutputError
from debrisgrasp.geometry import Bounds
from debrisgrasp.kinematics import APPROACHES, ReachSurvey, RobotModel
from debrisgrasp.viz import ReachPicture, reach_html, reach_png
from debrisgrasp.viz.page import Page
from debrisgrasp.viz.reach import half_metres

COUNT = sum(len(a.directions) for a in APPROACHES)


def _survey(name: str, places: np.ndarray, can: np.ndarray) -> ReachSurvey:
    free = np.repeat(can[:, None], COUNT, axis=1)
    return ReachSurvey(
        arm=name,
        gripper="any",
        places=places,
        approaches=APPROACHES,
        kind=np.repeat(np.arange(3), [len(a.directions) for a in APPROACHES]),
        is_reached=free,
        is_free=free,
    )


@pytest.fixture(scope="module")
def picture() -> ReachPicture:
    axes = [np.arange(0.5, 1.3, 0.2), np.arange(-0.6, 0.7, 0.2), np.array([0.0, 0.4])]
    level = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    upright = level[np.abs(level[:, 1]) < 0.1]

    def both(places: np.ndarray) -> tuple[ReachSurvey, ...]:
        return (
            _survey("right", places, places[:, 1] < 0.25),
            _survey("left", places, places[:, 1] > -0.25),
        )

    return ReachPicture(
        title="A <robot> & $its reach",
        summary="made up",
        robot=RobotModel.load("roman"),
        level=both(level),
        upright=both(upright),
        region=Bounds(np.array([0.7, -0.2, 0.0]), np.array([1.1, 0.2, 0.3])),
        rows=[["arm", "approach", "places", "free", "directions", "within"]]
        + [["right", "top-down", "50 %", "50 %", "50 %", "x 0 to 1"]] * 3,
    )


def test_a_picture_shows_each_arm_in_its_colour(
    picture: ReachPicture, tmp_path: Path
) -> None:
    path = tmp_path / "reach.png"
    reach_png(path, picture)
    with Image.open(path) as image:
        colors = np.asarray(image.convert("RGB")).reshape(-1, 3) / 255.0
    assert len(colors) == 1800 * 1160
    for wanted in ((0.10, 0.38, 0.77), (0.80, 0.38, 0.06), (0.05, 0.50, 0.34)):
        assert (np.abs(colors - wanted).max(axis=1) < 0.02).sum() > 2000


def test_the_name_of_an_arm_runs_into_nothing(
    picture: ReachPicture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "MANIPULATOR_of_the_right_side"
    level = tuple(replace(survey, arm=name) for survey in picture.level)
    rows = [picture.rows[0], [name, *picture.rows[1][1:]]]
    pages: list[Page] = []
    monkeypatch.setattr(Page, "write", lambda page, _: pages.append(page))
    reach_png(tmp_path / "reach.png", replace(picture, level=level, rows=rows))
    panels = pages[0].figure.axes
    (table,) = (a for a in panels if any(t.get_text() == "within" for t in a.texts))
    cells = [text.get_window_extent() for text in table.texts[6:8]]
    assert cells[0].x1 < cells[1].x0
    (legend,) = (a for a in panels if any("both" in t.get_text() for t in a.texts))
    for text, square in zip(legend.texts, legend.patches, strict=True):
        assert square.get_window_extent().x1 < text.get_window_extent().x0


def test_what_either_arm_can_do_is_named_whole(
    picture: ReachPicture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = [picture.rows[0], ["right or left", *picture.rows[1][1:]]]
    pages: list[Page] = []
    monkeypatch.setattr(Page, "write", lambda page, _: pages.append(page))
    reach_png(tmp_path / "reach.png", replace(picture, rows=rows))
    texts = [text for axes in pages[0].figure.axes for text in axes.texts]
    assert any(text.get_text() == "right or left" for text in texts)


def test_equal_pictures_give_equal_files(picture: ReachPicture, tmp_path: Path) -> None:
    for name in ("a", "b"):
        reach_png(tmp_path / f"{name}.png", picture)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_page_holds_picture_and_table_and_escapes_names(
    picture: ReachPicture, tmp_path: Path
) -> None:
    path = tmp_path / "reach.html"
    reach_html(path, picture)
    page = path.read_text()
    assert "A &lt;robot&gt; &amp; $its reach" in page
    assert page.count("<td>right</td>") == 3
    assert "http" not in page
    with pytest.raises(OutputError):
        reach_html(tmp_path / "none" / "reach.html", picture)


def test_lines_of_the_maps_have_no_negative_zero():
    assert [f"{x:g}" for x in half_metres(-0.4, 1.1)] == ["0", "0.5", "1"]
    assert [f"{x:g}" for x in half_metres(-1.0, 0.5)] == ["-1", "-0.5", "0"]
