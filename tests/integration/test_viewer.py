"""The viewer as a person meets it: from the command line, and in a browser."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from urllib.request import urlopen

import pytest

import debrisgrasp
import debrisgrasp.viewer
from debrisgrasp.cli.program import run
from debrisgrasp.io import Capture, data_path

pytest.importorskip("viser")
PILE = str(data_path("captures", "pile.npz"))


def _take_interrupts() -> None:
    """Jobs in the background of a shell are started deaf to them."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def test_the_command_serves_until_it_is_interrupted():
    command = [sys.executable, "-m", "debrisgrasp", "view", PILE, "--port", "0"]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=_take_interrupts,
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


def test_a_click_on_a_grasp_shows_its_figures():
    """In Chromium, where it and playwright are installed."""
    playwright = pytest.importorskip("playwright.sync_api")
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("no Chromium")
    result = debrisgrasp.plan(Capture.load(PILE), object_label=5)
    options = ["--no-sandbox"] if os.geteuid() == 0 else []
    options += ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    viewer = debrisgrasp.viewer.show(result)
    with viewer, playwright.sync_playwright() as kit:
        browser = kit.chromium.launch(executable_path=chromium, args=options)
        page = browser.new_page(viewport={"width": 800, "height": 500})
        page.set_default_timeout(120_000)
        page.goto(viewer.url)
        page.get_by_text("Grasp 1:").first.wait_for()
        page.get_by_role("button", name="2 Q").first.click()
        grasp = result.plan.grasps[1]
        page.get_by_text(f"Grasp 2: {grasp.prototype}").first.wait_for()
        page.get_by_text(f"{grasp.Q:.3f} = {grasp.S:.3f}").first.wait_for()
        page.get_by_role("tab", name="Ruled out").click()
        page.get_by_role("button", name="show", exact=True).click()
        page.get_by_text("pose 1 of").first.wait_for()
        browser.close()
