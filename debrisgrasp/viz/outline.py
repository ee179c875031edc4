"""Outline of what an arm reaches, at one height."""

from __future__ import annotations

import numpy as np
from contourpy import contour_generator
from scipy.ndimage import gaussian_filter

from debrisgrasp._arrays import FloatArray
from debrisgrasp.kinematics import RobotModel

__all__ = ["reach_outline", "sampled_reach"]

_N_SAMPLES = 80_000

_HALF_THICKNESS = 0.08
"""Positions this far above and below a height count as at it [m]."""
_CELL = 0.04
"""Grid of the outline [m]: finer would show the sampling, not the arm."""


def sampled_reach(robot: RobotModel, arm: str) -> FloatArray:
    """Positions of the palm [m] at random joint values, shape (k, 3), base frame.

    Collisions are not looked at: it is the outermost that the arm can do.
    """
    chain = robot.chain(arm)
    # The same samples every time, so that equal reports are equal files.
    q = chain.sampled(_N_SAMPLES, rng=np.random.default_rng(0))
    return chain.fk(q).p


def reach_outline(reach: FloatArray, height: float) -> list[FloatArray]:
    """Draw closed lines around the reachable positions near one height.

    Parameters
    ----------
    reach
        Positions that the hand can take [m], shape (k, 3), base frame.
    height
        Height z [m] of the cut.

    Returns
    -------
    list of FloatArray
        Lines of shape (j, 3) in the plane of the cut; none if nothing is reached there.
    """
    layer = reach[np.abs(reach[:, 2] - height) <= _HALF_THICKNESS][:, :2]
    if len(layer) < 20:
        return []
    low = layer.min(axis=0) - 4 * _CELL
    shape = np.ceil((layer.max(axis=0) + 4 * _CELL - low) / _CELL).astype(int)
    cells = ((layer - low) / _CELL).astype(int)
    counts = np.zeros(shape)
    np.add.at(counts, tuple(cells.T), 1.0)
    occupied = gaussian_filter((counts > 0).astype(np.float64), 2.0)
    x, y = (low[i] + _CELL * (np.arange(shape[i]) + 0.5) for i in (0, 1))
    lines = contour_generator(x, y, occupied.T).lines(0.35)
    return [
        np.column_stack([line, np.full(len(line), height)])
        for line in map(np.asarray, lines)
        if len(line) > 40
    ]
