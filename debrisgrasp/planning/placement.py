"""Where the base could stand instead."""

from __future__ import annotations

import numpy as np

from debrisgrasp.geometry import SE3, Bounds, lattice

from .reach import Distance

__all__ = ["MOVES", "is_blocked", "move_words", "placed"]

MOVES = (
    (-0.15, 0.0, 0.0),
    (0.15, 0.0, 0.0),
    (0.0, 0.15, 0.0),
    (0.0, -0.15, 0.0),
    (-0.30, 0.0, 0.0),
    (0.30, 0.0, 0.0),
    (0.0, 0.30, 0.0),
    (0.0, -0.30, 0.0),
    (0.0, 0.0, 20.0),
    (0.0, 0.0, -20.0),
)
"""Ahead and to the left [m], and turn to the left [degrees]; of equal ones the first is
advised."""


def placed(move: tuple[float, float, float]) -> SE3:
    """Pose of the base after a move, in the present base frame."""
    x, y, turn = move
    c, s = np.cos(np.deg2rad(turn)), np.sin(np.deg2rad(turn))
    return SE3.from_parts([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], [x, y, 0.0])


def is_blocked(footprint: Bounds, distance: Distance, T_base_placed: SE3) -> bool:
    """Whether the base would stand in something that was measured.

    Parameters
    ----------
    footprint
        Box around what stands still of the robot, base frame.
    distance
        Obstacles, base frame.
    """
    lower, upper = footprint.lower, footprint.upper
    # What the base drives over is lower than this.
    lower = np.maximum(lower, [-np.inf, -np.inf, 0.1])
    step = np.maximum(np.ceil((upper - lower) / 0.1), 1).astype(int)
    axes = [
        np.linspace(a, b, n + 1) for a, b, n in zip(lower, upper, step, strict=True)
    ]
    gap = distance(T_base_placed.apply(lattice(*axes).reshape(-1, 3)))
    return bool((gap < 0.05).any())


def move_words(move: tuple[float, float, float]) -> str:
    """Say a move."""
    x, y, turn = move
    if turn:
        return f"turns {abs(turn):.0f} degrees to the {'left' if turn > 0 else 'right'}"
    if x:
        return f"moves {'forward' if x > 0 else 'back'} {100 * abs(x):.0f} cm"
    return f"moves {100 * abs(y):.0f} cm to the {'left' if y > 0 else 'right'}"
