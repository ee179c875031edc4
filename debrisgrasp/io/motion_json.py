"""Motions as JSON, for whoever executes or looks at them."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from debrisgrasp._arrays import rounded
from debrisgrasp._files import (
    naming_fields,
    read_schema,
    require_own,
    write_atomic,
)
from debrisgrasp.errors import ConfigError
from debrisgrasp.kinematics import Trajectory

__all__ = [
    "MOTION_SCHEMA",
    "StoredMotion",
    "load_motion",
    "motion_to_dict",
    "save_motion",
]

MOTION_SCHEMA = "debrisgrasp/motion/2"
_rounded = partial(rounded, digits=12)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StoredMotion:
    """Motions that were read from a file."""

    trajectories: Mapping[str, Trajectory]
    """By name, in the order in which they are executed; empty if none was found."""
    arm: str | None
    rank: int | None
    """Place of the grasp in its plan, counted from 1."""


def motion_to_dict(
    trajectories: Mapping[str, Trajectory],
    *,
    robot: str,
    arm: str | None,
    index: int | None,
    passed_over: Sequence[tuple[int, str]],
) -> dict[str, Any]:
    """Motions as JSON values.

    Parameters
    ----------
    trajectories
        Motions by name, in the order in which they are executed.
    index
        Of the grasp in its plan, counted from 0 as in Python; None if there is none.
        The file counts from 1, as do tables and reports.
    passed_over
        Indices of the grasps before it, and what stops them.
    """
    return {
        "schema": MOTION_SCHEMA,
        "robot": robot,
        "arm": arm,
        "grasp": None if index is None else index + 1,
        "motions": [
            {
                "name": name,
                "joints": list(motion.joint_names),
                "limits": motion.limits_hash,
                "times": _rounded(motion.times),
                "q": _rounded(motion.q),
                "dq": _rounded(motion.dq),
            }
            for name, motion in trajectories.items()
        ],
        "passed_over": [
            {"grasp": other + 1, "reason": reason} for other, reason in passed_over
        ],
    }


def save_motion(content: Mapping[str, Any], path: str | os.PathLike[str]) -> None:
    """Write what `motion_to_dict` made, whole or not at all.

    Raises
    ------
    ConfigError
        If the file's name does not end in .json.
    OutputError
        If it can't be written, or a file is there that holds no motions.
    """
    require_own(path, MOTION_SCHEMA, "motions")
    write_atomic(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def load_motion(path: str | os.PathLike[str]) -> StoredMotion:
    """Read what `save_motion` wrote.

    Raises
    ------
    ConfigError
        If the file can't be read, or is none of this schema.
    """
    content = read_schema(path, MOTION_SCHEMA)
    with naming_fields(path, MOTION_SCHEMA):
        trajectories = {
            str(part["name"]): Trajectory(
                joint_names=tuple(part["joints"]),
                times=part["times"],
                q=part["q"],
                dq=part["dq"],
                limits_hash=str(part["limits"]),
            )
            for part in content["motions"]
        }
        for part in content["motions"]:
            _require_distinct(part["joints"], "joints of a motion")
        _require_distinct([part["name"] for part in content["motions"]], "motions")
        arm, rank = content["arm"], content["grasp"]
    is_place = type(rank) is int and rank >= 1
    if trajectories and not (isinstance(arm, str) and is_place):
        raise ConfigError(
            f"{path}",
            got=f"arm {arm!r}, grasp {rank!r}",
            expected="a name, and a place in the plan from 1",
        )
    return StoredMotion(trajectories=trajectories, arm=arm, rank=rank)


def _require_distinct(names: Any, what: str) -> None:
    if not isinstance(names, list) or len(set(names)) < len(names):
        raise ConfigError(what, got=names, expected="a list of names, each once")
