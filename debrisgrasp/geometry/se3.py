"""Rigid transforms as a value type, batch-first.

``T_a_b`` maps coordinates written in frame b to coordinates written in frame a; it is
also the pose of b seen from a. Twists are (v, omega) and wrenches (f, tau), linear part
first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import (
    FloatArray,
    as_floats,
    frozen,
    require_finite,
    sealed,
)
from debrisgrasp.errors import InputError, ShapeError

from . import so3

__all__ = ["SE3"]

_RIGID_TOLERANCE = 1e-3
"""How far ``R.T @ R`` may be from the identity: float32 files reach 1e-6, hand-typed
poses of three decimals 1e-3."""
_ROUNDED = 1e-12
"""What is nearer is a rotation, but for the rounding of its own products."""


@dataclass(frozen=True, slots=True, eq=False)
class SE3:
    """One rigid transform, or an array of them.

    The constructor and `from_parts` believe what they are given; `from_matrix` checks
    what comes from outside.
    """

    matrix: FloatArray
    """Homogeneous matrices, shape (..., 4, 4); translation [m]."""

    def __post_init__(self) -> None:
        matrix = frozen(self.matrix, "homogeneous matrix", (4, 4))
        object.__setattr__(self, "matrix", matrix)

    @classmethod
    def identity(cls) -> SE3:
        """Return the transform that changes nothing."""
        return cls(np.eye(4))

    @classmethod
    def from_parts(cls, R: ArrayLike | None = None, p: ArrayLike | None = None) -> SE3:
        """Build from rotations (..., 3, 3) and translations (..., 3) [m]."""
        rotation = as_floats(np.eye(3) if R is None else R, "rotation", (3, 3))
        translation = as_floats(np.zeros(3) if p is None else p, "translation", (3,))
        batches = rotation.shape[:-2], translation.shape[:-1]
        try:
            batch = np.broadcast_shapes(*batches)
        except ValueError as error:
            raise _mismatch("translations", *batches) from error
        matrix = np.zeros((*batch, 4, 4))
        matrix[..., :3, :3] = rotation
        matrix[..., :3, 3] = translation
        matrix[..., 3, 3] = 1.0
        return cls(sealed(matrix))

    @classmethod
    def from_matrix(cls, matrix: ArrayLike, name: str = "transform") -> SE3:
        """Take a matrix from outside, and check that it is a rigid transform.

        Small errors of rounding are removed by projecting onto the nearest rotation.

        Parameters
        ----------
        matrix
            Homogeneous matrices, shape (..., 4, 4).
        name
            What to call it in an error message.

        Raises
        ------
        InputError
            If it is not finite, not rigid, mirrored, or its last row isn't 0 0 0 1.
        """
        array = as_floats(matrix, name, (4, 4))
        require_finite(array, name)
        if not np.allclose(array[..., 3, :], (0, 0, 0, 1), atol=1e-6):
            raise InputError(
                f"last row of {name}",
                got=array[..., 3, :].tolist(),
                expected="0 0 0 1",
                mend="Give it row-major: a transposed matrix fails here.",
            )
        R = array[..., :3, :3]
        error = float(np.max(np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3)), initial=0))
        if error > _RIGID_TOLERANCE:
            raise InputError(
                name,
                got=f"axes that miss orthonormality by {error:.3g}",
                expected=f"a rigid transform (at most {_RIGID_TOLERANCE:g})",
                mend="Remove scale and shear from its rotation.",
            )
        if np.any(np.linalg.det(R) < 0.0):
            raise InputError(
                name,
                got="a left-handed (mirrored) rotation, determinant -1",
                expected="a right-handed one, determinant +1",
                mend="One of its axes points the wrong way.",
            )
        if error > _ROUNDED:  # else what was written and read again would differ
            u, _, vt = np.linalg.svd(R)
            R = u @ vt
        return cls.from_parts(R, array[..., :3, 3])

    @classmethod
    def exp(cls, twist: ArrayLike) -> SE3:
        """Transform reached after unit time at body twist (v, omega), (..., 6)."""
        twist = as_floats(twist, "twist", (6,))
        v, omega = twist[..., :3], twist[..., 3:]
        p = (so3.left_jacobian(omega) @ v[..., None])[..., 0]
        return cls.from_parts(so3.exp(omega), p)

    def log(self) -> FloatArray:
        """Twist (v, omega) whose `exp` this is, shape (..., 6); angle at most pi."""
        omega = so3.log(self.R)
        v = np.linalg.solve(so3.left_jacobian(omega), self.p[..., None])[..., 0]
        return np.concatenate([v, omega], axis=-1)

    @property
    def R(self) -> FloatArray:
        """Rotations, shape (..., 3, 3)."""
        return self.matrix[..., :3, :3]

    @property
    def p(self) -> FloatArray:
        """Translations [m], shape (..., 3)."""
        return self.matrix[..., :3, 3]

    @property
    def batch(self) -> tuple[int, ...]:
        """Shape of the leading axes; ``()`` for a single transform."""
        return self.matrix.shape[:-2]

    def __matmul__(self, other: SE3) -> SE3:
        if not isinstance(other, SE3):
            raise InputError(
                "right side of T @",
                got=type(other).__name__,
                expected="an SE3",
                mend="T.apply(points) maps points, SE3.from_matrix(matrix) makes one.",
            )
        try:
            product = self.matrix @ other.matrix
        except ValueError as error:
            raise _mismatch("transforms", self.batch, other.batch) from error
        return SE3(sealed(product))

    def __getitem__(self, index: Any) -> SE3:
        chosen = self.matrix[index]
        if chosen.shape[-2:] != (4, 4):
            n = len(self.batch)
            raise InputError(
                "index of transforms",
                got=f"{index!r} for {n} leading axes",
                expected="one that leaves the matrices whole",
                mend="T.R and T.p are the parts of one, T.matrix has its numbers.",
            )
        return SE3(chosen)

    def inverse(self) -> SE3:
        """Transform that undoes this one."""
        Rt = np.swapaxes(self.R, -1, -2)
        return SE3.from_parts(Rt, -_times(Rt, self.p, "origins"))

    def apply(self, points: ArrayLike) -> FloatArray:
        """Map points (..., 3) [m]; leading axes broadcast.

        To put every pose on every point write ``Ts[:, None].apply(points)``.
        """
        points = as_floats(points, "points", (3,))
        turned = _turned(self.R, points, "points")
        if self.R.ndim == 2:
            for axis in range(3):  # sums over rows of three are slow
                turned[..., axis] += self.p[axis]
            return turned
        return turned + self.p

    def rotate(self, vectors: ArrayLike) -> FloatArray:
        """Turn directions (..., 3) without moving them."""
        vectors = as_floats(vectors, "vectors", (3,))
        return _turned(self.R, vectors, "vectors")

    def adjoint(self) -> FloatArray:
        """Matrix with ``twist_a = T_a_b.adjoint() @ twist_b``, shape (..., 6, 6)."""
        out = np.zeros((*self.batch, 6, 6))
        out[..., :3, :3] = out[..., 3:, 3:] = self.R
        out[..., :3, 3:] = so3.hat(self.p) @ self.R
        return out

    def map_twist(self, twist: ArrayLike) -> FloatArray:
        """Twist (v, omega) in frame a of one in frame b, for ``T_a_b``."""
        twist = as_floats(twist, "twist", (6,))
        return _times(self.adjoint(), twist, "twist")

    def map_wrench(self, wrench: ArrayLike) -> FloatArray:
        """Wrench (f, tau) in frame a of one in frame b, for ``T_a_b``.

        The inverse transpose of the adjoint, which keeps power the same in every frame;
        the equation printed as (7) in the paper lacks the inverse.
        """
        wrench = as_floats(wrench, "wrench", (6,))
        dual = np.swapaxes(self.inverse().adjoint(), -1, -2)
        return _times(dual, wrench, "wrench")


def _mismatch(name: str, batch: tuple[int, ...], other: tuple[int, ...]) -> ShapeError:
    """Complain about leading axes that do not broadcast."""
    return ShapeError(
        f"leading axes of {name}",
        got=other,
        expected=f"some that broadcast with {batch}",
        mend="T[:, None] puts every one on every other.",
    )


def _times(matrices: FloatArray, vectors: FloatArray, name: str) -> FloatArray:
    """Products of matrices (..., i, j) and vectors (..., j); leading axes broadcast."""
    try:
        products: FloatArray = (matrices @ vectors[..., None])[..., 0]
    except ValueError as error:
        raise _mismatch(name, matrices.shape[:-2], vectors.shape[:-1]) from error
    return products


_BLOCK = 16384
"""Rows of a matrix product; up to here BLAS works in one thread."""


def _turned(R: FloatArray, vectors: FloatArray, name: str) -> FloatArray:
    """Rotations (..., 3, 3) of vectors (..., 3); leading axes broadcast."""
    if R.ndim == 2 and vectors.ndim == 2:
        # In blocks: one large product would start threads, which cost more than they
        # save.
        turned = np.empty(vectors.shape)
        for first in range(0, len(vectors), _BLOCK):
            some = slice(first, first + _BLOCK)
            np.matmul(vectors[some], R.T, out=turned[some])
        return turned
    if R.ndim == 2:
        return vectors @ R.T
    if R.shape[-3] == 1 and vectors.ndim > 1:
        # One rotation for a row of vectors: a matrix product, not many tiny ones.
        try:
            return vectors @ np.swapaxes(R[..., 0, :, :], -1, -2)
        except ValueError as error:
            raise _mismatch(name, R.shape[:-2], vectors.shape[:-1]) from error
    return _times(R, vectors, name)
