"""The page of a run, from the events of its record."""

from __future__ import annotations

import base64
import io
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from debrisgrasp.errors import ConfigError
from debrisgrasp.executive.record import MemoryRecord
from debrisgrasp.io import Capture, data_path
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.viz.run import run_html
from debrisgrasp.viz.run_map import map_svg

EXAMPLES = Path(__file__).parents[3] / "examples"
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


def test_a_record_without_states_is_an_empty_page(tmp_path):
    run_html(tmp_path / "run.html", MemoryRecord())
    assert "without an end of the run" in (tmp_path / "run.html").read_text()
    assert "Timeline" in page_of(tmp_path)


def test_the_key_names_what_the_timeline_shows_and_nothing_else(tmp_path):
    page = page_of(tmp_path, *states("capture", "approach", "lift"))
    key = page.split('class="key"')[1].split("</p>")[0]
    assert [name for name in ("look", "grasp", "plan", "recover") if name in key] == [
        "look",
        "grasp",
    ]
    assert "fault" not in key


def test_times_and_peaks_can_be_read_on_a_narrow_screen(tmp_path):
    rows = [[0.1 * k, 30.0 if k == 5 else 2.0, 1.5] for k in range(100)]
    page = page_of(
        tmp_path,
        *states("capture", "close", "retreat"),
        {"event": "trace", "state": "close", "rows": rows},
        {"event": "attempt", "number": 1, "removed": False},
    )
    # Texts in a picture shrink with it.
    assert "<text" not in page
    assert re.findall(r'<span style="left:([\d.]+)%">(\d+) s<', page)[:2] == [
        ("10.00", "2"),
        ("20.00", "4"),
    ]
    assert "at most 30 N (full height 150 N)" in page
    assert "at most 2 N m (full height 40 N m)" in page


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


def test_an_object_is_named_with_its_look(tmp_path):
    chosen = {
        "event": "done", "state": "select", "object": 1, "centroid": [0.9, 0.0, 0.1],
        "why_it": "it is free", "way": "pinch", "why_so": "9 cm thin",
    }  # fmt: skip
    attempts = []
    for number in (1, 2):
        attempts.append({**chosen, "look": number})
        attempts.append({"event": "attempt", "number": number, "removed": True})
    page = page_of(tmp_path, *states("capture", "close"), *attempts)
    assert "object 1 of look 1 at" in page
    assert "object 1 of look 2 at" in page


def test_the_forces_of_an_attempt_are_at_the_times_of_the_timeline(tmp_path):
    trace = {"event": "trace", "rows": [[3.0, 10.0, 1.0], [23.0, 60.0, 5.0]]}
    page = page_of(
        tmp_path, *states("capture", "lift"), trace,
        {"event": "attempt", "number": 1, "removed": True},
    )  # fmt: skip
    forces = page.split('viewBox="0 0 560')[1].split("</svg>")[1].split("</div>")[0]
    assert [f">{t} s<" in forces for t in (2, 4, 12, 22)] == [False, True, True, True]
    assert 'left:5.00%">4 s<' in forces


def test_the_page_counts_from_the_begin_of_the_run_whatever_the_clock_said(tmp_path):
    def page(begun):
        seen = states("capture", "lift")
        trace = {"event": "trace", "rows": [[3.0, 10.0, 1.0], [23.0, 60.0, 5.0]]}
        fault = {"event": "fault", "fault": "slip", "state": "lift", "time": 9.0}
        fault |= {"message": "slipped", "action": "next"}
        rows = [[time + begun, *felt] for time, *felt in trace["rows"]]
        events = [{**e, "time": e["time"] + begun} for e in (*seen, fault)]
        last = {"event": "attempt", "number": 1, "removed": False}
        return page_of(tmp_path, *events, {**trace, "rows": rows}, last)

    assert page(1234567.0) == page(0.0)


def test_no_force_is_drawn_where_none_was_read(tmp_path):
    page = page_of(
        tmp_path,
        *states("capture", "lift"),
        {"event": "trace", "rows": [[0.0, 10.0, 1.0], [1.0, 10.0, 1.0]]},
        {"event": "trace", "rows": [[9.0, 60.0, 5.0], [10.0, 60.0, 5.0]]},
        {"event": "attempt", "number": 1, "removed": True},
    )
    curves = re.findall(r'<polyline points="([^"]*)"', page)
    assert len(curves) == 4
    assert curves[0] == "0.0,103.3 56.0,103.3"
    assert curves[1] == "504.0,70.0 560.0,70.0"


def test_a_reading_that_was_no_number_is_left_out_of_the_forces(tmp_path):
    rows = [[0.0, 10.0, 1.0], [0.5, None, None], [1.0, 10.0, 1.0]]
    page = page_of(
        tmp_path,
        *states("capture", "lift"),
        {"event": "trace", "rows": [[None, None, None]]},
        {"event": "trace", "rows": rows},
        {"event": "attempt", "number": 1, "removed": True},
    )
    assert "nan" not in page
    assert '<polyline points="0.0,103.3 560.0,103.3"' in page


@pytest.mark.parametrize(
    "damaged",
    [
        {"event": "done", "state": "self_test", "left": {"drop_off": "x"}},
        {"event": "done", "state": "self_test", "left": {"drop_off": ["a", []]}},
        {"event": "fault", "fault": "slip"},
        {"event": "state", "state": "lift", "time": None},
    ],
)
def test_a_record_with_odd_values_is_refused_and_named(tmp_path, damaged):
    attempt = {"event": "attempt", "number": 1, "removed": True}
    with pytest.raises(ConfigError, match=r"^record: got .* the record of a run"):
        page_of(tmp_path, *states("capture"), damaged, attempt)
    assert not list(tmp_path.glob("*.html"))


def test_drop_offs_and_what_was_put_down_are_shown_from_above(tmp_path):
    tested = {
        "event": "done", "state": "self_test",
        "right": {"drop_off": [0.25, -0.75]}, "left": {"drop_off": [0.25, 0.75]},
    }  # fmt: skip
    let_go = {"event": "done", "state": "release", "place": [0.2, 0.7, 0.1]}
    page = page_of(
        tmp_path, *states("self_test", "release"), tested, let_go,
        {"event": "attempt", "number": 1, "removed": True},
        {"event": "done", "state": "select", "moved": 0.1}, let_go,
    )  # fmt: skip
    above = page.split("From above")[1].split("</svg>")[0]
    for arm, x in (("right", 352), ("left", 128)):
        assert f'<circle cx="{x}" cy="278" r="38"' in above
        assert f"drop-off, {arm} arm" in above
    # The base went 10 cm ahead before the second.
    for number, y in ((1, 285), (2, 270)):
        assert f'<circle cx="135" cy="{y}" r="9"' in above
        assert f">{number}</text>" in above


def test_where_an_object_was_gripped_can_be_found_by_its_coordinates(tmp_path):
    tried = {"event": "attempt", "removed": False, "centroid": [1.0, 0.5, 0.1]}
    page = page_of(
        tmp_path, *states("select"),
        {**tried, "number": 1, "prototype": "bar", "arm": "right"},
        {**tried, "number": 2, "prototype": None},
        {"event": "done", "state": "release", "place": [0.2, 0.7, 0.1]},
    )  # fmt: skip
    above = page.split("From above")[1].split("</svg>")[0]
    row, column = (
        re.search(rf'<path d="{pattern}"', above)[1]
        for pattern in (r"M0 ([\d.]+)H\d+", r"M([\d.]+) 0V\d+")
    )
    assert float(row) > 0
    assert float(column) >= 0
    (y,) = re.findall(r'y="(\d+)">x 1<', above)
    (x,) = re.findall(r'x="(\d+)" y="13" text-anchor="middle">y 0.5<', above)
    # The second attempt came to no grip.
    (at,) = re.findall(r'<circle cx="(\d+)" cy="(\d+)" r="9" fill="#2c4f9e"', above)
    assert at == (x, str(int(y) - 4))


def test_the_page_says_first_what_ended_the_run(tmp_path):
    fault = {
        "event": "fault", "state": "lift", "fault": "slip", "time": 2.0,
        "message": "the <grip> is lost", "action": "abort",
    }  # fmt: skip
    path = tmp_path / "aborted.html"
    end = {**END, "end": "aborted", "class": "bad_grasp"}
    run_html(path, MemoryRecord({"seed": 3}, [*states("lift"), fault, end]))
    head = path.read_text().split("<h2>")[0]
    assert "ended by slip in lift: the &lt;grip&gt; is lost" in head
    assert "ended by" not in page_of(tmp_path, *states("lift"), fault)


def test_what_was_pushed_is_shown_from_above_and_counted(tmp_path):
    pose = np.eye(4)
    pose[:3, 3] = [0.9, 0.2, 0.1]
    push = {
        "event": "done", "state": "push", "pushed": 0.2, "arm": "left",
        "gripper": "camhand", "preshape": "claw", "opening": 0.0,
        "pose": pose.tolist(), "way": [0.0, 0.5, 0.0],
    }  # fmt: skip
    attempt = {
        "event": "attempt", "number": 1, "removed": False, "pushed": 0.2,
        "centroid": [0.9, 0.3, 0.1],
    }  # fmt: skip
    drop_off = {"event": "done", "state": "self_test", "left": {"drop_off": [0.2, 0.7]}}
    end = {**END, "pushed": 1}
    run_html(
        tmp_path / "run.html",
        MemoryRecord({"seed": 3}, [*states("push"), drop_off, push, attempt, end]),
    )
    page = (tmp_path / "run.html").read_text()
    assert "1 time pushed aside, 0 removed" in page
    assert "pushed aside by 20 cm" in page
    assert "pushed to the left with the closed hand (camhand) of the left arm" in page
    above = page.split("From above")[1].split("</svg>")[0]
    # 20 cm are 30 widths; left of the robot is left in the picture.
    assert 'd="M195 180L165 180"' in above
    assert '<circle cx="165" cy="180" r="9"' in above


def record_of_a_grasp(hand, opening):
    pose = np.eye(4)
    pose[:3, 3] = [0.9, 0.2, 0.3]
    grasp = {
        "event": "done", "state": "plan_motion", "arm": "arm", "score": 0.7,
        "prototype": "bar_089", "gripper": hand.name, "preshape": "parallel",
        "opening": opening, "pose": pose.tolist(),
    }  # fmt: skip
    looked = {"event": "done", "state": "capture", "look": 1}
    attempt = {"event": "attempt", "number": 1, "removed": True}
    events = [*states("capture"), looked, grasp, attempt, END]
    record = MemoryRecord({"seed": 3}, events)
    record.keep(Capture.load(data_path("captures", "pile.npz")), "capture_001")
    return record


def test_a_hand_that_does_not_ship_is_drawn_if_it_is_given(tmp_path):
    hand = GripperModel.load(EXAMPLES / "grippers" / "jaw_140.yaml")
    record = record_of_a_grasp(hand, 0.1)
    path = tmp_path / "run.html"
    run_html(path, record, grippers={hand.name: hand})
    assert "data:image/jpeg" in path.read_text()
    run_html(path, record)
    assert "data:image/jpeg" not in path.read_text()
    assert "jaw_140 is not known" in path.read_text()


def test_a_hand_closed_as_far_as_it_goes_is_drawn_though_that_was_rounded(tmp_path):
    text = (EXAMPLES / "grippers" / "jaw_140.yaml").read_text()
    path = tmp_path / "jaw.yaml"
    path.write_text(text.replace("slide: [0, 0.07]", "slide: [0, 0.06798]"))
    hand = GripperModel.load(path)
    closed = hand.preshape("parallel").narrowest
    assert round(closed, 4) < closed
    record = record_of_a_grasp(hand, round(closed, 4))
    run_html(tmp_path / "run.html", record, grippers={hand.name: hand})
    assert "data:image/jpeg" in (tmp_path / "run.html").read_text()


def size_and_circles(page):
    above = page.split("From above")[1].split("</svg>")[0]
    width, height = re.search(r'viewBox="0 0 (\d+) (\d+)"', above).groups()
    circles = re.findall(r'<circle cx="(-?\d+)" cy="(-?\d+)" r="(\d+)"', above)
    return (int(width), int(height)), [tuple(map(int, found)) for found in circles]


def test_all_of_a_far_drop_off_is_shown_from_above(tmp_path):
    places = {"left": [0.4, 2.6], "right": [-1.1, -9.0]}
    tested = {"event": "done", "state": "self_test"}
    tested |= {arm: {"drop_off": place} for arm, place in places.items()}
    page = page_of(tmp_path, *states("self_test"), tested)
    (width, height), circles = size_and_circles(page)
    assert width <= 980
    assert len(circles) == 2
    for x, y, radius in circles:
        assert radius < x < width - radius
        assert radius < y < height - radius


def test_the_picture_from_above_has_a_scale_and_a_key(tmp_path):
    for distance in (1.0, 3.0):
        tested = {"event": "done", "state": "self_test"}
        places = {"left": [0.4, distance], "right": [0.4, -distance]}
        tested |= {arm: {"drop_off": place} for arm, place in places.items()}
        page = page_of(tmp_path, *states("self_test"), tested)
        _, ((one, _, _), (other, _, _)) = size_and_circles(page)
        (length,) = re.findall(r"v6h([\d.]+)v-6", page)
        # As the two drop-offs are apart, so long is half a metre.
        assert float(length) == pytest.approx(abs(one - other) / 4 / distance, rel=0.01)
        assert "0.5 m</text>" in page
    key = page.split("From above")[1].split("</svg>")[1]
    for name in ("ground", "0.5 m high", "drop-off", "gripped at, by", "let go, by"):
        assert name in key.split("</p>")[0]


def test_what_stood_there_is_shown_from_above():
    points = np.array([[0.9, 0.0, 0.3], [1.2, 0.2, 0.0], [9.0, 0.0, 0.0]])
    data = map_svg((), points).split("base64,")[1].split('"')[0]
    drawn = np.asarray(Image.open(io.BytesIO(base64.b64decode(data))))
    background = drawn[0, 0]
    assert (drawn != background).any(axis=-1).sum() == 2
    assert map_svg((), None) == ""
