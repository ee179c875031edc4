"""Vector arithmetic on recorded numbers, and a chain walked from base to tip."""

from __future__ import annotations

from collections.abc import Sequence

from .program import Number, Program
from .serial import SerialForm

__all__ = [
    "Vector",
    "Walk",
    "cross",
    "dot",
    "minus",
    "mixed",
    "plus",
    "solved",
    "triples",
    "turned",
]

Vector = Sequence[Number]


class Walk:
    """Frames of a chain at recorded joint values, in the frame of the first joint.

    ``q`` may lack the last value: then the last frame is that of angle zero.
    """

    def __init__(self, form: SerialForm, program: Program, q: Sequence[Number]) -> None:
        self._form = form
        x: Vector = [1.0, 0.0, 0.0]
        y: Vector = [0.0, 1.0, 0.0]
        z: Vector = [0.0, 0.0, 1.0]
        p: Vector = [0.0, 0.0, 0.0]
        self._axes: list[Vector] = []
        self._origins: list[Vector] = []
        n = len(form.is_revolute)
        for i in range(n):
            self._axes.append(z)
            if i < len(q) and form.is_revolute[i]:
                angle = q[i] + float(form.offsets[i])
                if angle != 0.0:
                    c, s = program.call("cos", angle), program.call("sin", angle)
                    x, y = mixed((x, y), (c, s)), mixed((y, x), (c, -s))
            elif i < len(q):
                p = plus(p, mixed((z,), (q[i],)))
            self._origins.append(p)
            if i + 1 < n:
                p = plus(p, mixed((x, y, z), form.shifts[i].tolist()))
                x, y, z = (
                    mixed((x, y, z), weights)
                    for weights in form.rotations[i].T.tolist()
                )
        self.x, self.y, self.z, self.p = x, y, z, p

    def twist(self, i: int, point: Vector) -> tuple[Vector, Vector]:
        """Velocity of a point of the last link, and its turning, by joint i."""
        axis = self._axes[i]
        if not self._form.is_revolute[i]:
            return axis, [0.0, 0.0, 0.0]
        return cross(axis, minus(point, self._origins[i])), axis


def dot(a: Vector, b: Vector) -> Number:
    """Scalar product."""
    total: Number = 0.0
    for left, right in zip(a, b, strict=True):
        total = left * right + total
    return total


def plus(a: Vector, b: Vector) -> Vector:
    """Sum."""
    return [left + right for left, right in zip(a, b, strict=True)]


def minus(a: Vector, b: Vector) -> Vector:
    """Difference."""
    return [left - right for left, right in zip(a, b, strict=True)]


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return [a[j] * b[k] - a[k] * b[j] for j, k in ((1, 2), (2, 0), (0, 1))]


def mixed(vectors: Sequence[Vector], weights: Vector) -> Vector:
    """Sum of vectors times weights."""
    return [dot(entries, weights) for entries in zip(*vectors, strict=True)]


def turned(a: Vector, c: Number, s: Number) -> Vector:
    """Turn a vector about the z axis by the angle of cosine c and sine s."""
    return [c * a[0] - s * a[1], s * a[0] + c * a[1], a[2]]


def triples(values: Vector) -> list[Vector]:
    """Cut into vectors of three."""
    return [values[i : i + 3] for i in range(0, len(values), 3)]


def solved(
    program: Program, columns: Sequence[Vector], shift: Number, b: Vector
) -> Vector:
    """Solve ``(J @ J.T + shift) y = b`` by elimination; J is given by its columns."""
    n = len(b)
    rows = list(zip(*columns, strict=True))
    A = [[dot(rows[i], rows[j]) for j in range(n)] for i in range(n)]
    y = list(b)
    inverse = []
    for k in range(n):
        A[k][k] = A[k][k] + shift
    for k in range(n):
        inverse.append(program.call("divide", 1.0, A[k][k]))
        for i in range(k + 1, n):
            factor = A[k][i] * inverse[k]
            for j in range(i, n):
                A[i][j] = A[i][j] - factor * A[k][j]
            y[i] = y[i] - factor * y[k]
    for k in reversed(range(n)):
        for j in range(k + 1, n):
            y[k] = y[k] - A[k][j] * y[j]
        y[k] = y[k] * inverse[k]
    return y
