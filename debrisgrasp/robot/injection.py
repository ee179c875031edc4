"""Faults on purpose: each of the task's faults, at any state, alone or together.

Devices are wrapped: what they say or do is spoiled while a fault is active. What can
only go wrong in the world itself (an object slips, or is not where it was) needs a
world that can be changed, as that of `FakeRobot`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, nan
from numbers import Real
from typing import Any

from debrisgrasp._arrays import Rng
from debrisgrasp.errors import ConfigError, InputError, UnknownNameError

from .happenings import APPEARING, HAPPENINGS, RESTING, Changeable
from .interface import Limb, Robot
from .spoiled import SpoiledArm, SpoiledGripper
from .spoiled_sensor import SpoiledSensor
from .spoiled_sight import SpoiledCamera, SpoiledHead
from .spoiling import Live, Spoiling

__all__ = ["INJECTABLE", "FaultKind", "InjectedRobot", "Injection", "inject"]


@dataclass(frozen=True, slots=True)
class FaultKind:
    """How one fault is brought about."""

    device: str
    """What is spoiled: sensor, arm, gripper, limb (all three), camera, head, world."""
    state: str
    """Where it shows if nothing else is asked for."""
    severity: float
    """How bad, if nothing else is asked for ..."""
    unit: str
    """... in this unit."""
    lasting: float = inf
    """For how long after it began [s]."""
    words: str = ""
    """What is done."""
    at: float = 0.0
    """How long after the begin of the state it begins, if nothing else is asked for
    [s]: what jumps must do so while the arm moves."""


_S = "sensor"
INJECTABLE: Mapping[str, FaultKind] = {
    "wrench_nan": FaultKind(_S, "approach", 1, "", 0.5, "all six values are NaN"),
    "wrench_frozen": FaultKind(
        _S, "lift", 1, "", 0.5, "the same values with new times"
    ),
    "wrench_sign": FaultKind(_S, "self_test", 1, "", inf, "all values negated"),
    "bias_drift": FaultKind(
        _S, "self_test", 40.0, "N", inf, "bias along x that grows to this in 5 s"
    ),
    "bias_jump": FaultKind(_S, "lift", 90.0, "N", inf, "bias along x, at once", 0.3),
    "sensor_saturated": FaultKind(
        _S, "lift", 660.0, "N", 0.2, "force along z pinned to this", 0.3
    ),
    "baseline_contact": FaultKind(
        _S, "self_test", 15.0, "N", 4.0, "a push along x of the base"
    ),
    "ratchet": FaultKind(
        _S, "lift", 0.75, "of the arm's force limit", inf,
        "a push down that grows within 0.5 s and stays",
    ),
    "clock_disorder": FaultKind(
        _S, "approach", 0.2, "s", 0.5, "stamps so much in the past, out of order"
    ),
    "joint_stuck": FaultKind(
        "arm", "pregrasp", 0, "joints from the base", inf, "a joint brakes and stays"
    ),
    "encoder_jump": FaultKind(
        "arm", "transport", 0.3, "rad", inf, "offset of a random joint's encoder", 0.3
    ),
    "connection_lost": FaultKind(
        "limb", "pregrasp", 0.3, "s, lasting", inf, "arm, sensor and hand do not answer"
    ),
    "controller_refuses": FaultKind(
        "arm", "switch", 1, "times", inf, "the drives do not engage when asked to"
    ),
    "limit_mismatch": FaultKind(
        "arm", "self_test", 0.2, "rad", inf, "drives keep a range so much narrower"
    ),
    "start_outside_limits": FaultKind(
        "world", "self_test", 0.01, "rad", inf, "a joint stands beyond the controller's"
    ),
    "gripper_uninitialised": FaultKind(
        "gripper", "self_test", 2, "times", inf, "it must be initialised so often"
    ),
    "finger_jammed": FaultKind(
        "gripper", "close", 0, "number of the finger", 20.0, "a finger stays"
    ),
    "calibration_off": FaultKind(
        "head", "calib_check", 0.05, "rad", inf, "pan and tilt read wrong by this"
    ),
    "calibration_poses": FaultKind(
        "head", "calib_check", 1, "", inf, "the head does not turn: looks are alike"
    ),
    "fiducial_lost": FaultKind(
        "camera", "calib_check", 12, "times", inf, "nothing nearer than 1 m is seen"
    ),
    "empty_cloud": FaultKind("camera", "capture", 1, "times", inf, "no depth at all"),
    "depth_dropout": FaultKind(
        "camera", "capture", 1, "times", inf, "patches without depth, 60 % of all"
    ),
    "stale_cloud": FaultKind(
        "camera", "capture", 1, "times", inf, "taken 5 s ago, or in another frame"
    ),
    "plane_eats_pile": FaultKind(
        "camera", "capture", 0.35, "of height and width", inf,
        "only the middle of the image has depth",
    ),
    "no_grasp": FaultKind(
        "world", "capture", 0.6, "m", inf, "all bodies become blocks of this size"
    ),
    "unreachable": FaultKind(
        "world", "self_test", 0.75, "m", inf, "all bodies lie so much farther away"
    ),
    "plan_collision": FaultKind(
        "world", "capture", 0.07, "m", inf, "bars with such gaps before the pile"
    ),
    "early_contact": FaultKind(
        _S, "approach", 1e4, "N/m", inf, "a wall 8 mm ahead of the hand, 20 cm wide"
    ),
    "empty_grip": FaultKind(
        "world", "close", 0.4, "m", inf, "all bodies are suddenly so much farther away"
    ),
    "slip": FaultKind("world", "lift", 0.03, "friction", inf, "everything is as slick"),
    "too_heavy": FaultKind(
        _S, "lift", 1.5, "of the arm's force limit", inf,
        "it is stuck: a pull down of at most this that grows by 5 N/mm",
    ),
    "object_swings": FaultKind(
        _S, "transport", 1.3, "of the arm's torque limit", 3.0, "torque at 1 Hz"
    ),
    "not_released": FaultKind(
        "world", "release", 1, "", 30.0, "what a hand holds sticks to it"
    ),
    "oscillation": FaultKind(
        _S, "lift", 0.3, "of the arm's force limit", 4.0, "force at 6 Hz"
    ),
}  # fmt: skip
"""Every fault that can be injected, by its name in the table of faults."""


_WHOLE = ("times", "joints from the base", "number of the finger")
_POSITIVE = ("s, lasting", "friction", "of height and width", "m")
"""Units in which a severity is counted, and in which it has no sign."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Injection:
    """One fault that is to happen.

    Raises
    ------
    UnknownNameError
        If there is no such fault.
    ConfigError
        If a number is not one.
    """

    fault: str
    """Name, of `INJECTABLE`."""
    state: str | None = None
    """State of the task at whose first begin it is armed; None: where it usually
    shows."""
    arm: str | None = None
    """Whose devices it strikes; None: those of all arms; but only one hand, drawn,
    loses its zero."""
    at: float | None = None
    """Seconds from there until it begins; None: as stated there."""
    severity: float | None = None
    """How bad, in the unit of its `FaultKind`; None: as stated there."""

    def __post_init__(self) -> None:
        if self.fault not in INJECTABLE:
            raise UnknownNameError("fault", self.fault, INJECTABLE)
        if self.at is not None and not (isfinite(self.at) and self.at >= 0.0):
            raise ConfigError(
                f"begin of {self.fault}", got=self.at, expected="0 s or more"
            )
        if self.severity is not None:
            self._require_severity(self.severity)

    def _require_severity(self, severity: object) -> None:
        """Raise `ConfigError` unless it can be meant, in its unit."""
        unit = self.kind.unit
        value = nan
        if isinstance(severity, Real) and not isinstance(severity, bool):
            value = float(severity)
        expected = f"a number [{unit}]"
        is_so = isfinite(value)
        if unit in _WHOLE:
            expected = f"a whole number of 0 or more [{unit}]"
            is_so = is_so and value >= 0.0 and value == int(value)
        elif unit in _POSITIVE:
            expected = f"0 or more [{unit}]"
            is_so = is_so and value >= 0.0
        elif not unit:
            expected = "none: it strikes, or it does not"
            is_so = value == self.kind.severity
        if not is_so:
            raise ConfigError(
                f"severity of {self.fault}", got=severity, expected=expected
            )

    @property
    def kind(self) -> FaultKind:
        """How it is brought about."""
        return INJECTABLE[self.fault]

    def to_json(self) -> dict[str, Any]:
        """Content for a file."""
        return {name: getattr(self, name) for name in self.__slots__}

    @staticmethod
    def from_json(content: Mapping[str, Any]) -> Injection:
        """Read what `to_json` wrote, or raise `ConfigError`."""
        try:
            return Injection(**content)
        except TypeError as error:
            raise ConfigError(
                "injection", got=str(error), expected=", ".join(Injection.__slots__)
            ) from error


class InjectedRobot:
    """A robot that faults strike; made by `inject`."""

    def __init__(self, robot: Robot, spoiling: Spoiling, world: Changeable | None):
        self.robot = robot
        """Its devices, spoiled."""
        self._spoiling, self._world = spoiling, world

    def on_state(self, state: str) -> None:
        """Arm the faults of a state that begins; to be called by whoever runs it."""
        self._spoiling.begin(state)
        self.on_time(is_begin=True)

    def on_time(self, *, is_begin: bool = False) -> None:
        """Let happen in the world what is due, while a state begins or lasts."""
        for live in self._spoiling.due(("world",)):
            is_looking = self._spoiling.state == "capture"
            if live.fault in APPEARING and not is_looking:
                continue  # nothing appears where an arm may be
            if live.fault in RESTING and not is_begin:
                continue
            if live.times == 0 and self._world is not None:
                live.times = int(HAPPENINGS[live.fault](self._world, live))

    @property
    def happened(self) -> tuple[str, ...]:
        """Faults that were really brought about so far."""
        return tuple(live.fault for live in self._spoiling.lives if live.times)

    @property
    def missed(self) -> tuple[str, ...]:
        """Faults that were not brought about so far, each with its state."""
        lives = self._spoiling.lives
        return tuple(f"{live.fault}@{live.state}" for live in lives if not live.times)


def inject(
    robot: Robot,
    injections: Sequence[Injection],
    *,
    states: Collection[str],
    rng: Rng,
    world: Changeable | None = None,
) -> InjectedRobot:
    """Wrap the devices that faults are to strike; all others stay as they are.

    Parameters
    ----------
    states
        Names of all states that will be told of by `InjectedRobot.on_state`. A fault
        at another one would never strike.
    rng
        Decides what an injection leaves open, such as which joint sticks.
    world
        The world behind the devices, for the faults that happen there.

    Raises
    ------
    UnknownNameError
        If a fault is for a state, or an arm, that there is not.
    InputError
        If a fault needs a device, or a world, that is not there.
    """
    lives = []
    for injection, stream in zip(injections, rng.spawn(len(injections)), strict=True):
        kind = injection.kind
        _require(robot, injection, states, world)
        severity = kind.severity if injection.severity is None else injection.severity
        arm = injection.arm
        if arm is None and injection.fault == "gripper_uninitialised":
            arm = str(stream.choice(sorted(robot.limbs)))
        lives.append(
            Live(
                fault=injection.fault,
                device=kind.device,
                state=injection.state or kind.state,
                arm=arm,
                at=kind.at if injection.at is None else injection.at,
                severity=severity,
                lasting=severity if kind.unit == "s, lasting" else kind.lasting,
                rng=stream,
            )
        )
    spoiling = Spoiling(robot.clock, lives)
    injected = InjectedRobot(_spoiled(robot, spoiling), spoiling, world)
    spoiling.on_time = injected.on_time
    return injected


def _require(
    robot: Robot,
    injection: Injection,
    states: Collection[str],
    world: Changeable | None,
) -> None:
    state = injection.state or injection.kind.state
    if state not in states:
        what = f"state in which {injection.fault} strikes"
        raise UnknownNameError(what, state, states)
    if injection.arm is not None and injection.arm not in robot.limbs:
        raise UnknownNameError("arm", injection.arm, robot.limbs)
    if injection.fault == "joint_stuck" and injection.severity is not None:
        n_joints = min(
            len(limb.arm.joint_names)
            for name, limb in robot.limbs.items()
            if injection.arm in (None, name)
        )
        if injection.severity >= n_joints:
            raise ConfigError(
                "severity of joint_stuck",
                got=injection.severity,
                expected=f"0 to {n_joints - 1}, the number of a joint from the base",
            )
    device = injection.kind.device
    missing = (device == "world" and world is None) or (
        device == "head" and robot.head is None
    )
    if missing:
        raise InputError(
            f"fault {injection.fault}",
            got=f"a robot without a {device} that can be spoiled",
            expected="a robot in memory" if device == "world" else "a head that turns",
        )


def _spoiled(robot: Robot, spoiling: Spoiling) -> Robot:
    def strikes(devices: tuple[str, ...], arm: str | None = None) -> bool:
        return any(
            live.device in devices and (arm is None or live.arm in (None, arm))
            for live in spoiling.lives
        )

    limbs: dict[str, Limb] = {}
    for name, limb in robot.limbs.items():
        chain = robot.model.chain(name)
        changes: dict[str, Any] = {}
        if strikes(("arm", "limb"), name):
            changes["arm"] = SpoiledArm(name, limb.arm, spoiling)
        if strikes(("sensor", "limb"), name):
            changes["sensor"] = SpoiledSensor(name, limb, chain, spoiling)
        if strikes(("gripper", "limb"), name):
            changes["gripper"] = SpoiledGripper(name, limb.gripper, spoiling)
        limbs[name] = replace(limb, **changes)
    camera, head = robot.camera, robot.head
    if strikes(("camera",)):
        camera = SpoiledCamera(camera, spoiling)
    if head is not None and strikes(("head",)):
        head = SpoiledHead(head, spoiling)
    return replace(
        robot,
        clock=spoiling.clock,
        limbs=limbs,
        camera=camera,
        head=head,
    )
