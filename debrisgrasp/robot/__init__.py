"""Layer 5: what a robot must offer, and a robot that only exists in memory."""

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
    "Arm",
    "Base",
    "Clock",
    "DepthCamera",
    "DepthFrame",
    "ForceSensor",
    "Gripper",
    "HandReading",
    "Head",
    "JointReading",
    "Limb",
    "Robot",
    "WrenchReading",
]
