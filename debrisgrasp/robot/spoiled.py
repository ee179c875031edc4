"""Arms and hands that do something wrong while a fault is active."""

from __future__ import annotations

from collections.abc import Sequence
from math import copysign

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._words import arm_called
from debrisgrasp.control import GripCommand
from debrisgrasp.errors import DriverError
from debrisgrasp.kinematics import LimitSet

from .interface import Arm, Gripper, HandReading, JointReading
from .spoiling import Live, Spoiling

__all__ = ["OnLine", "SpoiledArm", "SpoiledGripper"]


class OnLine:
    """Part of a limb whose connection can be lost."""

    def __init__(self, name: str, device: str, spoiling: Spoiling) -> None:
        self.limb_name, self.device = name, device
        self.spoiling = spoiling

    def require_answer(self) -> None:
        """Raise `DriverError` while the connection is lost."""
        for live in self.spoiling.due(("limb",), self.limb_name):
            live.times += 1
            raise DriverError(
                f"{self.device} of the {arm_called(self.limb_name)}", "no answer"
            )


class SpoiledArm(OnLine):
    """An arm whose joints stick or lie, or whose drives refuse."""

    def __init__(self, name: str, arm: Arm, spoiling: Spoiling) -> None:
        super().__init__(name, "drives", spoiling)
        self._arm = arm

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Joints, in the order of all readings and commands."""
        return self._arm.joint_names

    @property
    def limits(self) -> LimitSet:
        """What the drives keep, or say that they keep."""
        limits = self._arm.limits
        for live in self._due("limit_mismatch"):
            live.times += 1
            limits = limits.shrunk(live.severity)
        return limits

    @property
    def is_engaged(self) -> bool:
        """Whether commands are followed."""
        return self._arm.is_engaged

    @property
    def is_stopped(self) -> bool:
        """Whether a stop is latched."""
        return self._arm.is_stopped

    def read(self) -> JointReading:
        """Latest measurement, or what passes for it."""
        self.require_answer()
        reading = self._arm.read()
        offset = self._offset()
        if offset is None:
            return reading
        return JointReading(reading.time, np.asarray(reading.q) + offset)

    def engage(self) -> None:
        """Ask the drives to follow commands."""
        self.require_answer()
        for live in self._due("controller_refuses"):
            if live.times < live.severity:
                live.times += 1
                return
        self._arm.engage()

    def disengage(self) -> None:
        """Ask the drives to hold by themselves."""
        self.require_answer()
        self._arm.disengage()

    def command(self, q: Sequence[float]) -> None:
        """Send the posture to be at one period from now."""
        self.require_answer()
        for live in self._due("joint_stuck"):
            live.times += 1
            q = self._with_brake(live, q)
        # The drives use the same encoders.
        offset = self._offset()
        self._arm.command(q if offset is None else (np.asarray(q) - offset).tolist())

    def stop(self) -> None:
        """Stand still as quickly as possible, and latch that."""
        # A cut connection stops an arm by itself; the latch is on the robot's side.
        self._arm.stop()

    def reset(self) -> None:
        """End a latched stop."""
        self.require_answer()
        self._arm.reset()

    def _due(self, fault: str) -> list[Live]:
        due = self.spoiling.due(("arm",), self.limb_name)
        return [live for live in due if live.fault == fault]

    def _offset(self) -> FloatArray | None:
        """How far the encoders are off, shape (d,)."""
        for live in self._due("encoder_jump"):
            live.times += 1
            offset = np.zeros(len(self.joint_names))
            if self.limb_name not in live.kept:
                live.kept[self.limb_name] = int(live.rng.integers(len(offset)))
            offset[live.kept[self.limb_name]] = live.severity
            return offset
        return None

    def _with_brake(self, live: Live, q: Sequence[float]) -> list[float]:
        """Bring one joint to rest within its limits, and leave it there."""
        values, now = list(q), self.spoiling.now()
        joint = int(live.severity) % len(values)
        measured = float(self._arm.read().q[joint])
        last = live.kept.get(self.limb_name)
        if last is None:
            live.kept[self.limb_name] = (now, values[joint], values[joint] - measured)
            return values
        then, place, step = last
        dt = now - then
        if dt > 0.0:
            gain = 0.9 * float(self._arm.limits.acceleration[joint]) * dt * dt
            step = copysign(max(abs(step) - gain, 0.0), step)
            place += step
            live.kept[self.limb_name] = (now, place, step)
        values[joint] = place
        return values


class SpoiledGripper(OnLine):
    """A hand that has lost its zero, or one of whose fingers jams."""

    def __init__(self, name: str, gripper: Gripper, spoiling: Spoiling) -> None:
        super().__init__(name, "hand", spoiling)
        self._gripper = gripper

    @property
    def name(self) -> str:
        """Name of its model."""
        return self._gripper.name

    @property
    def is_initialised(self) -> bool:
        """Whether it takes commands."""
        return not self._lost() and self._gripper.is_initialised

    def initialise(self) -> None:
        """Find its zero."""
        self.require_answer()
        for live in self._lost():
            live.kept[self.limb_name] = live.kept.get(self.limb_name, 0) + 1
        self._gripper.initialise()

    def preshape(self, name: str, opening: float) -> None:
        """Begin to stand as for an approach."""
        self.require_answer()
        if not self._lost() and not self._jammed():
            self._gripper.preshape(name, opening)

    def command(self, command: GripCommand) -> None:
        """Send the pads somewhere with a limited force."""
        self.require_answer()
        if self._lost():
            return
        openings = list(command.openings)
        for live in self._jammed():
            finger = int(live.severity) % len(openings)
            openings[finger] = live.kept[self.limb_name]
        self._gripper.command(command._replace(openings=tuple(openings)))

    def read(self) -> HandReading:
        """Latest measurement."""
        self.require_answer()
        return self._gripper.read()

    def _lost(self) -> list[Live]:
        lost = [
            live
            for live in self.spoiling.due(("gripper",), self.limb_name)
            if live.fault == "gripper_uninitialised"
            and live.kept.get(self.limb_name, 0) < live.severity
        ]
        for live in lost:
            live.times += 1
        return lost

    def _jammed(self) -> list[Live]:
        due = self.spoiling.due(("gripper",), self.limb_name)
        jammed = [live for live in due if live.fault == "finger_jammed"]
        for live in jammed:
            live.times += 1
            openings = self._gripper.read().openings
            finger = int(live.severity) % len(openings)
            live.kept.setdefault(self.limb_name, openings[finger])
        return jammed
