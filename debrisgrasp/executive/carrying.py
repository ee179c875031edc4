"""Up, and away."""

from __future__ import annotations

from math import hypot

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._physics import GRAVITY
from debrisgrasp.control import (
    Compliance,
    LegOutcome,
    TarePolicy,
    identify_payload,
)
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3
from debrisgrasp.motion import MotionPlan, MotionPlanner, MotionSpace, UnknownSpace

from .context import Context, Held
from .drag import drag
from .drive import Drive
from .dropoff import drop_postures, longer, may_lie, no_place, room_below
from .folding import free_share, is_folded
from .hanging import looked_at
from .limb_state import LimbState
from .loaded import carrying
from .moves import LAST_RESORT, planned, within_limits
from .obstacles import box_around, room_for, space_of
from .result import Done, FaultFound, StepResult
from .senses import mean_wrench
from .stopping import reset_stops
from .triage import Way

__all__ = ["MET", "lift", "taken_back", "transport", "verify_hold"]

_STANDING = 0.4
"""How long the arm stands while the load is averaged [s]."""
_HIGHER = 0.12
"""How far an object is lifted once more where no way is free around it [m]."""
_SLOWEST = 0.1
"""Share of the usual speed that is left of it after some touches."""
_CAREFUL = 0.3
"""Share of the usual speed on a way on which what is held may touch something."""
_AROUND = 0.05
"""Room around what is held over the rest of the pile [m]."""
_LEAST = 5e-3
"""A shorter lift is none [m]."""
_SPARE = 0.02
"""The last bit of what an arm reaches is left to what pushes it [m]."""
_FREE = 0.6
"""Share of the lift after which what lies below no longer matters."""
_BORNE = 0.6
"""With less than this share of its weight on the hand, an object stands on something.
"""
MET = ("plan_collision", "too_heavy", "ratchet")
"""How a motion ends that meets something."""
_LOOKS_UP = 0.2
"""Upward part of a palm's axis from which on what it holds lies on it."""
_HANGS = 0.4
"""Share of the torque that a hand may bear: what hangs with more bears two or three
times as much as it turns in the fingers."""
_IMPOSSIBLE = 30.0
"""Nothing pushes a hand up that it has lifted; a sensor that says so lies [N]."""


def lift(context: Context) -> StepResult:
    """Draw the object out, giving way to what resists, within absolute limits."""
    held = context.held
    assert held is not None
    triage = context.cycle.triage
    if triage is not None and triage.way is Way.DRAG:
        return drag(context)
    limb, settings = context.limbs[held.arm], context.settings
    translation, rotation = settings.compliance
    drive = Drive(context, held.arm)
    p0 = limb.pose(context.posture(limb)).p
    held.begun = p0 if held.begun is None else held.begun
    height = _height_to_go(context, limb, held, float(p0[2]))
    if height < _LEAST:
        return Done({"share": 1.0})  # higher it can't be
    end = drive.leg(
        [0.0, 0.0, height],
        speed=settings.lift_speed * context.cycle.speed,
        compliance=Compliance.diagonal(translation, rotation),
        tare=TarePolicy.SESSION,
    )
    if isinstance(end, FaultFound):
        return end
    held.is_lifted = True
    if end.outcome is LegOutcome.BLOCKED and end.share < _FREE:
        words = f"the arm got {100 * end.share:.0f} % of the lift far"
        return FaultFound("too_heavy", words, held.arm, {"share": end.share})
    peak = context.cycle.peak_force
    facts = {"height": round(height, 3), "share": round(end.share, 3)}
    return Done({"peak_force": round(peak, 1), **facts})


def _height_to_go(context: Context, limb: LimbState, held: Held, z: float) -> float:
    """Tell how far to lift: clear of the pile, as far as the arm can [m].

    What is left of it if it was interrupted, and some more if something was touched
    on the way from there.
    """
    motion = context.cycle.motion
    assert motion is not None
    least = context.settings.lift
    q = context.posture(limb)
    if is_folded(limb, q):
        return 0.0 if held.is_lifted else least  # so much was planned
    if held.is_lifted:
        begun = float(motion.grasp.T_base_hand.p[2])
        wanted = max(least - max(z - begun, 0.0), _HIGHER)
        return wanted * free_share(limb, q, np.array([0.0, 0.0, wanted]))
    wanted = max(_height_over_pile(context, held, limb.pose(q)), least)
    share = free_share(limb, q, np.array([0.0, 0.0, wanted]))
    return max(share * wanted - _SPARE, least)


def _height_over_pile(context: Context, held: Held, T_base_hand: SE3) -> float:
    """Tell how far what is held must rise to be over all that is around it [m]."""
    seen, is_own = context.cycle.seen, context.cycle.is_own
    if seen is None or is_own is None or not len(held.points_hand):
        return 0.0
    others = seen.cloud.points[~is_own & (seen.segmentation.labels != 0)]
    own = T_base_hand.apply(held.points_hand)
    low, high = own.min(axis=0) - _AROUND, own.max(axis=0) + _AROUND
    inside = ((others[:, :2] > low[:2]) & (others[:, :2] < high[:2])).all(axis=1)
    if not inside.any():
        return 0.0
    return float(others[inside, 2].max() - own[:, 2].min()) + _AROUND


def verify_hold(context: Context) -> StepResult:
    """Weigh what hangs on the hand."""
    held, settings = context.held, context.settings
    assert held is not None
    limb, drive = context.limbs[held.arm], Drive(context, held.arm)
    n_seen = looked_at(context, held) if held.is_lifted else 0
    readings = drive.stand(_STANDING)
    if isinstance(readings, FaultFound):
        return readings
    T = limb.pose(context.posture(limb))
    raw = mean_wrench(readings)
    try:
        payload, _ = identify_payload(
            limb.loads,
            raw,
            T.R @ limb.loads.T_ee_ft.R,
            expected_com=_middle_ft(limb, held),
        )
    except InputError as error:
        up = -drive.carried(drive.mean_load(readings))
        if up > _IMPOSSIBLE:
            words = f"the hand, lifted, is pushed up by {up:.0f} N"
            return FaultFound("wrench_sign", words, held.arm, {"force": up})
        return FaultFound("slip", f"nothing hangs on the hand: {error}", held.arm)
    weight = GRAVITY * payload.mass
    values = {"mass": payload.mass}
    if weight < 0.5 * settings.empty_load:
        words = f"the hand carries {weight:.1f} N: the object was lost"
        return FaultFound("slip", words, held.arm, values)
    if payload.mass > settings.max_mass + 0.25:
        words = f"{payload.mass:.1f} kg, over the {settings.max_mass:g} kg allowed"
        return FaultFound("too_heavy", words, held.arm, values)
    held.payload = payload
    torque, most = hypot(*drive.mean_load(readings)[3:]), limb.limits.controller.torque
    if torque > _HANGS * most:
        words = f"{payload.mass:.1f} kg hang beside the hand: {torque:.0f} N m of the "
        words += f"{most:.0f} that it may bear, too much to be carried"
        return FaultFound("too_heavy", words, held.arm, {"torque": torque})
    # What lay on it during the lift is gone, and the fingers have found their hold: a
    # loss is one of this weight, with fingers that close from here.
    held.state = held.state.held_from(tuple(drive.fingers().openings))._replace(
        most_carried=weight, slipping=0.0
    )
    facts: dict[str, object] = {"mass": round(payload.mass, 3), "points": n_seen}
    if n_seen:
        facts["size"] = np.round(box_around(held.points_hand).size, 2).tolist()
    return Done(facts)


def _middle_ft(limb: LimbState, held: Held) -> FloatArray:
    """Middle of what is held as it was seen, frame of the sensor [m], shape (3,).

    Weighed in one attitude, an object tells its centre of mass across gravity only.
    """
    points = held.points_hand
    if not len(points):
        return limb.loads.T_ee_ft.inverse().p
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return limb.loads.T_ee_ft.inverse().apply(middle)


def transport(context: Context) -> StepResult:
    """Carry what is held over the drop-off, around everything else."""
    held = context.held
    assert held is not None
    limb, drive = context.limbs[held.arm], Drive(context, held.arm)
    if context.cycle.hung is None:
        context.cycle.hung = context.posture(limb)
    is_again = sum(state is context.state for state in context.cycle.reached) > 1
    if is_again and _is_beside(context, limb, held):
        context.is_in_pile = None
        return Done({"seconds": 0.0})  # what it touched bears it
    found, is_highest = _way(context, limb, held), False
    if isinstance(found, FaultFound) and found.fault == "plan_collision":
        # What it hangs over may be in the way of the box around it.
        q, up = context.posture(limb), np.array([0.0, 0.0, _HIGHER])
        share = 0.0 if is_folded(limb, q) else free_share(limb, q, up)
        is_highest = share * _HIGHER <= _LEAST
        if not is_highest:
            end = drive.leg(
                share * up, speed=context.settings.lift_speed, tare=TarePolicy.SESSION
            )
            if isinstance(end, FaultFound):
                return end
            found = _way(context, limb, held)
    pace = context.settings.carry_speed * context.cycle.speed
    if isinstance(found, FaultFound):
        found, pace = _bare_way(context, limb, held), _CAREFUL * pace
    if isinstance(found, FaultFound):
        if not is_highest or found.fault != "plan_collision":
            return found
        words = f"no way to the drop-off, and the arm lifts no higher: {found.message}"
        return FaultFound("unreachable", words, held.arm)
    assert found.trajectory is not None
    context.is_in_pile = None
    begun = context.now()
    fault = drive.follow(found.trajectory, pace=pace)
    if fault is not None:
        # It is larger than it looked: what it may touch next must be met more slowly.
        context.cycle.speed = max(0.5 * context.cycle.speed, _SLOWEST)
        if fault.fault == "plan_collision" and drive.carried(drive.load) < _BORNE * (
            GRAVITY * held.payload.mass
        ):
            T = limb.pose(context.posture(limb))
            room = room_below(context, T.apply(held.points_hand))
            held.points_hand = longer(held.points_hand, T, room)
        return fault
    return Done({"seconds": round(context.now() - begun, 3)})


def taken_back(context: Context) -> FaultFound | None:
    """Try to bring what lies on a palm that looks up back to where it was lifted.

    Let go here it would lie on the fingers. It is tried once: where a motion meets
    something, or there is none, it is let go all the same.
    """
    held, hung = context.held, context.cycle.hung
    context.cycle.hung = None
    if held is None or hung is None:
        return None
    limb = context.limbs[held.arm]
    if limb.pose(context.posture(limb)).R[2, 2] < _LOOKS_UP:
        return None
    is_own, ignored = context.cycle.is_own, UnknownSpace.IGNORED
    space = room_for(context, [limb], is_own, unknown=ignored)
    goal = within_limits(limb, hung)
    if isinstance(goal, FaultFound):
        return None
    found = planned(context, limb, goal, space, known=limb.known_way)
    if isinstance(found, FaultFound):
        return None
    assert found.trajectory is not None
    fault = Drive(context, held.arm).follow(
        found.trajectory,
        pace=_CAREFUL * context.settings.carry_speed * context.cycle.speed,
    )
    if fault is None or fault.fault not in MET:
        return fault
    reset_stops(context)  # what it touched may bear it
    return None


def _is_beside(context: Context, limb: LimbState, held: Held) -> bool:
    """Whether what is held hangs outside of the way, where it may be put down."""
    T = limb.pose(context.posture(limb))
    points = T.apply(held.points_hand)
    return (
        room_below(context, points) < _HIGHER + _AROUND
        and not context.is_in_way(points).any()
        and may_lie(context, limb, held.points_hand, T)
    )


def _way(context: Context, limb: LimbState, held: Held) -> MotionPlan | FaultFound:
    """Plan to over the drop-off with a box around what is held.

    Through what was not seen only if there is no other way.
    """
    planner, is_own = carrying(context, limb), context.cycle.is_own
    q = context.posture(limb)
    strict = space_of(context, is_own, unknown=UnknownSpace.HIDDEN)
    space = strict.without_unknown()
    if not planner.stands_free(q, space):
        stands, ignored = (planner, q), UnknownSpace.IGNORED
        space = space_of(context, is_own, unknown=ignored, stands=stands)
    if not planner.stands_free(q, space):
        words = "the box around what is held touches something where it hangs"
        return FaultFound("plan_collision", words, limb.name)
    goals = _goals(context, limb, held, space, planner)
    if not len(goals):
        return _nowhere(context, limb, held)
    if planner.stands_free(q, strict):
        found = planned(context, limb, goals, strict, planner)
        if not isinstance(found, FaultFound):
            return found
    return planned(context, limb, goals, space, planner, max_rounds=LAST_RESORT)


def _bare_way(context: Context, limb: LimbState, held: Held) -> MotionPlan | FaultFound:
    """Plan for the arm alone: the box may touch what the object itself does not."""
    is_own = context.cycle.is_own
    space = room_for(context, [limb], is_own, unknown=UnknownSpace.IGNORED)
    goals = _goals(context, limb, held, space, limb.planner)
    if not len(goals):
        return _nowhere(context, limb, held)
    return planned(context, limb, goals, space)


def _nowhere(context: Context, limb: LimbState, held: Held) -> FaultFound:
    T_base_hand = limb.pose(context.posture(limb))
    words = no_place(context, limb, held.points_hand, T_base_hand)
    return FaultFound("unreachable", words, limb.name)


def _goals(
    context: Context,
    limb: LimbState,
    held: Held,
    space: MotionSpace,
    planner: MotionPlanner,
) -> FloatArray:
    """Postures over the drop-off that touch nothing, nearest first, (g, d)."""
    q, points = context.posture(limb), held.points_hand
    is_free = planner.exact_test(space).is_free
    return drop_postures(context, limb, points, q, is_free)
