"""What is done with an object at all, and by which hand (Figure 3 of the paper).

Tracks drive over what is low. What fits between the fingers of the pinching hand goes
to it, what is thicker to the claw. What can't be lifted is dragged by the base, or
stays.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np

from debrisgrasp._words import in_kilograms
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.segmentation import Segment

from .settings import TaskSettings

__all__ = ["Triage", "Way", "judge"]

_DENSITY = 500.0
"""Wood, or aerated concrete [kg/m^3]; the forecast is an upper bound for hollows."""
_FILLED = 0.7
"""Share of the box around an object that is taken for solid."""
_THINNEST = 0.01
"""A sheet seen from one side still has some thickness [m]."""
_DOUBT = 0.01
"""By which an object may be higher than it was measured [m]: noise, and the pose of the
camera."""
_LARGEST = 2.5
"""Longer things are structures, not debris [m]."""


class Way(Enum):
    """What is done with an object."""

    DRIVE_OVER = "drive over"
    PINCH = "pinch"
    CLAW = "claw"
    DRAG = "drag"
    PUSH = "push aside"
    LEAVE = "leave"


@dataclass(frozen=True, slots=True, eq=False)
class Triage:
    """What is done with one object."""

    way: Way
    reason: str
    """In words, with the numbers."""
    arms: tuple[str, ...] = ()
    """Arms that may take it, the preferred first."""
    height: float = 0.0
    """Of its highest point over the ground [m]."""
    thickness: float = 0.0
    """Middle one of its three extents [m]: what a hand across it must span."""
    forecast: float = 0.0
    """Mass by its size, an upper bound for hollow things [kg]."""


def judge(
    segment: Segment,
    ground_height: float,
    hands: Mapping[str, GripperModel],
    settings: TaskSettings,
    *,
    is_too_heavy: bool = False,
    can_drag: bool = False,
) -> Triage:
    """Decide what is done with an object.

    Parameters
    ----------
    segment
        What was seen of it.
    ground_height
        Of the ground below it, base frame [m].
    hands
        Hand of each arm in use, by arm.
    is_too_heavy
        Whether a lift has shown that.
    can_drag
        Whether the robot has a base that drives.
    """
    height = float(segment.bounds.upper[2]) - ground_height
    extents = np.sort(np.maximum(segment.extents, _THINNEST))
    thin, thickness, length = extents.tolist()
    forecast = float(_DENSITY * _FILLED * np.prod(extents))
    seen = (height, thickness, forecast)
    if height < settings.drive_over - _DOUBT:
        words = f"its top is {100 * height:.1f} cm above the ground: "
        low = f"what is below {100 * settings.drive_over:.3g} cm"
        words += f"the tracks drive over {low}" if can_drag else f"{low} may stay"
        return Triage(Way.DRIVE_OVER, words, (), *seen)
    if length > _LARGEST:
        words = f"{length:.1f} m long: part of a structure"
        return Triage(Way.LEAVE, words, (), *seen)
    if is_too_heavy:
        words = "too heavy to lift"
        if not can_drag:
            return Triage(Way.LEAVE, f"{words}, and no base to drag it", (), *seen)
        return Triage(Way.DRAG, words, tuple(hands), *seen)
    return _handed(thin, hands, seen)


def _handed(
    thin: float, hands: Mapping[str, GripperModel], seen: tuple[float, float, float]
) -> Triage:
    """Choose hands by what they open to: the narrower one as long as it can."""
    order = sorted(hands, key=lambda arm: hands[arm].opening_range[1])
    height, thickness, forecast = seen
    by_width = [arm for arm in order if thickness <= 0.9 * hands[arm].opening_range[1]]
    # Long and hollow things are gripped by a thin part: that is for the plan to find.
    preferred = by_width[0] if by_width else order[0]
    widest = order[-1]
    way = Way.CLAW if preferred == widest and len(order) > 1 else Way.PINCH
    words = f"{100 * thickness:.0f} cm across, {100 * thin:.0f} cm thin, "
    words += f"at most {in_kilograms(forecast)} by its size"
    arms = (preferred, *(arm for arm in order if arm != preferred))
    return Triage(way, words, arms, height, thickness, forecast)
