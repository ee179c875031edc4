"""The page of a run, from the events of its record."""

from __future__ import annotations

from debrisgrasp.executive.record import MemoryRecord
from debrisgrasp.viz.run import run_html

END = {"event": "end", "end": "cleared", "removed": 0, "class": "success", "left": {}}


def page_of(tmp_path, *events) -> str:
    run_html(tmp_path / "run.html", MemoryRecord({"seed": 3}, [*events, END]))
    return (tmp_path / "run.html").read_text()


def states(*names):
    return [
        {"event": "state", "state": name, "time": 10.0 * k}
        for k, name in enumerate(names)
    ]


def test_a_run_without_attempts_has_no_heading_for_them(tmp_path):
    page = page_of(tmp_path, *states("capture", "select", "safe_stop"))
    assert "Timeline" in page
    assert "Attempts" not in page


def test_the_key_names_what_the_timeline_shows_and_nothing_else(tmp_path):
    page = page_of(tmp_path, *states("capture", "approach", "lift"))
    key = page.split('class="key"')[1].split("</p>")[0]
    assert [name for name in ("look", "grasp", "plan", "recover") if name in key] == [
        "look",
        "grasp",
    ]
    assert "fault" not in key


def test_a_fault_has_one_colour_in_the_picture_and_in_the_key(tmp_path):
    fault = {
        "event": "fault", "fault": "empty_grip", "state": "close", "time": 5.0,
        "message": "nothing", "action": "next",
    }  # fmt: skip
    page = page_of(tmp_path, *states("capture", "close", "retreat"), fault)
    color = page.split("42l5 10h-10z")[1].split('fill="')[1][:7]
    assert f'<b style="color:{color}">' in page


def test_what_was_judged_by_size_is_not_taken_for_the_grip(tmp_path):
    chosen = {
        "event": "done", "state": "select", "object": 4, "centroid": [0.9, 0.0, 0.1],
        "why_it": "it is free", "way": "pinch", "why_so": "9 cm thin",
    }  # fmt: skip
    planned = {
        "event": "done", "state": "plan_motion", "prototype": "bar", "arm": "left",
        "gripper": "camhand", "preshape": "claw", "score": 0.9,
    }  # fmt: skip
    page = page_of(
        tmp_path, *states("capture", "close"), chosen, planned,
        {"event": "attempt", "number": 1, "removed": True},
    )  # fmt: skip
    assert "what suits it: pinch; 9 cm thin" in page
    assert "gripped by bar (camhand claw) with the left arm, score 0.90" in page


def test_the_forces_of_an_attempt_have_a_time_axis(tmp_path):
    trace = {"event": "trace", "rows": [[3.0, 10.0, 1.0], [23.0, 60.0, 5.0]]}
    page = page_of(
        tmp_path, *states("capture", "lift"), trace,
        {"event": "attempt", "number": 1, "removed": True},
    )  # fmt: skip
    forces = page.split('viewBox="0 0 560')[1].split("</svg>")[0]
    assert [f">{t} s<" in forces for t in (2, 10, 18, 20)] == [True, True, True, False]
