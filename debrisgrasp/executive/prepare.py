"""See that the devices say the truth, before anything is touched."""

from __future__ import annotations

import logging
from math import isfinite

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._words import arm_called
from debrisgrasp.control import (
    BaselineLook,
    BiasBound,
    LoadModel,
    RefusalCause,
    felt_weight,
    judge_baseline,
)
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import LimitFamily
from debrisgrasp.motion import UnknownSpace
from debrisgrasp.robot.kinds import dead_half, odd_openings

from .context import Context
from .drive import Drive
from .fingers import open_hand
from .guarded import nonsense
from .limb_state import LimbState
from .moves import planned
from .noticed import misplaced
from .obstacles import space_of
from .resting import to_rest
from .result import Done, FaultFound, StepResult
from .stances import has_moved

__all__ = ["self_test"]

logger = logging.getLogger(__name__)

_WAITS = 9
"""By so many the period of the loop is measured."""
_LOOK = 1.02
"""Duration of a look at free space [s]; the sensor's noise is judged over it."""
_LATE, _OFTEN = 1.5, 0.02
"""A tick after so many periods is late, and more of them than this share are often."""
_TURN = np.pi / 2
"""By which a joint of the wrist turns between the looks [rad]."""
_LEAST_TURN = np.deg2rad(50.0)
_INITIALISING = 8.0
"""A hand has found its zero within so long [s]."""
_FIRST_AGE = 3600.0
"""How old the configured bias is taken to be when the robot starts [s]."""


def self_test(context: Context) -> StepResult:
    """See that limits, grippers, signs and zeros are what they are said to be."""
    facts: dict[str, object] = {}
    odd = nonsense(context)
    if odd is not None:
        return odd
    if fault := _out_of_step(context) or has_moved(context):
        return fault
    for limb in context.limbs.values():
        fault = _limits(limb) or _gripper(context, limb)
        if fault is not None:
            return fault
    for limb in context.limbs.values():
        fault = Drive(context, limb.name).engage() or to_rest(context, limb.name)
        if fault is not None:
            return fault
        found = _baseline(context, limb)
        if isinstance(found, FaultFound):
            return found
        limb.limb.arm.disengage()
        facts[limb.name] = {
            "bias": np.round(found, 3).tolist(),
            "limits": limb.limits.controller.hash,
            "drop_off": list(context.settings.drop_off[limb.name]),
        }
    return Done(facts)


def _out_of_step(context: Context) -> FaultFound | None:
    """See that the robot takes a period for what the loop takes for one."""
    period, times = context.settings.period, [context.now()]
    for _ in range(_WAITS):
        context.wait(period)
        times.append(context.now())
    taken = float(np.median(np.diff(times)))
    if taken <= 1.5 * period:
        return None
    words = f"a wait of {1e3 * period:g} ms takes {1e3 * taken:.3g} ms: set "
    words += "TaskSettings.period to the period of the robot's loop"
    return FaultFound("clock_disorder", words)


def _limits(limb: LimbState) -> FaultFound | None:
    """Compare the drives' limits with those that everything is planned with."""
    arm, family = limb.limb.arm, limb.limits
    try:
        LimitFamily(
            hardware=arm.limits, controller=family.controller, planner=family.planner
        )
    except ConfigError as error:
        return FaultFound("limit_mismatch", str(error), limb.name)
    reading = arm.read()
    if not isfinite(reading.time):
        words = f"the {arm_called(limb.name)} measures at {reading.time} s"
        return FaultFound("connection_lost", words, limb.name)
    q = np.asarray(reading.q, dtype=np.float64)
    return misplaced(q, family.controller, limb.name)


def _gripper(context: Context, limb: LimbState) -> FaultFound | None:
    """Let the hand find its zero, once, and see that it tells openings."""
    gripper = limb.limb.gripper
    if not gripper.is_initialised:
        gripper.initialise()
    end = context.now() + _INITIALISING
    while not gripper.is_initialised:
        if context.now() > end:
            words = f"{gripper.name} has not found its zero in {_INITIALISING:g} s"
            return FaultFound("gripper_uninitialised", words, limb.name)
        context.wait(0.05)
    return _odd_fingers(limb)


def _odd_fingers(limb: LimbState) -> FaultFound | None:
    """Name a hand whose openings are none that it can have."""
    hand = limb.hand
    widest = max(hand.preshape(name).widest for name in hand.preshapes)
    odd = odd_openings(limb.limb.gripper.read().openings, widest)
    words = f"the gripper of the {arm_called(limb.name)} sends nonsense: {odd}"
    return FaultFound("connection_lost", words, limb.name) if odd else None


def _baseline(context: Context, limb: LimbState) -> FloatArray | FaultFound:
    """Find the bias in free space, with gravity from two sides."""
    drive = Drive(context, limb.name)
    preshape = limb.first_preshape
    widest = limb.hand.preshape(preshape).widths[1]
    # A share of an opening shows once the fingers are open.
    fault = open_hand(drive, preshape, widest) or _odd_fingers(limb)
    if fault is not None:
        return fault
    first = _look(context, drive, widest)
    if isinstance(first, FaultFound):
        return first
    turned = _turn(context, limb)
    if turned is not None:
        return turned
    second = _look(context, drive, widest)
    if isinstance(second, FaultFound):
        return second
    looks = (first, second)
    if dead := dead_half(np.concatenate([look.raw for look in looks])):
        return FaultFound("wrench_frozen", dead, limb.name)
    wrong = _sign(limb.loads, looks)
    if wrong:
        return FaultFound("wrench_sign", wrong, limb.name)
    age = context.now() - limb.baseline_time if limb.baseline_time else _FIRST_AGE
    verdict = judge_baseline(
        looks, limb.loads, limb.limb.loads.bias, age=age, drift=BiasBound()
    )
    if verdict.bias is None:
        causes = {refusal.cause for refusal in verdict.refusals}
        has_drifted = (
            RefusalCause.SHIFTED in causes and RefusalCause.TOUCHED not in causes
        )
        name = "bias_drift" if has_drifted else "baseline_contact"
        words = "; ".join(map(str, verdict.refusals))
        return FaultFound(name, words, limb.name)
    limb.loads = limb.loads.with_bias(verdict.bias)
    limb.baseline_time = context.now()
    back = to_rest(context, limb.name)
    return verdict.bias if back is None else back


def _look(context: Context, drive: Drive, widest: float) -> BaselineLook | FaultFound:
    """Read the sensor while the arm stands."""
    limb = drive.limb
    before = context.posture(limb)
    readings = drive.stand(_LOOK)
    if isinstance(readings, FaultFound):
        return readings
    _tell_late(context, [reading.time for reading in readings])
    q = context.posture(limb)
    openings = limb.limb.gripper.read().openings
    T = limb.pose(q)
    return BaselineLook(
        raw=np.array([np.asarray(r.wrench_ft, dtype=np.float64) for r in readings]),
        R_base_ft=T.R @ limb.loads.T_ee_ft.R,
        duration=readings[-1].time - readings[0].time,
        clearance=_height(limb, T, widest),
        is_open_and_empty=len(openings) > 0 and min(openings) > widest - 0.01,
        is_standing=bool(np.abs(q - before).max() < 2e-3),
    )


def _tell_late(context: Context, times: list[float]) -> None:
    """Say if ticks at these times often come late: the arms stand, and go on hard."""
    period = context.settings.period
    share = float(np.mean(np.diff(times) > _LATE * period))
    if share > _OFTEN:
        logger.warning(
            "%.0f %% of the ticks come late by more than half a period of %g ms, and "
            "the arms jerk: give the loop a core of its own, or a longer "
            "TaskSettings.period",
            100.0 * share,
            1e3 * period,
        )


def _height(limb: LimbState, T_base_hand: SE3, opening: float) -> float:
    """Of the hand over the ground [m]."""
    solids = limb.hand.solids(limb.first_preshape, opening)
    return min(float(s.moved(T_base_hand).bounds.lower[2]) for s in solids)


def _turn(context: Context, limb: LimbState) -> FaultFound | None:
    """Turn the hand so that gravity comes from another side."""
    q = context.posture(limb)
    down = limb.pose(q).R.T @ np.array([0.0, 0.0, -1.0])
    limits, why = (
        limb.limits.planner,
        "joints are at their limits, or turn about gravity",
    )
    for joint in range(len(q) - 1, 0, -1):
        for step in (_TURN, -_TURN):
            other = q.copy()
            other[joint] += step
            if limits.violation(other):
                continue
            turned = limb.pose(other).R.T @ np.array([0.0, 0.0, -1.0])
            if np.arccos(np.clip(down @ turned, -1.0, 1.0)) < _LEAST_TURN:
                continue
            space = space_of(context, unknown=UnknownSpace.IGNORED)
            found = planned(context, limb, other, space)
            if not isinstance(found, FaultFound):
                assert found.trajectory is not None
                return Drive(context, limb.name).follow(found.trajectory)
            why = found.message
    words = "no free turn of the wrist shows the sensor gravity from another side: "
    words += why
    return FaultFound("baseline_contact", words, limb.name)


def _sign(loads: LoadModel, looks: tuple[BaselineLook, BaselineLook]) -> str:
    """Say whether the tool's weight changes the readings the wrong way round."""
    Rs = np.array([look.R_base_ft for look in looks])
    forces = np.array([look.raw[:, :3].mean(axis=0) for look in looks])
    along, size = felt_weight(loads, Rs, forces)
    if size < 3.0 or along > -0.5 * size:
        return ""
    return (
        f"a turn of the hand changed the force by {along:.1f} N along the way in which "
        f"the tool's weight of {loads.tool.mass:g} kg changes it by {size:.1f} N"
    )
