"""The base goes as far as it is asked by its odometry, and stands whatever happens."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from debrisgrasp.errors import DriverError
from debrisgrasp.executive.drag import drive_back
from debrisgrasp.executive.driving import driven
from debrisgrasp.executive.reposition import repositioned
from debrisgrasp.executive.result import FaultRaised
from debrisgrasp.executive.steady import SteadyClock
from debrisgrasp.geometry import SE3, so3
from tests.unit.executive.rigs import before_a_brick, look
from tests.unit.robot.broken_robots import Changed, nothing, raising


def with_base(pipeline, **members):
    """A task whose base has other members; what is true of it."""
    fake, task = before_a_brick(pipeline)
    context = task.context
    context.robot = replace(context.robot, base=Changed(fake.base, **members))
    return fake, context


def stands(fake, context):
    """Whether the base stands by itself, or soon does."""
    context.wait(0.3)
    return fake.base.is_still


def turned(yaw, *p):
    return SE3.from_parts(so3.exp(np.array([0.0, 0.0, yaw])), p)


@settings(max_examples=15, deadline=None)
@given(st.floats(-0.5, 0.5), st.floats(0.6, 1.0), st.booleans())
def test_a_base_goes_as_far_as_it_is_asked_however_fast_it_is(
    pipeline, size, share, is_turn
):
    fake, task = before_a_brick(pipeline)
    context, drive = task.context, fake.base.drive
    slow = Changed(fake.base, drive=lambda v, w: drive(share * v, share * w))
    way = {"turn" if is_turn else "ahead": size}
    moved = driven(context, slow, 0.08, **way)
    gone = so3.log(moved.R)[2] if is_turn else moved.p[0]
    assert gone == pytest.approx(size, abs=0.02)
    np.testing.assert_allclose(moved.matrix, fake.base.read().matrix, atol=1e-9)
    np.testing.assert_allclose(
        context.T_base_way.matrix, moved.inverse().matrix, atol=1e-9
    )
    assert fake.base.is_still


@pytest.mark.parametrize(
    "moved",
    [
        turned(0.6, -12.0, 0.0, 0.0),
        turned(2.0, -0.5, 0.0, 0.0),
        turned(0.6, np.nan, 0.0, 0.0),
        SE3.from_parts(np.full((3, 3), np.nan), [-0.5, 0.0, 0.0]),
    ],
    ids=["far", "round", "nan", "nan-turn"],
)
def test_a_base_drives_back_no_way_that_it_can_not_have_come(pipeline, moved):
    fake, context = with_base(pipeline)
    context.dragged = moved
    with pytest.raises(FaultRaised) as raised:
        drive_back(context)
    assert raised.value.found.fault == "encoder_jump"
    assert np.linalg.norm(fake.base.read().p) == 0.0
    assert fake.truth().violations == ()


def test_a_base_drives_back_from_where_it_dragged_to(pipeline):
    fake, context = with_base(pipeline)
    context.dragged = turned(0.5, -0.4, 0.0, 0.0)
    drive_back(context)
    assert context.dragged is None
    back = turned(0.5, -0.4, 0.0, 0.0) @ fake.base.read()
    assert np.linalg.norm(back.p) < 0.02
    assert np.linalg.norm(so3.log(back.R)) < 0.02


@pytest.mark.parametrize(
    "jump", [turned(0.0, 3.0, 0.0, 0.0), turned(0.5, 0.0, 0.0, 0.0),
             turned(0.0, np.nan, 0.0, 0.0), turned(0.0, 0.0, 0.9, 0.0)],
    ids=["ahead", "turn", "nan", "aside"],
)  # fmt: skip
def test_a_base_whose_odometry_jumps_stops_for_good(pipeline, jump):
    fake, context = with_base(pipeline)
    base, end = fake.base, context.now() + 1.0
    read = base.read
    context.robot.base._members["read"] = lambda: (
        read() @ jump if context.now() > end else read()
    )
    with pytest.raises(FaultRaised) as raised:
        driven(context, context.base, 0.08, ahead=0.35)
    assert raised.value.found.fault == "encoder_jump"
    assert 0.0 < read().p[0] < 0.4
    assert np.isfinite(context.T_base_way.matrix).all()
    assert stands(fake, context)


def test_a_base_that_does_not_go_is_not_told_to_for_ever(pipeline):
    _, context = with_base(pipeline, drive=nothing)
    with pytest.raises(FaultRaised) as raised:
        driven(context, context.base, 0.08, ahead=-0.35)
    assert raised.value.found.fault == "joint_stuck"
    assert "0.00 m" in raised.value.found.message
    assert context.now() < 20.0


@pytest.mark.parametrize("error", [KeyboardInterrupt(), DriverError("base", "silent")])
def test_a_base_stands_whatever_ends_its_way(pipeline, error):
    fake, context = with_base(pipeline)
    look(context)
    read, end = fake.base.read, context.now() + 1.0

    def broken():
        if context.now() > end:
            raise error
        return read()

    context.robot.base._members["read"] = broken
    with pytest.raises((KeyboardInterrupt, FaultRaised)) as raised:
        driven(context, context.base, 0.08, ahead=0.35)
    if isinstance(error, DriverError):
        assert raised.value.found.fault == "encoder_jump"  # nobody knows where it is
    assert context.cycle.seen is None
    assert stands(fake, context)
    assert read().p[0] < 0.15


def test_a_base_that_does_not_obey_a_stop_ends_the_run(pipeline):
    fake, context = with_base(pipeline, stop=raising)
    with pytest.raises(FaultRaised) as raised:
        driven(context, context.base, 0.08, ahead=0.2)
    assert raised.value.found.fault == "joint_stuck"
    assert "does not obey a stop: arm: no answer" in raised.value.found.message
    context.wait(1.0)
    assert fake.base.is_still  # told no more, it stands by itself
    assert fake.base.read().p[0] < 0.26


class Spiked:
    """A clock that tells a much later time so many times, from some time on."""

    def __init__(self, clock, since, times):
        self._clock, self._since, self._left = clock, since, times

    def now(self):
        now = self._clock.now()
        if now < self._since or not self._left:
            return now
        self._left -= 1
        return now + 600.0

    def wait_until(self, time):
        self._clock.wait_until(time)


@pytest.mark.parametrize("times", [1, 2, 3, 10**9])
@pytest.mark.parametrize("since", [0.0, 0.05, 1.0, 1.02, 2.0])
def test_a_clock_that_jumps_makes_no_base_go_farther(pipeline, since, times):
    fake, task = before_a_brick(pipeline)
    context = task.context
    look(context)
    clock = Spiked(fake.robot.clock, since, times)
    context.robot = replace(context.robot, clock=SteadyClock(clock))
    with suppress(FaultRaised):
        repositioned(context, [np.array([1.3, 0.0, 0.05])])
    assert fake.base.read().p[0] < 0.37
    fake.robot.clock.wait_until(fake.robot.clock.now() + 0.3)
    assert fake.base.is_still
