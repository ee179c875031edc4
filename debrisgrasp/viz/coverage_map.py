"""The map of what a dictionary covers, as a picture."""

from __future__ import annotations

import os
from collections.abc import Iterable

import numpy as np
from matplotlib.patches import Rectangle

from debrisgrasp._checked import checked
from debrisgrasp.prototypes import CoverageMap

from .colors import INK, MUTED_INK, hex_color, mixed
from .page import Page, Slot, short_name, wrapped

__all__ = ["coverage_png"]

_FRAME = 30
_CELL, _ROW = 52, 38
_GUTTER = 16
_APPROACHES = 180
"""Width of the column that names the approaches."""
_FULL = (0.06, 0.36, 0.60)
_GAP = (0.93, 0.45, 0.20)
_OUT = (0.93, 0.94, 0.96)
_LONGEST_NAME = 40
_DEEPEST = 4
"""So many prototypes for a size, or more, have the darkest colour."""


@checked
def coverage_png(path: str | os.PathLike[str], coverage: CoverageMap) -> None:
    """Write the map: a row for each hand and approach, a column for each size.

    Blue cells hold the number of prototypes within 1 cm, orange ones are gaps: sizes
    that the hand takes and no prototype covers. Grey is out of the hand's range.

    Raises
    ------
    ConfigError, OutputError
        If the file has another suffix, or can't be written.
    """
    n = len(coverage.rows)
    names = _FRAME + _width(hand for hand, _ in coverage.rows) + _GUTTER
    left = names + _APPROACHES
    width = left + _CELL * len(coverage.sizes) + 2 * _FRAME
    gaps = coverage.gaps()
    note = wrapped(["Gaps: " + "; ".join(gaps)] if gaps else ["No gaps."], 150, 8)
    foot = 26 * (note.count("\n") + 1)
    page = Page(width, 130 + _ROW * n + foot)
    page.text(_FRAME, 18, "What the prototypes cover", 18, weight="bold")
    page.text(
        _FRAME,
        50,
        "Prototypes within 1 cm of each diameter or width [cm]; orange: the hand takes "
        "it, but no prototype does; grey: out of the hand's range.",
        11,
        color=MUTED_INK,
    )
    top = 106
    slot = Slot(left, top, _CELL * len(coverage.sizes), _ROW * n)
    axes = page.panel(slot)
    axes.set_facecolor(hex_color(_OUT))
    for column, size in enumerate(coverage.sizes):
        x = left + (column + 0.5) * _CELL
        page.text(x, top - 22, f"{100 * size:.0f}", 11, ha="center", weight="bold")
    previous = ""
    for row, (hand, approach) in enumerate(coverage.rows):
        y = top + row * _ROW + 10
        if hand != previous:
            page.text(_FRAME, y, short_name(hand, _LONGEST_NAME), 11, weight="bold")
            axes.axhline(row * _ROW, color=hex_color(INK), linewidth=1.2)
        previous = hand
        page.text(names, y, approach, 11)
        for column, count in enumerate(coverage.counts[row]):
            usable = bool(coverage.in_range[row, column])
            if not usable and not count:
                continue
            color = _color(int(count))
            corner = (column * _CELL + 1, row * _ROW + 1)
            axes.add_patch(
                Rectangle(corner, _CELL - 2, _ROW - 2, facecolor=color, linewidth=0)
            )
            axes.text(
                (column + 0.5) * _CELL,
                (row + 0.5) * _ROW,
                str(count) if count else "",
                ha="center",
                va="center",
                fontsize=11,
                color="white" if count > 1 else hex_color(INK),
            )
    page.text(_FRAME, top + _ROW * n + 12, note, 10.5)
    page.write(path)


def _width(hands: Iterable[str]) -> int:
    """Width of the longest name of a hand as it is written."""
    page = Page(1, 1)
    for hand in hands:
        page.text(0, 0, short_name(hand, _LONGEST_NAME), 11, weight="bold")
    return max(round(text.get_window_extent().width) for text in page.figure.texts)


def _color(count: int) -> str:
    if not count:
        return hex_color(mixed(_GAP, (1, 1, 1), 0.25))
    share = min(count, _DEEPEST) / _DEEPEST
    return hex_color(np.clip(mixed(_FULL, (1, 1, 1), 0.85 * (1 - share)), 0, 1))
