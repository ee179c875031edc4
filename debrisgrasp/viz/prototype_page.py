"""Prototypes in their hands as one page for the browser, which needs nothing else."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._checked import checked
from debrisgrasp.geometry import SE3
from debrisgrasp.prototypes import GraspPrototype, GripperModel, half_turns

from .colors import CHOSEN_COLOR, HAND_COLORS
from .html import filled_page, write_page
from .payload import packed_bytes, packed_points
from .scene import merged, point_spacing
from .sheets import drawable

__all__ = ["prototypes_html"]

_T_VIEW_HAND = SE3.from_parts(np.diag([1.0, -1.0, -1.0]))
"""The palm looks down, as on the sheet of pictures."""


@checked
def prototypes_html(
    path: str | os.PathLike[str],
    prototypes: Iterable[GraspPrototype],
    grippers: Mapping[str, GripperModel],
    findings: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Write a page on which each prototype is turned about with its hand.

    Parameters
    ----------
    path
        Where to write; an existing file is replaced only when the page is complete.
    prototypes
        What to show, in this order.
    grippers
        The hands they are for.
    findings
        What `check` says against each, by name.

    Raises
    ------
    InputError
        If there is no prototype, or not its hand.
    ConfigError, OutputError
        If the file has another suffix, or can't be written.
    """
    shown = drawable(prototypes, grippers)
    said = findings or {}
    content = {
        "title": f"{len(shown)} prototype{'s' * (len(shown) != 1)}",
        "prototypes": [
            _entry(p, grippers[p.gripper], said.get(p.name, ())) for p in shown
        ],
    }
    page = filled_page("prototypes.html", "prototypes.js", "Prototypes", content)
    write_page(path, page)


def _entry(
    prototype: GraspPrototype, gripper: GripperModel, findings: Sequence[str]
) -> dict[str, Any]:
    points = _T_VIEW_HAND.apply(prototype.points)
    spacing = point_spacing(points)
    spacing = np.minimum(spacing, 1.5 * np.median(spacing))
    step = max(float(spacing.max()), 1e-6) / 255.0
    light = _light(_T_VIEW_HAND.rotate(prototype.normals))
    colors = np.clip(np.asarray(CHOSEN_COLOR) * light[:, None], 0.0, 1.0)
    turns = half_turns(prototype)
    return {
        "name": prototype.name,
        "hand": f"{prototype.gripper} {prototype.preshape}",
        "width": round(prototype.width, 5),
        "opening": round(prototype.opening, 5),
        "kind": prototype.kind,
        "description": prototype.definition.description,
        "turns": ", ".join(turns) or "none",
        "findings": list(findings),
        "count": len(points),
        "points": packed_points(points),
        "colors": packed_bytes(np.rint(255 * colors).astype(np.uint8)),
        "sizes": packed_bytes(np.rint(spacing / step).astype(np.uint8)),
        "sizeStep": round(step, 9),
        "open": _hand(gripper, prototype.preshape, prototype.opening),
        "closed": _hand(gripper, prototype.preshape, prototype.width),
    }


def _hand(gripper: GripperModel, preshape: str, opening: float) -> dict[str, Any]:
    solids = gripper.solids(preshape, opening)
    mesh = merged(solids, HAND_COLORS[0]).moved(_T_VIEW_HAND)
    return {
        **packed_points(mesh.vertices),
        "faces": packed_bytes(mesh.faces.astype("<u4")),
    }


def _light(normals: FloatArray) -> FloatArray:
    lamp = np.array([-0.35, 0.45, 0.82])
    light: FloatArray = 0.62 + 0.38 * np.clip(
        normals @ (lamp / np.linalg.norm(lamp)), -0.6, 1.0
    )
    return light
