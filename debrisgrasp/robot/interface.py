"""What a robot must offer to clear a pile: small protocols, one for each device.

An integrator writes one class for each device, puts them into a `Robot`, and runs
`debrisgrasp.robot.check_robot` on it. Nothing here sleeps, blocks or starts a thread:
whoever holds the `Clock` decides how time passes, so that the same code drives hardware
and a simulation that runs faster than real time.

A device that does not answer raises `DriverError`. A reading may be wrong, or NaN:
those who use it watch for that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.control import GripCommand, LoadModel
from debrisgrasp.geometry import SE3, Intrinsics
from debrisgrasp.kinematics import LimitSet, RobotModel

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


class JointReading(NamedTuple):
    """Where joints are."""

    time: float
    """When measured, by the robot's clock [s]."""
    q: Sequence[float] | FloatArray
    """Joint values [rad or m], d of them."""


class WrenchReading(NamedTuple):
    """What a wrist sensor measured."""

    time: float
    """When measured, by the robot's clock [s]."""
    wrench_ft: Sequence[float] | FloatArray
    """Force and torque as the driver gives them [N, N m], six values."""


class HandReading(NamedTuple):
    """How the fingers stand."""

    time: float
    """When measured, by the robot's clock [s]."""
    openings: tuple[float, ...]
    """Of each finger: distance of its pad from the opposing one [m], f of them."""
    forces: tuple[float, ...]
    """Resistance that each finger feels [N], f of them."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DepthFrame:
    """One image of the depth camera."""

    time: float
    """When taken, by the robot's clock [s]."""
    depth: FloatArray
    """Depth [m], 0 or NaN where nothing was measured, shape (H, W)."""
    intrinsics: Intrinsics
    rgb: IntArray | None = None
    """Colours, uint8, shape (H, W, 3)."""
    frame: str = "camera"
    """Optical frame that the image was taken in, as the driver names it."""


@runtime_checkable
class Clock(Protocol):
    """Time of the robot."""

    def now(self) -> float:
        """Seconds; never falls."""

    def wait_until(self, time: float) -> None:
        """Return at that time, or at once if it has passed."""


@runtime_checkable
class Arm(Protocol):
    """Joints that follow postures sent once per control period.

    Between two commands the arm goes to the last one. Without a command for 0.1 s it
    holds by itself. After `stop` it stands until `reset`, whatever is sent.
    """

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Joints, in the order of all readings and commands."""

    @property
    def limits(self) -> LimitSet:
        """What the drives themselves keep."""

    @property
    def is_engaged(self) -> bool:
        """Whether commands are followed, as the drives report it."""

    @property
    def is_stopped(self) -> bool:
        """Whether a stop is latched."""

    def read(self) -> JointReading:
        """Latest measurement."""

    def engage(self) -> None:
        """Ask the drives to follow commands; `is_engaged` tells when they do."""

    def disengage(self) -> None:
        """Ask the drives to hold by themselves."""

    def command(self, q: Sequence[float]) -> None:
        """Send the posture to be at one period from now [rad or m], d values."""

    def stop(self) -> None:
        """Stand still as quickly as possible, and latch that."""

    def reset(self) -> None:
        """End a latched stop; moves nothing."""


@runtime_checkable
class ForceSensor(Protocol):
    """Six-axis sensor in the wrist."""

    def read(self) -> WrenchReading:
        """Latest measurement."""


@runtime_checkable
class Gripper(Protocol):
    """A hand with preshapes."""

    @property
    def name(self) -> str:
        """Name of its model, as in the files of grippers."""

    @property
    def is_initialised(self) -> bool:
        """Whether it has found its own zero and takes commands."""

    def initialise(self) -> None:
        """Find its zero; `is_initialised` tells when that is done."""

    def preshape(self, name: str, opening: float) -> None:
        """Begin to stand as for an approach: name of a preshape, opening [m]."""

    def command(self, command: GripCommand) -> None:
        """Send the pads somewhere with a limited force; once per control period.

        The force is that of all fingers of one side together, as that of
        `GripperModel.max_force`: with two on a side each presses with half of it.
        """

    def read(self) -> HandReading:
        """Latest measurement."""


@runtime_checkable
class DepthCamera(Protocol):
    """A depth camera, whose pose the calibration and the head know."""

    def capture(self) -> DepthFrame:
        """Take a new image."""


@runtime_checkable
class Head(Protocol):
    """Pan and tilt of the camera."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Joints, in the order of all readings and commands."""

    @property
    def is_still(self) -> bool:
        """Whether it has arrived."""

    def read(self) -> JointReading:
        """Latest measurement."""

    def move_to(self, q: Sequence[float]) -> None:
        """Begin to turn there [rad]."""


@runtime_checkable
class Base(Protocol):
    """Tracks or wheels."""

    def read(self) -> SE3:
        """Pose of the base in its odometry's frame, ``T_odom_base``."""

    def drive(self, forward: float, turn: float) -> None:
        """Go on at this speed [m/s] and rate [rad/s] until told otherwise.

        Without a command for 0.5 s it stands by itself: whoever drives says so again.
        """

    def stop(self) -> None:
        """Stand still."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Limb:
    """An arm, the sensor in its wrist, and the hand that it carries."""

    arm: Arm
    sensor: ForceSensor
    gripper: Gripper
    loads: LoadModel
    """Where the sensor is, and what hangs on it, as configured or identified."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Robot:
    """All devices of a robot, under the names of its model."""

    model: RobotModel
    clock: Clock
    limbs: Mapping[str, Limb]
    """By the names of the model's arms."""
    camera: DepthCamera
    head: Head | None = None
    base: Base | None = None
