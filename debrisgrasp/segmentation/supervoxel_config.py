"""Settings of supervoxels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from debrisgrasp._arrays import require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import ConfigError

from .voxels import Binning

__all__ = ["COARSEST", "SupervoxelConfig"]

_FINEST, COARSEST = 5e-4, 10.0
"""Resolutions beyond these [m] can only be of another unit."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class SupervoxelConfig:
    """How fine the patches are and what makes a point similar to one."""

    voxel_resolution: float = 0.008
    """Edge of a voxel [m]; larger is faster and blurs thin parts together. Voxels are
    enlarged where the cloud is coarser, see ``min_points_per_voxel``."""
    seed_resolution: float = 0.024
    """Distance between the seeds of patches [m], about their size."""
    color_importance: float = 0.0
    """Weight of the distance in colour; needs colours with the cloud."""
    spatial_importance: float = 0.4
    """Weight of the distance in space, in units of ``seed_resolution``."""
    normal_importance: float = 8.0
    """Weight of 1 - |cos| between the normals."""
    binning: Binning = Binning.METRIC
    """Shape of the voxels; `Binning.SINGLE_CAMERA` keeps far surfaces whole where the
    samples lie farther apart than a voxel."""
    refinements: int = 0
    """Rounds of fitting normals within the patches, reseeding at their centres, and
    growing anew."""

    min_points_per_voxel: float = 2.0
    """Mean number of points per voxel below which voxels and patches are enlarged:
    cells finer than the samples of a coarse or distant scan don't touch each other. 0
    keeps the resolution."""

    def coarsened(self, factor: float) -> SupervoxelConfig:
        """Return the same settings with larger voxels and patches, within limits."""
        return replace(
            self,
            voxel_resolution=factor * self.voxel_resolution,
            seed_resolution=min(factor * self.seed_resolution, COARSEST),
        )

    def __post_init__(self) -> None:
        if not _FINEST <= self.voxel_resolution < self.seed_resolution <= COARSEST:
            raise ConfigError(
                "voxel_resolution and seed_resolution",
                got=f"{self.voxel_resolution} and {self.seed_resolution}",
                expected=f"{_FINEST} <= voxel_resolution < seed_resolution <= "
                f"{COARSEST} [m]",
                mend="Millimetres are to be divided by 1000.",
            )
        for name in (
            "color_importance",
            "spatial_importance",
            "normal_importance",
            "min_points_per_voxel",
        ):
            if not 0 <= getattr(self, name) < np.inf:
                raise ConfigError(name, got=getattr(self, name), expected="0 or more")
        require_range("refinements", self.refinements, 0, 100)
