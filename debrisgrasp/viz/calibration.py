"""The picture of a calibration: residuals, error over the workspace, what to add."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MultipleLocator

from debrisgrasp._arrays import FloatArray
from debrisgrasp.calibration import Calibration, predicted_error

from .calibration_frame import Drawn
from .colors import (
    BACKGROUND_COLOR,
    CHOSEN_COLOR,
    HAND_COLORS,
    INK,
    MUTED_INK,
    hex_color,
    rgb_color,
)
from .page import Page, Slot, plain, short_name, shortened, wrapped

__all__ = ["CalibrationPicture", "Suggestion", "calibration_png"]

_WIDTH, _HEIGHT, _FRAME = 1500, 1120, 30
_LEVELS = (1, 1.5, 2, 2.5, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96)
"""Contours of the error map [mm]."""
_BAD = "#c0392b"
_GOOD = "#1d7f4e"
_AXES = "xyz"


@dataclass(frozen=True, slots=True, kw_only=True)
class Suggestion:
    """A place worth measuring next."""

    name: str
    place: tuple[float, float, float]
    """Base frame [m]; that of a camera that an arm carries."""
    rms_after: float
    """Predicted error once it and those before it have been measured [m]."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CalibrationPicture:
    """What the picture shows."""

    title: str
    calibration: Calibration
    suggestions: tuple[Suggestion, ...] = ()
    change: str = ""
    """How far this calibration is from the one before, in words; empty for none."""


def calibration_png(path: str | os.PathLike[str], picture: CalibrationPicture) -> None:
    """Write the picture of a calibration.

    Parameters
    ----------
    path
        Where to write; an existing file is replaced only when the picture is complete.
    picture
        What to show.

    Raises
    ------
    ConfigError, OutputError
        If the file has another suffix, or can't be written.
    """
    page = Page(_WIDTH, _HEIGHT)
    bottom = _headline(page, picture)
    c = picture.calibration
    scale = _magnification(c)
    top = max(bottom + 44, 200)
    for column, (a, b) in enumerate(((0, 1), (0, 2))):
        slot = Slot(_FRAME + 45 + column * 500, top, 425, 380)
        axes = _plot(page, slot, a, b)
        seen = "from above" if (a, b) == (0, 1) else "from the side"
        if c.link is not None:
            seen = "as the camera sees it" if (a, b) == (0, 1) else "along its y axis"
        page.text(slot.x - 45, slot.y - 28, f"Residuals {seen}", 12, weight="bold")
        _draw_places(axes, picture, a, b, scale)
    page.text(
        _FRAME + 45 + 925,
        top - 26,
        f"magnified {scale:.0f} times",
        10,
        color=MUTED_INK,
        ha="right",
    )
    _table(page, picture, Slot(1030, top, 440, 380))
    low = top + 380 + 84
    _, y, z = c.error.bounds.lower + 0.5 * c.error.bounds.size
    maps = ((0, 1, z, f"at z = {z:.2f} m"), (0, 2, y, f"at y = {y:.2f} m"))
    for column, (a, b, at, words) in enumerate(maps):
        slot = Slot(_FRAME + 45 + column * 500, low, 425, 360)
        axes = _plot(page, slot, a, b)
        page.text(
            slot.x - 45, slot.y - 28, f"Predicted error {words} [mm]", 12, weight="bold"
        )
        _draw_map(axes, picture, a, b, at)
    _legend(page, picture, Slot(1030, low, 440, 360))
    page.write(path)


def _headline(page: Page, picture: CalibrationPicture) -> float:
    """Title, verdict and reasons; returns the y at which they end."""
    c = picture.calibration
    page.text(_FRAME, 18, shortened(picture.title, 80), 18, weight="bold")
    verdict = "ACCEPTED" if c.decision.accepted else "REFUSED"
    color = _GOOD if c.decision.accepted else _BAD
    page.figure.text(
        1.0 - _FRAME / _WIDTH,
        1.0 - 18 / _HEIGHT,
        verdict,
        fontsize=18,
        color=color,
        ha="right",
        va="top",
        weight="bold",
    )
    n_used = int((~c.is_outlier).sum())
    summary = (
        f"predicted error {1e3 * c.error.rms:.1f} mm {Drawn.of(c).where}, "
        f"{1e3 * c.error.worst:.1f} mm at its worst corner;  "
        f"{n_used} of {len(c.is_outlier)} observations used;  model: {c.model};  "
        f"RMSE {1e3 * c.rmse:.1f} mm (the camera's noise, not the error above)"
    )
    page.text(_FRAME, 58, summary, 11.5)
    lines = [str(f) for f in c.decision.findings] or [c.why_model]
    if c.link is not None:
        lines.append(f"all in the frame of the camera, which link {c.link} carries")
    lines += [*c.decision.notes, *([picture.change] if picture.change else [])]
    text = wrapped([f"• {line}" for line in lines], 175, 6)
    page.text(_FRAME, 88, text, 10.5, color=MUTED_INK)
    return 88 + 18.5 * (text.count("\n") + 1)


def _plot(page: Page, slot: Slot, a: int, b: int) -> Axes:
    """Panel with metric axes of two coordinates."""
    axes = page.panel(slot)
    axes.set_facecolor(BACKGROUND_COLOR)
    axes.xaxis.set_major_locator(MultipleLocator(0.2))
    axes.yaxis.set_major_locator(MultipleLocator(0.2))
    axes.tick_params(labelsize=9, colors=hex_color(MUTED_INK), length=3)
    axes.set_xlabel(f"{_AXES[a]} [m]", fontsize=9.5, color=hex_color(MUTED_INK))
    axes.set_ylabel(f"{_AXES[b]} [m]", fontsize=9.5, color=hex_color(MUTED_INK))
    axes.grid(visible=True, color="#dfe3e9", linewidth=0.6)
    axes.set_axisbelow(True)
    return axes


def _fitted(axes: Axes, points: FloatArray, a: int, b: int) -> None:
    """Show all points at equal scale, in the whole panel."""
    low, high = points[:, [a, b]].min(axis=0), points[:, [a, b]].max(axis=0)
    middle = 0.5 * (low + high)
    box = axes.get_window_extent()
    # Metres for each pixel: the same along both axes.
    step = 1.14 * float(((high - low) / (box.width, box.height)).max())
    axes.set_xlim(middle[0] + 0.5 * step * box.width * np.array([-1.0, 1.0]))
    axes.set_ylim(middle[1] + 0.5 * step * box.height * np.array([-1.0, 1.0]))


def _magnification(c: Calibration) -> float:
    """Round factor that makes the largest used residual about 8 cm long."""
    largest = float(np.linalg.norm(c.gaps[~c.is_outlier], axis=1).max(initial=1e-4))
    factor = 0.08 / max(largest, 1e-4)
    steps = np.array([1, 2, 5, 10, 20, 50, 100])
    return (
        float(steps[np.searchsorted(steps, factor, side="right") - 1])
        if (factor >= 1)
        else 1.0
    )


def _draw_places(
    axes: Axes, picture: CalibrationPicture, a: int, b: int, scale: float
) -> None:
    c = picture.calibration
    drawn = Drawn.of(c)
    places, camera = drawn.places, drawn.camera
    bounds = c.error.bounds
    _draw_box(axes, bounds.lower, bounds.upper, a, b)
    _draw_camera(axes, camera.p, camera.R[:, 2], a, b)
    for i, name in enumerate(c.observations.names):
        x, y = places[i, a], places[i, b]
        is_bad = bool(c.is_outlier[i])
        color = _BAD if is_bad else hex_color(HAND_COLORS[0])
        gap = drawn.gaps[i] * scale
        size = float(np.linalg.norm(gap))
        if size > 0.15:  # a wrong pick would leave the panel
            gap = gap * 0.15 / size
        axes.annotate(
            "",
            xy=(x + gap[a], y + gap[b]),
            xytext=(x, y),
            arrowprops={
                "arrowstyle": "-|>",
                "color": color,
                "lw": 1.6,
                "shrinkA": 0,
                "shrinkB": 0,
                "mutation_scale": 9,
            },
        )
        axes.plot(x, y, "x" if is_bad else "o", color=color, ms=7 if is_bad else 5)
        axes.annotate(
            plain(short_name(name, 10)),
            (x, y),
            xytext=(5, -11),
            textcoords="offset points",
            fontsize=8.5,
            color=color,
        )
    for item in picture.suggestions:
        axes.plot(
            item.place[a],
            item.place[b],
            "D",
            ms=7,
            mfc="none",
            mec=hex_color(CHOSEN_COLOR),
            mew=1.8,
        )
    shown = [places, camera.p[None], bounds.lower[None], bounds.upper[None]]
    if picture.suggestions:
        shown.append(np.array([s.place for s in picture.suggestions]))
    _fitted(axes, np.concatenate(shown), a, b)
    if drawn.is_camera_frame and b == 1:
        axes.invert_yaxis()  # y is down there


def _draw_box(axes: Axes, lower: FloatArray, upper: FloatArray, a: int, b: int) -> None:
    x = [lower[a], upper[a], upper[a], lower[a], lower[a]]
    y = [lower[b], lower[b], upper[b], upper[b], lower[b]]
    axes.plot(x, y, "--", color=hex_color(MUTED_INK), lw=1.2)


def _draw_camera(
    axes: Axes, place: FloatArray, view: FloatArray, a: int, b: int
) -> None:
    axes.plot(place[a], place[b], "s", color=hex_color(INK), ms=8)
    end = place + 0.15 * view
    axes.plot([place[a], end[a]], [place[b], end[b]], "-", color=hex_color(INK), lw=2)
    axes.annotate(
        "camera",
        (place[a], place[b]),
        xytext=(9, 6),
        textcoords="offset points",
        fontsize=9,
        color=hex_color(INK),
    )


def _draw_map(
    axes: Axes, picture: CalibrationPicture, a: int, b: int, at: float
) -> None:
    c = picture.calibration
    bounds = c.error.bounds
    low, high = bounds.lower - 0.25, bounds.upper + 0.25
    low[2] = max(low[2], 0.0)
    u, v = np.meshgrid(
        np.linspace(low[a], high[a], 61), np.linspace(low[b], high[b], 61)
    )
    points = np.zeros((*u.shape, 3))
    points[..., a], points[..., b], points[..., 3 - a - b] = u, v, at
    drawn = Drawn.of(c)
    error = 1e3 * predicted_error(drawn.covariance, points)
    axes.imshow(
        error,
        extent=(low[a], high[a], low[b], high[b]),
        origin="lower",
        cmap="YlOrRd",
        vmin=0.0,
        vmax=max(8.0, float(np.percentile(error, 99))),
        interpolation="bilinear",
        aspect="auto",
    )
    axes.grid(visible=False)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(low[a], high[a])
    axes.set_ylim(low[b], high[b])
    levels = [level for level in _LEVELS if error.min() < level < error.max()]
    if len(levels) < 2:
        middle = np.linspace(error.min(), error.max(), 6)[1:-1]
        levels = sorted(set(np.round(middle, 1)))
    lines = axes.contour(u, v, error, levels=levels, colors="#5a2d0c", linewidths=0.9)
    labels = axes.clabel(lines, fmt="%g", fontsize=10, inline=False)
    for label in labels:
        label.set_path_effects([withStroke(linewidth=3.0, foreground="white")])
    _draw_box(axes, bounds.lower, bounds.upper, a, b)
    for place, is_bad in zip(drawn.places, c.is_outlier, strict=True):
        if not is_bad:
            axes.plot(place[a], place[b], "o", color=hex_color(HAND_COLORS[0]), ms=4)
    for item in picture.suggestions:
        axes.plot(
            item.place[a],
            item.place[b],
            "D",
            ms=6,
            mfc="none",
            mec=hex_color(INK),
            mew=1.4,
        )
    if drawn.is_camera_frame and b == 1:
        axes.invert_yaxis()


def _table(page: Page, picture: CalibrationPicture, slot: Slot) -> None:
    """Residual of each observation, and its distance from what the others predict."""
    c = picture.calibration
    gaps = Drawn.of(c).gaps
    page.text(slot.x, slot.y - 28, "Observations [mm]", 12, weight="bold")
    columns = (0, 120, 180, 240, 320, 425)
    heads = ("name", "x", "y", "z", "size", "held out")
    for x, head in zip(columns, heads, strict=True):
        page.text(
            slot.x + x,
            slot.y,
            head,
            9.5,
            color=MUTED_INK,
            ha="left" if not x else "right",
        )
    most = int(slot.height // 21) - 2
    # The worst are what matters if not all fit.
    n = len(c.is_outlier)
    shown: Sequence[int] = range(n)
    if n > most:
        shown = sorted(np.argsort(-c.held_out)[:most])
    for row, i in enumerate(shown, start=1):
        cells = [
            short_name(c.observations.names[i], 14),
            *(f"{1e3 * g:+.1f}" for g in gaps[i]),
            f"{1e3 * np.linalg.norm(c.gaps[i]):.1f}",
            f"{1e3 * c.held_out[i]:.1f}",
        ]
        color = rgb_color(_BAD) if c.is_outlier[i] else INK
        for x, cell in zip(columns, cells, strict=True):
            side = "left" if not x else "right"
            page.text(slot.x + x, slot.y + 21 * row, cell, 10, color=color, ha=side)
    if n > most:
        y = slot.y + 21 * (most + 1)
        page.text(slot.x, y, f"and {n - most} with less", 9.5, color=MUTED_INK)


def _legend(page: Page, picture: CalibrationPicture, slot: Slot) -> None:
    c = picture.calibration
    page.text(slot.x, slot.y - 28, "What to measure next", 12, weight="bold")
    lines = [
        f"{s.name}: ({s.place[0]:.2f}, {s.place[1]:.2f}, {s.place[2]:.2f}) m, "
        f"then {1e3 * s.rms_after:.1f} mm"
        for s in picture.suggestions
    ]
    if not lines:
        lines = [
            "Nothing is needed: the predicted error is small enough."
            if c.decision.accepted
            else "No places were computed; name the robot to get some."
        ]
    text = wrapped(lines, 56, 10)
    page.text(slot.x, slot.y, text, 10.5)
    y = slot.y + 200
    key = (
        ("o", hex_color(HAND_COLORS[0]), "observation, arrow: measured less predicted"),
        ("x", _BAD, "left out as a wrong pick (arrow cut at 15 cm)"),
        ("D", hex_color(CHOSEN_COLOR), "place to measure next"),
        ("s", hex_color(INK), "camera, line: where it looks"),
        ("--", hex_color(MUTED_INK), "workspace in which the error counts"),
    )
    axes = page.panel(Slot(slot.x, y, 30, 130))
    axes.set_axis_off()
    for row, (mark, color, words) in enumerate(key):
        height = 13 + 26 * row
        if mark == "--":
            axes.plot([3, 27], [height, height], "--", color=color, lw=1.3)
        else:
            face = "none" if mark == "D" else color
            axes.plot(15, height, mark, color=color, mfc=face, ms=7)
        page.text(slot.x + 38, y + 26 * row + 5, words, 10, color=MUTED_INK)
