"""Whether devices answer in the kinds that their protocols ask for: a look at rest."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from debrisgrasp._words import shortened
from debrisgrasp.kinematics import LimitSet

from .interface import DepthFrame, Limb

__all__ = ["odd_answers", "odd_image", "unlike_numbers"]


def odd_answers(limb: Limb) -> Iterator[str]:
    """Say of each answer of a limb that is of another kind what it is, and should be.

    Numbers that are NaN or out of range are of the right kind.
    """
    arm, hand = limb.arm, limb.gripper.read()
    d = len(arm.joint_names)
    if not isinstance(arm.limits, LimitSet):
        said = shortened(repr(arm.limits))
        yield f"its arm's limits are {said}; a LimitSet is needed"
    for what in ("is_engaged", "is_stopped"):
        said = getattr(arm, what)
        if not isinstance(said, (bool, np.bool_)):
            yield f"{what} of its arm is {shortened(repr(said))}; a bool is needed"
    for what, values, n in (
        ("its arm", arm.read().q, d),
        ("its force sensor", limb.sensor.read().wrench_ft, 6),
        ("its gripper's openings", hand.openings, None),
        ("its gripper's forces", hand.forces, None),
    ):
        if odd := unlike_numbers(values, n):
            yield f"{what}: {odd}"


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
