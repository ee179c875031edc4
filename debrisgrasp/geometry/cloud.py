"""The point cloud that every later stage reads."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    as_floats,
    as_given,
    as_rows,
    finite,
    frozen,
    is_sealed,
    require_finite,
    require_range,
    sealed,
    shared,
)
from debrisgrasp._checked import checked
from debrisgrasp.errors import FrameMismatchError, InputError, ShapeError

from .se3 import SE3

__all__ = ["Bounds", "PointCloud"]

_RIM = 1 / 80
"""Width of the rim of what is measured, in which something is cut off; in images."""
_UNIT = 0.01
"""Normals whose length is off by more were not scaled to 1; files of few digits are."""
_FRAME = 1 / 10
"""Width of the frame at the border in which a camera may measure nothing; in images."""


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """An axis-aligned box in space, for instance the region V of a search."""

    lower: FloatArray
    """Corner with the smallest coordinates [m], shape (3,)."""
    upper: FloatArray
    """Corner with the largest coordinates [m], shape (3,)."""

    def __post_init__(self) -> None:
        lower = finite(self.lower, "lower corner", (3,))
        upper = finite(self.upper, "upper corner", (3,))
        if not (lower < upper).all():
            raise InputError(
                "region",
                got=f"lower {lower.tolist()} and upper {upper.tolist()}",
                expected="lower < upper along each axis",
                mend="Order: x0 y0 z0 x1 y1 z1, metres in the base frame.",
            )
        object.__setattr__(self, "lower", lower)
        object.__setattr__(self, "upper", upper)

    def __str__(self) -> str:
        """Ranges of the coordinates, as messages give them."""
        ends = zip("xyz", self.lower, self.upper, strict=True)
        return ", ".join(f"{name} {a:g} to {b:g}" for name, a, b in ends) + " m"

    @classmethod
    def around(cls, points: ArrayLike, margin: float = 0.0) -> Bounds:
        """Box around points (n, 3), grown by ``margin`` [m] on every side.

        Raises
        ------
        InputError
            If there are no points, or the margin is negative.
        """
        points = as_rows(points, "points to bound")
        require_range("margin [m]", margin, 0.0)
        if not len(points):
            raise InputError("points to bound", got="none", expected="at least one")
        pad = max(margin, 1e-6)
        return cls(points.min(axis=0) - pad, points.max(axis=0) + pad)

    @property
    def size(self) -> FloatArray:
        """Edge lengths [m], shape (3,)."""
        return self.upper - self.lower

    def contains(self, points: FloatArray) -> BoolArray:
        """Which of the points (..., 3) lie inside or on the border."""
        points = as_floats(points, "points", (3,))
        inside = np.ones(points.shape[:-1], dtype=bool)
        # One coordinate after the other: reductions along rows of three are slow.
        for axis, (low, high) in enumerate(zip(self.lower, self.upper, strict=True)):
            inside &= points[..., axis] >= low
            inside &= points[..., axis] <= high
        return inside

    def grown(self, margin: float) -> Bounds:
        """Return the box with every face moved outwards by ``margin`` [m]."""
        return Bounds(self.lower - margin, self.upper + margin)


@dataclass(frozen=True, slots=True, eq=False)
class PointCloud:
    """Points measured from one viewpoint; only points that were measured are in it."""

    points: FloatArray
    """Positions [m], shape (n, 3), finite."""
    normals: FloatArray
    """Unit surface normals towards the viewpoint, shape (n, 3); NaN where the
    neighbourhood of a point does not determine one."""
    viewpoint: FloatArray
    """Position of the sensor [m], shape (3,)."""
    frame: str = "base"
    """Frame in which all three are expressed."""
    pixels: IntArray | None = None
    """Flat index (row * width + column) of the pixel that each point came from, shape
    (n,), or None for an unorganised cloud."""
    image_shape: tuple[int, int] | None = None
    """(height, width) of the depth image, or None for an unorganised cloud."""

    def __post_init__(self) -> None:
        points = frozen(self.points, "points", (3,))
        normals = frozen(self.normals, "normals", (3,))
        viewpoint = frozen(self.viewpoint, "viewpoint", (3,))
        if points.ndim != 2 or points.shape != normals.shape:
            raise ShapeError(
                "points and normals",
                got=f"{points.shape} and {normals.shape}",
                expected="both (n, 3)",
            )
        if not is_sealed(self.points):
            require_finite(points, "points")
        if not is_sealed(self.normals):
            _require_unit(normals)
        require_finite(viewpoint, "viewpoint")
        if viewpoint.ndim != 1:
            raise ShapeError("viewpoint", got=viewpoint.shape, expected="(3,)")
        if self.pixels is not None or self.image_shape is not None:
            pixels, shape = _own_image(self.pixels, self.image_shape, len(points))
            object.__setattr__(self, "pixels", pixels)
            object.__setattr__(self, "image_shape", shape)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "normals", normals)
        object.__setattr__(self, "viewpoint", viewpoint)

    def __repr__(self) -> str:
        return f"<PointCloud of {len(self)} points, frame {self.frame}>"

    def __len__(self) -> int:
        return len(self.points)

    def selected(self, index: BoolArray | IntArray) -> PointCloud:
        """Keep the points that a mask (n,) or an array of indices (m,) names."""
        # Taking rows by number is several times faster than by mask.
        rows = np.arange(len(self))[index]
        pixels = None if self.pixels is None else sealed(self.pixels.take(rows))
        return replace(
            self,
            points=sealed(self.points.take(rows, axis=0)),
            normals=sealed(self.normals.take(rows, axis=0)),
            pixels=pixels,
        )

    @checked
    def cropped(self, bounds: Bounds) -> PointCloud:
        """Keep the points inside ``bounds``, which are in the same frame."""
        return self.selected(bounds.contains(self.points))

    def at_rim(self, index: IntArray) -> BoolArray:
        """Which of the points (m,) lie where the measured part of the image ends, (m,).

        What they belong to goes on out of sight. None of an unorganised cloud.
        """
        at_rim = np.zeros(len(index), dtype=bool)
        if self.pixels is None or self.image_shape is None:
            return at_rim
        measured = np.zeros(self.image_shape, dtype=bool)
        measured.ravel()[self.pixels] = True
        row, column = np.divmod(self.pixels[index], self.image_shape[1])
        size = max(self.image_shape)
        for lines, across, along in (
            (measured, row, column),
            (measured.T, column, row),
        ):
            for line, place in (
                (lines, along),
                (lines[:, ::-1], lines.shape[1] - 1 - along),
            ):
                is_first = place - line.argmax(axis=1)[across] < size * _RIM
                at_rim |= is_first & (place < size * _FRAME)
        return at_rim

    @checked
    def in_frame(self, T_frame_own: SE3, frame: str) -> PointCloud:
        """Express the same cloud in another frame."""
        return replace(
            self,
            points=sealed(T_frame_own.apply(self.points)),
            normals=sealed(T_frame_own.rotate(self.normals)),
            viewpoint=T_frame_own.apply(self.viewpoint),
            frame=frame,
            pixels=None if self.pixels is None else shared(self.pixels),
        )

    def require_frame(self, frame: str) -> None:
        """Raise `FrameMismatchError` unless the cloud is expressed in ``frame``."""
        if self.frame != frame:
            raise FrameMismatchError(
                "cloud", expected_frame=frame, got_frame=self.frame
            )


def _own_image(
    pixels: ArrayLike | None, shape: ArrayLike | None, n: int
) -> tuple[IntArray, tuple[int, int]]:
    """Freeze the pixels of n points, and the shape of their image, or raise."""
    pixels = [] if pixels is None else pixels
    given = as_given(pixels, "pixels")
    if given.shape != (n,):
        raise ShapeError("pixels", got=given.shape, expected=f"({n},)")
    if n and not np.issubdtype(given.dtype, np.integer):
        raise InputError("pixels", got=given.dtype, expected="integers")
    sizes = as_given([] if shape is None else shape, "image_shape")
    if sizes.shape != (2,) or not np.issubdtype(sizes.dtype, np.integer):
        raise InputError(
            "image_shape",
            got=shape,
            expected="(height, width) of the image that the pixels are of",
        )
    height, width = sizes.tolist()
    if n and not is_sealed(pixels):
        first, last, end = given.min(), given.max(), height * width
        if first < 0 or last >= end:
            got = f"{first} to {last}"
            raise InputError("pixels", got=got, expected=f"0 to {end - 1}")
    return frozen(pixels, "pixels", (n,), np.int64), (height, width)


def _require_unit(normals: FloatArray) -> None:
    """Refuse normals (n, 3) that are neither unit vectors nor NaN."""
    length = np.sqrt(np.einsum("ij,ij->i", normals, normals))
    is_off = np.abs(length - 1.0) > _UNIT
    if is_off.any():
        raise InputError(
            "normals",
            got=f"{np.count_nonzero(is_off)} of {len(length)} of another length, "
            f"the first of {length[is_off][0]:.3g}",
            expected="unit vectors, or NaN where there is none",
            mend="Divide each by its length.",
        )
