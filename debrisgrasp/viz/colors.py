"""Colours that stay apart, also for people who do not tell red from green."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray
from debrisgrasp.segmentation import PointKind

__all__ = [
    "BACKGROUND_COLOR",
    "CHOSEN_COLOR",
    "GROUND_COLOR",
    "HAND_COLORS",
    "INK",
    "KIND_COLORS",
    "MUTED_INK",
    "ROBOT_COLOR",
    "WARNING_COLOR",
    "hex_color",
    "label_colors",
    "mixed",
    "rgb_color",
]


def rgb_color(text: str) -> tuple[float, float, float]:
    """Red, green and blue in [0, 1] of ``"#rrggbb"``."""
    r, g, b = (int(text[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return r, g, b


# Paul Tol's "muted" and "light" sets, interleaved so that consecutive labels differ in
# lightness as well as in hue. Orange is left out: it is kept for the chosen object.
_LABELS = np.array(
    [
        rgb_color(text)
        for text in (
            *("#44aa99", "#aa4499", "#88ccee", "#117733", "#ddcc77", "#4f46a8"),
            *("#cc6677", "#99ddaa", "#882255", "#77aadd", "#999933", "#ffaabb"),
            *("#2f6f9f", "#bbcc33", "#8c6bb1", "#66c2c2"),
        )
    ]
)

CHOSEN_COLOR = rgb_color("#ff7a00")
GROUND_COLOR = rgb_color("#b9bdc4")
ROBOT_COLOR = rgb_color("#8d96a3")
BACKGROUND_COLOR = rgb_color("#f4f6f9")
INK = rgb_color("#1c2330")
MUTED_INK = rgb_color("#5d6675")
WARNING_COLOR = rgb_color("#b34700")
KIND_COLORS = {
    PointKind.GROUND: rgb_color("#9fb4c9"),
    PointKind.BELOW: rgb_color("#5b6b7d"),
    PointKind.WALL: rgb_color("#d05c8a"),
    PointKind.CONTAINER: rgb_color("#3d7dca"),
    PointKind.OUTSIDE: rgb_color("#6d6d6d"),
    PointKind.PIT: rgb_color("#7a5230"),
}
"""Colours of what was taken away before objects were sought."""
HAND_COLORS = tuple(rgb_color(text) for text in ("#1a62c6", "#008f6b", "#8b3fb0"))
"""Colours of the hands by rank; ranks beyond the last share its colour."""


def label_colors(labels: ArrayLike, chosen: int = 0) -> FloatArray:
    """Colours of object labels, shape (..., 3) in [0, 1].

    Parameters
    ----------
    labels
        Labels of any shape; 0, or less, is ground and gets its grey.
    chosen
        Label of the chosen object, which gets the colour kept for it; 0 for none.
    """
    numbers = np.asarray(labels)
    colors: FloatArray = _LABELS[(numbers - 1) % len(_LABELS)]
    colors[numbers <= 0] = GROUND_COLOR
    if chosen > 0:
        colors[numbers == chosen] = CHOSEN_COLOR
    return colors


def mixed(colors: ArrayLike, other: ArrayLike, share: float) -> FloatArray:
    """Colours (..., 3) with ``share`` of another one mixed in."""
    own = np.asarray(colors, dtype=np.float64)
    return own * (1.0 - share) + np.asarray(other, dtype=np.float64) * share


def hex_color(color: ArrayLike) -> str:
    """``"#rrggbb"`` of a colour (3,) in [0, 1]."""
    r, g, b = np.rint(np.asarray(color) * 255).astype(int)
    return f"#{r:02x}{g:02x}{b:02x}"
