"""Frames that a robot's file adds to its URDF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.geometry import SE3

from .urdf import UrdfJoint, UrdfTree

__all__ = ["FrameSpec", "with_frames"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FrameSpec:
    """A frame that is fixed to a link, and that the URDF doesn't have."""

    name: str
    parent: str
    """Link that it is fixed to."""
    T_parent_frame: SE3


def with_frames(tree: UrdfTree, frames: Sequence[FrameSpec]) -> UrdfTree:
    """Add frames as links without a body, each on a fixed joint.

    Raises
    ------
    ConfigError
        If there is no such parent, a name is taken, or frames are fixed to each other
        in a loop.
    """
    shapes = {**tree.shapes, **{frame.name: () for frame in frames}}
    joints = dict(tree.joints)
    for frame in frames:
        if frame.parent not in shapes:
            raise UnknownNameError(
                f"parent of frame {frame.name!r} of {tree.name}", frame.parent, shapes
            )
        joint = UrdfJoint.fixed(frame.parent, frame.name, frame.T_parent_frame)
        if frame.name in tree.shapes or joint.name in joints:
            raise ConfigError(
                f"frame of {tree.name}",
                got=repr(frame.name),
                expected="a name that no link and no joint has",
            )
        joints[joint.name] = joint
    parents = {frame.name: frame.parent for frame in frames}
    for name in parents:
        loop = [name]
        while (parent := parents.get(loop[-1])) and parent not in loop:
            loop.append(parent)
        if parent:
            raise ConfigError(
                f"frames of {tree.name}",
                got=f"a loop: {' on '.join([*loop, parent])}",
                expected="frames that lead to a link of the URDF",
            )
    return replace(tree, shapes=shapes, joints=joints)
