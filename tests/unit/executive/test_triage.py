"""What is done with an object, by which hand; and which objects were tried."""

from __future__ import annotations

import re
from types import SimpleNamespace
from weakref import ref

import numpy as np
import pytest

from debrisgrasp.control import (
    ArmResponse,
    StabilityBound,
    WrenchFilter,
    contact_gain,
)
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.executive import SimulatedTask, TaskSettings
from debrisgrasp.executive.choose_grasp import _ordered
from debrisgrasp.executive.marks import Mark, Marks
from debrisgrasp.executive.outcome import RunEnd, RunResult
from debrisgrasp.executive.result import FaultFound
from debrisgrasp.executive.triage import Way, judge
from debrisgrasp.geometry import Bounds
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.segmentation import Segment

HANDS = {
    "right": GripperModel.load("robotiq_3f"),
    "left": GripperModel.load("camhand"),
}


def segment(extents, height=0.3):
    half = 0.5 * np.array(extents)
    lower = np.array([1.0 - half[0], -half[1], height - 2 * half[2]])
    return Segment(
        label=1,
        n_points=500,
        centroid=np.array([1.0, 0.0, height - half[2]]),
        bounds=Bounds(lower, lower + np.array(extents)),
        axes=np.eye(3),
        extents=np.sort(np.array(extents))[::-1],
    )


def way(extents, height=0.3, **options):
    return judge(segment(extents, height), 0.0, HANDS, TaskSettings(), **options)


def test_the_tracks_drive_over_what_is_lower_than_ten_centimetres():
    assert way((0.5, 0.09, 0.04), height=0.085).way is Way.DRIVE_OVER
    # It may be higher than it was measured.
    assert way((0.5, 0.09, 0.04), height=0.095).way is not Way.DRIVE_OVER
    assert way((0.5, 0.09, 0.04), height=0.11).way is not Way.DRIVE_OVER


@pytest.mark.parametrize("can_drag", [False, True])
def test_only_of_a_base_that_drives_tracks_are_told(can_drag):
    triage = way((0.5, 0.09, 0.04), 0.04, can_drag=can_drag)
    assert triage.way is Way.DRIVE_OVER
    assert ("tracks" in triage.reason) == can_drag


def test_height_counts_from_the_ground_below():
    low = judge(segment((0.5, 0.09, 0.04), 0.25), 0.2, HANDS, TaskSettings())
    assert low.way is Way.DRIVE_OVER
    assert "top is 5.0 cm above the ground" in low.reason


def test_the_narrow_hand_is_preferred_as_long_as_it_opens_wide_enough():
    assert way((0.5, 0.06, 0.04)).arms == ("right", "left")
    assert way((0.5, 0.06, 0.04)).way is Way.PINCH
    assert way((0.5, 0.15, 0.15)).arms == ("left", "right")
    assert way((0.5, 0.15, 0.15)).way is Way.CLAW


def test_what_was_too_heavy_is_dragged_if_there_is_a_base_and_else_left():
    assert way((0.5, 0.1, 0.1), is_too_heavy=True, can_drag=True).way is Way.DRAG
    assert way((0.5, 0.1, 0.1), is_too_heavy=True).way is Way.LEAVE


def test_structures_are_left_and_every_verdict_has_its_reason():
    verdict = way((2.8, 0.1, 0.1))
    assert verdict.way is Way.LEAVE
    assert "2.8 m" in verdict.reason


def test_a_search_in_vain_is_repeated_and_then_waits_for_another_removal():
    marks, found = Marks(), FaultFound("no_grasp", "none found")
    for _ in range(2):
        assert not marks.why_left([1.01, 0.0, 0.1], 2, tries=2)
        marks.add([1.0, 0.0, 0.1], found, n_changes=2, is_search=True)
    assert "2 searches" in marks.why_left([1.01, 0.0, 0.1], 2, tries=2)
    assert not marks.why_left([1.01, 0.0, 0.1], 3, tries=2)


def test_a_search_that_drew_no_candidate_is_not_repeated():
    marks = Marks()
    found = FaultFound("no_grasp", "too small", None, {"candidates": 0.0})
    marks.add([1.0, 0.0, 0.1], found, n_changes=2, is_search=True)
    assert "too small" in marks.why_left([1.01, 0.0, 0.1], 2, tries=2)
    assert not marks.why_left([1.01, 0.0, 0.1], 3, tries=2)


def test_a_grip_that_failed_is_tried_as_often_as_allowed():
    marks, found = Marks(), FaultFound("empty_grip", "nothing there")
    place = [1.0, 0.0, 0.1]
    for _ in range(2):
        assert not marks.why_left(place, 0, tries=2)
        marks.add(place, found, n_changes=0)
    assert "2 tries" in marks.why_left(place, 0, tries=2)
    # One more for each object that was on or beside it.
    assert not marks.why_left(place, 1, tries=2)
    marks.add(place, found, n_changes=1)
    assert marks.why_left(place, 1, tries=2)


def test_two_faults_in_one_try_are_one_try():
    marks, found = Marks(), FaultFound("slip", "the object slips")
    place = [1.0, 0.0, 0.1]
    marks.add(place, found, n_changes=0)
    mark = marks.add(place, found, n_changes=0, is_same_try=True)
    assert mark.tries == 1


def test_what_is_caught_once_is_not_heavy_but_what_was_weighed_is():
    marks, stuck = Marks(), FaultFound("too_heavy", "130 N")
    place = [1.0, 0.0, 0.1]
    assert not marks.add(place, stuck, n_changes=0).is_heavy
    assert marks.add(place, stuck, n_changes=0).is_heavy
    weighed = FaultFound("too_heavy", "12 kg", None, {"mass": 12.0})
    assert Marks().add(place, weighed, n_changes=0).is_heavy


def test_what_is_too_heavy_is_left_for_that_and_not_for_how_a_push_ended():
    marks, place = Marks(), [1.0, 0.0, 0.1]
    marks.add(place, FaultFound("too_heavy", "12 kg", None, {"mass": 12.0}), 0)
    marks.add(place, FaultFound("plan_collision", "touched something"), 0)
    assert marks.why_left(place, 0, tries=2).startswith("12 kg (2 tries in vain)")


def test_marks_of_other_places_do_not_count():
    marks = Marks()
    weighed = FaultFound("too_heavy", "12 kg", None, {"mass": 12.0})
    marks.add([1.0, 0.0, 0.1], weighed, n_changes=0)
    assert marks.of([1.0, 0.2, 0.1]) is None
    assert marks.why_left([1.0, 0.0, 0.1], 9, tries=9)


def test_a_drop_off_in_the_way_is_refused_with_the_place_to_mend():
    with pytest.raises(ConfigError, match="beside the robot"):
        TaskSettings(drop_off={"right": (1.0, 0.0)})


def test_a_drop_off_in_millimetres_is_refused():
    with pytest.raises(ConfigError, match="metres"):
        TaskSettings(drop_off={"right": (250.0, -750.0)})


WAY = ((0.5, -0.5, -0.1), (1.5, 0.5, 1.0))


@pytest.mark.parametrize(
    "given", [np.array(WAY), np.array(WAY, dtype=object), list(map(np.array, WAY))]
)
def test_a_workspace_may_be_an_array(given):
    settings = TaskSettings(workspace=given)
    assert settings.workspace == WAY
    assert settings == TaskSettings(workspace=WAY)
    assert settings.bounds.upper == pytest.approx(np.array(WAY[1]))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (np.array(WAY).T, "got 3 values, expected 2"),
        (np.array(WAY)[:, :2], "got 2 values, expected 3"),
        (np.array(WAY)[::-1], "a lower corner below an upper one"),
        (np.array(WAY) * [1, 1, np.nan], "finite"),
        (np.array(WAY) * [1, 1, np.inf], "finite"),
        (np.array(WAY) > 0.0, "expected a finite number"),
        (np.array(WAY, dtype=str), "expected a finite number"),
    ],
)
def test_an_array_that_is_no_workspace_is_refused(given, words):
    with pytest.raises(InputError, match="workspace") as caught:
        TaskSettings(workspace=given)
    assert words in str(caught.value)


def test_a_workspace_or_a_region_in_millimetres_is_refused():
    low, high = (450.0, -620.0, -100.0), (1900.0, 620.0, 1300.0)
    with pytest.raises(ConfigError, match=r"workspace.*divide by 1000"):
        TaskSettings(workspace=(low, high))
    with pytest.raises(ConfigError, match=r"region.*divide by 1000"):
        TaskSettings(region=Bounds(np.array(low), np.array(high)))
    with pytest.raises(ConfigError, match=r"region.*divide by 1000"):
        SimulatedTask(region=(*low, *high))


def test_a_height_in_millimetres_is_refused_with_its_unit():
    with pytest.raises(ConfigError, match=r"drive_over \[m\].*millimetres"):
        TaskSettings(drive_over=100.0)
    with pytest.raises(ConfigError) as refused:
        TaskSettings(drive_over=-0.1)
    assert "millimetres" not in str(refused.value)


@pytest.mark.parametrize(
    "wrong",
    [
        {"max_removals": 0},
        {"carry_speed": 0.0},
        {"lift": -0.1},
        {"empty_load": 0.0},
        {"compliance": (-1e-5, 3e-4)},
        {"max_dropout": 0.0},
        {"period": 0.02},
        {"period": 4.0},
    ],
)
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ConfigError):
        TaskSettings(**wrong)


@pytest.mark.parametrize("period", [0.0005, 0.004, 0.01])
def test_a_compliance_with_which_no_lift_would_begin_is_refused(period):
    with pytest.raises(ConfigError, match=r"compliance .m/N.: got 0.001") as refused:
        TaskSettings(compliance=(1e-3, 3e-4), period=period)
    most = float(re.search(r"expected (\S+) or less", str(refused.value)).group(1))
    TaskSettings(compliance=(0.99 * most, 3e-4), period=period)
    with pytest.raises(ConfigError, match="compliance"):
        TaskSettings(compliance=(1.05 * most, 3e-4), period=period)


@pytest.mark.parametrize("period", [0.0005, 0.004, 0.01])
def test_a_turn_that_would_swing_at_the_end_of_a_long_object_is_refused(period):
    bound = StabilityBound(ArmResponse(), WrenchFilter(period=period))
    with pytest.raises(ConfigError, match=r"compliance .rad/") as refused:
        TaskSettings(compliance=(5e-5, 0.01), period=period)
    most = float(re.search(r"expected (\S+) or less", str(refused.value)).group(1))
    settings = TaskSettings(compliance=(5e-5, 0.99 * most), period=period)
    for lever in np.linspace(0.0, 1.5, 16):
        give = 1.0 / 3e4 + lever**2 / 1e4
        tensor = np.diag(np.repeat(settings.compliance, 3))
        gain = contact_gain(tensor, (lever, 0.0, 0.0)) / give
        assert gain < 1.13 * bound.gain_safe


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("arms", "left"),
        ("arms", (1,)),
        ("max_removals", 2.5),
        ("workspace", "all"),
        ("workspace", (1.0, 2.0)),
        ("workspace", np.zeros(3)),
        ("drop_off", (0.2, 0.8)),
        ("drop_off", {"left": "there"}),
        ("drop_off", {"left": None}),
        ("drop_off", {"left": (0.2,)}),
        ("rest", 3),
        ("look", (0.1, 0.2)),
        ("compliance", 5e-5),
        ("clamp", 0.015),
        ("camera_shift", "2 cm"),
        ("camera_shift", 0.005),
        ("mark", np.zeros((4, 4))),
        ("region", (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)),
    ],
)
def test_settings_of_another_type_are_refused(name, value):
    with pytest.raises(InputError, match=name.replace("drop_off", "drop.off")):
        TaskSettings(**{name: value})


def test_what_failed_on_an_object_comes_after_other_prototypes_about_as_likely():
    def grasp(prototype, rank, arm="left", steady=1.0, squeezed=1.0):
        success = SimpleNamespace(steady=steady, squeezed=squeezed)
        return SimpleNamespace(prototype=prototype, rank=rank, arm=arm, success=success)

    span, rim, other = grasp("span", 0.6), grasp("rim", 0.5), grasp("other", 0.1)
    triage = SimpleNamespace(arms=("right", "left"))
    assert _ordered([other, rim, span], triage) == (span, rim, other)
    failed = grasp("span", 0.7)
    # A grasp is noted at each fault of one try; it failed once.
    assert _ordered([span, rim, other], triage, [failed, failed]) == (rim, span, other)
    assert _ordered([span, grasp("rim", 0.56, "right")], triage)[0].prototype == "rim"
    # What turns in the hand is lost on the way.
    rod = grasp("rod", 0.9, steady=0.5)
    assert _ordered([rod, span, other], triage) == (span, rod, other)
    # What nobody can feel is taken for an empty hand.
    hook = grasp("hook", 0.9, squeezed=0.15)
    assert _ordered([hook, span, other], triage) == (span, hook, other)
    claw = grasp("claw", 0.9, squeezed=0.3)
    assert _ordered([span, other, claw], triage) == (claw, span, other)


class Look:
    """Stands for what was seen."""


def test_a_grasp_without_a_way_is_in_vain_until_the_pile_is_seen_again():
    look, later = Look(), Look()
    tried, unreached, other = (object() for _ in range(3))
    mark = Mark(np.zeros(3), "no way", failed=[tried])
    mark.sought(look, (unreached,))
    mark.sought(look, (other,))
    assert mark.in_vain(look) == [tried, unreached, other]
    assert mark.in_vain(later) == [tried]
    # A look is a whole image with all that was made of it: a mark does not keep it.
    gone = ref(look)
    del look
    assert gone() is None
    mark.sought(later, (other,))
    Marks([mark]).begin_anew()
    assert mark.in_vain(later) == []


def test_a_way_clear_because_all_is_low_says_so():
    low = {"object 1": "drive over: 8 cm high", "object 2": "drive over: 3 cm high"}

    def result(left, end=RunEnd.CLEARED):
        return RunResult(end=end, attempts=(), faults=(), left=left)

    assert result(low).is_all_driven_over
    assert not result({}).is_all_driven_over
    assert not result(low, RunEnd.LEFT).is_all_driven_over
    assert not result({**low, "object 3": "leave: a structure"}).is_all_driven_over
