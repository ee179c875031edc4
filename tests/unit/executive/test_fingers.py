"""Fingers that open: pressed, or with nobody to tell how hard."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from debrisgrasp.control import GripCommand
from debrisgrasp.executive.drive import Drive
from debrisgrasp.executive.fingers import give_way, loosen, open_hand
from debrisgrasp.robot import HandReading
from tests.unit.executive.rigs import before_a_brick


class Deaf:
    """A sensor that gives no number after some readings, and numbers again later."""

    def __init__(self, sensor, after, times):
        self.sensor, self.after, self.times = sensor, after, times
        self.n_read = 0

    def read(self):
        self.n_read += 1
        reading = self.sensor.read()
        if not self.after <= self.n_read - 1 < self.after + self.times:
            return reading
        return reading._replace(wrench_ft=np.full(6, np.nan))


@pytest.fixture(scope="module")
def brick_task(pipeline):
    return before_a_brick(pipeline)[1]


def opened(drive):
    return open_hand(drive, drive.limb.first_preshape, 0.1)


@pytest.mark.parametrize("opens", [lambda drive: loosen(drive, 0.15), opened])
@pytest.mark.parametrize(("times", "is_fault"), [(1, False), (99, True)])
def test_fingers_do_not_go_on_where_the_sensor_gives_no_number(
    pipeline, opens, times, is_fault
):
    fake, task = before_a_brick(pipeline)
    limb = task.context.limbs["right"]
    gripper = limb.limb.gripper
    gripper.command(GripCommand((0.02,) * len(gripper.read().openings), 10.0))
    task.context.wait(3.0)
    sensor = Deaf(limb.limb.sensor, 2, times)
    limb.limb = replace(limb.limb, sensor=sensor)
    begun = task.context.now()
    fault = opens(Drive(task.context, "right"))
    assert (fault is not None) is is_fault
    if fault is not None:
        assert fault.fault == "wrench_nan"
        assert task.context.now() - begun < 0.3
        assert fake.arms["right"].is_stopped
        before = limb.limb.gripper.read().openings
        task.context.wait(0.5)
        assert limb.limb.gripper.read().openings == pytest.approx(before, abs=2e-3)


class Springs:
    """Fingers that squeeze a stiff thing, those of one side harder than the others."""

    def __init__(self, sides, deep):
        self.sides, self.deep = sides, deep
        self.openings, self.pushes = [0.03] * len(sides), []
        self.begun = self.push()

    def forces(self):
        pressed = zip(self.deep, self.openings, strict=True)
        return tuple(max(2e5 * (deep - (x - 0.03)), 0.0) for deep, x in pressed)

    def push(self):
        """Force on the hand along its axis x [N]."""
        return sum(s * f for s, f in zip(self.sides, self.forces(), strict=True))

    def command(self, command):
        self.openings = list(command.openings)
        self.pushes.append(abs(self.push()))

    def read(self):
        return HandReading(0.0, tuple(self.openings), self.forces())


@pytest.mark.parametrize("deep", [(2e-3, 6e-4, 6e-4), (5e-4, 8e-4, 8e-4)])
def test_fingers_that_squeeze_come_off_together(pipeline, monkeypatch, deep):
    """Else the hand bears alone what one side still exerts."""
    _, task = before_a_brick(pipeline)
    limb = task.context.limbs["right"]
    springs = Springs([finger.side for finger in limb.hand.fingers], deep)
    limb.limb = replace(limb.limb, gripper=springs)
    monkeypatch.setattr(
        Drive, "weighed", lambda _: (springs.push(), *[0.0] * 5), raising=True
    )
    assert abs(springs.begun) > 50.0
    assert loosen(Drive(task.context, "right"), 0.1) is None
    assert max(springs.pushes) < abs(springs.begun) + 1.0
    assert min(springs.openings) > 0.095


@pytest.mark.parametrize("step", [0.4e-3, 0.61e-3])
def test_fingers_that_know_large_steps_only_open_too(pipeline, monkeypatch, step):
    _, task = before_a_brick(pipeline)
    limb = task.context.limbs["right"]

    class Stepped(Springs):
        def command(self, command):
            rounded = np.round(np.array(command.openings) / step) * step
            super().command(command._replace(openings=tuple(rounded.tolist())))

    springs = Stepped([finger.side for finger in limb.hand.fingers], (1e-4,) * 3)
    limb.limb = replace(limb.limb, gripper=springs)
    monkeypatch.setattr(Drive, "weighed", lambda _: (springs.push(), *[0.0] * 5))
    assert loosen(Drive(task.context, "right"), 0.1) is None
    assert min(springs.openings) > 0.095


@pytest.mark.parametrize("forces", [(9.0,), (), (np.nan, 9.0, 9.0)])
def test_a_gripper_that_tells_too_few_forces_opens(pipeline, forces):
    _, task = before_a_brick(pipeline)
    limb = task.context.limbs["right"]
    springs = Springs([finger.side for finger in limb.hand.fingers], (0.0,) * 3)
    springs.forces, springs.push = lambda: forces, lambda: 0.0
    limb.limb = replace(limb.limb, gripper=springs)
    loosen(Drive(task.context, "right"), 0.1)
    assert min(springs.openings) > 0.095


def test_fingers_that_only_press_the_hand_harder_stop(pipeline, monkeypatch):
    _, task = before_a_brick(pipeline)
    limb = task.context.limbs["right"]
    springs = Springs([finger.side for finger in limb.hand.fingers], (0.0,) * 3)
    limb.limb = replace(limb.limb, gripper=springs)
    outside = lambda _: (2e4 * (max(springs.openings) - 0.03), *[0.0] * 5)  # noqa: E731
    monkeypatch.setattr(Drive, "weighed", outside)
    loosen(Drive(task.context, "right"), 0.1)
    assert max(springs.openings) < 0.04


@pytest.mark.parametrize("outward", [1.0, -1.0])
def test_fingers_that_are_pressed_yield(pipeline, outward):
    """From inside they open, and from outside they close."""
    _, task = before_a_brick(pipeline)
    limb = task.context.limbs["right"]
    begun = np.array([0.05, 0.06, 0.07])

    class Pressed(Springs):
        def forces(self):
            yielded = outward * (np.array(self.openings) - begun)
            soft = np.array([5e4, 2e4, 1e3])
            return tuple(outward * soft * np.maximum(0.008 - yielded, 0.0))

    springs = Pressed([finger.side for finger in limb.hand.fingers], (0.0,) * 3)
    springs.openings = list(begun)
    limb.limb = replace(limb.limb, gripper=springs)
    assert max(np.abs(springs.forces())) > 300.0
    assert give_way(Drive(task.context, "right")) is None
    assert max(np.abs(springs.forces())) < 20.0
    gone = np.abs(np.array(springs.openings) - begun)
    assert gone[0] > 5e-3
    assert gone[2] == 0.0


def test_a_finger_that_is_nearly_where_it_was_sent_is_not_jammed(pipeline):
    _, task = before_a_brick(pipeline)
    limb = task.context.limbs["right"]
    springs = Springs([finger.side for finger in limb.hand.fingers], (0.0,) * 3)
    springs.openings = [0.097, 0.1, 0.1]
    springs.forces = lambda: (5.0, 0.0, 0.0)
    limb.limb = replace(limb.limb, gripper=springs)
    assert loosen(Drive(task.context, "right"), 0.1) is None


class Odd:
    """A gripper that reads anything, and keeps what it is sent."""

    def __init__(self, reads):
        self.reads, self.commands = reads, []

    def preshape(self, name, opening):
        pass

    def command(self, command):
        self.commands.append(command)

    def read(self):
        return HandReading(0.0, tuple(self.reads), (20.0,) * len(self.reads))


@given(
    reads=st.lists(st.floats(-0.02, 0.3), min_size=3, max_size=3),
    force=st.floats(-10.0, 1e4),
)
def test_no_hand_is_sent_beyond_what_it_can_do(brick_task, reads, force):
    limb = brick_task.context.limbs["right"]
    odd, whole, taken = Odd(reads), limb.limb, limb.taken
    limb.limb = replace(whole, gripper=odd)
    try:
        drive = Drive(brick_task.context, "right")
        for name, shape in limb.hand.preshapes.items():
            limb.taken = name
            odd.commands.clear()
            drive.send_fingers(reads, force)
            drive.halt_fingers()
            give_way(drive)
            assert len(odd.commands) > 2
            for openings, most in odd.commands:
                assert shape.narrowest <= min(openings)
                assert max(openings) <= shape.widest
                assert 0.0 <= most <= limb.hand.max_force
    finally:
        limb.limb, limb.taken = whole, taken


def test_a_hand_keeps_the_preshape_that_it_took_last(brick_task):
    limb = brick_task.context.limbs["right"]
    *_, last = limb.hand.preshapes
    assert last != limb.first_preshape
    drive = Drive(brick_task.context, "right")
    assert open_hand(drive, last, limb.hand.preshape(last).widest) is None
    assert limb.preshape == last
    assert limb.opening == pytest.approx(limb.hand.preshape(last).widest, abs=6e-3)
