"""Directions about a joint, one bit for each sixteenth of a turn, within limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from debrisgrasp._arrays import IntArray

from .serial import Lanes

__all__ = ["ALL_AROUND", "excess_turn", "fitting_bits", "has_gap", "sixteenth"]

ALL_AROUND = np.uint16(0xFFFF)


def sixteenth(angle: Lanes) -> IntArray:
    """Which sixteenth of a turn an angle [rad] lies in, counted from -pi."""
    return np.asarray(np.floor(angle * (8.0 / np.pi)).astype(np.intp) % 16)


def fitting_bits(lower: float, upper: float) -> NDArray[np.uint16]:
    """Which sixteenths may be met at zero by what is wanted in each, shape (16,).

    Wanted angle minus met angle is the value of the joint, which has limits.
    """
    step = np.pi / 8.0
    value = step * np.subtract.outer(np.arange(16), np.arange(16))
    # Either angle may lie anywhere in its sixteenth, and a neighbour's is close by.
    fits = excess_turn(value, lower, upper) <= 2.0 * step
    return np.asarray((fits << np.arange(16)).sum(axis=1), dtype=np.uint16)


def has_gap(lower: float, upper: float) -> bool:
    """Whether the limits [rad] keep a joint from some directions."""
    return bool(upper - lower < 2.0 * np.pi)


def excess_turn(value: Lanes, lower: float, upper: float) -> Lanes:
    """How far [rad] a turn must exceed the limits to take the direction of a value."""
    if not has_gap(lower, upper):
        return np.zeros_like(value)
    middle, half = float(0.5 * (lower + upper)), float(0.5 * (upper - lower))
    turns = np.round((value - middle) / (2.0 * np.pi))
    return np.maximum(np.abs(value - middle - 2.0 * np.pi * turns) - half, 0.0)
