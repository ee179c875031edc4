"""Reading where something is from the fields of a file."""

from __future__ import annotations

import numpy as np

from debrisgrasp._fields import Fields
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3, so3

__all__ = ["read_pose"]

_MAX_DEGREES = 720.0


def read_pose(fields: Fields) -> SE3:
    """Pose from ``position`` [m] and ``rpy`` [rad] or ``rpy_deg`` [degrees]."""
    if "rpy" in fields and "rpy_deg" in fields:
        raise ConfigError(
            fields.where("rpy"), got="rpy and rpy_deg", expected="one of the two"
        )
    degrees = fields.numbers("rpy_deg", 3, (0,) * 3)
    largest = float(np.abs(degrees).max())
    if largest > _MAX_DEGREES:
        raise ConfigError(
            fields.where("rpy_deg"),
            got=degrees.tolist(),
            expected=f"degrees, at most {_MAX_DEGREES:g}: two turns",
        )
    eighths = degrees / (np.pi / 4)
    whole = eighths.round()
    is_part = np.isclose(eighths, whole, 0, 3e-3)
    # Nobody turns by 1.57 degrees; 0.79 degrees may be among others.
    is_turn = is_part & (whole != 0) & ((whole % 2 == 0) | is_part.all())
    if largest < 8.5 * np.pi / 4 and is_turn.any():
        raise ConfigError(
            fields.where("rpy_deg"),
            got=degrees.tolist(),
            expected="degrees: parts of pi are among these",
            mend="If these are radians, say rpy instead of rpy_deg.",
        )
    radians = fields.numbers("rpy", 3, np.deg2rad(degrees))
    if "rpy" in fields and np.abs(radians).max() > 2.0 * np.pi + 1e-9:
        raise ConfigError(
            fields.where("rpy"),
            got=radians.tolist(),
            expected="radians, at most 2 pi = 6.28",
            mend="If these are degrees, say rpy_deg instead of rpy.",
        )
    return SE3.from_parts(so3.from_rpy(radians), fields.position())
