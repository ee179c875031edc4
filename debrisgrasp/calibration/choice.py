"""Where to put the fiducial next: the places that tell most about the camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    as_floats,
    finite,
    require_finite,
    require_metres,
    require_range,
)
from debrisgrasp._checked import checked
from debrisgrasp.errors import InputError, ShapeError
from debrisgrasp.geometry import Bounds, so3

from .observations import KINEMATIC_SIGMA, MEASUREMENT_SIGMA
from .uncertainty import WORKSPACE, WorkspaceError, grid

__all__ = ["Choice", "choose_places", "information_at"]

_IGNORANCE = 1.0
"""Standard deviation before the first look [m, rad]; any value far above the noise
gives the same choice."""
_MOST_ROUNDS = 10
_ROUNDING = 1e-9
"""Share of its largest eigenvalue that rounding leaves of one of zero."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Choice:
    """The places to measure, most telling first."""

    indices: IntArray
    """Which of the candidates, shape (n,)."""
    errors: tuple[WorkspaceError, ...]
    """Predicted error after each of them has been measured."""

    def needed(self, rms: float) -> int | None:
        """Count how many of them bring the predicted error down to ``rms`` [m].

        None if all together do not.
        """
        for count, error in enumerate(self.errors, start=1):
            if error.rms <= rms:
                return count
        return None


def information_at(
    places: ArrayLike, sigmas: ArrayLike, turns: ArrayLike | None = None
) -> FloatArray:
    """Information on the camera's pose in looks at places (m, 3), shape (m, 6, 6).

    In the convention of `camera_covariance`; ``sigmas`` [m] are numbers or (m,). With
    ``turns`` (m, 3, 3), which map a shift of the fiducial to that of its place, it is
    that on the shift, too, shape (m, 9, 9).

    Raises
    ------
    InputError
        If places or turns are of another shape, or not finite.
    """
    places = finite(places, "places", (None, 3))
    columns = [np.broadcast_to(np.eye(3), (len(places), 3, 3)), -so3.hat(places)]
    if turns is not None:
        columns.append(-finite(turns, "turns", (len(places), 3, 3)))
    jacobians = np.concatenate(columns, axis=-1)
    variances = np.broadcast_to(np.asarray(sigmas) ** 2, len(places))
    squares = np.swapaxes(jacobians, -1, -2) @ jacobians
    return np.asarray(squares / variances[:, None, None])


@checked
def choose_places(
    candidates: ArrayLike,
    n: int,
    *,
    information: ArrayLike | None = None,
    apart: float = 0.1,
    workspace: Bounds = WORKSPACE,
    turns: ArrayLike | None = None,
    fiducial_sigma: float = 0.02,
) -> Choice:
    """Choose the places that leave least uncertainty.

    First greedily by what each adds to the logarithm of the determinant of the
    information, the inverse volume of what the camera's pose may be: within 1 - 1/e of
    the best set, since the gain is submodular. Then places are exchanged one by one as
    long as that lowers the predicted error over the workspace.

    Parameters
    ----------
    candidates
        Fiducial positions that the robot can show to the camera, base frame [m],
        shape (m, 3).
    n
        How many to choose.
    information
        What is known already, shape (6, 6), the inverse of a `camera_covariance`, or
        (9, 9) with that on the fiducial; nothing by default.
    apart
        Least distance between two chosen places [m]; looks at one place share its
        error of kinematics.
    workspace
        Where the predicted error is evaluated.
    turns
        Attitude, for each candidate, of the frame in which the fiducial's place is in
        doubt, shape (m, 3, 3); None if it is in no doubt.
    fiducial_sigma
        How much in doubt it is [m].

    Raises
    ------
    InputError
        If there are too few candidates that lie so far apart, they can only be in
        millimetres, or anything is not of its shape, or not finite.
    """
    places = finite(candidates, "candidate places", (None, 3))
    require_metres("candidate places", places)
    require_range("apart [m]", apart, 0.0, 10.0)
    require_range("fiducial_sigma [m]", fiducial_sigma, 1e-6, 1.0)
    if n < 1:
        raise InputError("places to choose", got=n, expected="1 or more")
    sigma = np.hypot(MEASUREMENT_SIGMA, KINEMATIC_SIGMA)
    gains = information_at(places, sigma, turns)
    doubts = [_IGNORANCE] * 6 + [fiducial_sigma] * (gains.shape[-1] - 6)
    known = np.diag(np.array(doubts) ** -2.0)
    if information is not None:
        before = _checked_information(information, len(known))
        known[: len(before), : len(before)] += before
    is_near = np.linalg.norm(places[:, None] - places, axis=-1) <= apart
    chosen = _exchanged(
        _greedy(gains, is_near, known, n), gains, is_near, known, workspace
    )
    # Most telling first, also after the exchange.
    order = _greedy(gains[chosen], np.eye(n, dtype=bool), known, n)
    indices = np.array(chosen)[order]
    sums = known + np.cumsum(gains[indices], axis=0)
    left = np.linalg.inv(sums)[:, :6, :6]
    errors = [WorkspaceError.of(covariance, workspace) for covariance in left]
    return Choice(indices=indices, errors=tuple(errors))


def _checked_information(information: ArrayLike, most: int) -> FloatArray:
    """Information on the camera alone, or with that on the fiducial, if ``most`` is 9.

    That on any motion of the camera is none or more.
    """
    before = as_floats(information, "information", ())
    if before.shape not in ((6, 6), (most, most)):
        expected = "(6, 6), or (9, 9) with turns"
        raise ShapeError("shape of information", got=before.shape, expected=expected)
    require_finite(before, "information")
    values = np.linalg.eigvalsh(0.5 * (before + before.T))
    if values[0] < -_ROUNDING * values[-1]:
        raise InputError(
            "information",
            got=f"an eigenvalue of {values[0]:.3g}",
            expected="none below zero",
            mend="It is the inverse of a covariance.",
        )
    return before


def _greedy(
    gains: FloatArray, is_near: BoolArray, known: FloatArray, n: int
) -> list[int]:
    """Take n times the candidate that adds most to the determinant."""
    is_open = np.ones(len(gains), dtype=bool)
    chosen: list[int] = []
    for _ in range(n):
        if not is_open.any():
            raise InputError(
                "candidate places",
                got=f"{len(gains)}, of which {len(chosen)} lie far enough apart",
                expected=f"{n} that do",
                mend="Offer more candidates over a larger volume, or choose fewer.",
            )
        _, volume = np.linalg.slogdet(known + gains)
        best = int(np.argmax(np.where(is_open, volume, -np.inf)))
        chosen.append(best)
        known = known + gains[best]
        is_open &= ~is_near[best]
    return chosen


def _exchanged(
    chosen: list[int],
    gains: FloatArray,
    is_near: BoolArray,
    known: FloatArray,
    workspace: Bounds,
) -> list[int]:
    """Put a better candidate in the place of each chosen one, until none is better."""
    # Mean of J^T J over the workspace: its product with a covariance has the mean
    # squared error as trace.
    weights = np.zeros_like(known)
    weights[:6, :6] = information_at(grid(workspace), 1.0).mean(axis=0)
    chosen = list(chosen)
    for _ in range(_MOST_ROUNDS):
        before = list(chosen)
        for i, old in enumerate(before):
            others = chosen[:i] + chosen[i + 1 :]
            rest = known + gains[others].sum(axis=0)
            squared = np.einsum("mij,ji->m", np.linalg.inv(rest + gains), weights)
            squared[is_near[others].any(axis=0)] = np.inf
            best = int(np.argmin(squared))
            if squared[best] < squared[old] * (1.0 - 1e-6):
                chosen[i] = best
        if chosen == before:
            break
    return chosen
