"""What can go wrong in a removal: each fault has a number, one class, and an answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from debrisgrasp.control import FaultClass
from debrisgrasp.errors import UnknownNameError

__all__ = ["FAULTS", "LISTED_BY", "Action", "FaultSpec", "fault_named"]

LISTED_BY = "debrisgrasp clear --faults list"
"""Command that prints all faults and states."""


class Action(Enum):
    """What is done about a fault."""

    STOP = "stop"
    """Latched stop; only a person ends it."""
    HOLD = "hold"
    """Stand for a second, squeezing on, then go on at half the speed."""
    RETRY = "retry"
    """Back off, and do it again."""
    NEXT = "next"
    """Leave this grasp or object, and take the next."""
    SKIP = "skip"
    """Do without this step, and say so."""
    ABORT = "abort"
    """End the run in order: open, retreat, rest."""


@dataclass(frozen=True, slots=True)
class FaultSpec:
    """One kind of fault."""

    number: int
    """Place in the table of docs/faults.md."""
    name: str
    words: str
    """What happened, for people."""
    fault_class: FaultClass
    """The one class that a run which ends by it is counted in."""
    action: Action
    """The answer at first ..."""
    budget: int = 0
    """... so many times in one run; 0: `action` is final."""
    then: Action = Action.ABORT
    """And after that."""


_C = FaultClass
_A = Action
_TABLE = (
    FaultSpec(1, "wrench_nan", "the wrench is not a number", _C.DRIVER, _A.STOP),
    FaultSpec(2, "wrench_frozen", "the wrench does not change", _C.DRIVER, _A.STOP),
    FaultSpec(3, "wrench_sign", "the wrench has the wrong sign", _C.DRIVER, _A.STOP),
    FaultSpec(
        4, "bias_drift", "the bias drifted too far", _C.SAFETY, _A.RETRY, 1, _A.ABORT
    ),
    FaultSpec(5, "bias_jump", "the wrench jumped", _C.MECHANICAL, _A.STOP),
    FaultSpec(6, "sensor_saturated", "the sensor is at its end", _C.SAFETY, _A.STOP),
    FaultSpec(
        7,
        "baseline_contact",
        "touched during baseline",
        _C.SAFETY,
        _A.RETRY,
        1,
        _A.ABORT,
    ),
    FaultSpec(8, "ratchet", "the load grew over several motions", _C.SAFETY, _A.STOP),
    FaultSpec(9, "clock_disorder", "times out of order, or a gap", _C.DRIVER, _A.STOP),
    FaultSpec(10, "joint_stuck", "a joint does not follow", _C.MECHANICAL, _A.STOP),
    FaultSpec(11, "encoder_jump", "a joint's reading jumped", _C.MECHANICAL, _A.STOP),
    FaultSpec(
        12,
        "connection_lost",
        "a device does not answer",
        _C.DRIVER,
        _A.RETRY,
        1,
        _A.ABORT,
    ),
    FaultSpec(
        13,
        "controller_refuses",
        "the drives don't engage",
        _C.DRIVER,
        _A.RETRY,
        2,
        _A.ABORT,
    ),
    FaultSpec(
        14,
        "limit_mismatch",
        "drives allow less than is planned with",
        _C.OPERATOR_PARAMETERS,
        _A.ABORT,
    ),
    FaultSpec(
        15,
        "start_outside_limits",
        "the arm is outside its limits",
        _C.PLANNING,
        _A.RETRY,
        1,
    ),
    FaultSpec(
        16,
        "gripper_uninitialised",
        "the gripper is not initialised",
        _C.OPERATOR_GRIPPER_INIT,
        _A.RETRY,
        1,
    ),
    FaultSpec(
        17, "finger_jammed", "a finger does not move", _C.MECHANICAL, _A.RETRY, 1
    ),
    FaultSpec(
        18,
        "calibration_off",
        "the camera is not where it was",
        _C.CALIBRATION,
        _A.ABORT,
    ),
    FaultSpec(
        19,
        "calibration_poses",
        "poses too alike to calibrate",
        _C.CALIBRATION,
        _A.ABORT,
    ),
    FaultSpec(
        20, "fiducial_lost", "the fiducial is not seen", _C.CALIBRATION, _A.RETRY, 2
    ),
    FaultSpec(21, "empty_cloud", "the camera sees nothing", _C.PERCEPTION, _A.RETRY, 2),
    FaultSpec(
        22, "depth_dropout", "the image has holes", _C.PERCEPTION, _A.RETRY, 2, _A.NEXT
    ),
    FaultSpec(
        23,
        "stale_cloud",
        "the image is old or of another frame",
        _C.DRIVER,
        _A.RETRY,
        2,
    ),
    FaultSpec(
        24,
        "plane_eats_pile",
        "the ground is the pile",
        _C.OPERATOR_PARAMETERS,
        _A.SKIP,
        9,
    ),
    FaultSpec(25, "no_grasp", "no grasp was found", _C.PLANNING, _A.NEXT, 99),
    FaultSpec(26, "unreachable", "the arm reaches no grasp", _C.PLANNING, _A.NEXT, 99),
    FaultSpec(27, "plan_collision", "no way is free", _C.PLANNING, _A.NEXT, 99),
    FaultSpec(
        28,
        "early_contact",
        "touched before the grasp",
        _C.BAD_GRASP,
        _A.RETRY,
        1,
        _A.NEXT,
    ),
    FaultSpec(
        29, "empty_grip", "nothing between the fingers", _C.BAD_GRASP, _A.NEXT, 99
    ),
    FaultSpec(30, "slip", "the object slips", _C.BAD_GRASP, _A.RETRY, 1, _A.NEXT),
    FaultSpec(31, "too_heavy", "too heavy, or stuck", _C.SAFETY, _A.NEXT, 99),
    FaultSpec(32, "object_swings", "the object swings", _C.SAFETY, _A.HOLD, 2, _A.NEXT),
    FaultSpec(
        33, "not_released", "the hand does not come free", _C.MECHANICAL, _A.RETRY, 1
    ),
    FaultSpec(34, "oscillation", "the hand swings in contact", _C.SAFETY, _A.STOP),
    FaultSpec(35, "software_error", "a step raised an error", _C.SOFTWARE, _A.STOP),
)

FAULTS: Mapping[str, FaultSpec] = {spec.name: spec for spec in _TABLE}
"""Every fault by its name."""


def fault_named(name: str) -> FaultSpec:
    """Look a fault up, or raise `UnknownNameError`."""
    if name not in FAULTS:
        raise UnknownNameError("fault", name, FAULTS, listed_by=LISTED_BY)
    return FAULTS[name]
