"""Layer 5: what a robot must offer, and a robot that only exists in memory."""

from .config import FakeConfig
from .conformance import (
    CHECKS,
    MOVING_CHECKS,
    Check,
    Finding,
    Report,
    check_robot,
)
from .drives import Violation
from .fake import FakeRobot, FakeTruth, fake_robot
from .injection import INJECTABLE, FaultKind, InjectedRobot, Injection, inject
from .interface import (
    Arm,
    Base,
    Clock,
    DepthCamera,
    DepthFrame,
    ForceSensor,
    Gripper,
    HandReading,
    Head,
    JointReading,
    Limb,
    Robot,
    WrenchReading,
)

__all__ = [
    "CHECKS",
    "INJECTABLE",
    "MOVING_CHECKS",
    "Arm",
    "Base",
    "Check",
    "Clock",
    "DepthCamera",
    "DepthFrame",
    "FakeConfig",
    "FakeRobot",
    "FakeTruth",
    "FaultKind",
    "Finding",
    "ForceSensor",
    "Gripper",
    "HandReading",
    "Head",
    "InjectedRobot",
    "Injection",
    "JointReading",
    "Limb",
    "Report",
    "Robot",
    "Violation",
    "WrenchReading",
    "check_robot",
    "fake_robot",
    "inject",
]
