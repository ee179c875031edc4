"""The errors of an active stereo camera like the Intel RealSense D435."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from debrisgrasp._arrays import BoolArray, FloatArray, Rng, frozen, require_range
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp.geometry import Intrinsics

from .slopes import points_and_normals

__all__ = ["Measured", "StereoNoise"]


_FARTHEST = 100.0
"""No stereo camera sees farther [m]; larger depths are millimetres."""


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A depth image with errors."""

    depth: FloatArray
    """Metres along the optical axis, shape (height, width); 0 = no measurement."""
    is_flying: BoolArray
    """Pixels that show a depth between two surfaces, shape (height, width)."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class StereoNoise:
    """Errors of matching two images; all of them can be turned off by zero."""

    sigma: float = 0.0018
    """Standard deviation of the depth at 1 m [m]; it grows with depth squared, because
    it is constant in disparity."""
    correlation: float = 1.5
    """Standard deviation of the filter that correlates neighbouring errors [px]."""
    correlated_share: float = 0.64
    """Share of the variance that is correlated; the rest is independent per pixel."""
    baseline: float = 0.05
    """Distance of the two imagers [m]."""
    disparity_step: float = 1.0 / 32.0
    """Disparities are multiples of this [px]."""
    depth_step: float = 0.001
    """Depths are multiples of this [m]."""
    edge_jump: float = 0.03
    """Smallest difference in depth between neighbours that makes an edge [m]."""
    growth_share: float = 0.35
    """Share of the border along which the nearer surface grows by a pixel."""
    flying_share: float = 0.2
    """Share of the pixels at edges that fly."""
    edge_loss: float = 0.36
    """Share of the pixels within two of an edge that are lost."""
    grazing: float = 80.0
    """Incidence from which surfaces begin to be lost [degrees]; at 90 all of them."""
    specks: float = 12.0
    """Expected number of small specks without data."""

    def __post_init__(self) -> None:
        for name in ("sigma", "correlation", "disparity_step", "depth_step", "specks"):
            require_range(name, getattr(self, name), 0.0)
        for name in ("correlated_share", "growth_share", "flying_share", "edge_loss"):
            require_range(name, getattr(self, name), 0.0, 1.0)
        require_range("baseline", self.baseline, 1e-6)
        require_range("edge_jump", self.edge_jump, 1e-6)
        require_range("grazing", self.grazing, 0.0, 90.0)

    @checked
    def noisy(self, depth: FloatArray, intrinsics: Intrinsics, *, rng: Rng) -> Measured:
        """Measure an exact depth image.

        Parameters
        ----------
        depth
            Metres along the optical axis, shape (height, width); 0 and what is not
            finite = nothing there.
        intrinsics
            Camera of the image, which is the left imager of the pair.
        rng
            Source of randomness.

        Raises
        ------
        ShapeError
            If the image is not of the camera's size.
        InputError
            If depths are negative, or can only be millimetres.
        """
        depth = frozen(depth, "depth", (intrinsics.height, intrinsics.width))
        depth = np.where(np.isfinite(depth), depth, 0.0)
        require_range("least depth [m]", depth.min(), 0.0)
        require_range("greatest depth [m]", depth.max(), 0.0, _FARTHEST)
        has_depth = depth > 0.0
        far = np.where(has_depth, depth, np.inf)
        scale = intrinsics.fx * self.baseline
        is_lost = ~has_depth | self._unmatched(far, scale)
        is_edge = _is_edge(far, self.edge_jump)
        beside = ndimage.binary_dilation(is_edge, np.ones((3, 3), dtype=bool))
        is_lost |= beside & (rng.random(depth.shape) < self.edge_loss)
        is_lost |= self._grazed(depth, intrinsics, rng) & ~beside
        is_lost |= _specks(depth.shape, rng.poisson(self.specks), rng)

        grown = self._grown(far, rng)
        is_flying = is_edge & (rng.random(depth.shape) < self.flying_share)
        low = ndimage.minimum_filter(far, 3)
        high = ndimage.maximum_filter(np.where(has_depth, depth, 0.0), 3)
        mix = rng.random(depth.shape)
        is_flying &= np.isfinite(low)
        low = np.where(is_flying, low, 0.0)
        seen = np.where(is_flying, low + mix * (high - low), grown)

        is_lost |= ~np.isfinite(seen)
        disparity = scale / np.where(is_lost, 1.0, seen)
        disparity = disparity + self.sigma * scale * self._errors(depth.shape, rng)
        disparity = _rounded(disparity, self.disparity_step)
        is_lost |= disparity <= 0.0
        measured = _rounded(scale / np.where(is_lost, 1.0, disparity), self.depth_step)
        return Measured(np.where(is_lost, 0.0, measured), is_flying)

    def _errors(self, shape: tuple[int, ...], rng: Rng) -> FloatArray:
        """Unit-variance errors that are alike in neighbouring pixels."""
        share = self.correlated_share if self.correlation > 0.0 else 0.0
        own = rng.standard_normal(shape)
        common = rng.standard_normal(shape)
        if share == 0.0:
            return own
        reach = int(np.ceil(4.0 * self.correlation))
        line = np.exp(-0.5 * (np.arange(-reach, reach + 1) / self.correlation) ** 2)
        line /= np.sqrt((line**2).sum())
        for axis in (0, 1):
            common = ndimage.convolve1d(common, line, axis=axis, mode="wrap")
        return np.asarray(np.sqrt(share) * common + np.sqrt(1.0 - share) * own)

    def _unmatched(self, far: FloatArray, scale: float) -> BoolArray:
        """Pixels whose surface the right imager doesn't see.

        It is hidden there when something to its right in the left image lands at the
        same place or left of it; or it lies beyond the left border of the right image.
        """
        column = np.arange(far.shape[1])
        matched = column - scale / far
        leftmost = np.minimum.accumulate(matched[:, ::-1], axis=1)[:, ::-1]
        hidden = np.zeros(far.shape, dtype=bool)
        hidden[:, :-1] = matched[:, :-1] >= leftmost[:, 1:]
        return np.asarray(hidden | (matched < 0.0))

    def _grown(self, far: FloatArray, rng: Rng) -> FloatArray:
        near = ndimage.minimum_filter(far, size=3)
        # Whole stretches of a border grow together.
        patches = ndimage.gaussian_filter(rng.standard_normal(far.shape), 1.5)
        grows = patches > np.quantile(patches, 1.0 - self.growth_share)
        return np.where(grows & (far > near + self.edge_jump), near, far)

    def _grazed(self, depth: FloatArray, intrinsics: Intrinsics, rng: Rng) -> BoolArray:
        points, normals = points_and_normals(depth, intrinsics)
        sizes = np.linalg.norm(normals, axis=0) * np.linalg.norm(points, axis=0)
        cosine = np.abs((normals * points).sum(axis=0)) / np.maximum(sizes, 1e-30)
        limit = np.cos(np.radians(self.grazing))
        return np.asarray(rng.random(depth.shape) * limit > cosine)


def _rounded(values: FloatArray, step: float) -> FloatArray:
    return np.rint(values / step) * step if step > 0.0 else values


def _is_edge(far: FloatArray, jump: float) -> BoolArray:
    is_edge = np.zeros(far.shape, dtype=bool)
    for axis in (0, 1):
        with np.errstate(invalid="ignore"):
            is_step = np.abs(np.diff(far, axis=axis)) > jump
        ahead = [slice(None)] * 2
        behind = [slice(None)] * 2
        ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
        is_edge[tuple(ahead)] |= is_step
        is_edge[tuple(behind)] |= is_step
    return is_edge


def _specks(shape: tuple[int, ...], count: int, rng: Rng) -> BoolArray:
    is_lost = np.zeros(shape, dtype=bool)
    for row, column in rng.integers((0, 0), shape, size=(count, 2)):
        height, width = rng.integers(1, 5, size=2)
        is_lost[row : row + height, column : column + width] = True
    return is_lost
