"""What devices of a robot lack of their protocols, and of what they are to answer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from debrisgrasp._words import shortened
from debrisgrasp.errors import InputError

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

__all__ = ["Gap", "absent", "gaps_of", "unanswered"]

_ANSWERS: dict[Any, dict[str, type]] = {
    Arm: {"read": JointReading},
    ForceSensor: {"read": WrenchReading},
    Gripper: {"read": HandReading},
    DepthCamera: {"capture": DepthFrame},
    Head: {"read": JointReading},
}
"""What a device answers, by its protocol and method."""


@dataclass(frozen=True, slots=True)
class Gap:
    """Members of one device that it lacks, or that answer something else."""

    device: str
    """For instance ``arm right``; its first word says what kind it is."""
    members: tuple[str, ...]
    problem: str
    """In words."""

    def of(self, needs: frozenset[str]) -> tuple[str, ...]:
        """Members among those needed, which are named as in ``arm.read``."""
        kind = self.device.split()[0]
        lacking = [name for name in self.members if f"{kind}.{name}" in needs]
        return tuple(f"{name} of {self.device}" for name in lacking)


def absent(robot: Robot) -> Iterator[Gap]:
    """Find members that devices don't have; nothing is asked of them.

    Raises
    ------
    InputError
        If the limbs aren't a dictionary of `Limb`.
    """
    for name, device, protocol in _devices(robot):
        lacking = tuple(
            member
            for member, kind in _members(protocol).items()
            if not _has(device, member, kind)
        )
        if lacking:
            words = f"{name} has no {', '.join(lacking)} ({protocol.__name__})"
            yield Gap(name, lacking, words)


def unanswered(robot: Robot) -> Iterator[Gap]:
    """Find methods that give no reading, or one that lacks something."""
    for name, device, protocol in _devices(robot):
        for member, kind in _ANSWERS.get(protocol, {}).items():
            if not _has(device, member, kind):
                continue
            answer = getattr(device, member)()
            lacks = [f for f in kind.__annotations__ if not hasattr(answer, f)]
            if lacks:
                words = (
                    f"{name}: {member}() gives {type(answer).__name__} without "
                    f"{', '.join(lacks)}; a {kind.__name__} is needed"
                )
                yield Gap(name, (member,), words)


def gaps_of(robot: Robot) -> tuple[Gap, ...]:
    """Collect all, up to the first device that raises something when it is asked."""
    found = list(absent(robot))
    with suppress(Exception):  # a check tells of it
        for gap in unanswered(robot):
            found.append(gap)
    return tuple(found)


def _devices(robot: Robot) -> Iterator[tuple[str, Any, Any]]:
    """Every device with its name and protocol; a robot may have no head and no base."""
    yield "clock", robot.clock, Clock
    yield "camera", robot.camera, DepthCamera
    for name, device, protocol in (
        ("head", robot.head, Head),
        ("base", robot.base, Base),
    ):
        if device is not None:
            yield name, device, protocol
    for name, limb in _limbs(robot).items():
        yield f"arm {name}", limb.arm, Arm
        yield f"sensor {name}", limb.sensor, ForceSensor
        yield f"gripper {name}", limb.gripper, Gripper


def _limbs(robot: Robot) -> Mapping[str, Limb]:
    """Refuse limbs that hold no devices: nothing can be asked of them."""
    limbs = robot.limbs
    if not isinstance(limbs, Mapping):
        said = shortened(repr(limbs))
        raise InputError("limbs of the robot", got=said, expected="a dictionary")
    for name, limb in limbs.items():
        if not isinstance(limb, Limb):
            raise InputError(
                f"limb {name} of the robot",
                got=shortened(repr(limb)),
                expected="a Limb",
                mend="Limb(arm=..., sensor=..., gripper=..., loads=...) makes one.",
            )
    return limbs


def _members(protocol: Any) -> dict[str, object]:
    return {name: kind for name, kind in vars(protocol).items() if name[0] != "_"}


def _has(device: object, name: str, kind: object) -> bool:
    """Whether a device has a member, one that can be called if that is a method."""
    has = True
    with suppress(Exception):  # a property that raises is there; a check tells of it
        has = hasattr(device, name)
        if not isinstance(kind, property):
            has = has and callable(getattr(device, name))
    return has
