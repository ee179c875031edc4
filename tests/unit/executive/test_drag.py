"""What can't be lifted is dragged out of the way by the base."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.errors import DriverError
from debrisgrasp.executive.drag import _Pull, drag, drive_back
from debrisgrasp.executive.drive import Drive
from debrisgrasp.executive.releasing import release
from debrisgrasp.executive.result import Done
from debrisgrasp.executive.states import State
from debrisgrasp.geometry import SE3, so3
from tests.unit.executive.rigs import before_a_brick, holding


def test_a_base_that_drags_comes_back_to_where_it_was(pipeline, monkeypatch):
    fake, task = before_a_brick(pipeline)
    context = task.context
    context.state = State.LIFT
    context.held = holding(is_watched=False)
    found = drag(context)
    assert isinstance(found, Done)
    assert found.next is State.RELEASE
    assert np.linalg.norm(context.dragged.p) > 0.4
    limb = context.limbs["right"]
    there = context.dragged @ limb.pose(context.posture(limb))
    monkeypatch.setattr("debrisgrasp.executive.releasing.put_down", lambda *_: None)
    # Where that is once the base is back.
    assert release(context).facts["place"] == pytest.approx(there.p, abs=2e-3)
    assert drive_back(context) is None
    assert np.linalg.norm(fake.base.T_odom_base.p) < 0.1
    assert fake.truth().violations == ()


def test_a_base_stops_when_an_arm_that_drags_answers_no_more(pipeline, monkeypatch):
    fake, task = before_a_brick(pipeline)
    context, base = task.context, fake.robot.base
    context.state = State.LIFT
    context.held = holding(is_watched=False)
    read, end = Drive.read, context.now() + 2.0

    def silent(self):
        if context.now() > end:
            raise DriverError("arm", "no answer")
        return read(self)

    monkeypatch.setattr(Drive, "read", silent)
    with pytest.raises(DriverError):
        drag(context)
    gone = np.linalg.norm(context.dragged.p)
    assert gone > 0.02
    context.wait(3.0)
    assert np.linalg.norm(base.read().p) < gone + 0.01


@pytest.mark.parametrize(
    ("share", "of_torque"), [(0.3, False), (0.9, False), (0.3, True), (0.9, True)]
)
def test_a_base_that_pulls_too_hard_stops_before_the_arm_has_come_to_rest(
    pipeline, share, of_torque
):
    """What is dragged by its end bends the hand long before it pulls hard."""
    fake, task = before_a_brick(pipeline)
    context, base = task.context, fake.robot.base
    limits = Drive(context, "right").limits
    pull = _Pull(context, base, [(-0.03, 0.0, 10.0)], limits)
    assert not pull((0.0,) * 6)
    context.wait(0.5)
    load = np.zeros(6)
    load[4 if of_torque else 2] = share * (limits.torque if of_torque else limits.force)
    assert pull(tuple(load.tolist())) is pull.is_too_much is (share > 0.8)
    before = base.read().p
    context.wait(0.1)
    gone = np.linalg.norm(base.read().p - before)
    assert gone < 1e-3 if pull.is_too_much else gone > 2e-3


def test_a_base_that_pulls_goes_on_until_it_is_told_otherwise(pipeline):
    """It stands by itself if nobody tells it to go on."""
    fake, task = before_a_brick(pipeline)
    context = task.context
    limits = Drive(context, "right").limits
    pull = _Pull(context, fake.robot.base, [(-0.03, 0.0, 10.0)], limits)
    for _ in range(round(2.0 / context.settings.period)):
        assert not pull((0.0,) * 6)
        context.wait(context.settings.period)
    assert fake.base.read().p[0] == pytest.approx(-0.06, abs=3e-3)


def test_a_base_that_pulled_too_hard_pulls_no_more_as_that_gets_less(pipeline):
    fake, task = before_a_brick(pipeline)
    context = task.context
    limits = Drive(context, "right").limits
    pull = _Pull(context, fake.robot.base, [(-0.03, 0.0, 0.3)] * 3, limits)
    assert not pull((0.0,) * 6)
    context.wait(0.2)
    assert pull((0.9 * limits.force, *[0.0] * 5))
    for _ in range(5):
        context.wait(0.2)
        assert pull((0.0,) * 6)
        assert fake.base.is_still
    assert pull.is_too_much


@pytest.mark.parametrize("before", [0.2, 0.5])
def test_a_base_that_dragged_a_part_of_the_way_drags_the_rest(pipeline, before):
    fake, task = before_a_brick(pipeline)
    context = task.context
    context.state = State.LIFT
    context.held = holding(is_watched=False)
    context.dragged = SE3.from_parts(p=[-before, 0.0, 0.0])
    assert isinstance(drag(context), Done)
    assert fake.base.read().p[0] == pytest.approx(before - 0.5, abs=0.05)
    assert np.linalg.norm(context.dragged.p) == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("arm", ["right", "left"])
def test_a_base_turns_to_the_side_where_the_arm_puts_things_down(pipeline, arm):
    """Whatever the arm is called."""
    fake, task = before_a_brick(pipeline)
    context = task.context
    places = context.settings.drop_off
    swapped = {"right": places["left"], "left": places["right"]}
    context.settings = replace(context.settings, drop_off=swapped)
    context.state = State.LIFT
    context.held = holding(is_watched=False, arm=arm)
    assert isinstance(drag(context), Done)
    yaw = so3.log(fake.base.read().R)[2]
    assert np.sign(yaw) == np.sign(swapped[arm][1])
