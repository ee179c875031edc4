"""Surfaces that the last look does not show: what was put down, or touched, since."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import maximum_filter

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp.geometry import SE3, voxel_downsample

__all__ = ["ObstacleMemory"]

_GRAIN = 0.01
"""Spacing of the points of what was seen to lie [m]."""
_CELL = 0.04
"""Of the map of heights [m]; a point counts in all cells beside its own, too."""


@dataclass(eq=False)
class ObstacleMemory:
    """Surfaces [m] in the base frame, each (n, 3)."""

    dropped: list[FloatArray] = field(default_factory=list)
    """Of what was put down, as it is guessed ..."""
    settled: list[FloatArray] = field(default_factory=list)
    """... and where it was seen since."""
    fallen: list[FloatArray] = field(default_factory=list)
    """The same guess of what was let go among what the camera sees, until it looks
    again."""
    felt: list[FloatArray] = field(default_factory=list)
    """Of what empty hands touched on their ways, until then."""

    @property
    def guesses(self) -> list[FloatArray]:
        """What nobody has seen where it is taken to be."""
        return [*self.dropped, *self.fallen]

    @property
    def surfaces(self) -> list[FloatArray]:
        """All that is remembered."""
        return [*self.guesses, *self.settled, *self.felt]

    def heights(self, points: FloatArray) -> FloatArray:
        """How high what was put down lies below points (..., 2 or more) [m], (...)."""
        lies = np.concatenate([np.zeros((1, 3)), *self.dropped, *self.settled])
        corner = lies[:, :2].min(axis=0) - 2.0 * _CELL
        at = np.floor((lies[:, :2] - corner) / _CELL).astype(np.intp)
        cells = np.zeros(at.max(axis=0) + 3)
        np.maximum.at(cells, tuple(at.T), lies[:, 2])
        at = np.floor((points[..., :2] - corner) / _CELL).astype(np.intp)
        inside = np.asarray(((at >= 0) & (at < cells.shape)).all(axis=-1))
        x, y = np.moveaxis(np.where(inside[..., None], at, 0), -1, 0)
        return np.asarray(np.where(inside, maximum_filter(cells, size=3)[x, y], 0.0))

    def refresh(self) -> None:
        """Forget what counts only until the next look, which has come."""
        self.fallen.clear()
        self.felt.clear()

    def settle(
        self, points: FloatArray, still: Callable[[FloatArray], FloatArray]
    ) -> None:
        """Add what was seen to lie (n, 3); of all that was put down that is left."""
        self.dropped = [body for body in map(still, self.dropped) if len(body)]
        lain = np.concatenate([*map(still, self.settled), points])
        self.settled = [lain[voxel_downsample(lain, _GRAIN)]] if len(lain) else []

    def topple(self, is_gone: Callable[[FloatArray], BoolArray], above: float) -> None:
        """Forget what was put down, and is gone, above a height [m]."""

        def left(body: FloatArray, gone: BoolArray | np.bool_) -> FloatArray:
            return body[~(gone & (body[:, 2] > above))]

        self.settled = [left(body, is_gone(body)) for body in self.settled]
        # A guess is one thing: it stands, or it does not.
        stood = (left(body, is_gone(body).any()) for body in self.dropped)
        self.dropped = [body for body in stood if len(body)]

    def moved(self, T_now_before: SE3) -> None:
        """Take all along when the base has moved."""
        for bodies in (self.dropped, self.settled, self.fallen, self.felt):
            bodies[:] = [T_now_before.apply(body) for body in bodies]
