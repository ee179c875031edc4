"""The report as one picture."""

from __future__ import annotations

import os

from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from debrisgrasp._checked import checked

from .colors import (
    CHOSEN_COLOR,
    HAND_COLORS,
    INK,
    MUTED_INK,
    WARNING_COLOR,
    hex_color,
)
from .overlay import label_image
from .page import (
    Page,
    Slot,
    draw_picture,
    draw_segments,
    plain,
    short_name,
    shortened,
    wrapped,
)
from .panels import Panels
from .raster import Picture
from .report import Report
from .view import View
from .words import (
    doubt_line,
    grasp_row,
    headline,
    object_reason,
    percent,
    rejection_rows,
    remarks,
    summary,
)

__all__ = ["report_png"]

_SIZE = (1800, 1200)
_IMAGE = Slot(30, 132, 744, 558)
"""Most that the picture of the segments takes; it has the shape of its image."""
_LEAST, _WIDE = (300.0, 186.0), 480.0
"""It takes at least so much, so that its heading fits; where it is wide, all of it."""
_GUTTER, _HEADING = 20.0, 42.0
"""Between panels side by side, and above one another [pixels]."""
_RIGHT, _FOOT = 1770.0, 1172.0
_TABLE = Slot(794, 732, 976, 440)
_COLUMNS = (
    ("", 14, "left"),
    ("Prototype", 44, "left"),
    ("Arm, hand, preshape", 316, "left"),
    ("S", 548, "right"),
    ("C", 600, "right"),
    ("R", 652, "right"),
    ("Q", 708, "right"),
    ("Score", 778, "right"),
    ("Opening → closed", 962, "right"),
)
_MOST_ROWS = 10
_ROW_HEIGHT = 23


@checked
def report_png(path: str | os.PathLike[str], report: Report) -> None:
    """Write the report as a PNG of 1800 x 1200 pixels.

    The camera's picture with the segments, the best hands from two sides, the robot (or
    the scene from above), and the table of grasps with the reasons in words. Equal
    reports give equal files.

    Parameters
    ----------
    path
        Where to write; an existing file is replaced only when the picture is complete.
    report
        What to show. A plan without grasps shows the scene and why there is none.

    Raises
    ------
    ConfigError, OutputError
        If the file has another suffix, or can't be written.
    """
    page = Page(*_SIZE)
    plan = report.plan
    page.text(30, 20, shortened(report.title, 50), 20, weight="bold")
    page.text(30, 64, summary(report), 11.5, color=MUTED_INK)
    doubt = shortened(doubt_line(report.segmentation), 265)
    page.text(30, 87, doubt, 9.5, color=WARNING_COLOR)
    color = INK if plan.grasps else tuple(0.8 * c for c in CHOSEN_COLOR)
    sentence = wrapped([headline(report)], 82, 2)
    page.text(1770, 24, sentence, 13, ha="right", color=color, weight="bold")

    image = label_image(report.cloud, report.labels, report.capture)
    picture, sight, side, robot = _slots(image.labels.shape)
    note = "place in the order: #label"
    if picture.width >= _WIDE:
        source = "camera" if image.from_camera else "rendered from the viewpoint"
        note = f"{source}; {note}"
    axes = page.titled_panel(picture, "Segments", note)
    draw_segments(axes, image, picture, chosen=plan.object_label, order=report.order)

    panels = Panels.of(report)
    title = "Best hands" if plan.grasps else "First object"
    axes = page.titled_panel(sight, title, "box: region V; grid 10 cm")
    _draw_scene(axes, sight, panels.along_sight(sight.size), panels, len(panels.hands))
    title = "Best grasp, across its grip" if plan.grasps else "From the side"
    axes = page.titled_panel(side, title, "grid 10 cm")
    _draw_scene(axes, side, panels.across_grip(side.size), panels, 1)
    if report.robot is None:
        axes = page.titled_panel(robot, "From above", "grid 10 cm; x up, y left")
    else:
        note = "blue: the arm's reach at the height of the grasp; grid 50 cm"
        axes = page.titled_panel(
            robot,
            "Robot in the best grasp" if plan.grasps else "Robot at rest",
            note if plan.grasps else "grid 50 cm",
        )
    _draw_scene(axes, robot, panels.with_robot(robot.size), panels, 0)
    axes = page.titled_panel(_TABLE, "Grasps", "best score first; Q = S C R")
    _draw_table(axes, report, tuple(panels.hands))
    page.write(path)


def _slots(shape: tuple[int, int]) -> tuple[Slot, Slot, Slot, Slot]:
    """Places of the picture, the hands from two sides, and the robot.

    What an image of this shape (rows, columns) leaves free of its place the others
    take: the robot, where it is wide, and the hands, where it is high.
    """
    rows, columns = shape
    scale = min(_IMAGE.width / columns, _IMAGE.height / rows)
    width = max(round(scale * columns), _LEAST[0])
    height = max(round(scale * rows), _LEAST[1])
    picture = Slot(_IMAGE.x, _IMAGE.y, width, height)
    x = picture.x + width + _GUTTER
    half = (_RIGHT - x - _GUTTER) // 2
    sight = Slot(x, _IMAGE.y, half, _IMAGE.height)
    side = Slot(_RIGHT - half, _IMAGE.y, half, _IMAGE.height)
    y = picture.y + height + _HEADING
    robot = Slot(_IMAGE.x, y, _IMAGE.width, _FOOT - y)
    return picture, sight, side, robot


def _draw_scene(
    axes: Axes, slot: Slot, drawn: tuple[Picture, View], panels: Panels, n_numbers: int
) -> None:
    """Fill a panel with a rendered picture, and number its hands."""
    picture, view = drawn
    draw_picture(axes, picture.colors, slot)
    numbered = list(zip(panels.hands, HAND_COLORS, strict=False))[:n_numbers]
    for rank, color in reversed(numbered):
        # At the start of the approach there is most room for a number.
        (u, v), _ = view.project(panels.report.plan.grasps[rank].T_base_pregrasp.p)
        axes.text(
            min(max(u, 14.0), slot.width - 14.0),
            min(max(v, 14.0), slot.height - 14.0),
            str(rank + 1),
            fontsize=12,
            weight="bold",
            color="white",
            ha="center",
            va="center",
            bbox={
                "boxstyle": "circle,pad=0.25",
                "facecolor": hex_color(color),
                "edgecolor": "white",
            },
        )


def _draw_table(axes: Axes, report: Report, drawn: tuple[int, ...]) -> None:
    """Fill a panel with the best grasps, and below them with the reasons.

    ``drawn`` holds the ranks of the hands in the pictures; their rows carry the colour.
    """
    plan = report.plan
    colors = dict(zip(drawn, HAND_COLORS, strict=False))
    axes.set_facecolor("white")
    y = 22.0
    if plan.grasps:
        for title, x, side in _COLUMNS:
            _cell(axes, x, y, title, side, color=MUTED_INK, weight="bold")
        y += 8
        axes.plot([10, 966], [y + 8, y + 8], color="#c9ced6", linewidth=1.0)
        y += 12
    for rank, grasp in enumerate(plan.grasps[:_MOST_ROWS]):
        y += _ROW_HEIGHT if rank else 12
        if rank in colors:
            swatch = Rectangle((8, y - 10), 26, 20, color=hex_color(colors[rank]))
            axes.add_patch(swatch)
        cells = grasp_row(rank + 1, grasp)
        for place, ((_, x, side), text) in enumerate(zip(_COLUMNS, cells, strict=True)):
            is_on_swatch = place == 0 and rank in colors
            _cell(
                axes,
                21 if place == 0 else x,
                y,
                short_name(text, 30),
                "center" if place == 0 else side,
                color=(1.0, 1.0, 1.0) if is_on_swatch else INK,
                weight="bold" if place in (0, 7) else "normal",
            )
    left = len(plan.grasps) - _MOST_ROWS
    if left > 0:
        y += _ROW_HEIGHT
        _cell(axes, 44, y, f"and {left} more", "left", color=MUTED_INK)
    y += 22 if plan.grasps else -8
    axes.text(
        14,
        y,
        _reasons(report, int((_TABLE.height - y - 10) / 20.5)),
        fontsize=10.5,
        color=hex_color(INK),
        va="top",
        linespacing=1.4,
    )


def _cell(
    axes: Axes,
    x: float,
    y: float,
    text: str,
    side: str,
    *,
    color: tuple[float, float, float] = INK,
    weight: str = "normal",
) -> None:
    axes.text(
        x,
        y,
        plain(text),
        fontsize=10.5,
        color=hex_color(color),
        ha=side,
        va="center",
        weight=weight,
    )


def _reasons(report: Report, most_lines: int) -> str:
    """Why this object, what was left, and what was ruled out."""
    plan = report.plan
    paragraphs = [headline(report)] if not plan.grasps else []
    n_left = 4 if plan.grasps else 8
    paragraphs += [object_reason(report), *remarks(report)[:n_left]]
    rows = rejection_rows(plan)
    total = sum(n for _, n in rows)
    if rows:
        shares = "; ".join(f"{reason} {percent(n, total)}" for reason, n in rows[:6])
        paragraphs.append(f"Ruled out {total} candidate poses: {shares}.")
    if plan.grasps and plan.grasps[0].load is not None:
        load = plan.grasps[0].load
        paragraphs.append(
            f"Load: {load.in_words}; margin of the best {load.margin:.2g}, "
            f"by {load.limit}."
        )
    paragraphs += [f"What would help: {advice.text}." for advice in plan.advice]
    text = wrapped([f"• {p}" for p in paragraphs if p], 118, max(most_lines, 1))
    return plain(text)
