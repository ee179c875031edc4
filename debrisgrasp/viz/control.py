"""Pictures of legs and of what a compliance means."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from debrisgrasp._arrays import FloatArray
from debrisgrasp._checked import checked
from debrisgrasp.control import Preview, Rehearsal
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.kinematics import LimitSet

from .colors import CHOSEN_COLOR, HAND_COLORS, INK, MUTED_INK, hex_color
from .page import Page, Slot, plain, wrapped

__all__ = ["LegTrace", "Outline", "leg_png", "preview_png"]

_COLORS = (CHOSEN_COLOR, *HAND_COLORS)
_LIMIT = "#c0392b"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LegTrace:
    """One leg as it went."""

    label: str
    run: Rehearsal


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Outline:
    """Something drawn beside the paths, seen along y."""

    points: FloatArray
    """Corners in base [m], shape (k, 3)."""
    label: str = ""
    trace: int | None = None
    """Takes the colour of that trace; None: grey."""
    is_filled: bool = False


@checked
def leg_png(
    path: str | os.PathLike[str],
    title: str,
    traces: Sequence[LegTrace],
    limits: LimitSet,
    *,
    nominal: FloatArray,
    outlines: Sequence[Outline] = (),
    note: str = "",
) -> None:
    """Write a picture of one or more runs of the same leg.

    From the side the way of the hand; over time force and torque with their limits, and
    how far the hand gave way.

    Parameters
    ----------
    nominal
        The way asked for in base [m], shape (m, 3).

    Raises
    ------
    ConfigError, OutputError
        If the file has another suffix, or can't be written.
    """
    page = Page(1500, 900)
    page.text(30, 22, title, 19, weight="bold")
    page.text(30, 62, note, 11.5, color=MUTED_INK)
    y = 96.0
    for trace, color in zip(traces, _COLORS, strict=False):
        page.text(30, y, f"━ {trace.label}: {trace.run.ending}", 12, color=color)
        y += 24
    top = y + 46
    side = Slot(80, top, 620, 900 - top - 60)
    axes = page.scaled_panel(side, "From the side", "x [m]")
    _draw_side(axes, traces, nominal, outlines)
    height = (900 - top - 60 - 2 * 54) / 3
    gives_way = any(trace.run.deflection.any() for trace in traces)
    last = ("Given way [mm]", _given_way) if gives_way else ("Speed [mm/s]", _speed)
    rows = [
        ("Force at the hand [N]", _force, limits.force),
        ("Torque at the hand [N m]", _torque, limits.torque),
        (*last, None),
    ]
    for i, (name, size_of, limit) in enumerate(rows):
        slot = Slot(800, top + i * (height + 54), 625, height)
        axes = page.scaled_panel(slot, name, "time [s]" if i == 2 else "")
        largest = 0.0
        for trace, color in zip(traces, _COLORS, strict=False):
            size = size_of(trace.run)
            largest = max(largest, float(size.max()))
            axes.plot(trace.run.time, size, color=hex_color(color), linewidth=1.8)
            axes.plot(trace.run.time[-1], size[-1], "o", color=hex_color(color), ms=5)
        axes.set_ylim(0, 1.1 * max(largest, 1.0))
        if limit is not None:
            _draw_limit(axes, limit, largest)
    if gives_way:
        _draw_turn(axes, traces)
    page.write(path)


def _force(run: Rehearsal) -> FloatArray:
    return np.asarray(np.linalg.norm(run.load[:, :3], axis=1))


def _torque(run: Rehearsal) -> FloatArray:
    return np.asarray(np.linalg.norm(run.load[:, 3:], axis=1))


def _given_way(run: Rehearsal) -> FloatArray:
    return np.asarray(1e3 * np.linalg.norm(run.deflection[:, :3], axis=1))


def _speed(run: Rehearsal) -> FloatArray:
    velocity = np.gradient(run.position, run.time, axis=0)
    return np.asarray(1e3 * np.linalg.norm(velocity, axis=1))


def _draw_limit(axes: Axes, limit: float, largest: float) -> None:
    axes.axhline(limit, color=_LIMIT, linestyle="--", linewidth=1.2)
    axes.text(
        0.995,
        limit,
        "limit ",
        transform=axes.get_yaxis_transform(),
        color=_LIMIT,
        fontsize=9.5,
        ha="right",
        va="bottom",
    )
    axes.set_ylim(0, max(1.22 * limit, 1.05 * largest))


def _draw_side(
    axes: Axes,
    traces: Sequence[LegTrace],
    nominal: FloatArray,
    outlines: Sequence[Outline],
) -> None:
    for outline in outlines:
        grey = outline.trace is None
        color = "#9aa3af" if grey else hex_color(_COLORS[outline.trace or 0])
        x, z = outline.points[:, 0], outline.points[:, 2]
        if outline.is_filled:
            axes.fill(x, z, color=color, alpha=0.35 if grey else 0.22, linewidth=0)
        axes.plot(np.r_[x, x[:1]], np.r_[z, z[:1]], color=color, linewidth=1.3)
        if outline.label:
            axes.annotate(
                plain(outline.label),
                (float(x.min()), float(z.mean())),
                xytext=(-8, 0),
                textcoords="offset points",
                fontsize=9.5,
                color=hex_color(MUTED_INK),
                ha="right",
                va="center",
            )
    axes.plot(nominal[:, 0], nominal[:, 2], ":", color=hex_color(INK), linewidth=1.5)
    axes.annotate(
        "way asked for",
        (float(nominal[-1, 0]), float(nominal[-1, 2])),
        xytext=(6, 6),
        textcoords="offset points",
        fontsize=9.5,
        color=hex_color(INK),
    )
    for trace, rgb in zip(traces, _COLORS, strict=False):
        p = trace.run.position
        axes.plot(p[:, 0], p[:, 2], color=hex_color(rgb), linewidth=2.2)
        axes.plot(p[-1, 0], p[-1, 2], "o", color=hex_color(rgb), ms=7)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.12)
    axes.set_ylabel("z [m]", fontsize=10, color=hex_color(MUTED_INK))


def _draw_turn(axes: Axes, traces: Sequence[LegTrace]) -> None:
    """Rotation on a second scale, dotted."""
    twin = axes.twinx()
    for trace, color in zip(traces, _COLORS, strict=False):
        degrees = np.rad2deg(np.linalg.norm(trace.run.deflection[:, 3:], axis=1))
        twin.plot(trace.run.time, degrees, ":", color=hex_color(color), linewidth=1.8)
    twin.tick_params(labelsize=9.5, colors=hex_color(MUTED_INK), length=3)
    twin.set_ylabel("turned, dotted [degrees]", fontsize=9.5)
    twin.yaxis.label.set_color(hex_color(MUTED_INK))
    for spine in twin.spines.values():
        spine.set_color("#c9ced6")
    twin.set_ylim(0, max(1.0, twin.get_ylim()[1]))


@checked
def preview_png(path: str | os.PathLike[str], shown: Preview) -> None:
    """Write a picture of what pushes and turns would do to the hand.

    One panel for each axis of the task frame: the hand as it stands in grey, the pushed
    or turned hand in colour, drawn larger than it will be so that it can be seen.

    Raises
    ------
    ConfigError, OutputError
        If the file has another suffix, or can't be written.
    """
    page = Page(1500, 1080)
    page.text(30, 22, "What the hand will do when it is pushed", 19, weight="bold")
    page.text(30, 60, wrapped([shown.lines[0]], 170, 2), 11, color=MUTED_INK)
    for row, (twists, letter) in enumerate(
        ((shown.pushed, "N"), (shown.turned, "N m"))
    ):
        for axis in range(3):
            slot = Slot(30 + axis * 490, 132 + row * 405, 460, 340)
            words = shown.lines[1 + 3 * row + axis]
            size = shown.force if row == 0 else shown.torque
            verb = "along" if row == 0 else "about"
            axes = page.titled_panel(slot, f"{size:g} {letter} {verb} {'xyz'[axis]}")
            sign = words.split(" ", 1)[1] if " " in words else words
            page.text(
                slot.x,
                slot.y + slot.height + 6,
                wrapped([_sentence(sign, verb, axis)], 62, 2),
                11,
            )
            _draw_hand(axes, slot, shown, twists[axis], axis, row)
    y = 950
    for line in shown.lines[7:]:
        bad = bool(shown.verdict.refusals) and line == shown.lines[-1]
        page.text(30, y, "• " + line, 12, color=CHOSEN_COLOR if bad else INK)
        y += 26
    for line in (*shown.verdict.refusals, *shown.verdict.warnings):
        page.text(30, y, wrapped(["  " + line], 170, 2), 10.5, color=MUTED_INK)
        y += 24
    page.write(path)


def _sentence(words: str, verb: str, axis: int) -> str:
    """Cut what the heading says already: only what happens is left."""
    marker = f"{verb} {'xyz'[axis]} "
    return words.split(marker, 1)[-1].capitalize()


def _wire() -> list[FloatArray]:
    """Lines of a hand: palm and two fingers, palm convention [m]."""
    palm = [[-0.06, 0, -0.1], [0.06, 0, -0.1], [0.06, 0, 0], [-0.06, 0, 0]]
    lines = [np.array([*palm, palm[0]], dtype=np.float64)]
    for side in (-1.0, 1.0):
        for across in (-0.035, 0.035) if side > 0 else (0.0,):
            x = 0.055 * side
            finger = [[x, across, 0], [1.35 * x, across, 0.05], [x, across, 0.12]]
            lines.append(np.array(finger, dtype=np.float64))
    middle = [[0, -0.05, -0.1], [0, 0.05, -0.1], [0, 0.05, 0], [0, -0.05, 0]]
    lines.append(np.array([*middle, middle[0]], dtype=np.float64))
    return lines


def _draw_hand(
    axes: Axes,
    slot: Slot,
    shown: Preview,
    twist: FloatArray,
    axis: int,
    row: int,
) -> None:
    """Draw the hand before and after, in the plane in which it moves most."""
    # A push is seen from the side, a turn along its axis.
    normal = (1, 0, 1)[axis] if row == 0 else axis
    u, v = [(1, 2), (0, 2), (0, 1)][normal]
    gap, angle = np.linalg.norm(twist[:3]), np.linalg.norm(twist[3:])
    travel = float(gap + 0.12 * angle)
    larger = float(np.clip(2.0 ** np.floor(np.log2(0.06 / max(travel, 1e-4))), 1, 32))
    if angle > 0:
        larger = max(1.0, min(larger, 2.0 ** np.floor(np.log2(0.8 / angle))))
    T_now, R_base_task = shown.T_base_ee, shown.R_base_task
    R_after = so3.exp(larger * twist[3:]) @ T_now.R
    moved = larger * twist[:3]
    for R, shift, color, width in (
        (T_now.R, np.zeros(3), "#a8b0bb", 2.0),
        (R_after, moved, hex_color(HAND_COLORS[0]), 2.4),
    ):
        pose = SE3.from_parts(R_base_task.T @ R, R_base_task.T @ shift)
        for line in _wire():
            points = pose.apply(line)
            axes.plot(points[:, u], points[:, v], color=color, linewidth=width)
    pivot = R_base_task.T @ shown.pivot
    reach = max(0.24, 1.15 * float(np.abs(pivot[[u, v]]).max()))
    axes.plot(pivot[u], pivot[v], "+", color=hex_color(CHOSEN_COLOR), ms=13, mew=2.2)
    if row == 0 and axis != normal:
        way = np.eye(3)[axis][[u, v]] * 0.30 * reach
        axes.annotate(
            "",
            xy=tuple(0.9 * way - 1.9 * way),
            xytext=tuple(-1.9 * way - 0.9 * way),
            arrowprops={"arrowstyle": "-|>", "color": hex_color(INK), "lw": 2},
        )
    wide = reach * slot.width / slot.height
    axes.set_xlim(-wide, wide)
    axes.set_ylim(-reach, reach)
    scale = "to scale" if larger == 1.0 else f"motion drawn {larger:g} times"
    scale = "no motion" if travel < 1e-5 else scale
    views = {0: "along x: y right, z up", 1: "along y: x right, z up"}
    axes.text(
        -0.97 * wide,
        0.86 * reach,
        f"{views.get(normal, 'from above: x right, y up')}; " + scale,
        fontsize=9,
        color=hex_color(MUTED_INK),
    )
    axes.text(
        pivot[u] + 0.03 * reach,
        pivot[v] + 0.03 * reach,
        "pivot",
        fontsize=9,
        color=hex_color(CHOSEN_COLOR),
    )
