"""A page of pictures and words whose parts are placed in pixels."""

from __future__ import annotations

import io
import os
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from debrisgrasp._arrays import FloatArray
from debrisgrasp._files import require_picture, write_atomic
from debrisgrasp._words import as_text
from debrisgrasp.segmentation import Candidate, Segmentation

from .colors import CHOSEN_COLOR, INK, MUTED_INK, hex_color, label_colors, mixed
from .overlay import LabelImage, label_anchors, painted
from .words import UNSURE

__all__ = [
    "Page",
    "Slot",
    "draw_picture",
    "draw_segments",
    "plain",
    "short_name",
    "shortened",
    "wrapped",
    "write_order",
]

_DPI = 100
_FOOT = 30
"""Margin that a list keeps at the right and at the foot [pixels]."""
_LINE, _GAP = 20.0, 5.0
"""Height of a line of a list of reasons, and the gap between its entries [pixels]."""


@dataclass(frozen=True, slots=True)
class Slot:
    """A rectangle of a page [pixels], measured from the top left corner."""

    x: float
    y: float
    width: float
    height: float

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in whole pixels."""
        return int(self.width), int(self.height)


class Page:
    """A white figure of a fixed size, independent of the state of pyplot."""

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self.figure = Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI)
        FigureCanvasAgg(self.figure)

    def text(
        self,
        x: float,
        y: float,
        text: str,
        size: float = 11.0,
        *,
        color: Sequence[float] = INK,
        ha: str = "left",
        weight: str = "normal",
    ) -> None:
        """Write text whose top edge is at y, and whose side ``ha`` is at x."""
        self.figure.text(
            x / self.width,
            1.0 - y / self.height,
            plain(text),
            fontsize=size,
            color=hex_color(color),
            ha=ha,
            va="top",
            weight=weight,
            linespacing=1.45,
        )

    def row(
        self,
        x: float,
        y: float,
        parts: Iterable[tuple[str, Sequence[float]]],
        size: float = 11.0,
        *,
        gap: float = 20.0,
        weight: str = "normal",
    ) -> None:
        """Write texts, each in its colour, beside one another with equal gaps."""
        for text, color in parts:
            self.text(x, y, text, size, color=color, weight=weight)
            drawn = self.figure.texts[-1]
            # By their base lines: the tops of the letters differ from text to text.
            drawn.set(va="baseline", y=1.0 - (y + 1.35 * size) / self.height)
            x += drawn.get_window_extent().width + gap

    def titled_panel(self, slot: Slot, title: str, note: str = "") -> Axes:
        """Panel with a heading above it, and a short note at its right end."""
        self.text(slot.x, slot.y - 25, title, 12, weight="bold")
        right = slot.x + slot.width
        self.text(right, slot.y - 23, note, 10, color=MUTED_INK, ha="right")
        return self.panel(slot)

    def scaled_panel(
        self, slot: Slot, title: str, x_label: str, steps: tuple[int, int] = (6, 6)
    ) -> Axes:
        """Panel with a heading, a grid, and scales of at most so many steps."""
        axes = self.titled_panel(slot, title)
        for axis, most in zip((axes.xaxis, axes.yaxis), steps, strict=True):
            axis.set_major_locator(MaxNLocator(most))
        axes.set_xlim(auto=True)
        axes.set_ylim(auto=True)
        axes.invert_yaxis()
        axes.tick_params(labelsize=9.5, colors=hex_color(MUTED_INK), length=3)
        axes.grid(color="#dfe3e9", linewidth=0.8)
        axes.set_axisbelow(True)
        axes.set_xlabel(x_label, fontsize=10, color=hex_color(MUTED_INK))
        return axes

    def panel(self, slot: Slot) -> Axes:
        """Axes without marks, one unit per pixel, y downwards."""
        axes = self.figure.add_axes(
            (
                slot.x / self.width,
                1.0 - (slot.y + slot.height) / self.height,
                slot.width / self.width,
                slot.height / self.height,
            )
        )
        axes.set_xticks([])
        axes.set_yticks([])
        axes.set_xlim(0, slot.width)
        axes.set_ylim(slot.height, 0)
        for spine in axes.spines.values():
            spine.set_color("#c9ced6")
        return axes

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the page as a PNG, whole or not at all; its name ends in .png."""
        require_picture(path, (".png",), "a picture")
        stream = io.BytesIO()
        # The default metadata name the version of the plotting library.
        self.figure.savefig(stream, format="png", metadata={"Software": ""})
        write_atomic(path, stream.getvalue())


def shortened(text: str, length: int) -> str:
    """Cut text to at most ``length`` characters, with an ellipsis."""
    return text if len(text) <= length else text[: length - 1] + "…"


def short_name(name: str, length: int) -> str:
    """Cut the middle out of a name that is too long: like names differ at their ends.

    Examples
    --------
    >>> short_name("jaw_cylinder_040_end_deep", 16)
    'jaw_cyli…nd_deep'
    """
    if len(name) <= length:
        return name
    tail = (length - 1) // 2
    return f"{name[: length - 1 - tail]}…{name[-tail:]}"


def wrapped(paragraphs: Iterable[str], columns: int, most_lines: int) -> str:
    """Break paragraphs into lines; what does not fit is cut with an ellipsis."""
    lines = [
        line for text in paragraphs for line in textwrap.wrap(text, columns) or [""]
    ]
    if len(lines) > most_lines:
        lines = [*lines[: most_lines - 1], lines[most_lines - 1][: columns - 2] + " …"]
    return "\n".join(lines)


def draw_picture(
    axes: Axes, colors: FloatArray, slot: Slot
) -> tuple[float, float, float]:
    """Fit a picture (H, W, 3) into a panel, centred, without distortion.

    Returns
    -------
    scale, left, top
        Panel coordinates are ``left + scale * u`` and ``top + scale * v``.
    """
    height, width = colors.shape[:2]
    scale = min(slot.width / width, slot.height / height)
    left, top = (slot.width - scale * width) / 2, (slot.height - scale * height) / 2
    axes.imshow(
        colors,
        extent=(left, left + scale * width, top + scale * height, top),
        interpolation="antialiased" if scale != 1.0 else "nearest",
        aspect="auto",
    )
    axes.set_xlim(0, slot.width)
    axes.set_ylim(slot.height, 0)
    return scale, left, top


def draw_segments(
    axes: Axes,
    image: LabelImage,
    slot: Slot,
    *,
    chosen: int,
    order: Sequence[Candidate],
    segmentation: Segmentation | None = None,
) -> None:
    """Draw the segments in colours, with their labels and places in the order.

    Parameters
    ----------
    axes, slot
        Panel to draw into, and its place on the page.
    image
        Picture and labels.
    chosen
        Label of the object to outline; 0 for none.
    order
        Objects in the order in which they would be taken.
    segmentation
        What the labels are of, to mark its doubts (`DOUBT_KEY`); None marks none.
    """
    edges = None if segmentation is None else segmentation.edges
    segments = () if segmentation is None else segmentation.segments
    unsure = {s.label for s in segments if s.certainty < UNSURE}
    scale, left, top = draw_picture(axes, painted(image, chosen, edges), slot)
    axes.set_facecolor("#21262d")
    place = {item.label: number for number, item in enumerate(order, start=1)}
    anchors = label_anchors(image.labels)
    last = len(order) + 1
    written: list[tuple[float, float]] = []
    # The chosen object first, then in the order of removal; what would overlap a label
    # that is already written is left out.
    for label in sorted(anchors, key=lambda k: (k != chosen, place.get(k, last), k)):
        is_chosen = label == chosen
        u, v = anchors[label]
        x = min(max(left + scale * (u + 0.5), 34.0), slot.width - 34.0)
        y = min(max(top + scale * (v + 0.5), 11.0), slot.height - 11.0)
        if any(abs(x - p) < 62 and abs(y - q) < 17 for p, q in written):
            continue
        written.append((x, y))
        number = f"{place[label]}: " if label in place else ""
        axes.text(
            x,
            y,
            f"{number}#{label}{'?' * (label in unsure)}",
            fontsize=12.5 if is_chosen else 9.5,
            weight="bold",
            color="white",
            ha="center",
            va="center",
            path_effects=[
                withStroke(
                    linewidth=3.0,
                    foreground=hex_color(
                        np.asarray(CHOSEN_COLOR) * 0.75 if is_chosen else INK
                    ),
                )
            ],
        )


def write_order(page: Page, x: float, y: float, order: Sequence[Candidate]) -> None:
    """List objects with their turns and reasons down to the foot of the page.

    Only whole entries are written; of those left, the last line gives the number.
    """
    columns = int((page.width - _FOOT - x - 66) / 7.9)
    for turn, item in enumerate(order, start=1):
        text = wrapped([item.reason], columns, 4)
        height = _LINE * (text.count("\n") + 1) + _GAP
        rest = _LINE if turn < len(order) else 0.0
        if y + height + rest > page.height - _FOOT:
            left = f"and {len(order) - turn + 1} more"
            page.text(x, y, left, 10.5, weight="bold")
            return
        own = CHOSEN_COLOR if turn == 1 else label_colors(item.label)
        color = tuple(mixed(own, (0, 0, 0), 0.3))
        page.text(x, y, f"{turn}", 11, color=color, weight="bold")
        page.text(x + 26, y, f"#{item.label}", 10.5, weight="bold")
        page.text(x + 66, y, text, 10.5)
        y += height


def plain(text: str) -> str:
    """Escape text so that it is not read as a formula, whatever names it holds."""
    return as_text(text).replace("$", r"\$")
