"""Pictures of single products: the segments of a capture, and a sheet of prototypes."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._checked import checked
from debrisgrasp._words import counted
from debrisgrasp.errors import InputError, UnknownNameError
from debrisgrasp.geometry import SE3, PointCloud
from debrisgrasp.prototypes import GraspPrototype, GripperModel
from debrisgrasp.segmentation import Candidate, Segmentation

from .colors import (
    BACKGROUND_COLOR,
    CHOSEN_COLOR,
    HAND_COLORS,
    INK,
    KIND_COLORS,
    MUTED_INK,
    WARNING_COLOR,
)
from .overlay import DOUBT_KEY, label_image
from .page import (
    Page,
    Slot,
    draw_picture,
    draw_segments,
    short_name,
    shortened,
    wrapped,
    write_order,
)
from .raster import Splats, render
from .report import Image
from .scene import merged, point_spacing
from .view import View
from .words import doubt_line

__all__ = ["drawable", "prototype_png", "segmentation_png"]

_BY = {"singulation": "", "lccp": " by LCCP", "given": " as given"}
"""How segments came about, where it isn't as usual."""

_FRAME = 30
_LINE = 20


@checked
def segmentation_png(
    path: str | os.PathLike[str],
    capture: Image | None,
    cloud: PointCloud,
    segmentation: Segmentation,
    *,
    order: Sequence[Candidate] = (),
) -> None:
    """Write the picture of a capture with its segments in colours.

    Parameters
    ----------
    path
        Where to write; an existing file is replaced only when the picture is complete.
    capture
        Where the cloud came from, for its colour image; None if there is none.
    cloud, segmentation
        The points and their labels.
    order
        Objects in the order in which they would be taken. The first is outlined, and
        the reasons stand beside the picture.

    Raises
    ------
    ShapeError
        If the segmentation is of another cloud.
    ConfigError, OutputError
        If the file has another suffix, or can't be written.
    """
    segmentation.require_of(cloud)
    report = segmentation.ground
    image = label_image(cloud, segmentation.labels, capture, report.kinds)
    name = "Segments" if capture is None else capture.name
    found = counted(len(segmentation.segments), "segment")
    found += f"{_BY[segmentation.method]}; ground {report.status}: {report.reason}"
    columns = 190 if order else 130
    note = wrapped([found], columns, 3)
    counts = [
        (f"■ {kind.name.lower()} {report.counts[kind.name.lower()]}", color)
        for kind, color in KIND_COLORS.items()
        if report.counts.get(kind.name.lower())
    ]
    doubt = wrapped([doubt_line(segmentation)], columns, 3)
    y = 50 + _LINE * (note.count("\n") + 1)
    top = doubt_y = y + (_LINE if counts else 0)
    if doubt:
        top += _LINE * (doubt.count("\n") + 1)
    height, width = image.labels.shape
    slot = Slot(_FRAME, top + 2, 1080, min(810, int(1080 * height / width)))
    # The list beside the picture needs the room that a wide picture does not.
    foot = int(slot.y + (810 if order else slot.height)) + _FRAME
    page = Page(1700 if order else 1080 + 2 * _FRAME, foot)
    page.text(_FRAME, 18, shortened(name, 70), 18, weight="bold")
    page.text(_FRAME, 50, note, 11, color=MUTED_INK)
    page.row(_FRAME, y, counts, 10.5, weight="bold")
    page.text(_FRAME, doubt_y, doubt, 10.5, color=WARNING_COLOR)
    chosen = order[0].label if order else 0
    draw_segments(
        page.panel(slot),
        image,
        slot,
        chosen=chosen,
        order=order,
        segmentation=segmentation,
    )
    page.row(_FRAME, slot.y + slot.height + 6, DOUBT_KEY, 9.5, gap=18)
    if order:
        page.text(1130, slot.y - 34, "Order of removal", 12, weight="bold")
        write_order(page, 1130, slot.y, order)
    page.write(path)


@checked
def prototype_png(
    path: str | os.PathLike[str],
    prototypes: Iterable[GraspPrototype],
    grippers: Mapping[str, GripperModel],
) -> None:
    """Write a sheet of prototypes, each with its hand as it approaches from above.

    Parameters
    ----------
    path
        Where to write; an existing file is replaced only when the picture is complete.
    prototypes
        What to draw, in this order.
    grippers
        The hands they are for.

    Raises
    ------
    InputError
        If there is no prototype, or not its hand.
    ConfigError, OutputError
        If the file has another suffix, or can't be written.
    """
    shown = drawable(prototypes, grippers)
    columns, side = (6, 280) if len(shown) > 6 else (3, 400)
    columns = min(columns, len(shown))
    step_x, step_y = side + 16, side + 62
    rows = -(-len(shown) // columns)
    page = Page(2 * _FRAME + columns * step_x - 16, 2 * _FRAME + rows * step_y - 16)
    for place, prototype in enumerate(shown):
        row, column = divmod(place, columns)
        slot = Slot(
            _FRAME + column * step_x, _FRAME + 46 + row * step_y, side, side - 16
        )
        name = short_name(prototype.name, side // 10)
        page.text(slot.x, slot.y - 44, name, 11, color=INK, weight="bold")
        hand = f"{prototype.gripper} {prototype.preshape}"
        sizes = f"{1000 * prototype.opening:.0f} → {1000 * prototype.width:.0f} mm"
        note = short_name(f"{hand}, {sizes}", side // 7)
        page.text(slot.x, slot.y - 23, note, 9.5, color=MUTED_INK)
        colors = _drawn_prototype(prototype, grippers[prototype.gripper], slot)
        draw_picture(page.panel(slot), colors, slot)
    page.write(path)


def drawable(
    prototypes: Iterable[GraspPrototype], grippers: Mapping[str, GripperModel]
) -> tuple[GraspPrototype, ...]:
    """List what is to be drawn.

    Raises
    ------
    InputError
        If it is nothing, or something else than prototypes.
    UnknownNameError
        If the hand of one is not there.
    """
    shown = tuple(prototypes)
    if not shown:
        raise InputError("prototypes to draw", got="none", expected="at least one")
    for each in shown:
        if not isinstance(each, GraspPrototype):
            got = type(each).__name__
            mend = "PrototypeLibrary.load() has some, by name."
            raise InputError("prototypes to draw", got=got, expected="them", mend=mend)
        if each.gripper not in grippers:
            raise UnknownNameError("gripper", each.gripper, grippers)
    return shown


def _drawn_prototype(
    prototype: GraspPrototype, gripper: GripperModel, slot: Slot
) -> FloatArray:
    """Prototype in its hand, the palm turned to look down."""
    T_base_hand = SE3.from_parts(np.diag([1.0, -1.0, -1.0]))
    solids = gripper.solids(prototype.preshape, prototype.opening)
    hand = merged(solids, HAND_COLORS[0]).moved(T_base_hand)
    points = T_base_hand.apply(prototype.points)
    view = View.fitted(
        np.concatenate([points, hand.vertices]), [-0.4, 0.9, -0.35], slot.size
    )
    splats = Splats(
        points,
        np.broadcast_to(CHOSEN_COLOR, points.shape),
        1.15 * point_spacing(points),
        T_base_hand.rotate(prototype.normals),
    )
    picture = render(view, [splats], [hand], background=np.array(BACKGROUND_COLOR))
    return picture.colors
