"""The viewer as a person meets it: from the command line, and in a browser."""

from __future__ import annotations

import signal
import subprocess
import sys
from urllib.request import urlopen

import numpy as np
import pytest

import debrisgrasp
import debrisgrasp.viewer
from debrisgrasp.cli.program import run
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.io import Capture, data_path
from tests import browser
from tests.interrupts import take_interrupts

pytest.importorskip("viser")
PILE = str(data_path("captures", "pile.npz"))


def test_the_command_serves_until_it_is_interrupted():
    command = [sys.executable, "-m", "debrisgrasp", "view", PILE, "--port", "0"]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=take_interrupts,
    ) as process:
        line = process.stdout.readline()
        assert line.startswith("open http://localhost:"), process.stderr.read()
        with urlopen(line.split()[1]) as answer:
            assert answer.status == 200
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["absent.npz"], "no such file"),
        ([PILE, "--port", "99999"], "65535"),
        ([PILE, "--plan", "--motion", "m.json", "--object", "5"], "beside --plan"),
        (["grasps.json"], "--capture"),
    ],
)
def test_bad_input_is_told(words, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if words[0] == "grasps.json":
        result = debrisgrasp.plan(Capture.load(PILE), robot="none", gripper="camhand")
        result.save("grasps.json")
    assert run(["view", *words]) == 2
    assert said in capsys.readouterr().err


@pytest.fixture(scope="module")
def result():
    return debrisgrasp.plan(Capture.load(PILE), object_label=5, advise=True)


@pytest.fixture
def opened():
    if browser.chromium() is None:
        pytest.skip("needs Chromium and playwright")
    return browser.opened


def test_clicks_show_grasps_rejections_and_motion(opened, result):
    motions = debrisgrasp.plan_motion(result)
    with debrisgrasp.viewer.show(result, motions=motions) as viewer, opened() as page:
        page.goto(viewer.url)
        page.get_by_text("Grasp 1:").first.wait_for()
        page.get_by_text("Of the poses ruled out:").first.wait_for()
        grasp = result.plan.grasps[1]
        # The list is in the order of the scores.
        page.get_by_role("button", name=f"2. score {grasp.score:.2f}").first.click()
        page.get_by_text(f"Grasp 2: {grasp.prototype}").first.wait_for()
        page.get_by_text(f"{grasp.Q:.3f} = {grasp.S:.3f}").first.wait_for()
        page.get_by_role("tab", name="Ruled out").click()
        page.get_by_role("button", name="show", exact=True).click()
        page.get_by_text("pose 1 of").first.wait_for()
        page.get_by_role("tab", name="Motion").click()
        page.get_by_role("button", name="play").click()
        page.get_by_text("reach").first.wait_for()
        page.get_by_role("button", name="pause").click()


def test_a_click_on_a_pin_shows_what_the_hand_would_hit(opened, result):
    ruled_out = result.plan.ruled_out
    with debrisgrasp.viewer.show(result) as viewer, opened() as page:
        page.goto(viewer.url)
        page.get_by_role("tab", name="Ruled out").click()
        page.get_by_role("button", name="show", exact=True).click()
        page.get_by_text("pose 1 of").first.wait_for()
        reason = viewer.view.rejected.why.content.split("**")[1]
        rows = np.flatnonzero(ruled_out.code == ruled_out.reasons.index(reason))
        middles = SE3(ruled_out.Ts[rows]).apply(np.array([0.0, 0.0, -0.025]))
        for x, y in on_screen(viewer, page, middles)[3:]:
            page.mouse.click(x, y)
            page.wait_for_timeout(800)
            if "pose 1 of" not in viewer.view.rejected.why.content:
                break
        assert "pose 1 of" not in viewer.view.rejected.why.content
        assert reason in viewer.view.rejected.why.content


def test_a_prototype_is_recorded_with_the_mouse(opened, tmp_path):
    capture = Capture.load(PILE)
    with debrisgrasp.viewer.show(capture) as viewer, opened() as page:
        page.goto(viewer.url)
        page.get_by_role("tab", name="Record").click()
        panel = viewer.view.recording
        # A piece: the object, less what is outside a box that is drawn over it.
        choose(page, "piece", "object 6")
        page.get_by_text("points").first.wait_for()
        n_whole = int(panel.note.content.split()[0])
        page.get_by_role("button", name="cut out").click()
        page.get_by_text("now drag a box").first.wait_for()
        own = capture.cloud().points[viewer.view.recording._inside]
        low, high = np.percentile(on_screen(viewer, page, own), [4, 96], axis=0)
        drag(page, low, high)
        page.wait_for_timeout(500)
        assert 0.5 * n_whole < int(panel.note.content.split()[0]) < n_whole
        # A pose: the best proposal, then dragged along one of its arrows.
        page.get_by_role("button", name="propose").click()
        page.get_by_text("the best is shown").first.wait_for()
        page.wait_for_timeout(1000)
        start = panel._T_base_hand()
        for axis in np.eye(3):
            tip = start.apply(np.stack([0.0 * axis, 0.15 * axis]))
            middle, at = on_screen(viewer, page, tip)
            drag(page, at, at + 12.0 * (at - middle) / np.linalg.norm(at - middle))
            if np.linalg.norm(panel._T_base_hand().p - start.p) > 1e-3:
                break
        assert np.linalg.norm(panel._T_base_hand().p - start.p) > 1e-3
        choose(page, "pose", panel.pose.options[0])
        page.wait_for_timeout(500)
        assert np.allclose(panel._T_base_hand().p, start.p, atol=1e-6)
        for box, text in ((panel.name, "grey_part"), (panel.folder, str(tmp_path))):
            page.locator(f'input[value="{box.value}"]').first.fill(text)
            page.wait_for_timeout(500)
        page.get_by_role("button", name="save").click()
        page.get_by_text("wrote").first.wait_for()
    plan = debrisgrasp.plan(capture, object_label=6, prototypes=tmp_path).plan
    assert plan.grasps
    assert plan.grasps[0].prototype == "grey_part"


def on_screen(viewer, page, points):
    """Where the camera of the only client shows points [pixels], shape (n, 2)."""
    (client,) = viewer.server.get_clients().values()
    camera = client.camera
    R = so3.from_quat_wxyz(np.asarray(camera.wxyz))
    x, y, z = ((points - camera.position) @ R).T
    box = page.locator("canvas").first.bounding_box()
    scale = 0.5 * box["height"] / np.tan(camera.fov / 2)
    u = box["x"] + box["width"] / 2 + scale * x / z
    return np.column_stack([u, box["y"] + box["height"] / 2 + scale * y / z])


def drag(page, start, end):
    page.mouse.move(*start)
    page.wait_for_timeout(300)
    page.mouse.down()
    for share in (0.3, 0.6, 1.0):
        page.mouse.move(*(start + share * (end - start)))
        page.wait_for_timeout(200)
    page.mouse.up()
    page.wait_for_timeout(500)


def choose(page, label, option):
    page.get_by_label(label).first.click()
    page.get_by_role("option", name=option, exact=True).first.click()
