"""The YAML file that describes a robot, parsed and checked field by field."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from debrisgrasp._arrays import require_metres
from debrisgrasp._fields import is_number
from debrisgrasp._files import data_path, is_yaml
from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.geometry import SE3, so3

from .frames import FrameSpec

__all__ = ["ArmSpec", "RobotFile", "robot_path"]

_BESIDE_A_URDF = (
    "A URDF needs a YAML file that names it, its base and its arms; copy that of a "
    "shipped or an example robot, which tells of each field."
)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ArmSpec:
    """One arm: what it moves, what it carries, where it rests."""

    name: str
    tip: str
    """Link that is brought to a grasp pose (palm convention)."""
    gripper: str
    """Name of the hand model."""
    hand: str
    """Link at which the hand begins."""
    joints: tuple[str, ...]
    """Joints that planning moves."""
    postures: Mapping[str, Mapping[str, float]]
    """Named joint values [rad or m]; joints not named stand at zero."""
    present: str
    """Posture the arm is taken to be in when a search starts; the task holds its hand
    before the camera in it."""
    idle: str
    """Posture while another arm works, and while the camera looks."""
    limits: Mapping[str, float]
    """What a URDF can't say: ``acceleration`` [rad/s^2 or m/s^2] of every joint,
    ``force`` [N] and ``torque`` [N m] at the hand."""
    accelerations: Mapping[str, float]
    """Of joints for which another one than that holds [rad/s^2 or m/s^2]."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RobotFile:
    """What a robot's YAML file says."""

    name: str
    urdf: str
    base: str
    camera: str | None
    drives: bool
    rest: Mapping[str, float]
    frames: tuple[FrameSpec, ...]
    arms: Mapping[str, ArmSpec]
    ignored_collisions: frozenset[frozenset[str]]

    @classmethod
    def parse(cls, content: Any, path: Path) -> RobotFile:
        """Check the content of a file; errors name the field and what it needs."""
        reader = _Reader(content, str(path))
        reader.allow(
            "name",
            "urdf",
            "base",
            "camera",
            "drives",
            "rest",
            "frames",
            "arms",
            "ignored_collisions",
        )
        arms = reader.mapping("arms")
        frames = reader.mapping("frames") if reader.has("frames") else {}
        if not arms:
            raise ConfigError(f"arms in {path}", got="none", expected="at least one")
        return cls(
            name=reader.text("name"),
            urdf=reader.text("urdf"),
            base=reader.text("base"),
            camera=reader.text("camera") if reader.has("camera") else None,
            drives=reader.flag("drives") if reader.has("drives") else True,
            rest=reader.numbers("rest") if reader.has("rest") else {},
            frames=tuple(_frame(name, frames[name], path) for name in frames),
            arms={name: _arm(name, arms[name], path) for name in arms},
            ignored_collisions=reader.pairs("ignored_collisions"),
        )


def robot_path(name_or_path: str | Path) -> Path:
    """Find the file of a shipped robot by its name, or of any by its path.

    Raises
    ------
    UnknownNameError
        If no robot of that name is shipped.
    """
    path = Path(name_or_path)
    if is_yaml(path):
        return path
    shipped = sorted(data_path("robots").glob("*.yaml"))
    for candidate in shipped:
        if candidate.stem == str(name_or_path):
            return candidate
    known = [*(p.stem for p in shipped), "the path of a .yaml file"]
    is_urdf = path.suffix.lower() in (".urdf", ".xacro")
    raise UnknownNameError(
        "robot", str(name_or_path), known, mend=_BESIDE_A_URDF if is_urdf else ""
    )


def _frame(name: str, content: Any, path: Path) -> FrameSpec:
    reader = _Reader(content, f"{path}, frame {name}")
    reader.allow("parent", "position", "rpy")
    position, rpy = (
        reader.triple(field) if reader.has(field) else (0.0, 0.0, 0.0)
        for field in ("position", "rpy")
    )
    if max(map(abs, rpy)) > 2.0 * math.pi:
        raise ConfigError(
            f"rpy in {reader.where}",
            got=rpy,
            expected="radians, at most 2 pi = 6.28",
            mend="If these are degrees, multiply by pi / 180.",
        )
    require_metres(f"position in {reader.where}", position)
    return FrameSpec(
        name=name,
        parent=reader.text("parent"),
        T_parent_frame=SE3.from_parts(so3.from_rpy(np.array(rpy)), position),
    )


def _arm(name: str, content: Any, path: Path) -> ArmSpec:
    reader = _Reader(content, f"{path}, arm {name}")
    reader.allow(
        "tip", "gripper", "hand", "joints", "postures", "present", "idle", "limits"
    )
    postures = reader.mapping("postures")
    within = _Reader(postures, f"{path}, arm {name}, postures")
    joints = reader.texts("joints")
    limits, accelerations = _limits(reader, joints)
    spec = ArmSpec(
        name=name,
        tip=reader.text("tip"),
        gripper=reader.text("gripper"),
        hand=reader.text("hand"),
        joints=joints,
        postures={key: within.numbers(key) for key in postures},
        present=reader.text("present"),
        idle=reader.text("idle"),
        limits=limits,
        accelerations=accelerations,
    )
    for field in ("present", "idle"):
        if getattr(spec, field) not in spec.postures:
            raise ConfigError(
                f"{field} in {reader.where}",
                got=getattr(spec, field),
                expected="one of its postures: " + ", ".join(spec.postures),
            )
    return spec


_MOST = {"acceleration": 100.0, "force": 1e4, "torque": 1e4}
"""No arm that people stand beside does more [rad/s^2 or m/s^2, N, N m]."""


_UNITS = "rad/s^2 or m/s^2, N, N m"


def _limits(
    reader: _Reader, joints: Sequence[str]
) -> tuple[dict[str, float], dict[str, float]]:
    """Limits of an arm, and the accelerations of joints that have their own."""
    known = {"acceleration": 2.0, "force": 150.0, "torque": 40.0}
    content = reader.mapping("limits") if reader.has("limits") else {}
    own: dict[str, float] = {}
    if isinstance(content.get("acceleration"), dict):
        within = _Reader(content, f"{reader.where}, limits")
        own = within.numbers("acceleration", _UNITS)
        del content["acceleration"]
    given = _Reader({"limits": content}, reader.where).numbers("limits", _UNITS)
    for what, names, all_known in (
        ("limit", given, known),
        ("joint in limits.acceleration", own, joints),
    ):
        for name in names:
            if name not in all_known:
                raise UnknownNameError(f"{what} of {reader.where}", name, all_known)
    rows = [(name, name, value) for name, value in given.items()]
    rows += [("acceleration", f"acceleration.{j}", value) for j, value in own.items()]
    for name, called, value in rows:
        if not 0.0 < value <= _MOST[name]:
            words = f"If these are degrees, {value:g} is {math.radians(value):.3g} rad."
            raise ConfigError(
                f"limits.{called} in {reader.where}",
                got=value,
                expected=f"above zero, at most {_MOST[name]:g}",
                mend=words if name == "acceleration" and value > 0.0 else "",
            )
    return known | given, own


class _Reader:
    """Typed access to one mapping of a file, with errors that name the field."""

    def __init__(self, content: Any, where: str) -> None:
        if not isinstance(content, dict):
            raise ConfigError(
                where, got=type(content).__name__, expected="a mapping of fields"
            )
        self._content, self.where = content, where

    def allow(self, *fields: str) -> None:
        for field in self._content:
            if field not in fields:
                raise UnknownNameError(f"field in {self.where}", field, fields)

    def has(self, field: str) -> bool:
        return field in self._content

    def _get(self, field: str, kind: type, words: str) -> Any:
        if field not in self._content:
            raise ConfigError(f"{field} in {self.where}", got="nothing", expected=words)
        value = self._content[field]
        if not isinstance(value, kind):
            raise ConfigError(
                f"{field} in {self.where}", got=repr(value), expected=words
            )
        return value

    def text(self, field: str) -> str:
        text = str(self._get(field, str, "a name"))
        if not text.strip() or not text.isprintable():
            raise ConfigError(
                f"{field} in {self.where}", got=repr(text), expected="a name"
            )
        return text

    def flag(self, field: str) -> bool:
        return bool(self._get(field, bool, "true or false"))

    def mapping(self, field: str) -> dict[str, Any]:
        content = self._get(field, dict, "a mapping")
        if "" in content:
            raise ConfigError(f"{field} in {self.where}", got="''", expected="names")
        return {str(name): value for name, value in content.items()}

    def texts(self, field: str) -> tuple[str, ...]:
        values = self._get(field, list, "a list of names")
        if not values or not all(isinstance(value, str) for value in values):
            raise ConfigError(
                f"{field} in {self.where}", got=values, expected="a list of names"
            )
        return tuple(values)

    def numbers(self, field: str, unit: str = "rad or m") -> dict[str, float]:
        values = self.mapping(field)
        for joint, value in values.items():
            if not is_number(value):
                raise ConfigError(
                    f"{field}.{joint} in {self.where}",
                    got=repr(value),
                    expected=f"a finite number [{unit}]",
                )
        return {joint: float(value) for joint, value in values.items()}

    def triple(self, field: str) -> tuple[float, ...]:
        values = self._get(field, list, "three numbers [m or rad]")
        if len(values) != 3 or not all(map(is_number, values)):
            raise ConfigError(
                f"{field} in {self.where}",
                got=values,
                expected="three numbers [m or rad]",
            )
        return tuple(map(float, values))

    def pairs(self, field: str) -> frozenset[frozenset[str]]:
        if not self.has(field):
            return frozenset()
        pairs = self._get(field, list, "a list of [link, link]")
        for pair in pairs:
            is_pair = isinstance(pair, list) and len(set(map(str, pair))) == 2
            if not is_pair or len(pair) != 2:
                raise ConfigError(
                    f"{field} in {self.where}", got=pair, expected="[link, link]"
                )
        return frozenset(frozenset(map(str, pair)) for pair in pairs)
