"""What the looks of an observations file say, and what of it can't be."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.calibration import KINEMATIC_SIGMA, MEASUREMENT_SIGMA
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.io.observations_file import ObservationFile, ObservationRow
from debrisgrasp.kinematics import RobotModel

__all__ = ["kinematic_sigma_of", "points_of", "require_joints", "sigmas_of"]

_LIMIT_SLACK = 0.1
"""How far a joint may read beyond its limit [rad or m]; more is another unit."""
_FARTHEST_WOUND = 4.0 * np.pi
"""No joint without limits is wound up so far [rad]; most angles in degrees are."""
_DEGREES = "degrees: multiply by pi / 180"


def require_joints(
    robot: RobotModel, row: ObservationRow, needed: Iterable[str], end: str = "fiducial"
) -> None:
    """Refuse joints of a look that the robot lacks or can't have, or that are missing.

    Those in ``needed`` lie between base and ``end``.

    Raises
    ------
    UnknownNameError, ConfigError, InputError
        Naming the joint that is unknown, missing or beyond its limits.
    """
    robot.joint_values(row.joints)  # refuses unknown names
    missing = [name for name in needed if name not in row.joints]
    if missing:
        raise ConfigError(
            f"joints of observation {row.name}",
            got=f"no {', '.join(missing)}",
            expected=f"every joint between base and {end}",
        )
    for name, value in row.joints.items():
        joint = robot.tree.joints[name]
        low = max(joint.lower, -_FARTHEST_WOUND)
        high = min(joint.upper, _FARTHEST_WOUND)
        is_within = low - _LIMIT_SLACK <= value <= high + _LIMIT_SLACK
        if joint.kind != "fixed" and not is_within:
            slides = joint.kind == "prismatic"
            mend = "millimetres: divide by 1000" if slides else _DEGREES
            raise InputError(
                f"joint {name} of observation {row.name}",
                got=f"{value:g}",
                expected=f"{low:.4g} to {high:.4g} {'m' if slides else 'rad'}",
                mend=f"It looks like {mend}." if abs(value) > 6.3 else "",
            )


def points_of(given: ObservationFile) -> FloatArray:
    """Where the camera sees the fiducial, optical frame [m], (n, 3); none may lack."""
    empty = [row.name for row in given.rows if row.point is None]
    if empty:
        raise ConfigError(
            "observations",
            got=f"no point for {', '.join(empty[:5])}",
            expected="where the camera sees the fiducial, three numbers [m]",
            mend="Measure it (`debrisgrasp calibrate pick` or `find`), or leave the "
            "observation out.",
        )
    return np.array([row.point for row in given.rows]).reshape(-1, 3)


def sigmas_of(given: ObservationFile) -> FloatArray:
    """Return the standard deviations of what the camera measures [m], (n, 3)."""
    default = (MEASUREMENT_SIGMA if given.sigma is None else given.sigma,)
    rows: list[Sequence[float]] = [row.sigma or default for row in given.rows]
    return np.array([np.broadcast_to(row, 3) for row in rows]).reshape(-1, 3)


def kinematic_sigma_of(given: ObservationFile) -> float:
    """Return the standard deviation of a coordinate from forward kinematics [m]."""
    given_sigma = given.kinematic_sigma
    return KINEMATIC_SIGMA if given_sigma is None else given_sigma
