"""Servo of all joints: proportional, with speed, weight and a lasting error made up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.sim._mujoco import mujoco

from .physics import RobotPhysics
from .tree import BASE_JOINTS

__all__ = ["JointServo"]

_BASE_FREQUENCY = 10.0
"""Of the base on its drives [Hz]: tracks that stand don't give way."""
_MOST_INTEGRAL = 0.3
"""Share of its torque that a servo spends on a lasting error."""


class JointServo:
    r"""Drives the joints of the arms, and those that the base goes on.

    The torque of a joint is

    .. math:: k (q_r + e - q) + d (\dot q_r - \dot q) + b(q, \dot q)

    within the effort of the URDF; b is weight and Coriolis torque of the robot itself,
    as its model has them, and e what the servo has learnt of a lasting error.
    """

    def __init__(
        self, robot: RobotModel, joints: Sequence[str], physics: RobotPhysics
    ) -> None:
        self._robot, self._physics = robot, physics
        self.joints = tuple(joints)
        self.error: FloatArray = np.zeros(len(self.joints))
        """Made up for by now [rad or m], shape (j,)."""
        self._last_base: FloatArray | None = None

    def add(self, root: ElementTree.Element) -> None:
        """Append the drives to the tree of a world."""
        section = root.find("actuator")
        if section is None:
            section = ElementTree.SubElement(root, "actuator")
        for name in (*self.joints, *BASE_JOINTS):
            ElementTree.SubElement(
                section, "general", name=name, joint=name, biastype="affine"
            )

    def bind(self, model: Any, data: Any) -> None:
        """Work in a model that was just compiled."""
        self._data = data
        names = [*self.joints, *BASE_JOINTS]
        self._index = np.array([model.actuator(name).id for name in names])
        self._q = np.array([model.joint(name).qposadr[0] for name in names])
        self._v = np.array([model.joint(name).dofadr[0] for name in names])
        self._k, self._d = self._gains(model)
        tree = self._robot.tree
        effort = np.array([tree.joints[name].effort for name in self.joints])
        for i, k, d in zip(self._index, self._k, self._d, strict=True):
            model.actuator_gainprm[i, 0] = k
            model.actuator_biasprm[i, 1:3] = -k, -d
        strong = np.isfinite(effort)
        arm = self._index[: len(effort)][strong]
        model.actuator_forcelimited[arm] = 1
        model.actuator_forcerange[arm, 0] = -effort[strong]
        model.actuator_forcerange[arm, 1] = effort[strong]
        self._most = _MOST_INTEGRAL * effort / self._k[: len(effort)]

    def _gains(self, model: Any) -> tuple[FloatArray, FloatArray]:
        """Stiffness and damping from the inertia about each joint at work."""
        mj, n_arm = mujoco(), len(self.joints)
        trial = mj.MjData(model)
        for arm in self._robot.arms.values():
            for name, value in self._robot.posture(arm.name, arm.present).items():
                trial.joint(name).qpos[0] = value
        mj.mj_forward(model, trial)
        whole = np.zeros((model.nv, model.nv))
        mj.mj_fullM(model, trial, whole)
        inertia = np.diag(whole)[self._v]
        physics = self._physics
        omega = np.full(len(inertia), 2.0 * np.pi * _BASE_FREQUENCY)
        omega[:n_arm] = 2.0 * np.pi * physics.natural_frequency
        ratio = np.ones(len(inertia))
        ratio[:n_arm] = physics.damping_ratio
        return inertia * omega**2, 2.0 * ratio * inertia * omega

    def place(self, q: FloatArray, T_odom_base: SE3) -> None:
        """Put joints and base somewhere, at rest."""
        self._data.qpos[self._q] = [*q, *_planar(T_odom_base)]
        self._data.qvel[self._v] = 0.0
        self._last_base = None

    def positions(self) -> FloatArray:
        """Measured joints of the arms, shape (j,)."""
        return np.array(self._data.qpos[self._q[: len(self.joints)]])

    def aim(
        self, q: FloatArray, step: FloatArray, T_odom_base: SE3, period: float
    ) -> None:
        """Say where joints and base are to be after a period.

        Parameters
        ----------
        q, step
            Of the joints at its end, and how far they move in it, shapes (j,).
        period
            [s].
        """
        base = _planar(T_odom_base)
        last = base if self._last_base is None else self._last_base
        base[2] = last[2] + np.remainder(base[2] - last[2] + np.pi, 2.0 * np.pi) - np.pi
        self._last_base = base
        self._goal = np.concatenate([q, base])
        self._way = np.concatenate([step, base - last])
        self._push = self._d / self._k * self._way / period

    def drive(self, share: float, duration: float) -> None:
        """Set the drives for one step [s] that ends after a share of the period."""
        data, n = self._data, len(self.joints)
        goal = self._goal - (1.0 - share) * self._way
        missing = goal[:n] - data.qpos[self._q[:n]]
        self.error += (duration / self._physics.integral_time) * missing
        np.maximum(self.error, -self._most, out=self.error)
        np.minimum(self.error, self._most, out=self.error)
        own = self._v[:n]
        known = data.qfrc_bias[own] - data.qfrc_gravcomp[own]
        goal += self._push
        goal[:n] += self.error + known / self._k[:n]
        data.ctrl[self._index] = goal


def _planar(pose: SE3) -> FloatArray:
    return np.array([*pose.p[:2], np.arctan2(pose.R[1, 0], pose.R[0, 0])])
