"""A hand at the end of a simulated arm, made from the file that the planner reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any
from xml.etree import ElementTree

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3, Solid
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.prototypes.hand_kinematics import Finger
from debrisgrasp.robot import FakeConfig, Violation
from debrisgrasp.robot.drives import Timeline
from debrisgrasp.robot.fake_hand import FakeGripper
from debrisgrasp.sim import HandPhysics
from debrisgrasp.sim.fingers import FingerDrive, Mechanism, Skin

__all__ = ["SimGripper"]

_GRID = 121
_OVER = 1.02
"""So much more than asked for do fingers squeeze, so that they reach it."""
_WINDOW = 0.1
"""Share of the closing range over which the ratio of a finger is taken."""


class _Table:
    """Values over evenly spaced arguments, read one at a time as plain floats."""

    def __init__(self, at: FloatArray, values: FloatArray) -> None:
        order = np.argsort(at, kind="stable")
        low, high = float(at.min()), float(at.max())
        even = np.linspace(low, high, _GRID)
        self._low, self._per = low, (_GRID - 1) / max(high - low, 1e-9)
        self._values = np.interp(even, at[order], values[order]).tolist()

    def __call__(self, x: float) -> float:
        """Value at x, that of the end beyond it."""
        row = min(max((x - self._low) * self._per, 0.0), _GRID - 1.0)
        i = min(int(row), _GRID - 2)
        low, high = self._values[i], self._values[i + 1]
        return float(low + (row - i) * (high - low))


@dataclass(frozen=True, slots=True, eq=False)
class _Transmission:
    """How the travel of a drive goes with the opening of its finger."""

    travel: _Table
    """Of the drive, over the opening [m]."""
    opening: _Table
    """[m], over the travel."""
    ratio: _Table
    """Change of travel over that of the opening, without its sign, over the opening."""
    effort: _Table
    """Of the drive for each newton that its side presses with, over the opening."""


@dataclass(slots=True)
class _Drive:
    """Drive of one finger in the compiled model."""

    index: int
    """Of the actuator."""
    tendon: int
    stiffness: float
    damping: float
    aim: float
    """Where the drive is sent; its spring is stretched from there to the finger."""
    gear: _Transmission


class SimGripper(FakeGripper):
    """Fingers moved by drives in physics; fulfils `debrisgrasp.robot.Gripper`.

    What it takes and refuses is what `FakeGripper` does.
    """

    def __init__(
        self,
        arm: str,
        model: GripperModel,
        timeline: Timeline,
        config: FakeConfig,
        violations: list[Violation],
        physics: HandPhysics,
    ) -> None:
        super().__init__(model, timeline, config, violations)
        self.arm, self._physics = arm, physics
        self._fingers = [replace(f, name=f"{arm}/{f.name}") for f in model.fingers]
        self.built_shape = self.shape
        """Preshape of the compiled model."""
        self._drives: list[_Drive] = []
        self._made: list[tuple[FingerDrive, _Transmission]] = []
        self._data: Any = None
        self._bodies: list[list[int]] = []

    def add(
        self, root: ElementTree.Element, palm: ElementTree.Element, time_step: float
    ) -> None:
        """Append solids, joints and drives to the palm in the tree of a world."""
        self.built_shape = self.shape
        hand, shape = self.model, self.model.preshape(self.shape)
        skin = Skin.on(palm, hand, self._physics)
        middle = 0.5 * sum(shape.widths)
        wide = min(hand.opening_range[1], float(shape.openings[0]))
        command = hand.opening_to_command(self.shape, wide)
        self._made = []
        for finger in self._fingers:
            mechanism = Mechanism(hand, finger, shape, middle, self._physics, time_step)
            mechanism.add(root, palm, skin, command)
            drive = mechanism.drive(command)
            self._made.append((drive, _transmission(hand, self.shape, finger, drive)))

    def begin(self, model: Any, data: Any) -> None:
        """Stand open in a model that was just compiled."""
        for drive, _ in self._made:
            for joint, value in drive.joints.items():
                data.joint(joint).qpos[0] = value
        self.bind(model, data)
        for moved in self._drives:
            data.ctrl[moved.index] = moved.aim

    def bind(self, model: Any, data: Any) -> None:
        """Work in a model that was just compiled, from where its joints are."""
        self._data = data
        self._drives = []
        aims = {drive.name: drive.start for drive, _ in self._made}
        for drive, gear in self._made:
            index = model.actuator(drive.name).id
            self._drives.append(
                _Drive(
                    index=index,
                    tendon=model.tendon(drive.name).id,
                    stiffness=drive.stiffness,
                    damping=-float(model.actuator_biasprm[index, 2]),
                    aim=aims[drive.name],
                    gear=gear,
                )
            )
        self._bodies = [
            [model.body(f"{f.name}/{k}").id for k in range(len(f.links))]
            for f in self._fingers
        ]

    @property
    def aims(self) -> Sequence[float]:
        """Where the drives are sent; kept when a model is compiled anew."""
        return [drive.aim for drive in self._drives]

    @aims.setter
    def aims(self, values: Sequence[float]) -> None:
        for drive, value in zip(self._drives, values, strict=True):
            drive.aim = value
            self._data.ctrl[drive.index] = value

    def advance(self) -> bool:
        """Let a period pass for the drives: towards their goals, within their force."""
        if self._ready_at is not None and self._timeline.now >= self._ready_at:
            self._ready_at, self._is_initialised = None, True
        data, period = self._data, self._timeline.period
        for drive, goal, opening in zip(
            self._drives, self._goals, self.openings, strict=True
        ):
            gear = drive.gear
            target = gear.travel(goal)
            if target == drive.aim:
                continue
            step = self._config.finger_speed * gear.ratio(opening) * period
            # A worm gear never gives way by itself, but it winds up no further.
            length = float(data.ten_length[drive.tendon])
            drag = drive.damping * float(data.ten_velocity[drive.tendon])
            most = _OVER * self.force * gear.effort(opening)
            if target >= drive.aim:
                spent = max(length + (drag + most) / drive.stiffness, drive.aim)
                drive.aim = min(drive.aim + step, target, spent)
            else:
                spent = min(length + (drag - most) / drive.stiffness, drive.aim)
                drive.aim = max(drive.aim - step, target, spent)
            data.ctrl[drive.index] = drive.aim
        return True

    def measure(self) -> None:
        """Read openings and forces from the drives."""
        for i, drive in enumerate(self._drives):
            gear = drive.gear
            length = float(self._data.ten_length[drive.tendon])
            opening = gear.opening(length)
            self.openings[i] = opening
            effort = float(self._data.actuator_force[drive.index])
            self.forces[i] = effort / gear.effort(opening) / self.peers[i]

    def solids(self) -> tuple[Solid, ...]:
        """Palm and fingers as they stand, in the frame of the hand."""
        data = self._data
        at_hand = _pose(data, data.body(f"{self.arm}/hand").id).inverse()
        found = list(self.model.palm)
        for finger, bodies in zip(self._fingers, self._bodies, strict=True):
            for link, body in zip(finger.links, bodies, strict=True):
                pose = at_hand @ _pose(data, body)
                found += [solid.moved(pose) for solid in link.solids]
        return tuple(found)


def _pose(data: Any, body: int) -> SE3:
    return SE3.from_parts(data.xmat[body].reshape(3, 3), data.xpos[body])


def _transmission(
    hand: GripperModel, preshape: str, finger: Finger, drive: FingerDrive
) -> _Transmission:
    """Tables of one finger over its openings."""
    shape = hand.preshape(preshape)
    commands = np.linspace(shape.commands[0], shape.commands[-1], _GRID)
    tables = {
        name: np.interp(commands, shape.commands, table)
        for name, table in shape.joints.items()
    }
    openings = np.interp(commands, shape.commands, shape.openings)
    travel = np.zeros(_GRID)
    for k, link in enumerate(finger.links):
        if link.joint is not None:
            pull = drive.pulls.get(f"{finger.name}_{k}", 0.0)
            travel = travel + pull * tables[link.joint.variable]
    pad = -finger.side * finger.pad_position(tables)[..., 0]
    half = max(round(0.5 * _WINDOW * _GRID), 1)
    low = np.maximum(np.arange(_GRID) - half, 0)
    high = np.minimum(np.arange(_GRID) + half, _GRID - 1)
    gone = np.maximum(travel[high] - travel[low], 1e-9)
    gain = np.maximum((pad[high] - pad[low]) / gone, 1e-9)
    peers = sum(other.side == finger.side for other in hand.fingers)
    ratio = gone / np.maximum(openings[low] - openings[high], 1e-9)
    return _Transmission(
        travel=_Table(openings, travel),
        opening=_Table(travel, openings),
        ratio=_Table(openings, ratio),
        effort=_Table(openings, gain / peers),
    )
