"""Whether devices answer in the kinds that their protocols ask for: a look at rest."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._words import shortened
from debrisgrasp.geometry import SE3, Intrinsics
from debrisgrasp.kinematics import LimitSet

from .interface import Base, DepthFrame, Head, Limb

__all__ = [
    "dead_half",
    "odd_answers",
    "odd_base",
    "odd_head",
    "odd_image",
    "odd_openings",
    "odd_time",
    "unlike_numbers",
]

_FARTHEST = 50.0
"""Depths beyond this are no metres ..."""
_FAR_SHARE = 0.05
"""... if so many of the pixels that have any have such."""
_WIDEST, _NARROWEST = 1.0, -0.005
"""Of all openings [m] ..."""
_WIDER = 1.5
"""... and by so many times the widest preshape may be exceeded."""


def odd_answers(limb: Limb, n_fingers: int | None = None) -> Iterator[str]:
    """Say of each answer of a limb that is of another kind what it is, and should be.

    Numbers that are NaN or out of range are of the right kind. Without a number of
    fingers its gripper may answer for as many as it likes.
    """
    arm = limb.arm
    if not isinstance(arm.limits, LimitSet):
        said = shortened(repr(arm.limits))
        yield f"its arm's limits are {said}; a LimitSet is needed"
    for what in ("is_engaged", "is_stopped"):
        said = getattr(arm, what)
        if not isinstance(said, (bool, np.bool_)):
            yield f"{what} of its arm is {shortened(repr(said))}; a bool is needed"
    names = arm.joint_names
    if not isinstance(names, (tuple, list)):
        yield f"joint_names of its arm is {shortened(repr(names))}; a tuple is needed"
        names = ()
    hand = limb.gripper.read()
    for what, reading, name, n in (
        ("its arm", arm.read(), "q", len(names) or None),
        ("its force sensor", limb.sensor.read(), "wrench_ft", 6),
        ("its gripper's openings", hand, "openings", n_fingers),
        ("its gripper's forces", hand, "forces", n_fingers),
    ):
        if not hasattr(reading, name):
            yield f"{what}: reads {shortened(repr(reading))} without {name}"
            continue
        odd = unlike_numbers(getattr(reading, name), n)
        if odd := odd or odd_time(getattr(reading, "time", None)):
            yield f"{what}: {odd}"


def odd_head(head: Head) -> Iterator[str]:
    """Say of what a head reads, if it is of another kind, what it is."""
    reading = head.read()
    if not hasattr(reading, "q"):
        yield f"reads {shortened(repr(reading))} without q"
    elif odd := unlike_numbers(reading.q, len(head.joint_names)):
        yield odd


def odd_base(base: Base) -> Iterator[str]:
    """Say of what a base reads, if it is no pose, what it is."""
    said = base.read()
    if not isinstance(said, SE3) or said.matrix.ndim != 2:
        yield f"reads {shortened(repr(said))}; one pose is needed, as SE3"


def dead_half(raw: FloatArray) -> str:
    """Say if all forces, or all torques, of wrenches (n, 6) are the same; or ""."""
    for name, half in (("forces", raw[:, :3]), ("torques", raw[:, 3:])):
        if (half == half[0]).all():
            return (
                f"its {name} are {half[0].tolist()} to the last digit in all "
                f"{len(raw)} readings: a sensor of all six is needed, for without "
                "torques no load beside the hand is felt"
            )
    return ""


def odd_time(said: object) -> str:
    """Say why something is no time; "" if it is a number, be it NaN."""
    if isinstance(said, (int, float, np.integer, np.floating)):
        return ""
    return f"the time is {shortened(repr(said))}; a number is needed"


def odd_openings(openings: Sequence[float], widest: float = _WIDEST) -> str:
    """Say why numbers are no openings of fingers [m]; "" if they are.

    Parameters
    ----------
    widest
        Preshape of the hand, if that is known [m].
    """
    if not np.isfinite(openings).all():
        return f"openings read {np.asarray(openings, dtype=np.float64).tolist()}"
    if max(openings) > _WIDEST:
        return f"opening {max(openings):g}; metres, not millimetres?"
    if max(openings) > _WIDER * widest:
        return (
            f"opening {max(openings):g} of a hand that opens to {widest:g} m; metres, "
            "not per cent or a share?"
        )
    if min(openings) < _NARROWEST:
        return f"opening {min(openings):g} m, below zero"
    return ""


def odd_image(frame: Any) -> str:
    """Say why something is no depth image at all; "" if it is one."""
    if lacks := [
        name for name in DepthFrame.__annotations__ if not hasattr(frame, name)
    ]:
        return f"gives {shortened(repr(frame))} without {', '.join(lacks)}"
    try:
        depth = np.asarray(frame.depth)
    except ValueError:
        depth = np.zeros(0)  # rows of different lengths
    if depth.dtype.kind not in "fiu" or depth.ndim != 2 or not depth.size:
        return f"gives depth of shape {depth.shape} and type {depth.dtype}"
    K = frame.intrinsics
    if not isinstance(K, Intrinsics):
        return f"gives intrinsics {shortened(repr(K))}; Intrinsics are needed"
    if depth.shape != (K.height, K.width):
        return f"gives depth of {depth.shape}, intrinsics of {(K.height, K.width)}"
    if odd := odd_time(frame.time):
        return f"gives an image, but {odd}"
    seen = depth[np.isfinite(depth) & (depth != 0)]
    if seen.size and (seen > _FARTHEST).mean() > _FAR_SHARE:
        return f"gives depth up to {seen.max():g}; metres, not millimetres?"
    return ""


def unlike_numbers(values: Any, n: int | None = None) -> str:
    """Say why values are not n numbers, or any number of them; "" if they are."""
    try:
        array = np.asarray(values)
    except ValueError:
        array = np.asarray(None)  # rows of different lengths
    if array.dtype.kind not in "fiu" or array.ndim != 1:
        return f"reads {shortened(repr(values))}; {n or 'some'} numbers are needed"
    if n is not None and len(array) != n:
        return f"reads {len(array)} values; {n} are needed"
    return ""
