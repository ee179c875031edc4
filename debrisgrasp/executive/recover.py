"""Carries an answer out: what is moved, and where the task goes on."""

from __future__ import annotations

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import GripPhase, TarePolicy
from debrisgrasp.control.grip import STILL_FELT
from debrisgrasp.errors import DriverError
from debrisgrasp.geometry import SE3

from .carrying import MET, taken_back
from .caught import felt_out
from .context import Context, Held
from .drive import Drive
from .faults import Action
from .fingers import loosen
from .folding import free_share
from .guarded import nonsense
from .inside import moved_inside
from .laying import put_down
from .lowering import lower, lowering_speed
from .moves import back_out, let_go
from .outcome import FaultEvent
from .relief import doubted, heaviest, relieve, share_of, standing_load, with_room
from .resting import has_touched, put_away
from .result import Done, FaultFound, StepResult
from .states import State
from .stopping import reset_stops, stop_all
from .table import Answer

__all__ = ["clear_up", "recover"]

_RECONNECT = 2.0
"""How long a device that does not answer is asked again [s]."""
_CALM = 1.0
"""How long to stand after something swung [s]."""
_UPWARDS = 30.0
"""Nothing pushes a hand up so hard [N] that was drawn back; a sensor may be wrong."""
_PRESSED = 0.03
"""Share of a limit above which it gives way to what may only press on it."""
_LOOK = 0.1
"""How long a hand that should be empty is weighed [s]."""
_PUSHED_BACK = 45.0
"""A hand that goes back and is pushed against its way by more has come as far as it
can [N]: then it opens, and that pushes it, too."""
_HANGS = 0.7
"""A hand that bears so much of what hung on it has not lost it."""
_LOW = 5e-3
"""What hangs no higher than it lay falls no way [m]."""
_GOES_ON = (*MET, "oscillation", "bias_jump")
"""However it goes back, it is opened then, unless nobody knows what it bears."""
_HELD_FAST = ("too_heavy", "not_released")
"""How drawing a hand back ends that is caught."""
_LOWERED = 0.3
"""What is put back is lowered so far, or to the ground, until it lies [m]."""


def recover(context: Context, event: FaultEvent, answer: Answer) -> StepResult:
    """Do what an answer asks for; `Done.next` says where to go on."""
    if event.fault == "connection_lost":
        fault = _reconnected(context)
        if fault is not None:
            return fault
        # It was in motion: the next one begins at rest.
        if silent := stop_all(context):
            words = f"does not obey a stop: {'; '.join(silent)}"
            return FaultFound("joint_stuck", words)
    reset_stops(context)
    if event.fault == "start_outside_limits":
        fault = moved_inside(context, event.message)
        if fault is not None:
            return fault
    busy = context.is_in_pile if context.held is None else context.held.arm
    if answer.resume in (State.LIFT, State.RETREAT):
        for name in dict.fromkeys((busy, event.arm)):
            fault = relieve(context, name) if name is not None else None
            if fault is not None:
                return fault
    if answer.action is Action.HOLD:
        held = context.held
        if held is None:
            context.wait(_CALM)
        elif fault := Drive(context, held.arm).squeezed_on(_CALM):
            return fault
        context.cycle.speed *= 0.5
    if answer.is_cleared_up:
        fault = clear_up(context)
        if fault is not None:
            return fault
    return Done({"resume": answer.resume.value if answer.resume else ""}, answer.resume)


def clear_up(context: Context) -> FaultFound | None:
    """Put down what is held, back out, and bring every arm to rest."""
    held = context.held
    busy = context.is_in_pile if held is None else held.arm
    fault: FaultFound | None = None
    if held is not None:
        held.is_watched = False
    if held is not None and _has_lost(context, held):
        # Lowered, the hand would come down on what it lost.
        fault = let_go(context) or relieve(context, held.arm)
    elif held is not None and held.is_lifted:
        fault = relieve(context, held.arm) or taken_back(context)
        fault = fault or put_down(context, _LOWERED)
    elif busy is not None:
        # What presses on a hand that has lifted nothing is its own squeeze first.
        if held is not None:
            fault = _gone_back(context, held) or let_go(context)
        elif context.is_closed:
            fault = _opened(context, busy)
        fault = fault or relieve(context, busy)
    place = None if held is None else _remember(context, held)
    if fault is not None:
        return fault
    # A trunk that both arms share must be back before the idle arm is at rest again,
    # and turns with the other one, which may stand among other things.
    first, motion = busy, context.cycle.motion
    if first is None and motion is not None:
        first = motion.arm
    for name in sorted(context.limbs, key=lambda name: name != first):
        if name == busy:
            fault = back_out(context, name)
            is_held_fast = fault is not None and fault.fault in _HELD_FAST
            if is_held_fast or (fault is None and has_touched(context)):
                reset_stops(context)  # caught: pulled on, it would only press harder
                fault = felt_out(context, name)
            fault = fault or _hanging(context, name)
            if fault is None and State.VERIFY_RELEASE in context.cycle.reached:
                context.count_removal()  # let go at the drop-off, and off the hand now
        else:
            fault = relieve(context, name)  # on its way it may have met something
        if fault is not None:
            return fault
        fault = put_away(context, name, place if name == busy else None)
        if fault is not None:
            return fault
    context.is_in_pile = None
    return None


def _has_lost(context: Context, held: Held) -> bool:
    """Whether nothing is left in a hand that held something.

    What fingers of one side feel nothing of may still hang on the others.
    """
    if held.state.phase is not GripPhase.SLIPPED:
        return False
    drive = Drive(context, held.arm)
    hangs = drive.carried(drive.weighed()) > _HANGS * max(
        held.state.most_carried, context.settings.empty_load
    )
    return not hangs and held.grip.weakest(drive.fingers().forces) < STILL_FELT


def _gone_back(context: Context, held: Held) -> FaultFound | None:
    """Go back to where a lift began that came to nothing, as far as that goes.

    Opened under the load that ended it, the fingers would be caught in it.
    """
    drive = Drive(context, held.arm)
    if held.begun is None:
        return None
    load = standing_load(context, drive)
    if isinstance(load, FaultFound):
        return load
    way = held.begun - drive.limb.pose(context.posture(drive.limb)).p
    is_over = share_of(load, drive.limits) > 1.0
    if is_over or float(np.linalg.norm(way)) < _LOW:
        return None
    end = drive.leg(
        way,
        speed=lowering_speed(drive, load),
        tare=TarePolicy.SESSION,
        limits=with_room(drive.limits, load),
        until=drive.against(way, _PUSHED_BACK),
    )
    if not isinstance(end, FaultFound):
        return None
    if end.fault not in _GOES_ON:
        return end
    reset_stops(context)  # as far as it goes
    return None


def _remember(context: Context, held: Held) -> FloatArray | None:
    """Take what was let go on the way for an obstacle; it may have fallen.

    Returns
    -------
    FloatArray or None
        Where it was let go beside the way, where only a look of its own shows it, base
        frame [m], shape (3,).
    """
    if not len(held.points_hand):
        return None
    limb = context.limbs[held.arm]
    body = limb.pose(context.posture(limb)).apply(held.points_hand)
    is_seen = bool(context.is_in_way(body.mean(axis=0)))
    high = max(float(body[:, 2].min()), 0.0)
    lies = body - [0.0, 0.0, high]
    if high > _LOW:
        lies = np.concatenate([body, lies])  # it stands: its lower end was not seen
    memory = context.memory
    (memory.fallen if is_seen else memory.dropped).append(lies)
    return None if is_seen else lies.mean(axis=0)


def _hanging(context: Context, arm: str) -> FaultFound | None:
    """Notice that something is still caught in a hand that was opened and drawn out.

    No way to rest would be planned around it. What only presses on it does not hang.
    """
    drive = Drive(context, arm)
    found = _hangs(drive)
    if found is None or found.fault != "not_released":
        return found
    if abs(found.values["force"]) > heaviest(context):
        return doubted(context, arm, found.values["force"])
    relieve(context, arm, _PRESSED)  # as far as it goes
    found = _hangs(drive)
    if found is None or found.fault != "not_released":
        return found
    return _opened_low(drive) or _hangs(drive)


def _hangs(drive: Drive) -> FaultFound | None:
    """Weigh a hand that should be empty."""
    stood = drive.stand(_LOOK)
    if isinstance(stood, FaultFound):
        return stood
    weight = drive.carried(drive.load)
    if -_UPWARDS < weight < drive.context.settings.empty_load:
        return None
    words = f"{weight:.0f} N hang on a hand that was opened and drawn back"
    return FaultFound("not_released", words, drive.limb.name, {"force": weight})


def _opened_low(drive: Drive) -> FaultFound | None:
    """Open a hand as wide as it goes, low, where what hangs on it does not fall.

    From up here it would fall past the fingers that open, and strike them.
    """
    context, limb = drive.context, drive.limb
    motion = context.cycle.motion
    risen = 0.0 if motion is None else _risen(context, drive, motion.grasp.T_base_hand)
    end = lower(drive, risen) if risen > _LOW else None
    if isinstance(end, FaultFound):
        return end
    fault = loosen(drive, limb.hand.preshape(limb.preshape).widest)
    if fault is None and risen > _LOW:
        fault = back_out(context, limb.name)
    return fault


def _risen(context: Context, drive: Drive, grasp: SE3) -> float:
    """Tell how far a hand can go down to where it gripped [m]."""
    q = context.posture(drive.limb)
    height = float(drive.limb.pose(q).p[2] - grasp.p[2])
    return height * free_share(drive.limb, q, np.array([0.0, 0.0, -height]))


def _reconnected(context: Context) -> FaultFound | None:
    """Ask every device again until all answer."""
    end, words = context.now() + _RECONNECT, ""
    while context.now() < end:
        try:
            for limb in context.limbs.values():
                limb.limb.arm.read()
                limb.limb.sensor.read()
                limb.limb.gripper.read()
        except DriverError as error:
            words = str(error)
            context.wait(0.1)
            continue
        return nonsense(context)
    return FaultFound("connection_lost", f"{words} Asked for {_RECONNECT:g} s.")


def _opened(context: Context, arm: str) -> FaultFound | None:
    """Open a hand that holds nothing as it was on its way in, before it goes out."""
    drive, motion = Drive(context, arm), context.cycle.motion
    widest = max(shape.widest for shape in drive.limb.hand.preshapes.values())
    if motion is not None and motion.arm == arm:
        shape = drive.limb.hand.preshape(motion.grasp.preshape)
        widest = min(motion.grasp.opening, shape.widest)
    return loosen(drive, widest)
