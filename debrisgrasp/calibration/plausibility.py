"""Refuses observations that have no honest result, and says what they look like."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3

from .rigid import consensus
from .uncertainty import lever_arm

__all__ = [
    "Pairs",
    "Vote",
    "agreeing",
    "extent",
    "likely_unit",
    "require_right_way_round",
]

_UNITS = ((1000.0, "millimetres"), (100.0, "centimetres"), (39.37, "inches"))
_FARTHEST_SCALE = 3.0
"""Noise and wrong picks never stretch a whole set of points by so much."""
_SHORTEST_LEVER = 3.0
"""Standard deviations that points must stand off a line to fix a rotation at all."""
_FEWEST_TO_OUTVOTE = 5
"""With fewer points two wrong hypotheses have as many votes as the right one."""
_TURNED = np.deg2rad(40.0)
"""Farther from where the model has it, no camera is by drift."""
_EXCHANGE = (
    "The two have been swapped: exchange them. In a file `point` (camera_x, camera_y, "
    "camera_z) is the camera's, `position` (base_x, base_y, base_z) the arm's."
)
_OR_INVERT = (
    "If they are right, or computed from joints, the expected pose of the camera, as "
    "the robot's model has it, is the inverse of T_base_camera: mend that."
)

Pairs = tuple[FloatArray, FloatArray, FloatArray]
"""Places by kinematics (n, 3), by the camera (n, 3) [m], and variances (n,) [m^2]."""
Vote = Callable[[FloatArray, FloatArray, FloatArray], tuple[BoolArray, float]]
"""Which pairs agree, shape (n,), and at what cost; as `consensus`."""


def agreeing(pairs: Pairs, vote: Vote = consensus) -> BoolArray:
    """Which pairs agree on one rigid transform, shape (n,), as they ``vote``.

    Raises
    ------
    InputError
        For a wrong unit, places on a line or in one spot, or a mirrored axis.
    """
    by_arm, by_camera, variances = pairs
    _require_one_unit(by_arm, by_camera)
    noise = float(np.sqrt(np.median(variances)))
    spread, lever = extent(by_arm), min(lever_arm(by_arm), lever_arm(by_camera))
    if lever < _SHORTEST_LEVER * noise:
        is_line = spread > 2.0 * _SHORTEST_LEVER * noise
        raise InputError(
            "fiducial positions",
            got=("on one line" if is_line else "all in one place")
            + f" within {1e3 * lever:.1f} mm, at {1e3 * noise:.1f} mm of noise",
            expected="places that surround the workspace, best 0.3 m apart or more",
            mend="No rotation can be told from these. `debrisgrasp calibrate choose` "
            "names places that fix it.",
        )
    agrees, cost = vote(*pairs)
    _require_right_handed(pairs, vote, agrees, cost)
    if len(agrees) < _FEWEST_TO_OUTVOTE:
        return np.ones(len(agrees), dtype=bool)
    return agrees


def require_right_way_round(
    T_base_camera: SE3, nominal: SE3 | None, link: str | None = None
) -> None:
    """Raise `InputError` if the fit is the inverse of what a camera can be.

    With the nominal pose of the camera the test is against that; without one a camera
    that is upright only when the frames are exchanged is refused. ``link`` is the one
    that carries the camera instead of the base.
    """
    inverse = T_base_camera.inverse()
    if nominal is not None:
        turned = _angle_between(T_base_camera, nominal)
        other = _angle_between(inverse, nominal)
        is_swapped = turned > _TURNED and other < 0.5 * turned and other < _TURNED
    else:
        # The image's x axis of an upright camera is level.
        roll, other = abs(T_base_camera.R[2, 0]), abs(inverse.R[2, 0])
        is_down = inverse.R[2, 1] < 0 and inverse.p[2] > 0
        is_swapped = bool(roll > 0.5 and other < 0.2 and is_down)
    if is_swapped and link is not None:
        raise InputError(
            "pose of the camera in the robot's model",
            got="the inverse of what the looks give",
            expected=f"the pose of its optical frame in link {link!r}",
            mend="Mend it in the robot's file or its URDF.",
        )
    if is_swapped:
        raise InputError(
            "frames of the observations",
            got="measured points that fit as base coordinates, and positions by the "
            "arm that fit as camera coordinates",
            expected="the arm's positions in base, the camera's in its optical frame",
            mend=_EXCHANGE if nominal is None else f"{_EXCHANGE} {_OR_INVERT}",
        )


def _require_one_unit(by_arm: FloatArray, by_camera: FloatArray) -> None:
    sizes = [extent(by_arm), extent(by_camera)]
    if min(sizes) == 0.0:
        return
    ratio = sizes[1] / sizes[0]
    factor = max(ratio, 1.0 / ratio)
    if factor < _FARTHEST_SCALE:
        return
    larger = "measured points" if ratio > 1.0 else "fiducial positions"
    unit, name = likely_unit(factor)
    is_unit = abs(np.log(factor / unit)) < 0.3
    raise InputError(
        f"scale of the {larger}",
        got=f"{factor:.4g} times that of the others",
        expected="the same, metres in both",
        mend=f"They look like {name}: divide by {unit:g}."
        if is_unit
        else "Check that row for row the same place is meant.",
    )


def likely_unit(factor: float) -> tuple[float, str]:
    """Size and name of the unit whose numbers are most nearly so many times metres."""
    return min(_UNITS, key=lambda item: abs(np.log(factor / item[0])))


def extent(points: FloatArray) -> float:
    """Median distance from the middle [m]; wrong picks hardly change it."""
    middle = np.median(points, axis=0)
    return float(np.median(np.linalg.norm(points - middle, axis=1)))


def _require_right_handed(
    pairs: Pairs, vote: Vote, agrees: BoolArray, cost: float
) -> None:
    by_arm, by_camera, variances = pairs
    n = len(by_arm)
    # Three points are their own mirror image.
    if n < 4 or agrees.mean() > 0.6:
        return
    mirrored = by_camera * np.array([-1.0, 1.0, 1.0])
    also, mirrored_cost = vote(by_arm, mirrored, variances)
    if also.mean() > 0.6 and also.sum() > agrees.sum() and mirrored_cost < 0.5 * cost:
        raise InputError(
            "axes of the observations",
            got=f"a left-handed fit: with one axis mirrored {also.sum()} of {n} points "
            f"agree, without {agrees.sum()}",
            expected="right-handed frames (camera: x right, y down, z forward)",
            mend="One coordinate has the wrong sign: a flipped image, or y up instead "
            "of down.",
        )


def _angle_between(T_a: SE3, T_b: SE3) -> float:
    cosine = 0.5 * (np.trace(T_a.R.T @ T_b.R) - 1.0)
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))
