"""Pictures of what the arms of a robot can grip, and from which side."""

from __future__ import annotations

import base64
import io
import os
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from matplotlib.transforms import Bbox
from scipy.spatial import ConvexHull

from debrisgrasp._arrays import FloatArray
from debrisgrasp._checked import checked
from debrisgrasp._words import arm_called
from debrisgrasp.geometry import Bounds
from debrisgrasp.kinematics import ReachSurvey, RobotModel

from .colors import BACKGROUND_COLOR, INK, MUTED_INK, hex_color
from .html import write_page
from .page import Page, Slot, draw_picture, plain, short_name, shortened
from .raster import Splats, render
from .scene import box_edges, ground_grid, robot_mesh
from .view import View

__all__ = ["ReachPicture", "reach_html", "reach_png"]

_SIZE = (1800, 1160)
_VIEW = Slot(30, 132, 640, 700)
_TABLE = Slot(30, 872, 640, 258)
_MAPS = Slot(715, 132, 1069, 1042)
_ARM_COLORS = ((0.10, 0.38, 0.77), (0.80, 0.38, 0.06))
_BOTH_COLOR = (0.05, 0.50, 0.34)
_OUTSIDE = np.array([0.955, 0.96, 0.97])
_REGION_COLOR = (0.72, 0.05, 0.25)
_LONGEST_NAME = 13
_MOST_ROWS = 10
_FAINT = 0.25
"""Least strength of a place that can be gripped at all."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ReachPicture:
    """What is drawn: surveys of one or two arms over the same places."""

    title: str
    summary: str
    robot: RobotModel
    level: tuple[ReachSurvey, ...]
    """One for each arm, on a few level grids of places."""
    upright: tuple[ReachSurvey, ...]
    """The same on one upright plane of constant y."""
    region: Bounds | None
    rows: Sequence[Sequence[str]]
    """Table of words, its first row the header."""


@checked
def reach_png(path: str | os.PathLike[str], picture: ReachPicture) -> None:
    """Write the picture as a PNG of 1800 x 1160 pixels.

    Maps of level slices (columns) for each approach (rows), a view of the robot among
    its reach, and a table. Equal pictures give equal files.

    Raises
    ------
    ConfigError, OutputError
        If the file has another suffix, or can't be written.
    """
    _drawn(picture).write(path)


@checked
def reach_html(path: str | os.PathLike[str], picture: ReachPicture) -> None:
    """Write a page with the picture and the table, which needs nothing but itself.

    Raises
    ------
    ConfigError, OutputError
        If the file has another suffix, or can't be written.
    """
    stream = io.BytesIO()
    figure = _drawn(picture, is_headed=False).figure
    # Without the strip above the legend, where the picture alone has its title.
    width, height = figure.get_size_inches()
    shown = Bbox([[0.0, 0.0], [width, height * (1.0 - 24 / _SIZE[1])]])
    figure.savefig(stream, format="png", metadata={"Software": ""}, bbox_inches=shown)
    data = base64.b64encode(stream.getvalue()).decode()
    head, *body = picture.rows
    cells = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    lines = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>"
        for row in body
    )
    title = escape(picture.title)
    write_page(
        path,
        f'<!DOCTYPE html><html lang="en"><meta charset="utf-8"><title>{title}</title>'
        "<style>body{font:15px system-ui,'DejaVu Sans',sans-serif;margin:24px;"
        "color:#1c2330;background:#fff}h1{font-size:26px;margin:0}p{margin:6px 0 0}"
        "img{width:100%;max-width:1800px}"
        "td,th{padding:3px 14px 3px 0;text-align:left}</style>"
        f"<h1>{title}</h1><p>{escape(picture.summary)}</p>"
        f'<img alt="{title}" src="data:image/png;base64,{data}">'
        f"<table><tr>{cells}</tr>{lines}</table></html>\n",
    )


def _drawn(picture: ReachPicture, *, is_headed: bool = True) -> Page:
    page = Page(*_SIZE)
    if is_headed:
        page.text(30, 20, shortened(picture.title, 70), 20, weight="bold")
        page.text(30, 64, shortened(picture.summary, 130), 11.5, color=MUTED_INK)
    _legend(page, picture)
    axes = page.titled_panel(_VIEW, "Reach around the robot", "grid 50 cm")
    draw_picture(axes, _rendered(picture), _VIEW)
    axes = page.titled_panel(_TABLE, "What can be gripped")
    _draw_table(axes, picture.rows)
    _draw_maps(page, picture)
    return page


def _legend(page: Page, picture: ReachPicture) -> None:
    names = [survey.arm for survey in picture.level]
    entries = [
        *((f"{arm_called(name)}", _ARM_COLORS[i % 2]) for i, name in enumerate(names)),
        *((("both arms", _BOTH_COLOR),) if len(names) > 1 else ()),
    ]
    x = 1770.0
    note = "the stronger, the more of the approach's directions; maps: x up, y left"
    page.text(x, 66, note, 10, color=MUTED_INK, ha="right")
    axes = page.panel(Slot(0, 30, 1800, 26))
    axes.axis("off")
    for name, color in reversed(entries):
        name = plain(short_name(name, 40))
        text = axes.text(x, 13, name, fontsize=11, ha="right", va="center")
        x -= text.get_window_extent().width + 28
        axes.add_patch(Rectangle((x, 3), 20, 20, color=hex_color(color)))
        x -= 24


def _colors(surveys: Sequence[ReachSurvey], approach: int | None) -> FloatArray:
    """Hue by the arms that can grip each place, strength by the share; (p, 3)."""
    shares = np.stack([survey.share(approach) for survey in surveys])
    can = shares > 0
    hue = np.zeros((shares.shape[1], 3))
    for i in range(len(surveys)):
        hue[can[i]] = _ARM_COLORS[i % 2]
    hue[can.sum(axis=0) > 1] = _BOTH_COLOR
    best = shares.max(axis=0)
    strength = np.where(best > 0, _FAINT + (1.0 - _FAINT) * best, 0.0)[:, None]
    return _OUTSIDE * (1.0 - strength) + hue * strength


def _draw_maps(page: Page, picture: ReachPicture) -> None:
    """One map for each approach and height; x points up, y to the left."""
    places = picture.level[0].places
    xs, ys, zs = (np.unique(np.round(places[:, k], 6)) for k in range(3))
    kinds = picture.level[0].approaches
    step_x, step_y = _MAPS.width / len(zs), _MAPS.height / len(kinds)
    for row, kind in enumerate(kinds):
        colors = _colors(picture.level, row)
        grid = colors.reshape(len(xs), len(ys), len(zs), 3)
        for column, z in enumerate(zs):
            slot = Slot(
                _MAPS.x + column * step_x,
                _MAPS.y + row * step_y,
                step_x - 14,
                step_y - 44,
            )
            title = f"{kind.name}, z = {z:.2f} m"
            axes = page.titled_panel(slot, title)
            _draw_map(axes, slot, grid[:, :, column], xs, ys, float(z), picture)


def half_metres(low: float, high: float) -> FloatArray:
    """Multiples of 0.5 m from low up to high."""
    # Rounding up makes a negative zero, which prints as -0.
    return 0.5 * np.arange(np.ceil(low / 0.5) + 0.0, high / 0.5)


def _draw_map(
    axes: Axes,
    slot: Slot,
    colors: FloatArray,
    xs: FloatArray,
    ys: FloatArray,
    z: float,
    picture: ReachPicture,
) -> None:
    half = 0.5 * float(xs[1] - xs[0])
    scale = min(
        slot.width / (np.ptp(ys) + 2 * half), slot.height / (np.ptp(xs) + 2 * half)
    )
    middle = 0.5 * (ys[0] + ys[-1])
    top = xs[-1] + half

    def place(x: float, y: float) -> tuple[float, float]:
        return slot.width / 2 - scale * (y - middle), scale * (top - x)

    axes.set_facecolor(hex_color(_OUTSIDE))
    left, upper = place(top, ys[-1] + half)
    right, lower = place(xs[0] - half, ys[0] - half)
    axes.imshow(
        np.clip(colors[::-1, ::-1], 0, 1),
        extent=(left, right, lower, upper),
        interpolation="nearest",
        aspect="auto",
    )
    for x in half_metres(xs[0], top):
        _, v = place(x, 0.0)
        axes.plot([left, right], [v, v], color="white", linewidth=0.6)
        axes.text(left + 3, v, f"{x:g}", fontsize=7.5, color=hex_color(MUTED_INK))
    for y in half_metres(ys[0], ys[-1] + half):
        u, _ = place(0.0, y)
        axes.plot([u, u], [upper, lower], color="white", linewidth=0.6)
    for outline in _footprint(picture.robot):
        flat = np.array([place(x, y) for x, y in outline])
        axes.fill(*flat.T, color="#8d96a3", alpha=0.35, linewidth=0)
    region = picture.region
    if region is not None and region.lower[2] - 1e-9 <= z <= region.upper[2] + 1e-9:
        u0, v0 = place(*region.upper[:2])
        u1, v1 = place(*region.lower[:2])
        frame = Rectangle(
            (u0, v0), u1 - u0, v1 - v0, fill=False, color=hex_color(_REGION_COLOR)
        )
        axes.add_patch(frame)
    axes.set_xlim(0, slot.width)
    axes.set_ylim(slot.height, 0)


def _footprint(robot: RobotModel) -> list[FloatArray]:
    """Outlines (j, 2), seen from above, of the links that no arm moves."""
    moved = {joint for arm in robot.arms.values() for joint in arm.joints}
    outlines = []
    for link, solid in robot.links_solids():
        if not any(joint.name in moved for joint in robot.tree.joints_above(link)):
            corners = solid.mesh()[0][:, :2]
            outlines.append(corners[ConvexHull(corners).vertices])
    return outlines


def _rendered(picture: ReachPicture) -> FloatArray:
    """Robot at rest among one upright and the lowest level sheet of its reach."""
    body = robot_mesh(picture.robot, None)
    sheets = []
    low = picture.level[0].places[:, 2].min()
    for surveys, lowest in ((picture.level, True), (picture.upright, False)):
        places = surveys[0].places
        share = np.max([survey.share() for survey in surveys], axis=0)
        shown = (share > 0) & ((places[:, 2] == low) | (not lowest))
        step = np.diff(np.unique(np.round(places[:, 0], 6))).min()
        colors = _colors(surveys, None)
        sheets.append(
            Splats(places[shown], colors[shown], np.full(shown.sum(), 0.8 * step))
        )
    corners = np.concatenate([body.vertices, *(sheet.points for sheet in sheets)])
    view = View.fitted(corners, [0.75, 0.75, -0.62], _VIEW.size, margin=1.04)
    lines = [_row(ground_grid(corners, 0.5), (0.80, 0.82, 0.85))]
    if picture.region is not None:
        lines.append(_row(box_edges(picture.region), _REGION_COLOR, 0.012))
    return render(
        view, [*sheets, *lines], [body], background=np.array(BACKGROUND_COLOR)
    ).colors


def _row(
    segments: FloatArray, color: tuple[float, float, float], size: float = 0.007
) -> Splats:
    """Straight lines (l, 2, 3) as rows of discs."""
    share = np.linspace(0.0, 1.0, 400)[:, None]
    points = segments[:, 0, None] * (1.0 - share) + segments[:, 1, None] * share
    points = points.reshape(-1, 3)
    return Splats(
        points, np.tile(np.asarray(color), (len(points), 1)), np.full(len(points), size)
    )


def _draw_table(axes: Axes, rows: Sequence[Sequence[str]]) -> None:
    axes.set_facecolor("white")
    # Words in the first columns are wider than the figures that follow.
    starts = np.array([10, 106, 178, 228, 278, 353])[: len(rows[0])]
    for line, row in enumerate(rows[:_MOST_ROWS]):
        cells = [short_name(row[0], _LONGEST_NAME), *row[1:]]
        for x, cell in zip(starts, cells, strict=True):
            axes.text(
                x,
                20 + 23.5 * line,
                plain(cell),
                fontsize=8.6,
                va="center",
                color=hex_color(INK if line else MUTED_INK),
                weight="normal" if line else "bold",
            )
