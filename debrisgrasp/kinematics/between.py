"""The joints that move between two links of a robot, and where they stand at zero."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.geometry import SE3

from .urdf import MOVABLE_KINDS, UrdfJoint, UrdfTree

__all__ = ["joints_between"]

_ROUNDING = 1e-9
"""A locked value may be so far outside its limits [rad or m]."""


def joints_between(
    tree: UrdfTree, base: str, tip: str, locked: Mapping[str, float]
) -> tuple[list[tuple[UrdfJoint, FloatArray, FloatArray]], SE3]:
    """Find what moves between two links while some joints are held.

    Returns
    -------
    moving
        Joints in order, each with axis (3,) and origin (3,) [m] in base, all at zero.
    T_base_tip
        Pose of the tip there.

    Raises
    ------
    ConfigError, UnknownNameError
        See `KinematicChain.from_urdf`.
    """
    tree.require_link(base, "base link")
    tree.require_link(tip, "tip link")
    for name, value in locked.items():
        if name not in tree.joints:
            raise UnknownNameError(f"locked joint of {tree.name}", name, tree.joints)
        _require_possible(tree.joints[name], value)
    up, down = tree.joints_above(base), tree.joints_above(tip)
    while up and down and up[-1] is down[-1]:
        up.pop()
        down.pop()
    T, moving = SE3.identity(), []
    for joint, goes_down in [(j, False) for j in up] + [(j, True) for j in down[::-1]]:
        step = joint.T_parent_child(locked.get(joint.name, 0.0))
        # Walked from child to parent, the same joint turns the other way.
        axis = joint.axis if goes_down else -joint.axis
        T_base_joint = T @ joint.T_parent_joint if goes_down else T
        if joint.kind != "fixed" and joint.name not in locked:
            _require_supported(joint, tree)
            moving.append((joint, T_base_joint.rotate(axis), T_base_joint.p))
        T = T @ (step if goes_down else step.inverse())
    if not moving:
        raise ConfigError(
            f"chain from {base!r} to {tip!r}",
            got="no joint that moves",
            expected="at least one",
        )
    return moving, T


def _require_possible(joint: UrdfJoint, value: float) -> None:
    """Raise `ConfigError` unless a joint can stand at a value; NaN never does."""
    lower, upper = joint.lower, joint.upper
    if joint.kind not in MOVABLE_KINDS:
        lower, upper = -np.inf, np.inf
    is_number = isinstance(value, (int, float, np.number)) and np.isfinite(value)
    if not is_number or not lower - _ROUNDING <= value <= upper + _ROUNDING:
        raise ConfigError(
            f"value of locked joint {joint.name!r}",
            got=value,
            expected=f"a finite number from {lower:g} to {upper:g} rad or m",
        )


def _require_supported(joint: UrdfJoint, tree: UrdfTree) -> None:
    if joint.mimics is not None:
        got = f"a mimic joint, driven by {joint.mimics!r}"
    elif joint.kind not in MOVABLE_KINDS:
        got = f"a {joint.kind} joint"
    else:
        return
    raise ConfigError(
        f"joint {joint.name!r} in a chain of {tree.name}",
        got=got,
        expected="one of " + ", ".join(MOVABLE_KINDS) + ", fixed",
        mend="Choose base and tip so that it lies outside, or lock it at a value.",
    )
