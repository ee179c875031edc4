"""A recorded run as one page: timeline, a picture of each grasp, forces, faults."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence, Set
from html import escape
from typing import Any, Protocol

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._files import naming_fields
from debrisgrasp._words import arm_called, counted
from debrisgrasp.prototypes import GripperModel, with_shipped

from .html import write_page
from .run_events import Try, since_begun, spans_of, tries_of
from .run_map import map_key, map_svg
from .run_scene import scene_image

__all__ = ["run_html"]

_GROUPS = {
    "look": ("self_test", "calib_check", "capture", "segment"),
    "plan": ("select", "plan_grasp", "plan_motion"),
    "grasp": ("pregrasp", "switch", "approach", "close", "verify_grasp"),
    "carry": ("lift", "verify_hold", "transport"),
    "push": ("push",),
    "release": ("release", "verify_release", "retreat"),
    "recover": ("recover", "safe_stop", "abort"),
}
_COLORS = {
    "look": "#8fa8c8",
    "plan": "#c3b2d9",
    "grasp": "#e3a857",
    "carry": "#6fae7f",
    "push": "#9c8468",
    "release": "#4f9aa8",
    "recover": "#c94f4f",
    "other": "#bbbbbb",
}
_FAULT = "#b23b3b"
_STYLE = """
body{font:15px/1.45 system-ui,sans-serif;color:#1d2430;background:#f6f7f9;margin:0}
main{max-width:1060px;margin:0 auto;padding:26px 22px 60px}
h1{font-size:25px;margin:0 0 4px}h2{font-size:18px;margin:30px 0 8px}
.note{color:#5d6878;margin:0 0 18px}
.card{background:#fff;border:1px solid #e0e4ea;border-radius:8px;padding:14px 16px;
margin:0 0 16px}
.try{display:grid;grid-template-columns:420px 1fr;gap:18px}
.try>div{min-width:0}td:nth-child(3){min-width:150px}
.try img{width:420px;max-width:100%;border-radius:5px;display:block}
.none{background:#eef0f4;border-radius:5px;height:120px;display:flex;color:#7a8494;
align-items:center;justify-content:center}
h3{margin:0 0 4px;font-size:16px}.ok{color:#2f7d4f}.bad{color:#b23b3b}
ul{margin:6px 0;padding-left:20px}table{border-collapse:collapse;width:100%}
td,th{text-align:left;padding:4px 10px 4px 0;border-bottom:1px solid #edf0f3;
vertical-align:top}th{color:#5d6878;font-weight:600}
svg{display:block;width:100%;height:auto}svg text{font:11px system-ui;fill:#5d6878}
svg text.label{paint-order:stroke;stroke:#fff;stroke-width:3px}
.key span{display:inline-block;margin-right:16px}.key i{display:inline-block;width:11px;
height:11px;border-radius:2px;margin-right:5px;box-sizing:border-box}
.ticks{position:relative;height:17px;font-size:11px;color:#5d6878}
.ticks span{position:absolute;transform:translateX(-50%);white-space:nowrap}
.card{overflow-x:auto}.map{display:flex;flex-wrap:wrap;gap:8px 26px}
.map svg{flex:0 1 auto}.map .key{flex:1 0 200px;margin:0}
.map .key span{display:block;margin:0 0 8px}
.most{margin:6px 0 0;font-size:13px}.most span{margin-right:16px;display:inline-block}
.key:last-child{margin-bottom:2px}
@media(max-width:900px){.try{grid-template-columns:1fr}.try img{width:100%}}
@media(max-width:600px){.ticks span:nth-child(odd){display:none}
svg text.label{font-size:17px}}
"""


class RecordedRun(Protocol):
    """What the page needs of a record."""

    @property
    def inputs(self) -> Mapping[str, Any]:
        """What the run was asked for."""
        ...

    @property
    def events(self) -> Sequence[Mapping[str, Any]]:
        """What happened."""
        ...

    def capture(self, name: str) -> Any:
        """Capture by its name, or None."""
        ...


def run_html(
    path: str | os.PathLike[str],
    run: RecordedRun,
    *,
    grippers: Mapping[str, GripperModel] | None = None,
) -> None:
    """Write the page; it needs no network.

    Parameters
    ----------
    path
        Of the page.
    run
        Its record.
    grippers
        Hands that do not ship, by name; one that is in neither is not drawn.

    Raises
    ------
    ConfigError, OutputError
        If the record is damaged, or the file has another suffix or can't be written.
    """
    with naming_fields(getattr(run, "folder", "record"), "the record of a run"):
        page = _page(run, with_shipped(grippers))
    write_page(path, page)


def _page(run: RecordedRun, hands: Mapping[str, GripperModel]) -> str:
    events = since_begun(run.events)
    spans, total = spans_of(events)
    tries = tries_of(events)
    nothing: Mapping[str, Any] = {}
    end = next((e for e in reversed(run.events) if e.get("event") == "end"), nothing)
    attempts = [_card(item, run, hands) for item in tries]
    body = [
        f"<h1>{escape(_title(run.inputs))}</h1>",
        f'<p class="note">{escape(_ending(end, total))}</p>',
        _ended_by(end, tries),
        "<h2>Timeline</h2>",
        f'<div class="card">{_timeline(spans, tries, total)}</div>',
        _from_above(run, tries),
        *(["<h2>Attempts</h2>", *attempts] if attempts else []),
        _left(end.get("left") or {}),
    ]
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{escape(_title(run.inputs))}</title><style>{_STYLE}</style></head>"
        f"<body><main>{''.join(body)}</main></body></html>\n"
    )


def _title(inputs: Mapping[str, Any]) -> str:
    what = inputs.get("scene") or f"pile of seed {inputs.get('seed', 0)}"
    faults = ", ".join(inputs.get("faults") or ())
    return f"Clearing: {what}" + (f"; faults asked for: {faults}" if faults else "")


def _ending(end: Mapping[str, Any], total: float) -> str:
    if not end:
        return f"The record ends after {total:.0f} s, without an end of the run."
    words = f"{end['end']} after {total:.0f} s of the robot's time, "
    if end.get("pushed"):
        words += f"{counted(end['pushed'], 'time')} pushed aside, "
    words += f"{end['removed']} removed; "
    words += f"counts as {end['class']}" if end.get("class") else "not counted"
    if end.get("holding"):
        words += f"; STILL HELD by the hand of the {arm_called(end['holding'])}"
    return words


def _ended_by(end: Mapping[str, Any], tries: Sequence[Try]) -> str:
    """Say what fault a run ended by, if it did."""
    faults = [fault for item in tries for fault in item.faults]
    if end.get("class") in (None, "", "success") or not faults:
        return ""
    last = faults[-1]
    words = f"{last['fault']} in {last['state']}: {last['message']}"
    return f'<p class="note">ended by {escape(words)}</p>'


def _timeline(
    spans: Sequence[tuple[str, float, float]], tries: Sequence[Try], total: float
) -> str:
    """Draw the states over time, with a key to the groups that there were."""
    scale = 1000.0 / total
    group = {state: name for name, states in _GROUPS.items() for state in states}
    lasting = [span for span in spans if span[2] > span[1]]
    bars = [
        f'<rect x="{scale * a:.2f}" y="8" height="30" width="{scale * (b - a):.2f}" '
        f'fill="{_COLORS[group.get(state, "other")]}">'
        f"<title>{escape(state)}: {a:.1f} to {b:.1f} s</title></rect>"
        for state, a, b in lasting
    ]
    faults = [fault for item in tries for fault in item.faults]
    for fault in faults:
        x = min(max(scale * float(fault["time"]), 6.0), 994.0)
        bars.append(
            f'<path d="M{x:.1f} 42l5 10h-10z" fill="{_FAULT}"><title>'
            f"{escape(str(fault['fault']))}</title></path>"
        )
    shown = {group.get(state, "other") for state, _, _ in lasting}
    picture = f'<svg viewBox="0 0 1000 54">{"".join(bars)}</svg>'
    return picture + _ticks(0.0, total) + _key(shown, has_faults=bool(faults))


def _ticks(begin: float, span: float) -> str:
    """Write times below an axis: 1, 2 or 5 times a power of ten, about ten of them.

    They are no part of the picture, so that they can be read where that is small.

    Parameters
    ----------
    begin, span
        Time of the robot at which the axis begins, and its length [s].
    """
    size = 10.0 ** np.floor(np.log10(span / 10.0))
    step = next(k * size for k in (1, 2, 5, 10) if k * size >= span / 10.0)
    first = np.ceil((begin + 0.02 * span) / step)
    times = "".join(
        f'<span style="left:{100.0 * (t - begin) / span:.2f}%">{t:g} s</span>'
        for t in step * np.arange(first, (begin + 0.96 * span) / step)
    )
    return f'<div class="ticks">{times}</div>'


def _key(shown: Set[str], *, has_faults: bool) -> str:
    items = [
        f'<span><i style="background:{color}"></i>{name}</span>'
        for name, color in _COLORS.items()
        if name in shown
    ]
    if has_faults:
        items.append(f'<span><b style="color:{_FAULT}">&#9650;</b> fault</span>')
    return f'<p class="key">{"".join(items)}</p>'


def _from_above(run: RecordedRun, tries: Sequence[Try]) -> str:
    """Show the pile at the first look, and where its objects were put down."""
    name = next((item.capture for item in tries if item.capture), "")
    capture = run.capture(name) if name else None
    picture = map_svg(run.events, None if capture is None else capture.cloud().points)
    if not picture:
        return ""
    has_pushes = any(item.facts.get("pushed") for item in tries)
    return (
        f'<h2>From above</h2><div class="card map">{picture}'
        f'<p class="key">{map_key(has_pushes=has_pushes)}</p></div>'
    )


def _card(item: Try, run: RecordedRun, hands: Mapping[str, GripperModel]) -> str:
    is_removed = bool(item.facts.get("removed"))
    fate, pushed = "removed" if is_removed else "not removed", item.facts.get("pushed")
    if pushed:
        fate = f"pushed aside by {100 * pushed:.0f} cm"
    style = "ok" if is_removed or pushed else "bad"
    lines = []
    if item.object is not None and item.object.get("object"):
        x, y, z = (round(float(v), 2) + 0.0 for v in item.object["centroid"])
        name = f"object {item.object['object']}"
        if "look" in item.object:  # not in older records
            name += f" of look {item.object['look']}"
        lines.append(f"{name} at ({x:.2f}, {y:.2f}, {z:.2f})")
        lines.append(f"by the order of removal: {item.object['why_it']}")
        lines.append(f"what suits it: {item.object['way']}; {item.object['why_so']}")
    if item.grasp is not None:
        g = item.grasp
        lines.append(
            f"gripped by {g['prototype']} ({g['gripper']} {g['preshape']}) with the "
            f"{arm_called(str(g['arm']))}, score {g['score']:.2f}"
        )
    if item.push is not None:
        p = item.push
        side = "left" if p["way"][1] > 0.0 else "right"
        lines.append(
            f"pushed to the {side} with the closed hand ({p['gripper']}) of the "
            f"{arm_called(str(p['arm']))}" + (f": {p['why']}" if "why" in p else "")
        )
    faults = "".join(
        f"<tr><td>{escape(f['state'])}</td><td>{escape(f['fault'])}</td>"
        f"<td>{escape(f['message'])}</td><td>{escape(f['action'])}</td></tr>"
        for f in item.faults
    )
    table = (
        f"<table><tr><th>state</th><th>fault</th><th>evidence</th><th>answer</th></tr>"
        f"{faults}</table>"
        if faults
        else ""
    )
    text = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return (
        f'<div class="card try"><div>{_picture(item, run, hands)}</div><div>'
        f'<h3>{item.number}. <span class="{style}">{fate}</span></h3>'
        f"<ul>{text}</ul>{_forces(item.traces)}{table}</div></div>"
    )


def _forces(traces: Sequence[FloatArray]) -> str:
    """Force and torque at the hand, at the times of the timeline."""
    if sum(map(len, traces)) < 2:
        return ""
    values = np.concatenate(traces)
    begin, span = float(values[0, 0]), max(float(np.ptp(values[:, 0])), 1e-9)
    curves, words = "", ""
    for column, color, unit, top in (
        (1, "#c2702a", "N", 150.0),
        (2, "#3b6ea5", "N m", 40.0),
    ):
        largest = float(values[:, column].max())
        most = max(top, largest)
        digits = ".0f" if largest >= 1.0 else ".1f"
        for rows in traces:
            x = 560.0 / span * (rows[:, 0] - begin)
            y = 110.0 - 100.0 * rows[:, column] / most
            points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
            curves += (
                f'<polyline points="{points}" fill="none" stroke="{color}" '
                'stroke-width="1.3"/>'
            )
        words += (
            f'<span style="color:{color}">at most {largest:{digits}} {unit} '
            f"(full height {most:.0f} {unit})</span>"
        )
    frame = '<path d="M0 10V110H560" fill="none" stroke="#c9cfd8"/>'
    picture = f'<svg viewBox="0 0 560 112">{frame}{curves}</svg>'
    return f'<p class="most">{words}</p>{picture}{_ticks(begin, span)}'


def _picture(item: Try, run: RecordedRun, hands: Mapping[str, GripperModel]) -> str:
    """Draw the scene with the hand where it was to grip, or began to push."""
    hand = item.grasp if item.push is None else item.push
    capture = run.capture(item.capture) if item.capture else None
    if hand is None or capture is None:
        why = "no grasp was found" if hand is None else "no capture was recorded"
        return f'<div class="none">{why}</div>'
    model = hands.get(hand["gripper"])
    if model is None:
        why = f"{hand['gripper']} is not known: give run_html its model (grippers)"
        return f'<div class="none">{escape(why)}</div>'
    centroid = None if item.object is None else item.object.get("centroid")
    data = scene_image(capture.cloud().points, hand, model, centroid)
    return f'<img alt="hand at the object" src="data:image/jpeg;base64,{data}">'


def _left(left: Mapping[str, str]) -> str:
    if not left:
        return ""
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td>{escape(reason)}</td></tr>"
        for name, reason in left.items()
    )
    return (
        '<h2>What stays</h2><div class="card"><table><tr><th>object</th><th>why</th>'
        f"</tr>{rows}</table></div>"
    )
