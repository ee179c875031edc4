"""The picture of a calibration is written whole; the page to pick in computes right."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from debrisgrasp.calibration import calibrate
from debrisgrasp.errors import OutputError
from debrisgrasp.geometry import SE3, Intrinsics
from debrisgrasp.io import Capture
from debrisgrasp.viz.calibration import (
    CalibrationPicture,
    Suggestion,
    calibration_png,
)
from debrisgrasp.viz.pick import PickView, pick_html
from tests.unit.calibration.looks import PLACES, looks

GREEN, RED = (29, 127, 78), (192, 57, 43)


def pixels(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path).convert("RGB"))


def has_color(image: np.ndarray, color: tuple[int, int, int]) -> bool:
    return bool((np.abs(image.astype(int) - color).max(axis=-1) <= 2).any())


def test_an_accepted_calibration_is_drawn(tmp_path, rng):
    found = calibrate(looks(noise=0.002, rng=rng))
    calibration_png(
        tmp_path / "c.png", CalibrationPicture(title="T", calibration=found)
    )
    image = pixels(tmp_path / "c.png")
    head = image[:60, image.shape[1] // 2 :]
    assert has_color(head, GREEN)
    assert not has_color(head, RED)


def test_a_refused_one_with_many_looks_and_suggestions_is_drawn(tmp_path, rng):
    near = PLACES[1] + rng.uniform(-0.05, 0.05, (40, 3))
    names = tuple(f"a very long name ${i}_{{" for i in range(40))
    found = calibrate(looks(near, noise=0.0025, rng=rng, names=names))
    suggestion = Suggestion(name="look_1", place=(1.0, 0.2, 0.3), rms_after=0.004)
    picture = CalibrationPicture(
        title="$T",
        calibration=found,
        suggestions=(suggestion,) * 6,
        change="moved a little",
    )
    calibration_png(tmp_path / "c.png", picture)
    assert has_color(pixels(tmp_path / "c.png")[:60], RED)


def test_equal_calibrations_give_equal_pictures(tmp_path):
    picture = CalibrationPicture(title="T", calibration=calibrate(looks()))
    for name in ("a.png", "b.png"):
        calibration_png(tmp_path / name, picture)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_place_that_does_not_exist_is_refused(tmp_path):
    picture = CalibrationPicture(title="T", calibration=calibrate(looks()))
    with pytest.raises(OutputError):
        calibration_png(tmp_path / "no" / "c.png", picture)


CAMERA = Intrinsics(fx=200.0, fy=200.0, cx=79.5, cy=59.5, width=160, height=120)
TARGET = np.array([0.1, -0.05, 1.0])


@pytest.fixture
def page(tmp_path) -> Path:
    """Page with one capture: a plane at 1 m, no depth around the target."""
    depth = np.full((120, 160), 1.0)
    (u, v), _ = CAMERA.project(TARGET)
    rows, columns = np.indices(depth.shape)
    depth[np.hypot(columns - u, rows - v) < 3] = 0.0
    depth[:, :20] = 0.0
    capture = Capture(depth=depth, intrinsics=CAMERA, T_base_camera=SE3.identity())
    path = tmp_path / "pick.html"
    views = [
        PickView(capture=capture, observation={"name": name, "joints": {}})
        for name in ("</script>", "second")
    ]
    pick_html(path, views, header={"schema": "s"})
    return path


def test_the_page_is_closed_in_itself(page):
    text = page.read_text()
    assert "http" not in text.split("</head>")[1]
    assert text.count("</script>") == 3


DRIVER = """
const fs = require("fs"), text = fs.readFileSync(process.argv[2], "utf8");
const between = (a, b) => text.split(a)[1].split(b)[0];
const data = between('id="data">', "</script>");
const parts = text.split("<script>").slice(1).map((t) => t.split("</script>")[0]);
const made = () => new Proxy(function () {}, {
  get: (t, k) => k in t ? t[k] : k === "tBodies" ? [made()] : made(),
  set: (t, k, v) => { t[k] = v; return true; },
  apply: () => made(),
});
const items = {};
global.document = {
  getElementById: (id) =>
    id === "data" ? { textContent: data } : (items[id] ??= made()),
  querySelectorAll: () => [], createElement: made,
};
global.window = {}; global.ResizeObserver = class { observe() {} };
global.requestAnimationFrame = () => 1;
(0, eval)(parts.join("\\n") + `
  pickInPicture(5, 60);
  const empty = [find("picked").textContent, current];
  pickInPicture(PIXEL);
  const after = [find("picked").textContent, current];
  pickInPicture(PIXEL);
  const said = { empty, after, last: current, file: fileText() };
  process.stdout.write(JSON.stringify(said));`);
"""


@pytest.mark.skipif(shutil.which("node") is None, reason="needs node")
def test_a_click_in_the_picture_gives_the_place(page, tmp_path):
    (u, v), _ = CAMERA.project(TARGET)
    driver = tmp_path / "driver.js"
    driver.write_text(DRIVER.replace("PIXEL", f"{u}, {v}"))
    done = subprocess.run(
        ["node", str(driver), str(page)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert said["empty"] == ["no depth here: hardly any within 6 pixels", 0]
    assert said["after"][0].startswith("</script>:   x 0.1")
    assert said["after"][1] == said["last"] == 1  # on to the next look, there it ends
    content = json.loads(said["file"])
    assert content["schema"] == "s"
    assert [o["name"] for o in content["observations"]] == ["</script>", "second"]
    for observation in content["observations"]:
        assert observation["point"] == pytest.approx(TARGET, abs=2e-3)
