"""Distance to solids that stand still, as a grid for quick lookups."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from debrisgrasp._arrays import Float32Array, FloatArray
from debrisgrasp.geometry import Solid, SolidContent, lattice

__all__ = ["GRID_SPACING", "SolidField"]

GRID_SPACING = 0.01
"""Default edge of a cell [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class SolidField:
    """Truncated distance to the nearest of some solids, in their frame."""

    origin: FloatArray
    """Centre of the first cell [m], shape (3,)."""
    spacing: float
    shape: tuple[int, int, int]
    gap: Float32Array
    """Distance from each cell's centre [m], flat, at most the reach."""

    @classmethod
    def build(
        cls,
        solids: Sequence[Solid],
        *,
        spacing: float = GRID_SPACING,
        reach: float = 0.11,
    ) -> SolidField:
        """Fill a grid around solids in one frame; distances saturate at ``reach``.

        Grids around the same solids are filled once.
        """
        return _filled(SolidContent.of(solids), spacing, reach)

    def __call__(
        self, x: Float32Array, y: Float32Array, z: Float32Array
    ) -> Float32Array:
        """Distance of points [m], to half the diagonal of a cell."""
        index = np.zeros(x.shape, dtype=np.int32)
        for axis, coordinate in enumerate((x, y, z)):
            scaled = coordinate * np.float32(1.0 / self.spacing)
            scaled += np.float32(0.5 - self.origin[axis] / self.spacing)
            np.clip(scaled, 0, self.shape[axis] - 1, out=scaled)
            index *= np.int32(self.shape[axis])
            index += scaled.astype(np.int32)
        found: Float32Array = self.gap[index]
        return found


@lru_cache(maxsize=32)
def _filled(content: SolidContent, spacing: float, reach: float) -> SolidField:
    solids = content.solids
    lower = np.min([solid.bounds.lower for solid in solids], axis=0)
    upper = np.max([solid.bounds.upper for solid in solids], axis=0)
    origin = lower - reach - spacing
    nx, ny, nz = (int(n) for n in np.ceil((upper - lower + 2 * reach) / spacing) + 3)
    gap = np.full((nx, ny, nz), reach, dtype=np.float32)
    for solid in solids:
        low = np.floor((solid.bounds.lower - reach - origin) / spacing).astype(int)
        high = np.ceil((solid.bounds.upper + reach - origin) / spacing).astype(int)
        block = tuple(
            slice(max(int(i), 1), min(int(j) + 1, n - 1))
            for i, j, n in zip(low, high, gap.shape, strict=True)
        )
        axes = (
            o + spacing * np.arange(part.start, part.stop)
            for o, part in zip(origin, block, strict=True)
        )
        found = solid.signed_distance(lattice(*axes)).astype(np.float32)
        np.minimum(gap[block], found, out=gap[block])
    origin.flags.writeable = gap.flags.writeable = False
    return SolidField(origin, spacing, (nx, ny, nz), gap.ravel())
