"""The selection report as one page for the browser, which needs nothing but itself."""

from __future__ import annotations

import base64
import io
import os
from html import escape

import numpy as np
from PIL import Image

from debrisgrasp._checked import checked

from .colors import CHOSEN_COLOR, hex_color, label_colors, mixed
from .html import with_head, write_page
from .support_layer import Arrow, Node, SelectionReport, SupportLayer
from .words import doubt_line

__all__ = ["selection_html"]

_RADII = (1.0 / 130.0, 1.0 / 65.0)
"""Of the discs of the smallest and of large objects, as a share of the width."""


@checked
def selection_html(path: str | os.PathLike[str], report: SelectionReport) -> None:
    """Write who lies on whom as a page; pointing at an object shows its relations.

    Parameters
    ----------
    path
        Where to write; an existing file is replaced only when the page is complete.
    report
        What to show.

    Raises
    ------
    ConfigError, OutputError
        If the file has another suffix, or can't be written.
    """
    n = len(report.segmentation.segments)
    layer = SupportLayer.of(report)
    parts = {
        "note": f"{n} object{'s' * (n != 1)}, order of removal",
        "doubt": escape(doubt_line(report.segmentation)),
        "picture": _picture(layer),
        "rows": "\n".join(_rows(report)),
    }
    write_page(path, with_head("selection.html", report.title, parts))


def _rows(report: SelectionReport) -> list[str]:
    """One row of the table for each object."""
    rows = []
    for turn, item in enumerate(report.order, start=1):
        weight, load = (
            _span(low, high)
            for low, high in (
                report.support.weight[item.label - 1],
                report.support.load[item.label - 1],
            )
        )
        cells = "".join(
            f'<td class="number">{escape(str(text))}</td>'
            for text in (turn, item.label, weight, load)
        )
        key = f'data-node="{item.label}" data-of="{item.label}"'
        rows.append(f"<tr {key}>{cells}<td>{escape(item.reason)}</td></tr>")
    return rows


def _span(low: float, high: float) -> str:
    """Format bounds of a force [N]."""
    if high < 0.5:
        return "<1" if high > 0 else "0"
    return f"{low:.0f}–{high:.0f}"


def _picture(layer: SupportLayer) -> str:
    """Picture with nodes and arrows over it, as SVG."""
    height, width = layer.colors.shape[:2]
    stream = io.BytesIO()
    pixels = np.rint(np.clip(layer.colors, 0.0, 1.0) * 255).astype(np.uint8)
    Image.fromarray(pixels).save(stream, format="JPEG", quality=90, subsampling=0)
    jpeg = base64.b64encode(stream.getvalue()).decode()
    large = _RADII[1] * width
    related: dict[int, set[int]] = {label: {label} for label in layer.nodes}
    for arrow in layer.arrows:
        related[arrow.above.label].add(arrow.below.label)
        related[arrow.below.label].add(arrow.above.label)
    return "\n".join(
        [
            f'<svg viewBox="0 0 {width} {height}" role="img">',
            f'<image href="data:image/jpeg;base64,{jpeg}" '
            f'width="{width}" height="{height}"/>',
            *(_arrow(arrow, large) for arrow in layer.arrows),
            *(_node(n, width, related[n.label]) for n in layer.nodes.values()),
            "</svg>",
        ]
    )


def _arrow(arrow: Arrow, radius: float) -> str:
    start = np.array([arrow.above.u, arrow.above.v])
    end = np.array([arrow.below.u, arrow.below.v])
    length = max(float(np.linalg.norm(end - start)), 1e-6)
    along = (end - start) / length
    across = np.array([-along[1], along[0]])
    width = radius * (0.12 + 0.25 * arrow.confidence)
    start, tip = start + radius * along, end - 1.1 * radius * along
    neck = tip - 0.9 * radius * along
    points = (tip, neck + 0.45 * radius * across, neck - 0.45 * radius * across)
    head = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    dash = f' stroke-dasharray="{radius * 0.5:.1f}"' if arrow.is_leaning else ""
    verb = "leans" if arrow.is_leaning else "rests"
    above, below = arrow.above.label, arrow.below.label
    return (
        f'<g class="arrow" data-of="{above} {below}" '
        f'opacity="{0.4 + 0.6 * arrow.confidence:.2f}">'
        f"<title>{above} {verb} on {below}: {100 * arrow.confidence:.0f} %</title>"
        f'<line x1="{start[0]:.1f}" y1="{start[1]:.1f}" x2="{neck[0]:.1f}" '
        f'y2="{neck[1]:.1f}" stroke-width="{width:.2f}"{dash}/>'
        f'<polygon points="{head}" fill="#fff" stroke="none"/></g>'
    )


def _node(node: Node, width: int, related: set[int]) -> str:
    radius = float(np.clip(0.3 * node.size, _RADII[0] * width, _RADII[1] * width))
    own = CHOSEN_COLOR if node.place == 1 else label_colors(node.label)
    fill = hex_color(mixed(own, (0, 0, 0), 0.3))
    u, v = node.u, node.v
    bars = "".join(
        f'<line class="ground" x1="{u - share * radius:.1f}" '
        f'x2="{u + share * radius:.1f}" y1="{v + radius * y:.1f}" '
        f'y2="{v + radius * y:.1f}" stroke-width="{0.13 * radius:.2f}"/>'
        for share, y in ((0.85, 1.35), (0.5, 1.65), (0.2, 1.95))
        if node.is_on_ground
    )
    text = f"{node.place or ''}{'?' * node.is_unsure}"
    keys = " ".join(str(label) for label in sorted(related))
    return (
        f'<g data-node="{node.label}" data-of="{keys}">{bars}'
        f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{radius:.1f}" fill="{fill}" '
        f'stroke-width="{0.15 * radius:.2f}"/>'
        f'<text x="{u:.1f}" y="{v:.1f}" font-size="{radius:.1f}" '
        f'style="font-size:{radius:.1f}px">{text}</text>'
        f'<text class="name" x="{u + 1.2 * radius:.1f}" y="{v - 0.8 * radius:.1f}" '
        f'style="font-size:{0.75 * radius:.1f}px;stroke-width:{0.22 * radius:.1f}px">'
        f"#{node.label}</text></g>"
    )
