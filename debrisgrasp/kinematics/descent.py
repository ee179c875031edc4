r"""Levenberg-Marquardt descent of many inverse kinematics problems side by side.

A lane is one target started from one seed. A lane that converges, stalls or uses up its
iterations is taken over by a waiting target; once all have had a lane, the unsolved
ones get further lanes with other seeds, so that all lanes stay busy to the end.

With the error :math:`e` (position, and :math:`2 \tan(\theta/2)` along the axis of the
remaining turn) the step is

.. math:: \Delta q = J^T (J J^T + \lambda \lVert e \rVert^2 I)^{-1} e

with the columns of joints that stand at a limit and are pulled outwards set to zero.
The damping fades with the error (Sugihara 2011), so that the last steps converge
quadratically.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray

from .lanes import LanePool, SeedSource
from .serial import LaneFrames, Lanes, Scratch, SerialForm

__all__ = ["Descent", "DescentEnd", "Goals"]

_CHUNK = 1024
"""Double precision lanes evaluated at once; more would leave the cache."""


@dataclass(frozen=True, slots=True, eq=False)
class Goals:
    """Poses wanted of the last joint frame, in the frame of the first joint."""

    columns: Lanes
    """Rotation columns x, y, z and translation [m], shape (4, 3, targets)."""

    @classmethod
    def from_matrices(cls, form: SerialForm, T_base_tip: FloatArray) -> Goals:
        """Move targets (targets, 4, 4) of the tip to both ends of the form."""
        T = (
            np.linalg.inv(form.T_base_first)
            @ T_base_tip
            @ np.linalg.inv(form.T_last_tip)
        )
        columns = np.ascontiguousarray(T[:, :3, :].transpose(2, 1, 0))
        return cls(columns.astype(form.dtype))

    def errors(self, form: SerialForm, q: Lanes) -> FloatArray:
        """Distance [m] and angle [rad] of the tip at q (d, targets); (2, targets)."""
        errors, scratch = np.empty((2, q.shape[1])), Scratch()
        for start in range(0, q.shape[1], _CHUNK):
            part = slice(start, start + _CHUNK)
            frames = form.frames(q[:, part], scratch)
            errors[:, part] = _tip_errors(form, frames, self.columns[:, :, part])
        return errors


@dataclass(frozen=True, slots=True, eq=False)
class DescentEnd:
    """The best end of each target."""

    q: Lanes
    """Joint values [rad or m], shape (d, targets)."""
    error: Lanes
    """Squared norm of the weighted error [m^2], shape (targets,)."""
    is_converged: BoolArray
    """Shape (targets,)."""
    is_at_limit: BoolArray
    """A joint stood at its limit and was pulled outwards, shape (targets,)."""
    has_stalled: BoolArray
    """Left for lack of progress, not for lack of iterations; shape (targets,)."""

    @classmethod
    def empty(cls, n_joints: int, n_targets: int, dtype: type) -> DescentEnd:
        """Return the state before any lane has ended."""
        return cls(
            np.zeros((n_joints, n_targets), dtype=dtype),
            np.full(n_targets, np.inf, dtype=dtype),
            *(np.zeros(n_targets, dtype=bool) for _ in range(3)),
        )

    def record(
        self,
        target: IntArray,
        q: Lanes,
        error: Lanes,
        flags: tuple[BoolArray, BoolArray, BoolArray],
    ) -> None:
        """Keep ended lanes that are better than what their targets had."""
        # The best of several lanes of one target must be written last.
        order = np.argsort(-error, kind="stable")
        order = order[error[order] < self.error[target[order]]]
        winner = target[order]
        self.q[:, winner] = q[:, order]
        self.error[winner] = error[order]
        for kept, flag in zip(
            (self.is_converged, self.is_at_limit, self.has_stalled), flags, strict=True
        ):
            kept[winner] = flag[order]


@dataclass(frozen=True, eq=False, kw_only=True)
class Descent:
    """A chain with its limits, ready to run."""

    form: SerialForm
    lower: FloatArray
    """Limits [rad or m], shape (d,); -inf where a joint may turn freely."""
    upper: FloatArray
    rotation_weight: float
    """Metres of position error that one radian of rotation error counts as."""
    damping: float
    max_iterations: int
    width: int
    """Lanes that run at once."""
    tolerance: float
    """Weighted error at which a lane has converged [m]."""
    stall_ratio: float = 0.6
    """A lane stalls if its error stays above this part of what it was a while ago."""

    def run(self, goals: Goals, seeds: SeedSource, attempts: int) -> DescentEnd:
        """Bring every goal to convergence, or use up its attempts."""
        n_targets = goals.columns.shape[-1]
        end = DescentEnd.empty(len(self.lower), n_targets, self.form.dtype)
        pool, scratch = LanePool(goals.columns, seeds, attempts, self.width), Scratch()
        while pool.n_lanes:
            error, step, is_at_limit = self._step(pool.q, pool.goal, scratch)
            size = (error * error).sum(axis=0)
            is_converged = size < self.tolerance**2
            has_stalled = pool.has_stalled(size, self.stall_ratio**2)
            is_done = is_converged | has_stalled | (pool.age >= self.max_iterations)
            done = np.flatnonzero(is_done)
            if len(done):
                flags = (is_converged[done], is_at_limit[done], has_stalled[done])
                end.record(pool.target[done], pool.q[:, done], size[done], flags)
            pool.advance(self._projected(pool.q + step))
            if len(done):
                # Sister lanes of a target that has just been solved leave too.
                is_free = is_done | end.is_converged[pool.target]
                pool.refill(is_free, end.is_converged)
        return end

    def refined(self, q: Lanes, goals: Goals) -> Lanes:
        """Take one step from q (d, targets), however good it is."""
        out, scratch = np.empty_like(q), Scratch()
        for start in range(0, q.shape[1], self.width):
            part = slice(start, start + self.width)
            _, step, _ = self._step(q[:, part], goals.columns[:, :, part], scratch)
            out[:, part] = self._projected(q[:, part] + step)
        return out

    def _projected(self, q: Lanes) -> Lanes:
        for i, lower, upper in self._bounded:
            np.minimum(np.maximum(q[i], lower, out=q[i]), upper, out=q[i])
        return q

    @cached_property
    def _bounded(self) -> list[tuple[int, Any, Any]]:
        """Joints that have a limit, with their limits in the form's precision."""
        is_bounded = np.isfinite(self.lower) | np.isfinite(self.upper)
        dtype = self.form.dtype
        return [
            (int(i), dtype(self.lower[i]), dtype(self.upper[i]))
            for i in np.flatnonzero(is_bounded)
        ]

    def _step(
        self, q: Lanes, goal: Lanes, scratch: Scratch
    ) -> tuple[Lanes, Lanes, BoolArray]:
        """Weighted error (6, lanes), step (d, lanes), and who is held by a limit."""
        dtype = self.form.dtype
        frames = self.form.frames(q, scratch)
        error = _error(frames, goal)
        J = self.form.jacobian(frames, scratch)
        error[3:] *= dtype(self.rotation_weight)
        J[3:] *= dtype(self.rotation_weight)
        is_at_limit = self._hold_at_limits(q, J, error)
        A = _gram(J, scratch)
        shift = dtype(self.damping) * (error * error).sum(axis=0) + dtype(1e-7)
        for k in range(6):
            A[k, k] += shift
        y = _solve_in_place(A, error.copy(), scratch)
        product = scratch.array("product", J.shape, J.dtype)
        np.multiply(J, y[:, None], out=product)
        return error, product.sum(axis=0), is_at_limit

    def _hold_at_limits(self, q: Lanes, J: Lanes, error: Lanes) -> BoolArray:
        """Zero the columns of joints that a limit holds; return the lanes with any."""
        is_held_anywhere = np.zeros(q.shape[1], dtype=bool)
        for i, lower, upper in self._bounded:
            is_low, is_high = q[i] <= lower, q[i] >= upper
            if not (is_low.any() or is_high.any()):
                continue
            pull = (J[:, i] * error).sum(axis=0)
            is_held = (is_low & (pull < 0)) | (is_high & (pull > 0))
            J[:, i, is_held] = 0.0
            is_held_anywhere |= is_held
        return is_held_anywhere


def _turn(frames: LaneFrames, goal: Lanes) -> tuple[Lanes, Lanes]:
    """Remaining rotation: 2 sin(angle) along its axis (3, lanes), and 2 cos(angle)."""
    columns = (frames.x, frames.y, frames.z)
    twice_sine = np.zeros((3, goal.shape[-1]), dtype=goal.dtype)
    twice_cosine = np.full(goal.shape[-1], -1.0, dtype=goal.dtype)
    for have, want in zip(columns, goal[:3], strict=True):
        twice_cosine += (have * want).sum(axis=0)
        for k, (a, b) in enumerate(((1, 2), (2, 0), (0, 1))):
            twice_sine[k] += have[a] * want[b] - have[b] * want[a]
    return twice_sine, twice_cosine


def _tip_errors(form: SerialForm, frames: LaneFrames, goal: Lanes) -> Lanes:
    """Distance [m] and angle [rad] between tip and goal, shape (2, lanes)."""
    twice_sine, twice_cosine = _turn(frames, goal)
    angle = np.arctan2(np.sqrt((twice_sine * twice_sine).sum(axis=0)), twice_cosine)
    offset = goal[3] - frames.p
    reached = (frames.x, frames.y, frames.z)
    lever = form.T_last_tip[:3, 3]
    for length, want, have in zip(lever, goal[:3], reached, strict=True):
        if length:
            offset += length * (want - have)
    return np.stack([np.sqrt((offset * offset).sum(axis=0)), angle])


def _error(frames: LaneFrames, goal: Lanes) -> Lanes:
    """Position error [m] and 2 tan(angle / 2) rotation error, shape (6, lanes)."""
    error = np.empty((6, goal.shape[-1]), dtype=goal.dtype)
    np.subtract(goal[3], frames.p, out=error[:3])
    twice_sine, twice_cosine = _turn(frames, goal)
    # sin / (1 + cos) = tan(angle / 2); near half a turn its length is bounded.
    np.multiply(twice_sine, 2.0 / np.maximum(twice_cosine + 2.0, 0.1), out=error[3:])
    return error


def _gram(J: Lanes, scratch: Scratch) -> Lanes:
    """``J @ J.T`` per lane, shape (6, 6, lanes); only the upper triangle is set."""
    A = scratch.array("gram", (6, 6, J.shape[-1]), J.dtype)
    product = scratch.array("product", J.shape, J.dtype)
    for row in range(6):
        np.multiply(J[row], J[row:], out=product[row:])
        np.sum(product[row:], axis=1, out=A[row, row:])
    return A


def _solve_in_place(A: Lanes, b: Lanes, scratch: Scratch) -> Lanes:
    """Solve the positive definite ``A x = b`` per lane, by its upper triangle.

    Whole squares are updated, which is faster than rows; what this leaves in the lower
    triangle is never read.
    """
    n = len(b)
    outer = scratch.array("outer", A.shape, A.dtype)
    inverse_pivots = []
    for k in range(n):
        inverse = 1.0 / A[k, k]
        inverse_pivots.append(inverse)
        if k < n - 1:
            rest = slice(k + 1, n)
            factors = A[k, rest] * inverse
            np.multiply(factors[:, None], A[k, rest], out=outer[rest, rest])
            A[rest, rest] -= outer[rest, rest]
            b[rest] -= factors * b[k]
    for k in range(n - 1, -1, -1):
        b[k] *= inverse_pivots[k]
        if k:
            b[:k] -= A[:k, k] * b[k]
    return b
