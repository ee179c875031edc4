"""Loops of the fingers: close until they meet, open, or loosen a little."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from math import copysign, hypot, isfinite, nan

import numpy as np

from debrisgrasp.control import GripPhase

from .context import Held
from .drive import Drive
from .result import FaultFound

__all__ = ["draw_in", "give_way", "loosen", "open_hand", "run_grip"]

_OPENING_FORCE = 30.0
"""With which fingers open among other things [N]."""
_LOOSENING = 0.03
"""At which fingers open among other things [m/s] ..."""
_PRESSED = 0.5
"""... until the hand is pressed by this share of its limit ..."""
_MORE = 15.0
"""... and by so much more than it was [N]."""
_FELT = 2.0
"""A finger that feels more still holds [N]."""
_SHORT = 4e-3
"""A finger that is so near to where it was sent is there [m]."""
_OPEN = 1.5e-4
"""One that opens goes on up to there [m]: just short of it, it may still hold."""
_SOFT, _YIELD, _YIELDS = 15.0, 1e-3, 25
"""Fingers of an open hand that are pressed harder [N] yield by so much [m] at a time,
so many times at most."""
_SQUEEZES, _EASES = 5.0, 3e-4
"""A finger that feels more squeezes [N]; step in which the one opens that squeezes
hardest [m]."""
_AHEAD = 3e-3
"""A finger is sent no farther ahead of where it is [m]."""
_CREEP, _STALLED = 1.5e-4, 0.4
"""Fingers that move by less [m] for so long [s] have met something."""
_SILENT = 0.04
"""For longer no finger goes on where the sensor gives no number [s]."""


class _Pressed:
    """Measures how hard a hand is pressed whose fingers open."""

    def __init__(self, drive: Drive) -> None:
        self._drive, self._told = drive, drive.clock.now()
        self.fault: FaultFound | None = None
        """Why nobody knows any more; then arm and fingers are stopped."""

    def moved(self, openings: tuple[float, ...], force: float) -> FaultFound | None:
        """Send the fingers somewhere [m], and measure it a little later."""
        self._drive.send_fingers(openings, force)
        self._drive.context.wait(self._drive.finger_period)
        self.force()
        return self.fault

    def force(self) -> float:
        """Measure it [N]; NaN where the sensor gives none."""
        drive = self._drive
        force, now = hypot(*drive.weighed()[:3]), drive.clock.now()
        if isfinite(force):
            self._told = now
            return force
        if now - self._told > _SILENT + 1e-6:
            words = f"no number for {now - self._told:.2f} s while the fingers open"
            drive.devices.arm.stop()
            drive.halt_fingers()
            self.fault = FaultFound("wrench_nan", words, drive.limb.name)
        return nan


def run_grip(
    drive: Drive,
    held: Held,
    until: tuple[GripPhase, ...],
    most_force: float = np.inf,
) -> FaultFound | None:
    """Tick the fingers until their grip is in one of some phases, arm standing.

    Ends before that, the fingers halted, when the hand is pushed by more than
    ``most_force`` [N]; `load` tells where to.
    """
    supervisor, begun = drive.supervised()
    if isinstance(begun, FaultFound):
        return begun
    state, q = begun, tuple(np.asarray(begun.q).tolist())
    for _ in range(int(12.0 / drive.period)):
        held.state, command = held.grip.step(held.state, drive.fingers())
        # No finger squeezes before all have met the object, or it is pushed away.
        force = held.grip.config.resistance
        drive.send_fingers(command.openings, force)
        if held.state.phase in until:
            return None
        fault, state, _ = drive.ticked(
            supervisor, state, q, is_moving=False, with_fingers=False
        )
        if fault is not None:
            return fault
        if hypot(*drive.load[:3]) > most_force:
            drive.send_fingers(drive.fingers().openings, force)
            return None
    words = f"the fingers are still {held.state.phase.value} after 12 s"
    return FaultFound("finger_jammed", words, drive.limb.name)


def open_hand(drive: Drive, preshape: str, opening: float) -> FaultFound | None:
    """Open an empty hand to a preshape, and see that the fingers got there.

    Where they press against something they stop: there is no room for the preshape.
    """
    gripper = drive.devices.gripper
    gripper.preshape(preshape, opening)
    drive.limb.taken = preshape
    n = len(gripper.read().openings)
    drive.send_fingers((opening,) * n, _OPENING_FORCE)
    hand = _Pressed(drive)
    end, pressed = drive.clock.now() + 6.0, hand.force()
    widest = tuple(gripper.read().openings)
    most_force = (pressed if isfinite(pressed) else 0.0) + _MORE
    while drive.clock.now() < end and not pressed > most_force:
        if len(widest) and min(widest) >= opening - 0.006:
            drive.context.is_closed = False
            return None
        drive.context.wait(drive.period)
        widest, pressed = gripper.read().openings, hand.force()
        if hand.fault is not None:
            return hand.fault
    drive.send_fingers(widest, _OPENING_FORCE)
    words = f"fingers at {', '.join(f'{1e3 * x:.0f}' for x in widest)} mm of "
    words += f"{1e3 * opening:.0f} mm, {pressed:.0f} N on the hand"
    return FaultFound("finger_jammed", words, drive.limb.name)


def loosen(drive: Drive, most: float) -> FaultFound | None:
    """Open all fingers as far as they stood during the approach, and no harder.

    So far there was room for them; where there is none any more, they stop.
    """
    gripper = drive.devices.gripper
    before = gripper.read().openings
    goals = tuple(max(x, most) for x in before)
    end, last, since = drive.clock.now() + 8.0, before, drive.clock.now()
    sent = before
    step = _LOOSENING * drive.finger_period
    pressed = _Pressed(drive)
    most_force = max(_PRESSED * drive.limits.force, pressed.force() + _MORE)
    while drive.clock.now() < end:
        squeeze = gripper.read().forces
        steps = _in_balance(drive, squeeze)
        # On from where they were sent: a hand may know larger steps only.
        sent = tuple(
            min(max(x, was_sent) + min(step, steps.get(i, step)), x + _AHEAD, goal)
            for i, (x, was_sent, goal) in enumerate(zip(last, sent, goals, strict=True))
        )
        drive.send_fingers(sent, _OPENING_FORCE)
        drive.context.wait(drive.finger_period)
        now = gripper.read().openings
        force = pressed.force()
        if pressed.fault is not None:
            return pressed.fault
        if force > most_force and not _is_less(gripper.read().forces, squeeze):
            # Wedged: from here on the arm must give way.
            drive.send_fingers(now, _OPENING_FORCE)
            return None
        if all(x > goal - _OPEN for x, goal in zip(now, goals, strict=True)):
            break
        if max(abs(x - y) for x, y in zip(now, last, strict=True)) > _CREEP:
            since = drive.clock.now()
        last = now
        if drive.clock.now() - since > _STALLED:
            break
    hand = gripper.read()
    fingers = zip(hand.openings, before, goals, hand.forces, strict=False)
    for i, (now_open, was_open, goal, force) in enumerate(fingers):
        gone, wanted = now_open - was_open, goal - was_open
        # One that something outside keeps from opening more holds nothing, either.
        if wanted > _SHORT and gone < min(_SHORT, 0.5 * wanted) and force > _FELT:
            words = f"finger {i + 1} opened by {1e3 * gone:.1f} mm"
            return FaultFound("finger_jammed", words, drive.limb.name)
    return None


def give_way(drive: Drive) -> FaultFound | None:
    """Let fingers of an open hand yield to what presses them, from inside or outside.

    As far as they go, or until none is pressed hard any more.
    """
    gripper, pressed = drive.devices.gripper, _Pressed(drive)
    for _ in range(_YIELDS):
        hand = gripper.read()
        steps = [_yielding(force) for force in hand.forces]
        if not any(steps):
            break
        goals = tuple(
            x + step for x, step in zip_longest(hand.openings, steps, fillvalue=0.0)
        )
        fault = pressed.moved(goals, _OPENING_FORCE)
        if fault is not None:
            return fault
    return None


def draw_in(drive: Drive) -> FaultFound | None:
    """Close the fingers of an open hand half-way, or until they touch what is between.

    Gently: they are to hold nothing.
    """
    gripper, pressed = drive.devices.gripper, _Pressed(drive)
    halves = [0.5 * x for x in gripper.read().openings]
    for _ in range(round(max(halves, default=0.0) / _YIELD)):
        hand = gripper.read()
        free = [force <= _FELT for force in hand.forces]
        goals = tuple(
            max(x - _YIELD, half) if is_free else x
            for x, half, is_free in zip_longest(
                hand.openings, halves, free, fillvalue=0.0
            )
        )
        fault = pressed.moved(goals, _SQUEEZES)
        if fault is not None:
            return fault
    return None


def _yielding(force: float) -> float:
    """Step of a finger that is pressed from inside, or below zero from outside [m]."""
    return copysign(_YIELD, force) if abs(force) > _SOFT else 0.0


def _in_balance(drive: Drive, forces: Sequence[float]) -> dict[int, float]:
    """Longest steps of those fingers, by number, that squeeze so hard [N] and open [m].

    Those of both sides come off at once: else the hand bears what one side still exerts
    when the other is off.
    """
    squeezing = {i: force for i, force in enumerate(forces) if force > _SQUEEZES}
    fingers = drive.limb.hand.fingers
    sides = {fingers[i].side > 0 for i in squeezing if i < len(fingers)}
    if len(sides) < 2:
        return {}
    hardest = max(squeezing.values())
    return {i: _EASES * force / hardest for i, force in squeezing.items()}


def _is_less(forces: Sequence[float], before: Sequence[float]) -> bool:
    """Whether fingers squeeze less than before [N]; those that feel nothing, no."""
    return sum(max(f, 0.0) for f in forces) < sum(max(f, 0.0) for f in before) - _FELT
