"""What can go wrong while the robot moves, and whose matter it is."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

__all__ = ["Fault", "FaultClass", "Stop"]


class FaultClass(Enum):
    """Where to look for the cause: the paper's seven classes, and three more."""

    BAD_GRASP = "bad_grasp"
    OPERATOR_PARAMETERS = "operator_parameters"
    OPERATOR_GRIPPER_INIT = "operator_gripper_init"
    MECHANICAL = "mechanical"
    PLANNING = "planning"
    CALIBRATION = "calibration"
    DRIVER = "driver"
    PERCEPTION = "perception"
    SAFETY = "safety"
    SOFTWARE = "software"


class Fault(Enum):
    """What was noticed."""

    WRENCH_LOST = "no usable wrench"
    WRENCH_FROZEN = "the wrench does not change although the arm moves"
    WRENCH_SATURATED = "the sensor is at the end of its range"
    WRENCH_JUMP = "the wrench jumped"
    OVERLOAD = "the force reached its limit"
    TORQUE_OVERLOAD = "the torque reached its limit"
    MOTION_OVERLOAD = "the load changed more than this motion may change it"
    SWING = "the load turns the hand more than a push could"
    JOINT_STUCK = "a joint does not follow"
    ENCODER_JUMP = "a joint's reading jumped"
    ENCODER_INVALID = "a joint's reading is not a number"
    CLOCK_GAP = "the control loop was interrupted"
    CLOCK_FAST = "the control loop is faster than its period"
    COMMAND_INVALID = "the next command is not a number"
    OSCILLATION = "the hand swings against what it touches"

    @property
    def fault_class(self) -> FaultClass:
        """Where to look for the cause."""
        return _CLASSES[self]


_CLASSES = {
    Fault.WRENCH_LOST: FaultClass.DRIVER,
    Fault.WRENCH_FROZEN: FaultClass.DRIVER,
    Fault.WRENCH_SATURATED: FaultClass.SAFETY,
    Fault.WRENCH_JUMP: FaultClass.MECHANICAL,
    Fault.OVERLOAD: FaultClass.SAFETY,
    Fault.TORQUE_OVERLOAD: FaultClass.SAFETY,
    Fault.MOTION_OVERLOAD: FaultClass.SAFETY,
    Fault.SWING: FaultClass.SAFETY,
    Fault.JOINT_STUCK: FaultClass.MECHANICAL,
    Fault.ENCODER_JUMP: FaultClass.MECHANICAL,
    Fault.ENCODER_INVALID: FaultClass.DRIVER,
    Fault.CLOCK_GAP: FaultClass.DRIVER,
    Fault.CLOCK_FAST: FaultClass.DRIVER,
    Fault.COMMAND_INVALID: FaultClass.SAFETY,
    Fault.OSCILLATION: FaultClass.SAFETY,
}


@dataclass(frozen=True, slots=True)
class Stop:
    """A latched stop; only a person, or the executive on their behalf, resets it."""

    fault: Fault
    message: str
    """What was measured, and which limit it met."""
    time: float
    """When, by the clock of the readings [s]."""
