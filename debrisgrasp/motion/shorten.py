"""Shortcuts through a path of straight edges, many tried at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from debrisgrasp._arrays import FloatArray, Rng

from .edges import EdgeTest

__all__ = ["path_cost", "shortened"]

_BATCH = 24
"""Shortcuts tried in a round."""
_CORNER = 0.2
"""What a corner costs, in the units of an edge [s]: the arm has to slow down there."""


def path_cost(path: FloatArray, velocity: FloatArray) -> float:
    """Time for a path (m, d) at full speed [s], corners counted."""
    legs = np.abs(np.diff(path, axis=0)) / velocity
    return float(legs.max(axis=1).sum() + _CORNER * (len(path) - 2))


def shortened(
    path: FloatArray,
    velocity: FloatArray,
    edges: EdgeTest,
    *,
    rounds: int,
    rng: Rng,
    is_late: Callable[[], bool],
) -> FloatArray:
    """Cut corners of a path (m, d) as long as that saves time."""
    idle = 0
    for _ in range(rounds):
        if len(path) <= 2 or idle == 2 or is_late():
            break
        better = _cut(path, velocity, edges, rng)
        idle = 0 if better is not None else idle + 1
        path = path if better is None else better
    return path


def _cut(
    path: FloatArray, velocity: FloatArray, edges: EdgeTest, rng: Rng
) -> FloatArray | None:
    """Path with the best of a batch of shortcuts, or None."""
    legs = (np.abs(np.diff(path, axis=0)) / velocity).max(axis=1)
    clock = np.concatenate([[0.0], np.cumsum(legs)])
    ends = np.sort(rng.uniform(0.0, clock[-1], (_BATCH, 2)), axis=1)
    # Corners themselves are good ends, and start and goal the best.
    is_corner = rng.random(ends.shape) < 0.5
    nearest = np.abs(ends[..., None] - clock).argmin(axis=-1)
    ends = np.where(is_corner, clock[nearest], ends)
    ends[0] = clock[0], clock[-1]
    at = np.clip(np.searchsorted(clock, ends, "right") - 1, 0, len(legs) - 1)
    share = (ends - clock[at]) / np.maximum(legs[at], 1e-12)
    q = path[at] + share[..., None] * (path[at + 1] - path[at])
    direct = (np.abs(q[:, 1] - q[:, 0]) / velocity).max(axis=1)
    corners = np.floor(at[:, 1] - at[:, 0])
    saved = ends[:, 1] - ends[:, 0] - direct + _CORNER * (corners - 2.0)
    saved[(share[:, 0] <= 0.0) & (corners > 0)] += _CORNER
    saved[(share[:, 1] >= 1.0) & (corners > 0)] += _CORNER
    rows = np.flatnonzero((corners > 0) & (saved > 1e-3))
    if not len(rows):
        return None
    free = rows[edges.are_free(q[rows, 0], q[rows, 1])]
    if not len(free):
        return None
    best = int(free[saved[free].argmax()])
    first, last = at[best]
    cut = np.concatenate([path[: first + 1], q[best], path[last + 1 :]])
    steps = np.abs(np.diff(cut, axis=0)).max(axis=1)
    kept: FloatArray = cut[np.concatenate([[True], steps > 1e-9])]
    return kept if path_cost(kept, velocity) < path_cost(path, velocity) else None
