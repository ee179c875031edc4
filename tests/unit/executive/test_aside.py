"""What no hand can hold is pushed out of the way."""

from __future__ import annotations

from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from debrisgrasp.errors import DriverError
from debrisgrasp.executive import TaskSettings
from debrisgrasp.executive.aside import push_aside, to_push
from debrisgrasp.executive.choose import select
from debrisgrasp.executive.faults import Action
from debrisgrasp.executive.outcome import FaultEvent
from debrisgrasp.executive.recover import recover
from debrisgrasp.executive.result import Done, FaultFound
from debrisgrasp.executive.states import State
from debrisgrasp.executive.table import answer_to
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.worlds import make_body
from tests.unit.executive.rigs import look, task_before

CRATE = {"length": 0.38, "width": 0.27, "height": 0.24, "wall": 0.01}


def before_a_crate(pipeline, place, mass=1.4, **settings):
    """A crate upside down that was tried in vain, as the task stands after a look."""
    over = so3.from_rpy(np.array([np.pi, 0.0, 0.3]))
    crate = make_body("crate", CRATE, mass)
    low = min(solid.bounds.lower[2] for solid in crate.at(SE3.from_parts(over)).solids)
    crate = crate.at(SE3.from_parts(over, [*place, -float(low)]))
    # A loop of long periods needs few of them for the same task.
    settings = TaskSettings(repositions=0, period=0.008, **settings)
    fake, task = task_before(pipeline, crate, settings=settings)
    context = task.context
    look(context)
    mark_tried(context)
    return fake, context


def mark_tried(context):
    seen = context.cycle.seen
    for candidate in seen.order(context.pipeline.policy):
        middle = seen.segmentation.segment(candidate.label).centroid
        for _ in range(2):
            context.marks.add(
                middle,
                FaultFound("no_grasp", "no hand spans it"),
                context.n_changes,
                is_search=True,
            )


def chosen_to_push(context):
    found = select(context)
    assert isinstance(found, Done)
    assert found.next is State.PUSH
    assert found.facts["way"] == "push aside"
    context.state = State.PUSH


def across(fake):
    return float(fake.world.bodies[0].T_base_body.p[1])


@pytest.mark.parametrize(("place", "side"), [((0.9, -0.3), -1), ((1.0, 0.2), 1)])
def test_a_crate_upside_down_is_pushed_over_the_nearer_border(pipeline, place, side):
    fake, context = before_a_crate(pipeline, place)
    chosen_to_push(context)
    done = push_aside(context)
    assert isinstance(done, Done)
    assert done.next is State.RETREAT
    came = side * (across(fake) - place[1])
    assert came > 0.3
    # It also turns, and its middle gets less far than where it is pushed.
    assert came < done.facts["pushed"] < came + 0.12
    assert side * across(fake) > 0.6
    truth = fake.truth()
    assert truth.removed == ("crate",)
    assert truth.violations == ()
    assert max(truth.peak_force.values()) < 80.0
    assert context.is_in_pile is None
    # Where it is remembered it is.
    mark = context.marks.marks[0]
    assert mark.centroid[1] == pytest.approx(across(fake), abs=0.12)
    for limb in context.limbs.values():
        rest = context.model.posture(limb.name, limb.rest_of)
        assert np.allclose(
            context.posture(limb), limb.reach.chain.vector(rest), atol=0.02
        )


def test_what_does_not_slide_stays_and_is_pushed_no_harder(pipeline):
    fake, context = before_a_crate(pipeline, (0.9, -0.3), mass=40.0)
    for n_tries in (1, 2):
        chosen_to_push(context)
        done = push_aside(context)
        assert isinstance(done, Done)
        assert done.facts["pushed"] == 0.0
        assert context.marks.marks[0].n_stayed == n_tries
    assert across(fake) == pytest.approx(-0.3, abs=0.02)
    assert max(fake.truth().peak_force.values()) < 110.0
    found = select(context)
    assert isinstance(found, FaultFound)
    assert found.fault == "no_grasp"
    (why,) = context.left.values()
    assert "not pushed aside" in why


def test_a_push_for_which_there_is_no_room_is_none_of_those_allowed(
    pipeline, monkeypatch
):
    _, context = before_a_crate(pipeline, (0.9, -0.3), pushes=1)
    none = "no hand fits beside it"
    monkeypatch.setattr("debrisgrasp.executive.aside._sought", lambda *_: none)
    for n_tries in (1, 2):
        chosen_to_push(context)
        found = push_aside(context)
        assert isinstance(found, Done)
        assert found.facts["why"] == none
        assert context.marks.marks[0].n_stayed == n_tries
    assert context.n_pushes == 0
    assert isinstance(select(context), FaultFound)  # twice is enough of this one


def test_a_push_that_fails_twice_is_not_tried_again(pipeline, monkeypatch):
    _, context = before_a_crate(pipeline, (0.9, -0.3))
    touched = FaultFound("plan_collision", "touched something", "right")
    monkeypatch.setattr("debrisgrasp.executive.aside._taken_there", lambda *_: touched)
    for _ in range(2):
        chosen_to_push(context)
        assert push_aside(context) is touched
    found = select(context)
    assert isinstance(found, FaultFound)
    assert "not pushed aside" in next(iter(context.left.values()))


def test_what_came_has_come_whatever_happens_on_the_way_back(pipeline, monkeypatch):
    fake, context = before_a_crate(pipeline, (0.9, -0.3))
    touched = FaultFound("plan_collision", "touched something", "right")
    monkeypatch.setattr("debrisgrasp.executive.aside._left", lambda *_: touched)
    chosen_to_push(context)
    assert push_aside(context) is touched
    assert context.n_pushed == 1
    came = -0.3 - across(fake)
    assert came < context.cycle.pushed < came + 0.12
    assert context.marks.marks[0].n_stayed == 0
    assert context.is_in_pile == "right"  # it is cleared up


def test_what_is_too_heavy_for_a_robot_that_stands_fast_is_pushed(pipeline):
    _, context = before_a_crate(pipeline, (0.9, -0.3), pushes=1)
    context.robot = replace(context.robot, base=None)
    context.marks.marks[0].is_heavy = True
    chosen_to_push(context)
    context.n_pushes = 1
    found = select(context)
    assert isinstance(found, FaultFound)  # and else it is no clear way
    assert found.fault == "no_grasp"


def test_what_is_too_heavy_is_pushed_if_no_way_to_drag_it_is_found(pipeline):
    _, context = before_a_crate(pipeline, (0.9, -0.3))
    (mark,) = context.marks.marks
    mark.is_heavy, mark.searches = True, 1
    found = select(context)
    assert isinstance(found, Done)
    assert found.facts["way"] == "drag"
    mark.searches = 2  # and that is enough until something changes
    chosen_to_push(context)


def test_nothing_is_pushed_that_may_not_be(pipeline):
    fake, context = before_a_crate(pipeline, (0.9, -0.3), pushes=0)
    found = select(context)
    assert isinstance(found, FaultFound)
    assert "1 object could not be taken" in found.message
    assert across(fake) == pytest.approx(-0.3, abs=1e-3)


@pytest.mark.parametrize("n_before", [200, 1700])
def test_a_command_that_is_lost_on_a_push_ends_at_rest(pipeline, monkeypatch, n_before):
    fake, context = before_a_crate(pipeline, (0.9, -0.3))
    chosen_to_push(context)
    arm = context.limbs["right"].limb.arm
    sent, lost = arm.command, DriverError("drives", "no answer")
    calls = count()

    def command(q):
        if next(calls) == n_before:
            raise lost
        sent(q)

    monkeypatch.setattr(arm, "command", command)
    with pytest.raises(DriverError):
        push_aside(context)
    answer = answer_to(State.PUSH, "connection_lost")
    event = FaultEvent(
        time=context.now(),
        state=State.PUSH,
        fault="connection_lost",
        message=str(lost),
        action=answer.action,
    )
    assert isinstance(recover(context, event, answer), Done)
    # It was still in motion.
    assert fake.truth().violations == ()
    assert context.is_in_pile is None
    assert not any(limb.limb.arm.is_engaged for limb in context.limbs.values())


def test_a_baseline_that_is_too_old_for_a_push_is_taken_anew():
    answer = answer_to(State.PUSH, "bias_drift")
    assert answer.resume is State.SELF_TEST
    assert answer.is_cleared_up
    assert answer_to(State.PUSH, "early_contact").action is Action.NEXT


def test_what_has_the_shortest_way_out_is_pushed_first(pipeline):
    _, context = before_a_crate(pipeline, (0.9, -0.3))

    class Segment:
        def __init__(self, *centroid):
            self.centroid = np.array(centroid)

    middle, beside = Segment(1.0, 0.05, 0.2), Segment(1.0, 0.4, 0.2)
    assert to_push(context, [middle, beside]) is beside
    # The way may have been turned, and moved, by the base.
    turned = SE3.from_parts(so3.from_rpy(np.array([0.0, 0.0, np.pi / 2])))
    context.T_base_way = turned
    left, right = Segment(-0.5, 1.0, 0.2), Segment(0.1, 1.0, 0.2)
    assert to_push(context, [left, right]) is left
    assert to_push(context, []) is None
