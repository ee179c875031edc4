"""Picture of who lies on whom, with the order of removal beside it."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyArrowPatch
from matplotlib.patheffects import Stroke, withStroke

from debrisgrasp.segmentation import Candidate

from .colors import CHOSEN_COLOR, INK, MUTED_INK, hex_color, label_colors, mixed
from .page import Page, Slot, draw_picture, plain, shortened, wrapped
from .support_layer import DOUBT_COLOR, Arrow, Node, SelectionReport, SupportLayer

__all__ = ["selection_png"]

_FRAME = 30
_PICTURE = Slot(_FRAME, 84, 1080, 810)
_LIST_X = 1140
_WIDTH, _HEIGHT = 1720, 960
_RADII = (8.0, 15.0)
"""Of the discs of the smallest and of large objects [pixels of the page]."""
_NAMED = 10.0
"""Radius from which on there is room for a label beside the disc."""
_LINE, _GAP = 20.0, 5.0
"""Height of a line of the list, and the gap between its entries [pixels]."""


def selection_png(path: str | os.PathLike[str], report: SelectionReport) -> None:
    """Write the objects with arrows to what they rest on, numbered by their turn.

    Parameters
    ----------
    path
        Where to write; an existing file is replaced only when the picture is complete.
    report
        What to show.

    Raises
    ------
    OutputError
        If the file can't be written.
    """
    layer = SupportLayer.of(report)
    page = Page(_WIDTH, _HEIGHT)
    n = len(report.segmentation.segments)
    page.text(_FRAME, 18, shortened(report.title, 70), 18, weight="bold")
    note = f"{n} object{'s' * (n != 1)}, {len(layer.arrows)} relations of support shown"
    page.text(_FRAME, 54, note, 11, color=MUTED_INK)
    axes = page.panel(_PICTURE)
    axes.set_facecolor("#21262d")
    scale, left, top = draw_picture(axes, layer.colors, _PICTURE)
    places = {
        label: (left + scale * (node.u + 0.5), top + scale * (node.v + 0.5))
        for label, node in layer.nodes.items()
    }
    radii = {
        label: float(np.clip(0.3 * scale * node.size, *_RADII))
        for label, node in layer.nodes.items()
    }
    for arrow in layer.arrows:
        above, below = arrow.above.label, arrow.below.label
        ends, shrink = (places[above], places[below]), (radii[above], radii[below])
        _draw_arrow(axes, arrow, ends, shrink)
    for label, node in layer.nodes.items():
        _draw_node(axes, node, places[label], radii[label])
    _draw_legend(page)
    _write_order(page, report.order)
    page.write(path)


def _draw_arrow(
    axes: Axes,
    arrow: Arrow,
    ends: tuple[tuple[float, float], tuple[float, float]],
    shrink: tuple[float, float],
) -> None:
    width = 1.0 + 3.5 * arrow.confidence
    color = "white"
    patch = FancyArrowPatch(
        *ends,
        arrowstyle=f"-|>,head_length={3 + width:.1f},head_width={2 + 0.6 * width:.1f}",
        connectionstyle="arc3,rad=0.08",
        shrinkA=0.75 * shrink[0],
        shrinkB=0.75 * shrink[1],
        linewidth=width,
        linestyle=(0, (2.2, 1.1)) if arrow.is_leaning else "-",
        color=color,
        alpha=0.45 + 0.55 * arrow.confidence,
        zorder=3 + arrow.confidence,
        path_effects=[
            Stroke(linewidth=width + 2.2, foreground=hex_color(INK), alpha=0.75),
            withStroke(linewidth=0.0, foreground=color),
        ],
    )
    axes.add_patch(patch)


def _draw_node(
    axes: Axes, node: Node, place: tuple[float, float], radius: float
) -> None:
    x, y = place
    is_first = node.place == 1
    own = CHOSEN_COLOR if is_first else label_colors(node.label)
    radius *= 1.2 if is_first else 1.0
    if node.is_on_ground:
        for k, half in enumerate((0.85, 0.5, 0.2)):
            line = y + radius + 5 + 4.5 * k
            axes.plot(
                [x - half * radius, x + half * radius],
                [line, line],
                color="white",
                linewidth=1.8,
                zorder=5,
                path_effects=[withStroke(linewidth=3.6, foreground=hex_color(INK))],
            )
    axes.add_patch(
        Circle(
            (x, y),
            radius,
            facecolor=hex_color(mixed(own, (0, 0, 0), 0.3)),
            edgecolor="white",
            linewidth=2.0,
            zorder=6,
        )
    )
    text = f"{node.place or ''}{'?' * node.is_unsure}"
    axes.text(
        x,
        y,
        text,
        color="white",
        fontsize=0.68 * radius,
        weight="bold",
        ha="center",
        va="center_baseline",
        zorder=7,
    )
    if radius < _NAMED:
        return
    axes.text(
        x + radius + 3,
        y - radius * 0.75,
        f"#{node.label}",
        color="white",
        fontsize=8.5,
        weight="bold",
        va="center",
        zorder=7,
        path_effects=[withStroke(linewidth=2.6, foreground=hex_color(INK))],
    )


def _draw_legend(page: Page) -> None:
    y = _PICTURE.y + _PICTURE.height + 14
    parts = (
        ("disc: turn, label beside it", INK),
        ("arrow: rests on (thicker: surer, dashed: leans)", INK),
        ("bars: lies on the ground", INK),
        ("?: may be several objects", INK),
        (
            "yellow dashes: may be one object",
            tuple(mixed(DOUBT_COLOR, (0, 0, 0), 0.35)),
        ),
    )
    x = float(_FRAME)
    for text, color in parts:
        page.text(x, y, text, 9.5, color=color)
        x += 6.1 * len(text) + 24


def _write_order(page: Page, order: Sequence[Candidate]) -> None:
    page.text(_LIST_X, 54, "Order of removal", 12, weight="bold")
    y = _PICTURE.y
    for turn, item in enumerate(order, start=1):
        text = wrapped([item.reason], 60, 4)
        height = _LINE * (text.count("\n") + 1) + _GAP
        if y + height + _LINE > _HEIGHT - _FRAME:
            page.text(_LIST_X, y, f"and {len(order) - turn + 1} more", 10.5)
            return
        own = CHOSEN_COLOR if turn == 1 else label_colors(item.label)
        color = tuple(mixed(own, (0, 0, 0), 0.3))
        page.text(_LIST_X, y, f"{turn}", 11, color=color, weight="bold")
        page.text(_LIST_X + 26, y, f"#{item.label}", 10.5, weight="bold")
        page.text(_LIST_X + 66, y, plain(text), 10.5)
        y += height
