"""The ground: a level floor, or smooth unevenness of a few centimetres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter, map_coordinates

from debrisgrasp._arrays import (
    FloatArray,
    Rng,
    frozen,
    require_finite,
    require_metres,
    require_range,
)
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp.errors import InputError

__all__ = ["Ground"]

_ITERATIONS = 7


@checked_fields
@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """Heights over a regular grid; beyond it the border goes on."""

    heights: FloatArray
    """Heights in the base frame [m], shape (rows along y, columns along x)."""
    spacing: float = 0.04
    """Distance of neighbouring grid points [m]."""
    origin: tuple[float, float] = (0.0, 0.0)
    """Position (x, y) of the first grid point in the base frame [m]."""

    def __post_init__(self) -> None:
        heights = frozen(self.heights, "ground heights", (None, None))
        require_finite(heights, "ground heights")
        if min(heights.shape) < 2 or not self.spacing > 0:
            raise InputError(
                "ground heights",
                got=f"a grid of {heights.shape} every {self.spacing} m",
                expected="at least 2 x 2 points at a positive spacing",
            )
        object.__setattr__(self, "heights", heights)

    @classmethod
    def level(cls) -> Ground:
        """Return a floor at z = 0."""
        return cls(np.zeros((2, 2)), spacing=1.0)

    @classmethod
    @checked
    def uneven(
        cls,
        rng: Rng,
        *,
        peak_to_peak: float = 0.045,
        wavelength: float = 0.6,
        size: float = 6.0,
        center: tuple[float, float] = (1.4, 0.0),
    ) -> Ground:
        """Draw smooth unevenness about z = 0.

        Parameters
        ----------
        rng
            Source of randomness.
        peak_to_peak
            Highest minus lowest point [m].
        wavelength
            Typical distance from bump to bump [m].
        size, center
            Edge length and middle (x, y) of the square that is uneven [m].

        Raises
        ------
        ConfigError
            If one of them is out of range.
        """
        require_range("peak_to_peak [m]", peak_to_peak, 0.0, 1.0)
        require_range("wavelength [m]", wavelength, 0.1, 10.0)
        require_range("size [m]", size, 0.5, 50.0)
        require_metres("center", center)
        spacing = 0.04
        count = round(size / spacing) + 1
        white = rng.standard_normal((count, count))
        smooth = gaussian_filter(white, wavelength / 4 / spacing, mode="nearest")
        smooth -= (smooth.max() + smooth.min()) / 2
        heights = smooth * (peak_to_peak / np.ptp(smooth))
        corner = (center[0] - size / 2, center[1] - size / 2)
        return cls(heights, spacing, corner)

    @property
    def is_level(self) -> bool:
        """Whether all heights are the same."""
        return bool(np.ptp(self.heights) == 0.0)

    def height(self, xy: ArrayLike) -> FloatArray:
        """Height [m] at positions (..., 2), bilinear between grid points."""
        xy = np.asarray(xy, dtype=np.float64)
        if self.is_level:
            return np.full(xy.shape[:-1], self.heights[0, 0])
        grid = (xy.reshape(-1, 2) - np.asarray(self.origin)) / self.spacing
        found: FloatArray = map_coordinates(
            self.heights, grid.T[::-1], order=1, mode="nearest"
        )
        return found.reshape(xy.shape[:-1])

    def hit(self, origin: ArrayLike, rays: FloatArray) -> FloatArray:
        """How many lengths of each ray (n, 3) lead from the origin to the ground.

        Rays that don't go down get infinity. Where a flat ray meets the ground more
        than once, any of the places is found.
        """
        origin = np.asarray(origin, dtype=np.float64)
        is_falling = rays[:, 2] < -1e-9
        slope = np.where(is_falling, rays[:, 2], -1.0)
        top, bottom = self.heights.max(), self.heights.min()
        first, last = (top - origin[2]) / slope, (bottom - origin[2]) / slope
        steps = last
        if not self.is_level:
            above, below = (
                self._gaps(origin, rays, first),
                self._gaps(origin, rays, last),
            )
            for _ in range(_ITERATIONS):
                share = above / np.maximum(above - below, 1e-12)
                steps = first + np.clip(share, 0.0, 1.0) * (last - first)
                gap = self._gaps(origin, rays, steps)
                # The end that stays is halved, or the bracket would shrink on one side.
                is_above = gap > 0.0
                first, last = (
                    np.where(is_above, steps, first),
                    np.where(is_above, last, steps),
                )
                above, below = (
                    np.where(is_above, gap, above / 2),
                    np.where(is_above, below / 2, gap),
                )
        return np.where(is_falling & (steps > 0.0), steps, np.inf)

    def _gaps(
        self, origin: FloatArray, rays: FloatArray, steps: FloatArray
    ) -> FloatArray:
        """Height above the ground after so many lengths of each ray [m]."""
        points = origin + np.clip(steps, 0.0, 1e4)[:, None] * rays
        return np.asarray(points[:, 2] - self.height(points[:, :2]))
