"""Descent of many inverse kinematics problems side by side, one on each lane.

A lane is one target started from one seed. One that comes in, stalls or uses up its
iterations is taken over by a waiting target; once all have had a lane, the unsolved
ones get further lanes with other seeds, so that all lanes stay busy to the end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray

from .formulas import ChainFormulas
from .ik_types import IkConfig
from .lanes import LanePool, SeedSource
from .program import LaneCode, LaneKernel
from .serial import Lanes, SerialForm

__all__ = [
    "SINGLE_FLOOR",
    "STALL_INTERVAL",
    "STALL_RATIO",
    "Descent",
    "DescentEnd",
    "Goals",
]

STALL_RATIO = 0.6
"""A descent stalls if its error stays above this part of what it was a while ago."""
STALL_INTERVAL = 3
"""Iterations between two looks at whether a descent still makes progress."""
SINGLE_FLOOR = 2e-5
"""Weighted error [m] that single precision reaches for certain."""
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
        T_first_base, T_tip_last = form.T_first_base, form.T_tip_last
        n = len(T_base_tip)
        # Two products of plain matrices, which cost less than many small ones.
        rows = T_base_tip[:, :3].transpose(1, 2, 0).reshape(3, -1)
        moved = (T_first_base[:3, :3] @ rows).reshape(3, 4, n)
        moved[:, 3] += T_first_base[:3, 3, None]
        columns = moved.transpose(1, 0, 2).reshape(4, -1)
        return cls((T_tip_last.T @ columns).reshape(4, 3, n))

    def picked(self, index: IntArray) -> Goals:
        """Pick some of the targets."""
        return Goals(self.columns[:, :, index])

    @property
    def rows(self) -> Lanes:
        """The twelve numbers of each target, shape (12, targets)."""
        return self.columns.reshape(12, -1)

    def errors(self, formulas: ChainFormulas, q: FloatArray) -> FloatArray:
        """Distance [m] and angle [rad] left at q (d, targets); shape (2, targets)."""
        proof = LaneKernel(formulas.proof_of_lanes, np.float64)
        out = np.empty((2, q.shape[1]))
        for start in range(0, q.shape[1], _CHUNK):
            part = slice(start, start + _CHUNK)
            square, sine_square, cosine = proof(*q[:, part], *self.rows[:, part])
            out[0, part] = np.sqrt(square)
            out[1, part] = np.arctan2(np.sqrt(sine_square), cosine)
        return out


@dataclass(frozen=True, slots=True, eq=False)
class DescentEnd:
    """The best end of each target."""

    q: Lanes
    """Joint values [rad or m], shape (joints, targets)."""
    error: Lanes
    """Squared weighted error [m^2] before the last step, shape (targets,)."""
    has_converged: BoolArray
    """Shape (targets,)."""
    has_stalled: BoolArray
    """Left for lack of progress, not for lack of iterations; shape (targets,)."""

    def record(
        self,
        target: IntArray,
        q: Lanes,
        error: Lanes,
        is_in: BoolArray,
        slow: BoolArray,
    ) -> None:
        """Keep ended lanes that are better than what their targets had."""
        # The best of several lanes of one target must be written last.
        order = np.argsort(-error, kind="stable")
        order = order[error[order] < self.error[target[order]]]
        winner = target[order]
        self.q[:, winner] = q[:, order]
        self.error[winner] = error[order]
        self.has_converged[winner] = is_in[order]
        self.has_stalled[winner] = slow[order]


@dataclass(frozen=True, eq=False)
class Descent:
    """Iterations of one chain on lanes of single precision."""

    code: LaneCode
    config: IkConfig
    enough: float
    """Weighted error [m] before a step from which that step is the last."""
    is_last: Callable[[Lanes, Lanes], BoolArray] | None = None
    """Whether it is, given joints (d, n) and the step (d, n); None: it always is."""

    def run(
        self,
        goals: Lanes,
        seeds: SeedSource,
        attempts: int,
        accepts: Callable[[IntArray, Lanes], BoolArray] | None = None,
    ) -> DescentEnd:
        """Descend until all goals (..., targets) are in.

        Or until each has used up its attempts. What comes in counts only where
        ``accepts``, given targets (n,) and their joints (d, n), agrees.
        """
        config = self.config
        n = goals.shape[1]
        pool = LanePool(goals.astype(np.float32), seeds, attempts, config.width)
        end = DescentEnd(
            np.zeros((len(pool.q), n), dtype=np.float32),
            np.full(n, np.inf, dtype=np.float32),
            np.zeros(n, dtype=bool),
            np.zeros(n, dtype=bool),
        )
        step = LaneKernel(self.code, np.float32)
        weights = [
            np.array(value, dtype=np.float32)
            for value in (config.rotation_weight, config.damping)
        ]
        enough = np.float32(self.enough**2)
        while pool.n_lanes and not end.has_converged.all():
            outputs = step(*pool.q, *pool.goal, *weights)
            size = outputs[0]
            is_in = size < enough
            is_slow = pool.has_stalled(size, STALL_RATIO**2, STALL_INTERVAL)
            before = pool.q
            pool.advance(outputs[1:].copy())
            come = is_in.nonzero()[0]
            if self.is_last is not None and len(come):
                now = pool.q[:, come]
                is_in[come] = self.is_last(now, now - before[:, come])
                come = is_in.nonzero()[0]
            is_done = is_in | is_slow | (pool.age > config.max_iterations)
            if accepts is not None and len(come):
                is_in[come] = accepts(pool.target[come], pool.q[:, come])
            done = is_done.nonzero()[0]
            if len(done):
                # What was refused must not stand in the way of what will not be.
                error = np.where(is_in, size, np.maximum(size, enough))[done]
                end.record(
                    pool.target[done],
                    pool.q[:, done],
                    error,
                    is_in[done],
                    is_slow[done],
                )
                # Sister lanes of a target that has just come in leave too.
                pool.refill(is_done | end.has_converged[pool.target], end.has_converged)
        return end
