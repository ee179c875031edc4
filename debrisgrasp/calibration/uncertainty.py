"""How far off a point of the workspace will be: the figure that matters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray, finite
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, Bounds, lattice

from .head import Head

__all__ = [
    "BEFORE_CAMERA",
    "WORKSPACE",
    "WorkspaceError",
    "camera_covariance",
    "checked_covariance",
    "displacement",
    "lever_arm",
    "predicted_error",
]

WORKSPACE = Bounds(np.array([0.7, -0.4, 0.0]), np.array([1.2, 0.4, 0.7]))
"""Where RoMan's piles lie, base frame [m]."""
BEFORE_CAMERA = Bounds(np.array([-0.3, -0.3, 0.3]), np.array([0.3, 0.3, 0.8]))
"""What a camera that an arm carries looks at, camera frame [m]."""
_ROUNDING = 1e-12
"""So far below zero rounding leaves a variance [m^2, rad^2]."""
_STEPS = 7
"""Grid points along each edge of the workspace."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WorkspaceError:
    """Predicted error of a calibrated point, root mean square over what may be true."""

    bounds: Bounds
    rms: float
    """Root mean square over the workspace [m]."""
    worst: float
    """Largest over the workspace [m]; it is at a corner."""
    worst_at: FloatArray
    """That corner, base frame [m], shape (3,)."""

    @classmethod
    def of(cls, covariance: FloatArray, bounds: Bounds = WORKSPACE) -> WorkspaceError:
        """Evaluate a covariance (6, 6), in the convention of `camera_covariance`."""
        points = grid(bounds)
        error = predicted_error(covariance, points)
        worst = int(np.argmax(error))
        return cls(
            bounds=bounds,
            rms=float(np.sqrt(np.mean(error**2))),
            worst=float(error[worst]),
            worst_at=points[worst],
        )


def grid(bounds: Bounds, steps: int = _STEPS) -> FloatArray:
    """Points spread evenly over a box, borders included, shape (steps^3, 3)."""
    shares = lattice(*[np.linspace(0.0, 1.0, steps)] * 3)
    return bounds.lower + shares.reshape(-1, 3) * bounds.size


def predicted_error(covariance: FloatArray, points: FloatArray) -> FloatArray:
    r"""Root mean square error of points placed by an uncertain camera pose.

    .. math:: e(x) = \sqrt{\operatorname{tr}(J P J^T)}, \quad J = [I, -[x]_\times]

    Parameters
    ----------
    covariance
        P in the convention of `camera_covariance`, shape (6, 6).
    points
        Base frame [m], shape (..., 3).

    Returns
    -------
    FloatArray
        [m], shape (...).
    """
    # tr(J P J^T) written out: no 3x6 matrix for each point.
    vv, vw, ww = covariance[:3, :3], covariance[:3, 3:], covariance[3:, 3:]
    squared = (points**2).sum(axis=-1)
    turning = squared * np.trace(ww) - np.einsum("...i,ij,...j", points, ww, points)
    skew = np.array([vw[1, 2] - vw[2, 1], vw[2, 0] - vw[0, 2], vw[0, 1] - vw[1, 0]])
    total = np.trace(vv) + 2.0 * points @ skew + turning
    return np.asarray(np.sqrt(np.maximum(total, 0.0)))


def checked_covariance(rows: ArrayLike, name: str, size: int) -> FloatArray:
    """Check a covariance, of a pose and then of what may be known without doubt.

    Raises
    ------
    InputError
        If it is none, or not of this size.
    """
    matrix = finite(rows, name, (size, size))
    if not np.allclose(matrix, matrix.T, atol=1e-9):
        raise InputError(
            name,
            got=f"an asymmetry of {np.abs(matrix - matrix.T).max():.3g}",
            expected="a symmetric matrix",
        )
    least = np.linalg.eigvalsh(matrix)[0]
    least_of_pose = np.linalg.eigvalsh(matrix[:6, :6])[0]
    if least < -_ROUNDING or least_of_pose <= 0.0:
        raise InputError(
            name,
            got=f"an eigenvalue of {min(least, least_of_pose):.3g}",
            expected="none below zero, and those of the pose above",
            mend="No pose is known without any doubt.",
        )
    return matrix


def camera_covariance(
    head: Head, readings: FloatArray, covariance: FloatArray
) -> FloatArray:
    """Covariance of the camera's pose for one reading of the head.

    Parameters
    ----------
    head
        Head as fitted.
    readings
        Of its joints [rad], shape (k,).
    covariance
        Of the twist of the mount in the camera frame and of the offsets of the head,
        shape (6 + k, 6 + k).

    Returns
    -------
    FloatArray
        Shape (6, 6): of the twist (v, omega) [m, rad] about the origin of the base, in
        base axes, with ``T_true = exp(twist) @ T_base_camera`` (a perturbation from the
        left, linear part first).
    """
    mount = head.T_base_camera(readings).adjoint()
    to_base = np.concatenate([mount, head.screws(readings).T], axis=1)
    return np.asarray(to_base @ covariance @ to_base.T)


def displacement(T_a: SE3, T_b: SE3, bounds: Bounds = WORKSPACE) -> FloatArray:
    """Distance between where two camera poses put the same measured point.

    Over the grid of a workspace (base frame, by the first pose), shape (m,) [m].
    """
    points = grid(bounds)
    moved = (T_b @ T_a.inverse()).apply(points)
    return np.asarray(np.linalg.norm(moved - points, axis=-1))


def lever_arm(points: FloatArray) -> float:
    """How well points fix a rotation: their spread about the worst axis [m].

    Root mean square distance from the line through their middle to which they are
    nearest; 0 for points on one line.
    """
    offsets = points - points.mean(axis=0)
    turning = np.einsum("ni,ni->", offsets, offsets) * np.eye(3) - offsets.T @ offsets
    return float(np.sqrt(max(np.linalg.eigvalsh(turning)[0], 0.0) / len(points)))
