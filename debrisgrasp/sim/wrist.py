"""A compliant wrist of limited force that carries a flying hand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp.geometry import SE3, so3

__all__ = ["Wrist", "WristConfig"]

_JOINTS = tuple(f"wrist_{name}" for name in ("x", "y", "z", "roll", "pitch", "yaw"))
_MASS, _INERTIA = 8.0, 0.07
"""Of hand and reflected arm, for the damping [kg], [kg m^2]."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class WristConfig:
    """Spring, damper and limits between the commanded pose and the hand."""

    stiffness: tuple[float, float] = (10000.0, 400.0)
    """Of translation [N/m] and rotation [N m/rad]: an arm that holds its pose."""
    give: float = 1500.0
    """Along the closing axis while the fingers close [N/m]: the hand centres itself on
    the object, as an arm does that is moved on when it is pushed."""
    limits: tuple[float, float] = (150.0, 40.0)
    """Largest force [N] and torque [N m]; RoMan's arms bear these."""

    def __post_init__(self) -> None:
        for name in ("stiffness", "limits"):
            for value in getattr(self, name):
                require_range(name, value, 1e-3, 1e6)
        require_range("give", self.give, 1.0, 1e6)


class Wrist:
    """Drives the six wrist joints of one simulation towards a target."""

    def __init__(self, model: Any, T_base_start: SE3, config: WristConfig) -> None:
        joints = [model.joint(name) for name in _JOINTS]
        self._q = np.array([joint.qposadr[0] for joint in joints])
        self._v = np.array([joint.dofadr[0] for joint in joints])
        self._config = config
        self.T_base_start = T_base_start
        self.target = np.zeros(6)
        """Displacement from the start: translation in base, turn about own axes."""
        self.rate = np.zeros(6)
        """Velocity of the target."""
        self.wrench = np.zeros(6)
        """What the wrist exerts on the hand, as joint efforts [N, N m]."""
        self.hold_firmly()

    def hold_firmly(self) -> None:
        """Be equally stiff along all axes."""
        self._set(self._config.stiffness[0])

    def give_way(self) -> None:
        """Be soft along the closing axis of the hand."""
        self._set(self._config.give)

    def _set(self, along_closing: float) -> None:
        """Springs, and critical damping."""
        x = self.T_base_start.R[:, 0]
        along, (across, turning) = np.outer(x, x), self._config.stiffness
        self._k, self._d = np.zeros((6, 6)), np.zeros((6, 6))
        self._k[3:, 3:] = turning * np.eye(3)
        self._d[3:, 3:] = 2.0 * np.sqrt(turning * _INERTIA) * np.eye(3)
        for matrix, value in (
            (along, along_closing),
            (np.eye(3) - along, across),
        ):
            self._k[:3, :3] += value * matrix
            self._d[:3, :3] += 2.0 * np.sqrt(value * _MASS) * matrix

    def drive(self, data: Any) -> None:
        """Set the forces for the next step."""
        error = self.target - data.qpos[self._q]
        wrench = self._k @ error + self._d @ (self.rate - data.qvel[self._v])
        for part, limit in zip(
            (wrench[:3], wrench[3:]), self._config.limits, strict=True
        ):
            size = float(np.sqrt(part @ part))
            if size > limit:
                part *= limit / size
        self.wrench = wrench
        data.qfrc_applied[self._v] = wrench

    def displacement(self, data: Any) -> FloatArray:
        """Where the hand is, as `target` counts, shape (6,)."""
        return np.array(data.qpos[self._q])

    def pose(self, data: Any) -> SE3:
        """Pose ``T_base_hand``."""
        q = data.qpos[self._q]
        return self.pose_at(q)

    def pose_at(self, displacement: FloatArray) -> SE3:
        """Pose of the hand at a displacement."""
        turn = np.eye(3)
        for axis, angle in zip(np.eye(3), displacement[3:], strict=True):
            turn = turn @ so3.exp(axis * angle)
        start = self.T_base_start
        return SE3.from_parts(start.R @ turn, start.p + displacement[:3])

    def displacement_of(self, T_base_hand: SE3) -> FloatArray:
        """Displacement at which the hand has a pose, shape (6,)."""
        R = self.T_base_start.R.T @ T_base_hand.R
        pitch = np.arcsin(np.clip(R[0, 2], -1.0, 1.0))
        roll = np.arctan2(-R[1, 2], R[2, 2])
        yaw = np.arctan2(-R[0, 1], R[0, 0])
        shift = T_base_hand.p - self.T_base_start.p
        return np.array([*shift, roll, pitch, yaw])
