"""Motions as JSON, for whoever executes them."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._files import write_atomic
from debrisgrasp.kinematics import Trajectory

__all__ = ["MOTION_SCHEMA", "motion_to_dict", "save_motion"]

MOTION_SCHEMA = "debrisgrasp/motion/1"
_DIGITS = 12


def motion_to_dict(
    trajectories: Mapping[str, Trajectory],
    *,
    robot: str,
    arm: str | None,
    grasp: int | None,
    passed_over: Sequence[tuple[int, str]],
) -> dict[str, Any]:
    """Motions as JSON values.

    Parameters
    ----------
    trajectories
        Motions by name, in the order in which they are executed.
    grasp
        Place of the grasp in its plan, counted from 0; None if there is none.
    passed_over
        Grasps before it, and what stops them.
    """
    return {
        "schema": MOTION_SCHEMA,
        "robot": robot,
        "arm": arm,
        "grasp": grasp,
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
            {"grasp": index, "reason": reason} for index, reason in passed_over
        ],
    }


def save_motion(content: Mapping[str, Any], path: str | os.PathLike[str]) -> None:
    """Write what `motion_to_dict` made, whole or not at all."""
    write_atomic(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def _rounded(array: ArrayLike) -> Any:
    return np.round(np.asarray(array, dtype=np.float64), _DIGITS).tolist()
