"""Fingers as small kinematic chains, so that a new hand is a text file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.geometry.solids import Solid

__all__ = ["Finger", "HandJoint", "HandLink", "JointValues", "Preshape"]

JointValues = Mapping[str, float | FloatArray]
"""Value of each joint variable [rad or m], all of one shape (...)."""


@dataclass(frozen=True, slots=True, eq=False)
class HandJoint:
    """What moves a link."""

    variable: str
    """Name of the value that drives it; joints of several fingers may share one."""
    axis: FloatArray
    """Unit axis in the joint's own frame, shape (3,)."""
    sign: float = 1.0
    """-1 where a finger mirrors the value."""
    is_prismatic: bool = False

    def shift_and_turn(self, value: float | FloatArray) -> FloatArray:
        """Return translation [m], rotation vector [rad] at values (...), (..., 6)."""
        along = np.asarray(value)[..., None] * self.sign * self.axis
        still = np.zeros_like(along)
        parts = (along, still) if self.is_prismatic else (still, along)
        return np.concatenate(parts, axis=-1)

    def motion(self, value: float | FloatArray) -> SE3:
        """Displacement at a value (...) of the variable."""
        return _motion(self.shift_and_turn(value))


def _motion(shift_and_turn: FloatArray) -> SE3:
    return SE3.from_parts(so3.exp(shift_and_turn[..., 3:]), shift_and_turn[..., :3])


@dataclass(frozen=True, slots=True, eq=False)
class HandLink:
    """A rigid piece of a finger, and the joint before it."""

    T_parent_link: SE3
    """Pose in the link before at value 0 of the joint."""
    joint: HandJoint | None
    solids: tuple[Solid, ...]
    """In the frame of the link."""


@dataclass(frozen=True, slots=True, eq=False)
class Finger:
    """A chain of links from the hand frame to the pad."""

    name: str
    side: int
    """Where along the closing axis it stands: -1 thumb side, +1 pair side."""
    links: tuple[HandLink, ...]
    """From the root on; the root's parent is the hand frame."""
    pad: FloatArray
    """Where the last link meets an object, in its frame [m], shape (3,)."""

    def link_poses(self, values: JointValues) -> tuple[SE3, ...]:
        """Poses of the links in the hand frame, each of the values' batch shape."""
        still = np.zeros((*np.broadcast_shapes(*map(np.shape, values.values())), 6))
        moves = [
            still
            if link.joint is None
            else link.joint.shift_and_turn(values[link.joint.variable])
            for link in self.links
        ]
        motions = _motion(np.stack(moves))
        poses, T_hand_link = [], SE3.identity()
        for i, link in enumerate(self.links):
            T_hand_link = T_hand_link @ link.T_parent_link @ motions[i]
            poses.append(T_hand_link)
        return tuple(poses)

    def pad_position(self, values: JointValues) -> FloatArray:
        """Where the pad is in the hand frame [m], shape (..., 3)."""
        return self.link_poses(values)[-1].apply(self.pad)

    def pad_gap(self, values: Mapping[str, float]) -> float:
        """How far the pad is from what the finger is made of [m]; negative within."""
        pad = self.pad_position(values)
        return min(float(s.signed_distance(pad)) for s in self.solids(values))

    def solids(self, values: Mapping[str, float]) -> tuple[Solid, ...]:
        """Solids of all links in the hand frame."""
        return self.placed(self.link_poses(values))

    def placed(self, poses: Sequence[SE3]) -> tuple[Solid, ...]:
        """Solids of all links where `link_poses` are these."""
        return tuple(
            solid.moved(T_hand_link)
            for link, T_hand_link in zip(self.links, poses, strict=True)
            for solid in link.solids
        )

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Name of every joint, ``<finger>_<variable>``, from the root on."""
        return tuple(f"{self.name}_{joint.variable}" for joint in self._joints)

    def joint_values(self, values: Mapping[str, float]) -> dict[str, float]:
        """Value of every joint by its own name, ``<finger>_<variable>``."""
        driven = [j.sign * float(values[j.variable]) for j in self._joints]
        return dict(zip(self.joint_names, driven, strict=True))

    @property
    def _joints(self) -> tuple[HandJoint, ...]:
        return tuple(link.joint for link in self.links if link.joint is not None)


@dataclass(frozen=True, slots=True, eq=False)
class Preshape:
    """How the fingers stand before they close, and how they close."""

    name: str
    widths: tuple[float, float]
    """Smallest and largest object that the preshape takes [m]."""
    commands: FloatArray
    """Closing commands from open to closed, in the units of the hand, shape (c,)."""
    joints: Mapping[str, FloatArray]
    """Value of every joint variable at each command [rad or m], shapes (c,)."""
    openings: FloatArray
    """Distance between opposing pads at each command [m], shape (c,), falling."""

    def __repr__(self) -> str:
        low, high = self.widths
        return f"<Preshape {self.name} for objects of {low:g} to {high:g} m>"

    @property
    def widest(self) -> float:
        """Opening of the hand before it closes [m], somewhat more than `widths`."""
        return float(self.openings[0])

    @property
    def narrowest(self) -> float:
        """Opening where the fingers close as far as they go [m], 0 if they overlap."""
        return max(float(self.openings[-1]), 0.0)

    def values(self, command: float | FloatArray) -> dict[str, Any]:
        """Value of every joint variable at commands (...)."""
        return {
            name: np.interp(command, self.commands, table)
            for name, table in self.joints.items()
        }
