"""A recorded run from above: what stood there, the drop-offs, what was put down."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
from PIL import Image

from debrisgrasp._arrays import FloatArray

from .colors import CHOSEN_COLOR, GROUND_COLOR

__all__ = ["map_svg"]

_LOW, _HIGH = np.array([-0.4, -1.6]), np.array([2.1, 1.6])
"""What is shown of the ground, base frame at the first look [m]."""
_CELL = 0.02
"""[m]."""
_ABOVE = 0.02
"""What is higher than this is no ground [m]."""
_TALL = 0.5
"""What is as high as this is darkest [m]."""
_SCALE = 150.0
"""Widths of the picture for each metre."""
_AREA = 0.25
"""Radius of the circle that stands for a drop-off [m]."""
_DROP, _PLACED = "#4f9aa8", "#2f7d4f"


def map_svg(events: Sequence[Mapping[str, Any]], points: FloatArray | None) -> str:
    """Draw a run from above, ahead of the robot upwards.

    Parameters
    ----------
    events
        Of the record.
    points
        What the first look saw, base frame [m], shape (n, 3); None if nothing is known.

    Returns
    -------
    str
        SVG; empty if there is nothing to show.
    """
    parts = [_ground(points)] if points is not None else []
    parts += [*_drop_offs(events), *_places(events)]
    if not parts:
        return ""
    x, y = _at(0.0, 0.0)
    parts.append(
        f'<path d="M{x:.0f} {y - 14:.0f}l10 20h-20z" fill="#5d6878"/>'
        f'<text x="{x + 14:.0f}" y="{y + 4:.0f}">robot</text>'
    )
    height, width = _SCALE * (_HIGH - _LOW)
    return (
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}" style="max-width:{width:.0f}px">'
        f"{''.join(parts)}</svg>"
    )


def _at(x: float, y: float) -> tuple[float, float]:
    """Where a place of the base frame [m] is in the picture."""
    return _SCALE * (_HIGH[1] - y), _SCALE * (_HIGH[0] - x)


def _ground(points: FloatArray) -> str:
    """Picture of the highest points of each cell, the higher the darker."""
    shape = np.rint((_HIGH - _LOW) / _CELL).astype(np.intp)
    cell = np.floor((_HIGH - points[:, :2]) / _CELL)
    inside = (
        np.isfinite(points).all(axis=1) & (cell >= 0).all(1) & (cell < shape).all(1)
    )
    heights = np.full(shape, -np.inf)
    np.maximum.at(heights, tuple(cell[inside].astype(np.intp).T), points[inside, 2])
    colors = np.full((*shape, 3), 0.97)
    colors[np.isfinite(heights)] = np.minimum(1.05 * np.asarray(GROUND_COLOR), 1.0)
    is_thing = heights > _ABOVE
    share = np.clip(heights[is_thing] / _TALL, 0.0, 1.0)[:, None]
    colors[is_thing] = (0.95 - 0.6 * share) * np.asarray(CHOSEN_COLOR)
    stream = io.BytesIO()
    Image.fromarray(np.rint(255.0 * colors).astype(np.uint8)).save(stream, format="PNG")
    data = base64.b64encode(stream.getvalue()).decode()
    height, width = _SCALE * (_HIGH - _LOW)
    return (
        f'<image width="{width:.0f}" height="{height:.0f}" '
        f'href="data:image/png;base64,{data}"/>'
    )


def _drop_offs(events: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Draw a circle around the drop-off of each arm in use."""
    tested: Mapping[str, Any] = next(
        (e for e in events if e.get("event") == "done" and e["state"] == "self_test"),
        {},
    )
    for arm, facts in tested.items():
        if not isinstance(facts, Mapping) or "drop_off" not in facts:
            continue
        x, y = _at(*facts["drop_off"])
        yield (
            f'<circle cx="{x:.0f}" cy="{y:.0f}" r="{_SCALE * _AREA:.0f}" fill="none" '
            f'stroke="{_DROP}" stroke-width="1.5" stroke-dasharray="5 4"/>'
            f'<text x="{x:.0f}" y="{y + _SCALE * _AREA + 13:.0f}" '
            f'text-anchor="middle">drop-off, {escape(arm)} arm</text>'
        )


def _places(events: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Mark where the hand let go, with the number of the attempt."""
    number, gone = 1, 0.0
    for event in events:
        number += event.get("event") == "attempt"
        if event.get("event") != "done":
            continue
        gone += float(event.get("moved", 0.0))  # of the base, ahead
        if event["state"] == "release" and "place" in event:
            x, y = _at(event["place"][0] + gone, event["place"][1])
            yield (
                f'<circle cx="{x:.0f}" cy="{y:.0f}" r="9" fill="{_PLACED}"/>'
                f'<text x="{x:.0f}" y="{y + 4:.0f}" text-anchor="middle" '
                f'style="fill:#fff">{number}</text>'
            )
