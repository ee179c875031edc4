"""A serial chain of joints: forward kinematics and Jacobian for batches of postures."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import (
    BoolArray,
    FloatArray,
    Rng,
    as_floats,
    bounded,
    frozen,
    require_count,
    require_finite,
    require_generator,
)
from debrisgrasp._words import counted
from debrisgrasp.errors import ShapeError
from debrisgrasp.geometry import SE3, so3

from .between import joints_between
from .formulas import ChainFormulas
from .ik_types import Freedom
from .ranges import require_ranges
from .serial import LaneFrames, SerialForm, cross
from .urdf import UrdfTree

__all__ = ["KinematicChain"]

_FULL_TURN = 2.0 * np.pi - 1e-3
"""A revolute joint whose range [rad] reaches this can take any direction."""


@dataclass(frozen=True, eq=False, kw_only=True)
class KinematicChain:
    """The movable joints between two links, in order from base to tip."""

    base: str
    """Link that targets are expressed in."""
    tip: str
    """Link that is brought to the target."""
    joint_names: tuple[str, ...]
    is_revolute: BoolArray
    """True for revolute and continuous joints, False for prismatic; shape (d,)."""
    lower: FloatArray
    """Smallest joint values [rad or m], shape (d,); -inf for continuous joints."""
    upper: FloatArray
    """Largest joint values [rad or m], shape (d,); +inf for continuous joints."""
    axes: FloatArray
    """Joint axes in base with all joints at zero, shape (d, 3)."""
    points: FloatArray
    """Origins of the joints in base with all joints at zero [m], shape (d, 3)."""
    T_base_tip_at_zero: SE3
    """Pose of the tip with all joints at zero."""
    shared: frozenset[str] = frozenset()
    """Joints that move other arms, too."""

    def __post_init__(self) -> None:
        d = len(self.joint_names)
        is_revolute = frozen(self.is_revolute, "is_revolute", (d,), np.bool_)
        object.__setattr__(self, "is_revolute", is_revolute)
        shapes = {"lower": (d,), "upper": (d,), "axes": (d, 3), "points": (d, 3)}
        for name, trailing in shapes.items():
            array = frozen(getattr(self, name), name, trailing)
            if len(trailing) == 2:
                require_finite(array, f"{name} of a chain")
            object.__setattr__(self, name, array)
        require_ranges(self.joint_names, self.is_revolute, self.lower, self.upper)

    def __repr__(self) -> str:
        joints = counted(self.n_joints, "joint")
        return f"<KinematicChain of {joints} from {self.base} to {self.tip}>"

    @classmethod
    def from_urdf(
        cls,
        path: str | Path,
        base: str,
        tip: str,
        locked: Mapping[str, float] | None = None,
    ) -> KinematicChain:
        """Take the chain between two links of a URDF file.

        Revolute, continuous and prismatic joints are supported; meshes are not opened.

        Parameters
        ----------
        path
            URDF file, or ``package://NAME/...``.
        base, tip
            Names of the links at both ends; base need not be the root, nor above tip.
        locked
            Joints of the chain to hold still, and at which value [rad or m].

        Raises
        ------
        UnknownNameError
            If a link or a locked joint does not exist; names near ones.
        ConfigError
            If a joint on the way is of an unsupported kind or has no range, if none can
            move, or if a locked value is outside the limits of its joint.
        """
        return cls.from_tree(UrdfTree.load(path), base, tip, locked)

    @classmethod
    def from_tree(
        cls,
        tree: UrdfTree,
        base: str,
        tip: str,
        locked: Mapping[str, float] | None = None,
    ) -> KinematicChain:
        """Take the chain between two links of a robot already read.

        Raises
        ------
        ConfigError, UnknownNameError
            If nothing moves between the links, or a joint to lock is not known.
        """
        moving, T_base_tip = joints_between(tree, base, tip, locked or {})
        joints = [joint for joint, _, _ in moving]
        return cls(
            base=base,
            tip=tip,
            joint_names=tuple(joint.name for joint in joints),
            is_revolute=np.array([joint.kind != "prismatic" for joint in joints]),
            lower=np.array([joint.lower for joint in joints]),
            upper=np.array([joint.upper for joint in joints]),
            axes=np.array([axis for _, axis, _ in moving]),
            points=np.array([point for _, _, point in moving]),
            T_base_tip_at_zero=T_base_tip,
        )

    @property
    def n_joints(self) -> int:
        """Number of joints d."""
        return len(self.joint_names)

    @cached_property
    def form(self) -> SerialForm:
        """The chain's constants for evaluation in double precision."""
        return SerialForm.fit(
            self.is_revolute, self.axes, self.points, self.T_base_tip_at_zero.matrix
        )

    @cached_property
    def single_form(self) -> SerialForm:
        """The same constants for evaluation in single precision."""
        return self.form.in_single_precision()

    @property
    def has_turning_ends(self) -> bool:
        """Whether first and last joint turn, and enough are left between them.

        Then they can be set in closed form once the others are right.
        """
        return bool(self.n_joints >= 6 and self.is_revolute[0] and self.is_revolute[-1])

    def formulas(self, freedom: Freedom) -> ChainFormulas:
        """Compiled formulas of the chain, made once for each freedom of its tip."""
        if freedom not in self._formulas:
            turns_freely = np.where(self.is_cyclic, np.inf, 0.0)
            self._formulas[freedom] = ChainFormulas(
                self.form, self.lower - turns_freely, self.upper + turns_freely, freedom
            )
        return self._formulas[freedom]

    @cached_property
    def _formulas(self) -> dict[Freedom, ChainFormulas]:
        return {}

    @cached_property
    def reach(self) -> float:
        """Distance between first and last joint that no posture exceeds [m]."""
        return self.form.reach_bound(self.lower, self.upper)

    @cached_property
    def is_cyclic(self) -> BoolArray:
        """Joints that can take any direction, so that values wrap; shape (d,)."""
        return self.is_revolute & (self.upper - self.lower >= _FULL_TURN)

    @cached_property
    def hash(self) -> str:
        """Digest of geometry and limits; maps and trajectories are bound to it."""
        digest = hashlib.sha256("|".join(self.joint_names).encode())
        for array in (
            self.is_revolute.astype(np.float64),
            self.lower,
            self.upper,
            self.axes,
            self.points,
            self.T_base_tip_at_zero.matrix,
        ):
            digest.update(np.round(array, 9).tobytes())
        return digest.hexdigest()[:16]

    def fk(self, q: ArrayLike) -> SE3:
        """Pose of the tip in base for postures q (..., d) [rad or m]."""
        lanes, batch = self._lanes(q)
        return SE3(self._tip(self.form.frames(lanes)).reshape(*batch, 4, 4))

    def jacobian(self, q: ArrayLike) -> FloatArray:
        """Body Jacobian: ``twist_tip = J @ dq``, linear first, axes of the tip.

        Parameters
        ----------
        q
            Postures, shape (..., d).

        Returns
        -------
        FloatArray
            Shape (..., 6, d); rows [m/rad or 1] and [1 or 0].
        """
        lanes, batch = self._lanes(q)
        frames = self.form.frames(lanes)
        J = self.form.jacobian(frames)
        T_first_tip = frames.matrices() @ self.form.T_last_tip
        R = np.swapaxes(T_first_tip[:, :3, :3], -1, -2)
        # Move the reference point from the last joint's origin to the tip.
        lever = T_first_tip[:, :3, 3].T - frames.p
        J[:3] -= cross(lever[:, None], J[3:])
        linear, angular = (np.moveaxis(part, -1, 0) for part in (J[:3], J[3:]))
        body = np.concatenate([R @ linear, R @ angular], axis=1)
        return body.reshape(*batch, 6, self.n_joints)

    def joint_frames(self, q: ArrayLike) -> SE3:
        """Pose, in base, of a frame fixed to the link behind each joint.

        At zero it is aligned with base and its origin is the joint's. Shape (..., d).
        """
        lanes, batch = self._lanes(q)
        n, d = lanes.shape[1], self.n_joints
        angles = np.where(self.is_revolute, lanes.T, 0.0)[..., None, None]
        ways = np.where(self.is_revolute, 0.0, lanes.T)[..., None]
        k = so3.hat(self.axes)
        turns = np.eye(3) + np.sin(angles) * k + (1.0 - np.cos(angles)) * (k @ k)
        steps = ways * self.axes + np.diff(self.points, axis=0, prepend=0.0)
        out = np.zeros((n, d, 4, 4))
        out[..., 3, 3] = 1.0
        R, p = np.eye(3), np.zeros((n, 3))
        for i in range(d):
            p = p + (R @ steps[:, i, :, None])[..., 0]
            R = R @ turns[:, i]
            out[:, i, :3, :3], out[:, i, :3, 3] = R, p
        return SE3(out.reshape(*batch, d, 4, 4))

    @cached_property
    def middle(self) -> FloatArray:
        """Middle of each joint's range [rad or m], zero if endless; shape (d,)."""
        is_bounded = np.isfinite(self.lower) & np.isfinite(self.upper)
        ends = np.where(is_bounded, (self.lower, self.upper), 0.0)
        return np.asarray(ends.mean(axis=0))

    def wrapped(self, q: ArrayLike) -> FloatArray:
        """Return the same postures (..., d), turns near the middle of their ranges."""
        q = self._postures(q)
        turns = np.round((q - self.middle) / (2.0 * np.pi))
        return np.asarray(q - 2.0 * np.pi * np.where(self.is_revolute, turns, 0.0))

    def unwound(self, q: ArrayLike, q_near: ArrayLike) -> FloatArray:
        """Return the same postures, turned by whole turns to lie near others.

        As near as the limits allow, and as they are where no turn leads within them;
        postures (..., d) of which leading axes broadcast.
        """
        q, tau = self._postures(q), 2.0 * np.pi
        gap = self._postures(q_near) - q
        least, most = np.ceil((self.lower - q) / tau), np.floor((self.upper - q) / tau)
        fits, turns = (least <= most) & self.is_revolute, np.round(gap / tau)
        return q + tau * np.where(fits, bounded(turns, least, most), 0.0)

    def way(self, q_to: ArrayLike, q_from: ArrayLike) -> FloatArray:
        """Motion that leads from one posture to another [rad or m], shape (..., d).

        A joint with limits goes the way that lies within them, an endless one the
        shorter way.
        """
        gap = self._postures(q_to) - self._postures(q_from)
        is_endless = ~np.isfinite(self.lower) & self.is_revolute
        return np.where(is_endless, self.difference(q_to, q_from), gap)

    def travel(self, q_a: ArrayLike, q_b: ArrayLike) -> FloatArray:
        """Largest motion of a joint between postures [rad or m], shape (...)."""
        return np.asarray(np.abs(self.way(q_a, q_b)).max(axis=-1))

    def clipped(self, q: ArrayLike) -> FloatArray:
        """Return the nearest postures (..., d) within limits; cyclic joints wrap."""
        q = self._postures(q)
        nearest = np.where(self.is_cyclic, self.wrapped(q), q)
        return bounded(nearest, self.lower, self.upper)

    def difference(self, q_a: ArrayLike, q_b: ArrayLike) -> FloatArray:
        """``q_a - q_b`` the short way round for cyclic joints, shape (..., d)."""
        gap = self._postures(q_a) - self._postures(q_b)
        wrapped = gap - 2.0 * np.pi * np.round(gap / (2.0 * np.pi))
        return np.where(self.is_cyclic, wrapped, gap)

    def sampled(self, n: int, *, rng: Rng) -> FloatArray:
        """Random postures within the limits, uniform per joint, shape (n, d)."""
        require_generator(rng)
        require_count("number of postures", n)
        low, high = np.nan_to_num([self.lower, self.upper], posinf=np.pi, neginf=-np.pi)
        return rng.uniform(low, high, size=(n, self.n_joints))

    def vector(self, values: Mapping[str, float]) -> FloatArray:
        """Joint values (d,) in order; zero where not named; other names don't count."""
        return np.array([values.get(name, 0.0) for name in self.joint_names])

    def named(self, q: Sequence[float] | FloatArray) -> dict[str, float]:
        """Joint values by name, of one posture (d,); others raise `ShapeError`."""
        values = self._postures(q)
        if values.ndim != 1:
            raise ShapeError("joint values", got=values.shape, expected="one posture")
        return dict(zip(self.joint_names, values.tolist(), strict=True))

    def _postures(self, q: ArrayLike) -> FloatArray:
        return as_floats(q, "joint values", (self.n_joints,))

    def _lanes(self, q: ArrayLike) -> tuple[FloatArray, tuple[int, ...]]:
        q = self._postures(q)
        return np.ascontiguousarray(q.reshape(-1, self.n_joints).T), q.shape[:-1]

    def _tip(self, frames: LaneFrames) -> FloatArray:
        form = self.form
        return form.T_base_first @ frames.matrices() @ form.T_last_tip
