"""Picture of who lies on whom, with the order of removal beside it."""

from __future__ import annotations

import os

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyArrowPatch
from matplotlib.patheffects import Stroke, withStroke

from debrisgrasp._checked import checked

from .colors import (
    CHOSEN_COLOR,
    INK,
    MUTED_INK,
    WARNING_COLOR,
    hex_color,
    label_colors,
    mixed,
)
from .overlay import DOUBT_KEY
from .page import Page, Slot, draw_picture, shortened, wrapped, write_order
from .support_layer import Arrow, Node, SelectionReport, SupportLayer
from .words import doubt_line

__all__ = ["selection_png"]

_FRAME = 30
_TOP = 84
_PICTURE = (1080, 810)
_LIST_X = 1140
_WIDTH, _HEIGHT = 1720, 960
_RADII = (8.0, 15.0)
"""Of the discs of the smallest and of large objects [pixels of the page]."""
_NAMED = 10.0
"""Radius from which on there is room for a label beside the disc."""
_MOST_DISCS = 15
"""Of more objects, only the first in the order get a disc: more would overlap."""


@checked
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
    ConfigError, OutputError
        If the file has another suffix, or can't be written.
    """
    layer = SupportLayer.of(report)
    doubt = wrapped([doubt_line(report.segmentation)], 150, 3)
    shift = 19 * (doubt.count("\n") + 1) if doubt else 0
    slot = Slot(_FRAME, _TOP + shift, *_PICTURE)
    page = Page(_WIDTH, _HEIGHT + shift)
    n = len(report.segmentation.segments)
    nodes = [node for node in layer.nodes.values() if node.place <= _MOST_DISCS]
    if n <= _MOST_DISCS:
        nodes = list(layer.nodes.values())
    drawn = {node.label for node in nodes}
    arrows = [arrow for arrow in layer.arrows if arrow.above.label in drawn]
    page.text(_FRAME, 18, shortened(report.title, 70), 18, weight="bold")
    note = f"{n} object{'s' * (n != 1)}, {len(arrows)} relations of support shown"
    if n > _MOST_DISCS:
        note += f": those of the first {_MOST_DISCS} objects in the order"
    page.text(_FRAME, 54, note, 11, color=MUTED_INK)
    page.text(_FRAME, 76, doubt, 10, color=WARNING_COLOR)
    axes = page.panel(slot)
    axes.set_facecolor("#21262d")
    scale, left, top = draw_picture(axes, layer.colors, slot)
    places = {
        label: (left + scale * (node.u + 0.5), top + scale * (node.v + 0.5))
        for label, node in layer.nodes.items()
    }
    radii = {
        label: float(np.clip(0.3 * scale * node.size, *_RADII))
        for label, node in layer.nodes.items()
    }
    for arrow in arrows:
        above, below = arrow.above.label, arrow.below.label
        ends, shrink = (places[above], places[below]), (radii[above], radii[below])
        _draw_arrow(axes, arrow, ends, shrink)
    for node in nodes:
        _draw_node(axes, node, places[node.label], radii[node.label])
    for label in {arrow.below.label for arrow in arrows} - drawn:
        _write_label(axes, label, places[label], "center")
    _draw_legend(page, slot)
    page.text(_LIST_X, slot.y - 28, "Order of removal", 12, weight="bold")
    write_order(page, _LIST_X, slot.y, report.order)
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
    if radius >= _NAMED:
        place = (x + radius + 3, y - radius * 0.75)
        _write_label(axes, node.label, place, "left")


def _write_label(axes: Axes, label: int, place: tuple[float, float], ha: str) -> None:
    axes.text(
        *place,
        f"#{label}",
        color="white",
        fontsize=8.5,
        weight="bold",
        ha=ha,
        va="center",
        zorder=7,
        path_effects=[withStroke(linewidth=2.6, foreground=hex_color(INK))],
    )


def _draw_legend(page: Page, slot: Slot) -> None:
    parts = (
        ("disc: turn, label beside it", INK),
        ("arrow: rests on (thicker: surer, dashed: leans)", INK),
        ("bars: lies on the ground", INK),
        *DOUBT_KEY,
    )
    page.row(_FRAME, slot.y + slot.height + 14, parts, 9.5, gap=18)
