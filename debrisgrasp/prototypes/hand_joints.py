"""Joint values in the file of a hand: what they must name, and in which units."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._fields import MAX_LENGTH, Fields
from debrisgrasp.errors import ConfigError, UnknownNameError

from .hand_kinematics import Finger

__all__ = ["require_joints", "require_pads", "require_units"]

_PAD_GAP = 0.02
"""A pad farther from its finger than this meets no object that the finger meets [m]."""
_FULL_TURN = 2.0 * np.pi + 1e-9


def require_joints(
    fields: Fields, fingers: tuple[Finger, ...], joints: Mapping[str, FloatArray]
) -> None:
    """Refuse joints that no finger has, and fingers whose joints have no values."""
    driven = {
        link.joint.variable
        for finger in fingers
        for link in finger.links
        if link.joint is not None
    }
    for name in joints:
        if name not in driven:
            raise UnknownNameError(f"joint in {fields.where()}", name, sorted(driven))
    if missing := sorted(driven - set(joints)):
        raise ConfigError(
            fields.where(),
            got=f"no values of {', '.join(missing)}",
            expected="every joint among closing or fixed",
        )


def require_units(
    fields: Fields, fingers: tuple[Finger, ...], joints: Mapping[str, FloatArray]
) -> None:
    """Refuse joint values that can only be millimetres or degrees."""
    slides = {
        link.joint.variable
        for finger in fingers
        for link in finger.links
        if link.joint is not None and link.joint.is_prismatic
    }
    for name, table in joints.items():
        value = float(table[np.abs(table).argmax()])
        if abs(value) <= (MAX_LENGTH if name in slides else _FULL_TURN):
            continue
        is_fixed = "fixed" in fields and name in fields.child("fixed")
        where = fields.where(f"{'fixed' if is_fixed else 'closing'}.{name}")
        if name in slides:
            raise ConfigError(
                where,
                got=value,
                expected=f"metres, for a prismatic joint at most {MAX_LENGTH:g}",
                mend=f"If these are millimetres, {value:g} mm is {value / 1e3:g}.",
            )
        raise ConfigError(
            where,
            got=value,
            expected="radians, for a revolute joint at most 2 pi = 6.28",
            mend=f"If these are degrees, {value:g} degrees is {np.deg2rad(value):.4g}.",
        )


def require_pads(
    fields: Fields, fingers: tuple[Finger, ...], joints: Mapping[str, FloatArray]
) -> None:
    """Refuse a pad in the air: shapes are placed at the pads, and solids meet them."""
    opened = {name: float(table[0]) for name, table in joints.items()}
    for finger in fingers:
        gap = finger.pad_gap(opened)
        if gap > _PAD_GAP:
            raise ConfigError(
                fields.where("closing"),
                got=f"a pad of finger {finger.name} that is {1e3 * gap:.0f} mm from "
                "all solids of the finger",
                expected="one on the face that meets objects",
                mend="Check the pad, in the frame of the last link, and the solids.",
            )
