"""Find the tool, the bias and the payload from what a wrist sensor reads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import (
    FloatArray,
    as_floats,
    finite,
    require_finite,
    require_range,
)
from debrisgrasp.errors import InputError, ShapeError
from debrisgrasp.geometry import SE3, so3

from .loads import DOWN, Body, LoadModel, require_sign

__all__ = ["ToolFit", "felt_weight", "identify_payload", "identify_tool"]

_TURNS = "orientations of the sensor"
_LEAST_POSES = 4
_LEAST_SPAN = np.deg2rad(60.0)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ToolFit:
    """Tool and bias found from readings in several orientations."""

    tool: Body
    bias: FloatArray
    """[N, N m], shape (6,)."""
    rms: FloatArray
    """Root mean square of what the model leaves of force [N] and torque [N m], (2,)."""
    span: float
    """Largest angle between two directions of gravity as the sensor felt it [rad]."""


def identify_tool(
    raw: ArrayLike,
    R_base_ft: ArrayLike,
    *,
    wrench_sign: float = 1.0,
    expected_mass: float | None = None,
    gravity: ArrayLike = DOWN,
) -> ToolFit:
    """Find mass, centre of mass and bias of an empty hand in free space.

    Parameters
    ----------
    raw
        Mean reading in each orientation [N, N m], shape (n, 6), n at least 4.
    R_base_ft
        Orientations of the sensor, shape (n, 3, 3); gravity must turn by at least
        60 degrees between two of them.
    expected_mass
        Configured mass of the tool [kg]; a fit that misses it by more than 10 % is
        refused.

    Raises
    ------
    InputError
        If there are too few or too similar orientations, the fitted mass is negative
        (the sign of the sensor is inverted), it is not the expected one, or
        ``wrench_sign`` is neither 1 nor -1.
    """
    require_sign(wrench_sign)
    if expected_mass is not None:
        require_range("expected mass of the tool [kg]", expected_mass, 1e-3, 1e4)
    raw, R, g = _readings(raw, R_base_ft, gravity)
    n = len(raw)
    g_ft = np.einsum("nji,j->ni", R, g)
    unit = g_ft / np.linalg.norm(g)
    span = float(np.arccos(np.clip(unit @ unit.T, -1.0, 1.0)).max())
    if n < _LEAST_POSES or span < _LEAST_SPAN:
        raise InputError(
            "orientations for the identification of the tool",
            got=f"{n} that turn gravity by {np.rad2deg(span):.0f} degrees",
            expected="at least 4 that turn it by 60 degrees or more",
            mend="Tilt the hand further, about two different axes.",
        )
    A = np.zeros((n, 6, 10))
    A[:, :3, 0], A[:, 3:, 1:4] = g_ft, -so3.hat(g_ft)
    A[:, :3, 4:7] = A[:, 3:, 7:] = np.eye(3)
    rows = A.reshape(-1, 10)
    rank = np.linalg.matrix_rank(rows, tol=0.02 * float(np.linalg.norm(g)))
    if rank < 10:
        raise InputError(
            "orientations for the identification of the tool",
            got=f"rank {rank}",
            expected="rank 10",
            mend="Add an orientation tilted about another axis.",
        )
    y = wrench_sign * raw
    x = np.asarray(np.linalg.lstsq(rows, y.ravel(), rcond=None)[0], dtype=np.float64)
    mass = float(x[0])
    if mass < 0.0:
        raise InputError(
            "mass of the tool",
            got=f"{mass:.3g} kg",
            expected="a positive mass",
            mend="The sign of the sensor is inverted: set wrench_sign to "
            f"{-wrench_sign:g}. Do not start before that.",
        )
    if expected_mass is not None and abs(mass - expected_mass) > 0.1 * expected_mass:
        raise InputError(
            "mass of the tool",
            got=f"{mass:.3f} kg",
            expected=f"{expected_mass:g} kg within 10 %",
            mend="Something hangs on the hand, or it touches something.",
        )
    rest = (y.ravel() - rows @ x).reshape(n, 2, 3)
    com = x[1:4] / mass if mass > 1e-9 else np.zeros(3)
    return ToolFit(
        tool=Body(mass, com),
        bias=x[4:],
        rms=np.sqrt((rest**2).sum(axis=2).mean(axis=0)),
        span=span,
    )


def felt_weight(
    loads: LoadModel, Rs_base_ft: FloatArray, forces: FloatArray
) -> tuple[float, float]:
    """Compare how a turn of an empty hand changes the force, and how it must.

    Parameters
    ----------
    Rs_base_ft
        Orientation of the sensor before and after, shape (2, 3, 3).
    forces
        Raw forces read there [N], shape (2, 3).

    Returns
    -------
    felt, due : float
        Change along the way in which the tool's weight changes it, and the change of
        that weight [N]: equal if the sensor is right, opposite if its sign is wrong.
    """
    before, after = Rs_base_ft.swapaxes(1, 2) @ (loads.tool.mass * loads.gravity)
    change, due = after - before, float(np.linalg.norm(after - before))
    felt = loads.wrench_sign * (forces[1] - forces[0])
    return float(change @ felt) / max(due, 1e-9), due


def identify_payload(
    model: LoadModel,
    raw: ArrayLike,
    R_base_ft: ArrayLike,
    *,
    expected_com: ArrayLike = (0.0, 0.0, 0.0),
) -> tuple[Body, bool]:
    """Find what a hand holds freely in the air.

    The mass needs one orientation, the whole centre of mass two: along gravity it has
    no effect. A constant tare instead of this is wrong by ``2 m g sin(angle / 2)``
    after the hand has turned by an angle.

    Parameters
    ----------
    raw
        Readings of the sensor [N, N m], shape (n, 6).
    R_base_ft
        Orientation of the sensor at each, shape (n, 3, 3).
    expected_com
        Where the centre of mass should be [m], sensor frame, shape (3,): it is as near
        to there as the readings allow.

    Returns
    -------
    payload, is_complete
        ``is_complete`` is false if the centre of mass is only known across gravity.

    Raises
    ------
    InputError
        If the mass comes out negative: something pushes the hand up.
    """
    raw, R, g = _readings(raw, R_base_ft, model.gravity)
    load = model.load_ft(raw, R)
    g_ft = np.einsum("nji,j->ni", R, g)
    mass = float((load[:, :3] * g_ft).sum() / (g_ft * g_ft).sum())
    if mass < 0.0:
        raise InputError(
            "mass of the payload",
            got=f"{mass:.3g} kg",
            expected="zero or more",
            mend="The hand is pushed up by something, or the bias has drifted.",
        )
    if mass < 1e-3:
        return Body(0.0), False
    expected = finite(expected_com, "expected centre of mass [m]", (3,))
    A = -so3.hat(g_ft).reshape(-1, 3)
    rest = load[:, 3:].ravel() - mass * (A @ expected)
    solution = np.linalg.lstsq(A, rest, rcond=0.05)
    com = expected + np.asarray(solution[0]) / mass
    return Body(mass, com), bool(solution[2] == 3)


def _readings(
    raw: ArrayLike, R_base_ft: ArrayLike, gravity: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    raw = np.atleast_2d(as_floats(raw, "readings", ()))
    R = as_floats(R_base_ft, _TURNS, (3, 3)).reshape(-1, 3, 3)
    if raw.shape != (len(R), 6) or not len(R):
        raise ShapeError("readings", got=raw.shape, expected=f"({len(R) or 'n'}, 6)")
    require_finite(raw, "readings")
    SE3.from_matrix(SE3.from_parts(R).matrix, _TURNS)
    g = finite(gravity, "gravity", (3,))
    require_range("size of gravity [m/s^2]", float(np.linalg.norm(g)), 0.1, 100.0)
    return raw, R, g
