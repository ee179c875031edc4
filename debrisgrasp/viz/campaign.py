"""The tables of a campaign as one picture: outcomes, stages, and what mending buys."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from .colors import CHOSEN_COLOR, GROUND_COLOR, INK, MUTED_INK, hex_color
from .page import Page, Slot, shortened

__all__ = ["Bar", "campaign_png"]

_WIDTH = 1500
_ROW, _HEAD, _FOOT = 34, 150, 80
_ALL, _GRASPS = (0.20, 0.42, 0.70), (0.53, 0.75, 0.93)
_MENDED = (0.27, 0.67, 0.60)


@dataclass(frozen=True, slots=True)
class Bar:
    """One share with its interval."""

    name: str
    share: float
    """In [0, 1]; NaN where nothing was counted: there is only the note."""
    low: float
    high: float
    note: str = ""
    """Written at its end, for instance ``"19 of 43"``."""


def campaign_png(
    path: str | os.PathLike[str],
    title: str,
    note: str,
    *,
    of_all: Sequence[Bar],
    of_grasps: Sequence[Bar],
    stages: Sequence[Bar],
    mended: Sequence[Bar],
    system: float,
) -> None:
    """Draw the outcomes of a campaign.

    Parameters
    ----------
    path
        PNG to write, 1500 pixels wide.
    of_all, of_grasps
        Share of each outcome in all runs, and in those that got to a grasp; both in the
        same order.
    stages
        Reliability of each stage of the series.
    mended
        Success of the whole if one class never occurred.
    system
        Success of the whole [0, 1]: the product of the stages.

    Raises
    ------
    ConfigError, OutputError
        If the file has another suffix, or can't be written.
    """
    rows = max(len(of_all), len(stages) + len(mended) + 2)
    height = _HEAD + _ROW * rows + _FOOT
    page = Page(_WIDTH, height)
    page.text(30, 20, shortened(title, 80), 20, weight="bold")
    page.text(30, 62, shortened(note, 160), 11.5, color=MUTED_INK)
    legend = "bars: share, lines: 95 % Wilson intervals"
    page.text(1410, 26, legend, 11.5, color=MUTED_INK, ha="right")
    tall = height - _HEAD - _FOOT
    left = _axes(page, Slot(190, _HEAD, 520, tall), "Outcomes")
    _pairs(left, of_all, of_grasps)
    part = (tall - 70) * len(stages) / max(len(stages) + len(mended), 1)
    upper = _axes(
        page, Slot(910, _HEAD, 500, part), "Reliability of each class, in series"
    )
    _single(upper, stages, _ALL)
    lower_slot = Slot(910, _HEAD + part + 70, 500, tall - part - 70)
    lower = _axes(page, lower_slot, "Success if a class never occurred")
    _single(lower, mended, _MENDED)
    lower.axvline(system, color=hex_color(CHOSEN_COLOR), linewidth=1.6)
    words = f"now {100 * system:.1f} %"
    page.text(1410, lower_slot.y - 25, words, 11, color=CHOSEN_COLOR, ha="right")
    page.write(path)


def _axes(page: Page, slot: Slot, title: str) -> Axes:
    page.text(slot.x, slot.y - 30, title, 12.5, weight="bold")
    axes = page.figure.add_axes(
        (
            slot.x / page.width,
            1.0 - (slot.y + slot.height) / page.height,
            slot.width / page.width,
            slot.height / page.height,
        )
    )
    axes.set_xlim(0.0, 1.0)
    axes.set_xticks(np.linspace(0.0, 1.0, 6))
    axes.set_xticklabels([f"{20 * i} %" for i in range(6)])
    axes.grid(axis="x", color=hex_color(GROUND_COLOR), linewidth=0.5, alpha=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.tick_params(length=0, colors=hex_color(INK), labelsize=10)
    return axes


def _named(axes: Axes, bars: Sequence[Bar]) -> None:
    axes.set_ylim(len(bars) - 0.4, -0.6)
    axes.set_yticks(range(len(bars)))
    axes.set_yticklabels([bar.name.replace("_", " ") for bar in bars])


def _draw(
    axes: Axes, y: float, bar: Bar, height: float, color: tuple[float, float, float]
) -> None:
    right = 0.0
    if not np.isnan(bar.share):
        axes.barh(y, bar.share, height, color=hex_color(color))
        axes.plot([bar.low, bar.high], [y, y], color=hex_color(INK), linewidth=1.1)
        right = max(bar.share, bar.high)
    is_outside = right < 0.8
    axes.text(
        right + 0.015 if is_outside else 0.015,
        y,
        bar.note,
        va="center",
        fontsize=8.5,
        color=hex_color(MUTED_INK if is_outside else _legible_on(color)),
    )


def _legible_on(color: tuple[float, float, float]) -> tuple[float, float, float]:
    return (1.0, 1.0, 1.0) if sum(color) < 1.6 else INK


def _pairs(axes: Axes, of_all: Sequence[Bar], of_grasps: Sequence[Bar]) -> None:
    _named(axes, of_all)
    for i, (one, other) in enumerate(zip(of_all, of_grasps, strict=True)):
        _draw(axes, i - 0.19, one, 0.34, _ALL)
        _draw(axes, i + 0.19, other, 0.34, _GRASPS)
    # Empty bars only give the legend its colours.
    axes.barh(0, 0.0, color=hex_color(_ALL), label="of all runs")
    axes.barh(0, 0.0, color=hex_color(_GRASPS), label="of runs that got to a grasp")
    axes.legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False, fontsize=9
    )


def _single(axes: Axes, bars: Sequence[Bar], color: tuple[float, float, float]) -> None:
    _named(axes, bars)
    for i, bar in enumerate(bars):
        _draw(axes, i, bar, 0.62, color)
