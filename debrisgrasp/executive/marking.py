"""Marks the object of interest in each capture, once it was marked in one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp.errors import CaptureError
from debrisgrasp.io import Capture

__all__ = ["StaysMarked"]

_SAME = 0.015
"""Surfaces that lie so near to each other are the same [m]."""
_LEAST = 30
"""Pixels of an object, at least."""


@dataclass(frozen=True, slots=True, eq=False)
class StaysMarked:
    """Marks what lies where the marked object lay; a `Marker` of `TaskSettings`.

    It does not follow an object that moves: once that is gone nothing is marked.
    """

    points: FloatArray
    """On the object, base frame of when the task begins [m], shape (n, 3)."""

    @classmethod
    def of(cls, capture: Capture) -> StaysMarked:
        """Take the object from a capture with a mask.

        Raises
        ------
        CaptureError
            If there is no depth image with a mask and a pose, or nothing measured in
            the mask.
        """
        if capture.mask is None or capture.depth is None:
            raise CaptureError(
                f"mask of {capture.name or 'the capture'}",
                got="none",
                expected="a depth image with a mask of the object of interest",
                mend="Store it as `mask` (H, W) in the .npz of the capture.",
            )
        points = _in_base(capture)[np.asarray(capture.mask, dtype=bool)]
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) < _LEAST:
            raise CaptureError(
                f"mask of {capture.name or 'the capture'}",
                got=f"{len(points)} pixels with depth",
                expected=f"{_LEAST} or more",
            )
        return cls(points)

    def __call__(self, capture: Capture) -> BoolArray | None:
        """Mask of the object in a capture, shape (H, W); None of a cloud."""
        if capture.depth is None:
            return None
        points = _in_base(capture)
        low, high = self.points.min(axis=0) - _SAME, self.points.max(axis=0) + _SAME
        is_marked: BoolArray = ((points > low) & (points < high)).all(axis=-1)
        gaps, _ = cKDTree(self.points).query(
            points[is_marked], distance_upper_bound=_SAME
        )
        is_marked[is_marked] = np.isfinite(gaps)
        return is_marked


def _in_base(capture: Capture) -> FloatArray:
    """Points of all pixels (H, W, 3), NaN where nothing was measured."""
    assert capture.depth is not None
    if capture.intrinsics is None or capture.T_base_camera is None:
        raise CaptureError(
            f"capture {capture.name}",
            got="no pose or no intrinsics",
            expected="both, so that the mask has a place",
        )
    depth = np.asarray(capture.depth, dtype=np.float64)
    points = capture.intrinsics.deproject(np.where(depth > 0.0, depth, np.nan))
    found: FloatArray = capture.T_base_camera.apply(points)
    return found
