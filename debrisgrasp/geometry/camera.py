"""The pinhole camera: pixels to points and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray, as_floats, require_finite
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import CaptureError, ShapeError

__all__ = ["Intrinsics"]

_PINHOLE = "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class Intrinsics:
    """Pinhole intrinsics in pixels; pixel centres at integer coordinates.

    The camera frame is optical: x right, y down, z forward.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    def __post_init__(self) -> None:
        if not (0.0 < self.fx < np.inf and 0.0 < self.fy < np.inf):
            raise CaptureError(
                "focal lengths", got=(self.fx, self.fy), expected="pixels above 0"
            )
        if min(self.height, self.width) < 2:
            raise CaptureError(
                "image",
                got=f"{self.width} x {self.height} pixels",
                expected="at least 2 x 2",
                mend="Is the file empty, or has it been cropped away?",
            )

    @classmethod
    def from_matrix(cls, K: ArrayLike, shape: tuple[int, int]) -> Intrinsics:
        """Take a 3x3 matrix, or its 9 numbers row by row, for an image of ``shape``.

        Parameters
        ----------
        K
            [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels.
        shape
            Rows and columns of the image.

        Raises
        ------
        CaptureError
            If K is no pinhole matrix, or belongs to an image of another size, or shape
            is that of no image.
        """
        K = as_floats(K, "K", ())
        if K.shape not in ((3, 3), (9,)):
            raise CaptureError(
                "K",
                got=f"numbers of shape {K.shape}",
                expected=f"{_PINHOLE}, or its 9 numbers row by row",
            )
        K = K.reshape(3, 3)
        require_finite(K, "K")
        fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
        is_pinhole = fx > 0 and fy > 0 and np.allclose(K[2], (0, 0, 1))
        # Calibrations store a skew of rounding size; a real one would bend the cloud.
        has_skew = max(abs(K[0, 1]), abs(K[1, 0])) > 1e-3 * abs(fx)
        if not is_pinhole or has_skew:
            raise CaptureError(
                "K",
                got=K.tolist(),
                expected=f"{_PINHOLE} with fx, fy > 0",
                mend="Rectify images of a camera with skew first."
                if has_skew
                else "Give it row by row, in pixels of this image.",
            )
        if np.shape(shape) != (2,):
            raise CaptureError(
                "shape of the image",
                got=shape,
                expected="(rows, columns)",
                mend="That of a colour image is image.shape[:2].",
            )
        height, width = shape
        camera = cls(
            fx=float(fx),
            fy=float(fy),
            cx=float(cx),
            cy=float(cy),
            width=width,
            height=height,
        )
        camera.require_plausible()
        return camera

    def require_plausible(self) -> None:
        """Raise `CaptureError` if no depth camera gives such images.

        Fields of view beyond these bounds are what a K of another resolution, or in
        millimetres, looks like.
        """
        width, height = self.width, self.height
        fits = (
            0 <= self.cx <= width - 1
            and 0 <= self.cy <= height - 1
            and 0.2 <= self.fx / width <= 10
            and 0.2 <= self.fy / height <= 10
            and abs(self.cx / (width - 1) - 0.5) < 0.25
            and abs(self.cy / (height - 1) - 0.5) < 0.25
        )
        if not fits:
            raise CaptureError(
                "K",
                got=f"fx {self.fx:g}, fy {self.fy:g}, cx {self.cx:g}, cy {self.cy:g}",
                expected=f"intrinsics of an image of {width} x {height} pixels",
                mend="Scale K together with the image, or give the K of this stream.",
            )

    @property
    def matrix(self) -> FloatArray:
        """K, shape (3, 3)."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    def deproject(self, depth: FloatArray) -> FloatArray:
        """Points of a depth image in the camera frame.

        Parameters
        ----------
        depth
            Metres along the optical axis, shape (height, width).

        Returns
        -------
        FloatArray
            Points [m], shape (height, width, 3); NaN depth gives NaN points.

        Raises
        ------
        ShapeError
            If it is no image of this size.
        """
        depth = as_floats(depth, "depth", (self.height, self.width))
        if depth.ndim > 2:
            raise ShapeError("depth", got=depth.shape, expected="one image")
        x = (np.arange(self.width) - self.cx) / self.fx
        y = (np.arange(self.height) - self.cy) / self.fy
        points = np.empty((self.height, self.width, 3))
        np.multiply(depth, x, out=points[..., 0])
        np.multiply(depth, y[:, None], out=points[..., 1])
        points[..., 2] = depth
        return points

    def project(self, points_cam: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pixel coordinates (u, v) and depth of points in the camera frame.

        Points at or behind the camera plane get NaN pixel coordinates.

        Returns
        -------
        uv, depth
            Shapes (..., 2) in pixels and (...) in metres.
        """
        points = as_floats(points_cam, "points", (3,))
        z = points[..., 2]
        safe = np.where(z > 1e-9, z, np.nan)
        u = self.fx * points[..., 0] / safe + self.cx
        v = self.fy * points[..., 1] / safe + self.cy
        return np.stack([u, v], axis=-1), z
