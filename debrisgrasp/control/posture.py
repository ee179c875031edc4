"""Pose and Jacobian of one posture, in the time of a control tick.

`KinematicChain` evaluates thousands of postures at once. One posture costs it a hundred
array operations, each of which takes longer than its arithmetic. Here the chain's
constants are multiplied out once, into the text of a Python function without loops in
which every product with 0 or 1 has vanished; for arms whose axes meet at right angles
that is most of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from math import cos, sin
from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray, snapped
from debrisgrasp.kinematics import KinematicChain

from ._rigid import Rotation, Vector

__all__ = ["PostureKinematics"]

_LATEST = 4
"""So many postures are remembered."""

_Term = tuple[float, str]
"""A number times a product of variables; the empty product is 1."""


class PostureKinematics:
    """Forward kinematics of a chain for single postures given as floats."""

    def __init__(self, chain: KinematicChain) -> None:
        self.n_joints = chain.n_joints
        self._pose = _compiled(chain, has_jacobian=False)
        self._both = _compiled(chain, has_jacobian=True)

    def pose(self, q: Sequence[float]) -> tuple[Rotation, Vector]:
        """Rotation and translation of the tip in base."""
        R, p = self._pose(q if type(q) is tuple else tuple(q))
        return R, p

    def pose_and_jacobian(
        self, q: Sequence[float]
    ) -> tuple[Rotation, Vector, FloatArray]:
        """Pose of the tip, and the Jacobian at its origin in the axes of base (6, d).

        ``(v, omega) = J @ dq``, linear part first.
        """
        R, p, entries = self._both(q if type(q) is tuple else tuple(q))
        return R, p, np.array(entries).reshape(6, self.n_joints)


class _Text:
    """Lines of a function in the making; its numbers are folded as they come."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def named(self, expression: str) -> _Term:
        name = f"v{len(self.lines)}"
        self.lines.append(f"{name} = {expression}")
        return 1.0, name

    def sum(self, *terms: _Term) -> _Term:
        """Add terms; what needs arithmetic gets a name."""
        constant = sum(number for number, product in terms if not product)
        rest = [(number, product) for number, product in terms if product and number]
        if not rest:
            return constant, ""
        if len(rest) == 1 and not constant and "*" not in rest[0][1]:
            return rest[0]
        pieces = [_written(number, product) for number, product in rest]
        if constant:
            pieces.append(f"{constant:+.17g}")
        return self.named("".join(pieces).lstrip("+"))


def _written(number: float, product: str) -> str:
    if abs(number) == 1.0:
        return f"{'+' if number > 0 else '-'}{product}"
    return f"{number:+.17g}*{product}"


def _times(a: _Term, b: _Term) -> _Term:
    return a[0] * b[0], "*".join(name for name in (a[1], b[1]) if name)


def _product(text: _Text, A: list[list[_Term]], B: FloatArray) -> list[list[_Term]]:
    """Terms (3, 3) times numbers (3, m)."""
    return [
        [
            text.sum(*(_times(row[k], (float(B[k, j]), "")) for k in range(3)))
            for j in range(B.shape[1])
        ]
        for row in A
    ]


def _moved(
    text: _Text, R: list[list[_Term]], p: list[_Term], shift: FloatArray
) -> list[_Term]:
    offset = _product(text, R, shift.reshape(3, 1))
    return [text.sum(p[k], offset[k][0]) for k in range(3)]


def _constants(matrix: FloatArray) -> list[list[_Term]]:
    return [[(float(value), "") for value in row] for row in matrix]


@lru_cache(maxsize=64)
def _compiled(chain: KinematicChain, *, has_jacobian: bool) -> Callable[..., Any]:
    """Write out and compile the function of one chain; every leg asks for it.

    It takes a tuple.
    """
    form, n, text = chain.form, chain.n_joints, _Text()
    first, last = snapped(form.T_base_first, 1e-14), snapped(form.T_last_tip, 1e-14)
    R = _constants(first[:3, :3])
    p = [(float(value), "") for value in first[:3, 3]]
    axes, origins = [], []
    for i in range(n):
        if form.is_revolute[i]:
            angle = text.named(f"q[{i}] {form.offsets[i]:+.17g}")[1]
            u, v = text.named(f"cos({angle})"), text.named(f"sin({angle})")
            minus_v = (-1.0, v[1])
            for row in R:
                x, y, _ = row
                row[0] = text.sum(_times(u, x), _times(v, y))
                row[1] = text.sum(_times(u, y), _times(minus_v, x))
        else:
            along = (1.0, f"q[{i}]")
            p = [text.sum(p[k], _times(along, R[k][2])) for k in range(3)]
        axes.append([row[2] for row in R])
        origins.append(p)
        if i < n - 1:
            p = _moved(text, R, p, form.shifts[i])
            R = _product(text, R, form.rotations[i])
    p = _moved(text, R, p, last[:3, 3])
    R = _product(text, R, last[:3, :3])
    rotation = ", ".join(_value(entry) for row in R for entry in row)
    results = [f"({rotation})", f"({', '.join(map(_value, p))})"]
    if has_jacobian:
        columns = [
            _column(text, axes[i], origins[i], p, is_turning=bool(form.is_revolute[i]))
            for i in range(n)
        ]
        entries = [_value(columns[i][k]) for k in range(6) for i in range(n)]
        results.append(f"[{', '.join(entries)}]")
    return _run("\n    ".join([*text.lines, f"return {', '.join(results)}"]))


@lru_cache(maxsize=64)
def _run(body: str) -> Callable[..., Any]:
    """Compile the body of a function.

    Several ask for the same posture within a tick; of equal chains they share the
    function, and so the answer.
    """
    names: dict[str, Any] = {"cos": cos, "sin": sin}
    exec(f"def kinematics(q):\n    {body}", names)
    return lru_cache(maxsize=_LATEST)(names["kinematics"])


def _column(
    text: _Text,
    axis: list[_Term],
    origin: list[_Term],
    tip: list[_Term],
    *,
    is_turning: bool,
) -> list[_Term]:
    """Twist of the tip for unit speed of one joint."""
    if not is_turning:
        return [*axis, (0.0, ""), (0.0, ""), (0.0, "")]
    arm = [text.sum(tip[k], (-origin[k][0], origin[k][1])) for k in range(3)]
    linear = []
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        minus = (-axis[j][0], axis[j][1])
        linear.append(text.sum(_times(axis[i], arm[j]), _times(minus, arm[i])))
    return [*linear, *axis]


def _value(term: _Term) -> str:
    number, product = term
    return _written(number, product).lstrip("+") if product else repr(number)
