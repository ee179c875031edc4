"""A recorded run from above: what stood there, the drop-offs, what was put down."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from PIL import Image

from debrisgrasp._arrays import FloatArray
from debrisgrasp._words import arm_called

from .colors import CHOSEN_COLOR, GROUND_COLOR

__all__ = ["map_key", "map_svg"]

_LOW, _HIGH = np.array([-0.4, -1.6]), np.array([2.1, 1.6])
"""What is shown of the ground at least, base frame at the first look [m]."""
_CELL = 0.02
"""[m]."""
_ABOVE = 0.02
"""What is higher than this is no ground [m]."""
_TALL = 0.5
"""What is as high as this is darkest [m]."""
_SCALE = 150.0
"""Widths of the picture for each metre, as long as it is no wider than the page."""
_WIDEST = 980.0
_AREA = 0.25
"""Radius of the circle that stands for a drop-off [m]."""
_BESIDE = 0.2
"""Room beside that for its name [m]."""
_DROP, _PLACED, _PUSHED, _ROBOT = "#4f9aa8", "#2f7d4f", "#7a6248", "#5d6878"
_TAKEN = "#2c4f9e"
_MESH = 0.5
"""Between the lines of the grid [m]."""
_LIGHTEST, _DARKEST = 0.95, 0.35
"""Brightness of what is lowest, and of what is highest."""
_GROUND = np.minimum(1.05 * np.asarray(GROUND_COLOR), 1.0)


@dataclass(frozen=True, slots=True)
class _Frame:
    """What part of the ground is shown, and how large."""

    low: FloatArray
    """Of x and y, base frame at the first look [m], shape (2,)."""
    high: FloatArray

    @classmethod
    def around(cls, places: Sequence[tuple[float, float]]) -> _Frame:
        """Show the ground where piles are, and all of some places."""
        shown = np.reshape(places, (-1, 2))
        low = np.minimum(_LOW, (shown - _AREA - _BESIDE).min(axis=0, initial=np.inf))
        high = np.maximum(_HIGH, (shown + _AREA + _BESIDE).max(axis=0, initial=-np.inf))
        return cls(low, low + np.ceil((high - low) / _CELL - 1e-6) * _CELL)

    @property
    def scale(self) -> float:
        """Widths of the picture for each metre."""
        return min(_SCALE, _WIDEST / float((self.high - self.low)[1]))

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the picture."""
        height, width = (self.scale * (self.high - self.low)).tolist()
        return width, height

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Where a place of the base frame [m] is in the picture."""
        return self.scale * (self.high[1] - y), self.scale * (self.high[0] - x)


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
    drop_offs, places = dict(_drop_offs(events)), list(_places(events))
    taken = list(_taken(events))
    pushes = list(_pushes(events))
    if points is None and not drop_offs and not places:
        return ""
    ends = [place for _, place in places] + [place for _, _, place in pushes]
    frame = _Frame.around([*drop_offs.values(), *ends])
    parts = [] if points is None else [_ground(points, frame)]
    parts.append(_grid(frame))
    parts += [_circle(frame, *place) for place in drop_offs.values()]
    parts += [_number(number, _TAKEN, frame, place) for number, place in taken]
    parts += [_number(number, _PLACED, frame, place) for number, place in places]
    for number, begin, end in pushes:
        parts += [_line(frame, begin, end), _number(number, _PUSHED, frame, end)]
    parts += [_label(arm, frame, *place) for arm, place in drop_offs.items()]
    x, y = frame.at(0.0, 0.0)
    parts.append(
        f'<path d="M{x:.0f} {y - 14:.0f}l10 20h-20z" fill="{_ROBOT}"/>'
        f'<text class="label" x="{x:.0f}" y="{y + 22:.0f}" '
        'text-anchor="middle">robot</text>'
    )
    width, height = frame.size
    bar = 0.5 * frame.scale
    parts.append(
        f'<path d="M10 {height - 16:.0f}v6h{bar:.1f}v-6" fill="none" '
        f'stroke="{_ROBOT}" stroke-width="1.5"/>'
        f'<text class="label" x="{10 + bar / 2:.1f}" y="{height - 16:.0f}" '
        'text-anchor="middle">0.5 m</text>'
    )
    return (
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}" style="max-width:{width:.0f}px">'
        f"{''.join(parts)}</svg>"
    )


def map_key(*, has_pushes: bool = False) -> str:
    """Say what is what in the picture, as HTML for a paragraph."""
    low, high = (
        _css(share * np.asarray(CHOSEN_COLOR)) for share in (_LIGHTEST, _DARKEST)
    )
    items = [
        (f"background:{_css(_GROUND)}", "ground"),
        (
            f"width:60px;background:linear-gradient(90deg,{low},{high})",
            f"{_ABOVE:g} m to {_TALL:g} m high and more, at the first look",
        ),
        (f"border:1.5px dashed {_DROP};border-radius:50%", "drop-off"),
        (f"background:{_TAKEN};border-radius:50%", "gripped at, by attempt"),
        (f"background:{_PLACED};border-radius:50%", "let go, by attempt"),
    ]
    if has_pushes:
        items.append((f"background:{_PUSHED};border-radius:50%", "pushed to there"))
    return "".join(f'<span><i style="{look}"></i>{name}</span>' for look, name in items)


def _css(color: FloatArray) -> str:
    red, green, blue = np.rint(255.0 * color).astype(int).tolist()
    return f"rgb({red},{green},{blue})"


def _ground(points: FloatArray, frame: _Frame) -> str:
    """Picture of the highest points of each cell, the higher the darker."""
    shape = np.rint((frame.high - frame.low) / _CELL).astype(np.intp)
    cell = np.floor((frame.high - points[:, :2]) / _CELL)
    inside = (
        np.isfinite(points).all(axis=1) & (cell >= 0).all(1) & (cell < shape).all(1)
    )
    heights = np.full(shape, -np.inf)
    np.maximum.at(heights, tuple(cell[inside].astype(np.intp).T), points[inside, 2])
    colors = np.full((*shape, 3), 0.97)
    colors[np.isfinite(heights)] = _GROUND
    is_thing = heights > _ABOVE
    share = np.clip(heights[is_thing] / _TALL, 0.0, 1.0)[:, None]
    brightness = _LIGHTEST + (_DARKEST - _LIGHTEST) * share
    colors[is_thing] = brightness * np.asarray(CHOSEN_COLOR)
    stream = io.BytesIO()
    Image.fromarray(np.rint(255.0 * colors).astype(np.uint8)).save(stream, format="PNG")
    data = base64.b64encode(stream.getvalue()).decode()
    width, height = frame.size
    return (
        f'<image width="{width:.0f}" height="{height:.0f}" '
        f'href="data:image/png;base64,{data}"/>'
    )


def _drop_offs(
    events: Sequence[Mapping[str, Any]],
) -> Iterator[tuple[str, tuple[float, float]]]:
    """Find the drop-off of each arm in use [m]."""
    tested: Mapping[str, Any] = next(
        (e for e in events if e.get("event") == "done" and e["state"] == "self_test"),
        {},
    )
    for arm, facts in tested.items():
        if isinstance(facts, Mapping) and "drop_off" in facts:
            x, y = facts["drop_off"]
            yield arm, (x, y)


def _circle(frame: _Frame, x: float, y: float) -> str:
    """Draw a circle around a drop-off."""
    (x, y), radius = frame.at(x, y), frame.scale * _AREA
    return (
        f'<circle cx="{x:.0f}" cy="{y:.0f}" r="{radius:.0f}" fill="none" '
        f'stroke="{_DROP}" stroke-width="1.5" stroke-dasharray="5 4"/>'
    )


def _label(arm: str, frame: _Frame, x: float, y: float) -> str:
    """Name the drop-off of an arm below its circle, over whatever was put down."""
    (x, y), radius = frame.at(x, y), frame.scale * _AREA
    return (
        f'<text class="label" x="{x:.0f}" y="{y + radius + 15:.0f}" '
        f'text-anchor="middle">drop-off, {escape(arm_called(arm))}</text>'
    )


def _places(
    events: Sequence[Mapping[str, Any]],
) -> Iterator[tuple[int, tuple[float, float]]]:
    """Find where the hand let go [m], with the number of the attempt."""
    number = 1
    for event, gone in _along(events):
        number += event.get("event") == "attempt"
        is_let_go = event.get("event") == "done" and event["state"] == "release"
        if is_let_go and "place" in event:
            yield number, (event["place"][0] + gone, event["place"][1])


def _along(
    events: Sequence[Mapping[str, Any]],
) -> Iterator[tuple[Mapping[str, Any], float]]:
    """Give each event with how far the base had gone ahead by its end [m]."""
    gone = 0.0
    for event in events:
        if event.get("event") == "done":
            gone += float(event.get("moved", 0.0))
        yield event, gone


def _taken(
    events: Sequence[Mapping[str, Any]],
) -> Iterator[tuple[int, tuple[float, float]]]:
    """Find the middles of what was gripped at [m], with the number of the attempt."""
    for event, gone in _along(events):
        is_grip = event.get("event") == "attempt" and event.get("prototype")
        if is_grip and event.get("centroid"):
            x, y, _ = event["centroid"]
            yield event["number"], (x + gone, y)


def _pushes(
    events: Sequence[Mapping[str, Any]],
) -> Iterator[tuple[int, tuple[float, float], tuple[float, float]]]:
    """Find from where to where objects were pushed [m], with the attempt's number."""
    way = np.zeros(3)
    for event, gone in _along(events):
        if event.get("event") == "done" and event["state"] == "push":
            way = np.array(event.get("way", way))
        is_push = event.get("event") == "attempt" and event.get("pushed")
        if is_push and way.any() and event.get("centroid"):
            begin = np.array(event["centroid"][:2]) + np.array([gone, 0.0])
            end = begin + event["pushed"] * way[:2] / np.linalg.norm(way)
            (x0, y0), (x1, y1) = begin.tolist(), end.tolist()
            yield event["number"], (x0, y0), (x1, y1)


def _grid(frame: _Frame) -> str:
    """Draw lines of equal x and y, named at the left and the upper edge."""
    (x0, y0), (x1, y1) = frame.low.tolist(), frame.high.tolist()
    width, height = frame.size
    parts = []
    for x in np.arange(np.ceil(x0 / _MESH), np.floor(x1 / _MESH) + 1) * _MESH:
        _, v = frame.at(x, 0.0)
        parts.append(f'<path d="M0 {v:.1f}H{width:.0f}" stroke="#0001"/>')
        if 16.0 < v < height - 36.0:
            text = f'<text class="label" x="4" y="{v + 4:.0f}">x {x + 0.0:g}</text>'
            parts.append(text)
    for y in np.arange(np.ceil(y0 / _MESH), np.floor(y1 / _MESH) + 1) * _MESH:
        u, _ = frame.at(0.0, y)
        parts.append(f'<path d="M{u:.1f} 0V{height:.0f}" stroke="#0001"/>')
        if 40.0 < u < width - 20.0:
            parts.append(
                f'<text class="label" x="{u:.0f}" y="13" '
                f'text-anchor="middle">y {y + 0.0:g}</text>'
            )
    return "".join(parts)


def _line(frame: _Frame, begin: tuple[float, float], end: tuple[float, float]) -> str:
    """Draw the way of what was pushed."""
    (x0, y0), (x1, y1) = frame.at(*begin), frame.at(*end)
    return (
        f'<path d="M{x0:.0f} {y0:.0f}L{x1:.0f} {y1:.0f}" stroke="{_PUSHED}" '
        'stroke-width="3"/>'
    )


def _number(number: int, color: str, frame: _Frame, place: tuple[float, float]) -> str:
    """Mark a place with the number of an attempt."""
    x, y = frame.at(*place)
    return (
        f'<circle cx="{x:.0f}" cy="{y:.0f}" r="9" fill="{color}"/>'
        f'<text x="{x:.0f}" y="{y + 4:.0f}" text-anchor="middle" '
        f'style="fill:#fff">{number}</text>'
    )
