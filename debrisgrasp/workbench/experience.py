"""Recorded grasps: what was inside the hand, and whether it held.

A folder holds ``grasps.jsonl``, a line for each grasp, and ``surfaces/`` with the piece
of surface around each grip in the palm frame, as the camera saw it before.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from debrisgrasp._checked import checked, checked_fields
from debrisgrasp._files import read_text, write_atomic
from debrisgrasp._parsing import json_content
from debrisgrasp._unreadable import is_there, why_not_there
from debrisgrasp.errors import ConfigError, InputError, OutputError, ShapeError
from debrisgrasp.geometry import SE3, PointCloud
from debrisgrasp.planning import Grasp
from debrisgrasp.prototypes import GripperModel, SurfaceShape, around_grip
from debrisgrasp.prototypes.surface_file import read_surface, surface_bytes

__all__ = ["GraspRecord", "load_records", "recorded", "save_records"]

SCHEMA = "debrisgrasp/grasp/1"
_LINES, _SURFACES = "grasps.jsonl", "surfaces"


@checked_fields
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GraspRecord:
    """One grasp that was carried out."""

    surface: SurfaceShape
    """What was around the grip, palm frame."""
    gripper: str
    preshape: str
    opening: float
    """Distance between the pads on the approach [m]."""
    width: float
    """Distance between the pads when closed [m]."""
    held: bool
    """Whether the object was lifted and kept."""
    prototype: str = ""
    """What the planner took the surface for."""
    source: str = ""
    """Where it is from, for instance the tier and the seed of a trial."""


@checked
def recorded(
    cloud: PointCloud,
    is_object: np.ndarray[Any, Any],
    grasp: Grasp,
    gripper: GripperModel,
    *,
    held: bool,
    source: str = "",
) -> GraspRecord:
    """Make the record of a grasp from what was seen before it.

    Parameters
    ----------
    cloud
        In the frame of the grasp, base.
    is_object
        Which of its points belong to what was gripped, shape (n,).

    Raises
    ------
    InputError
        If next to nothing of the object is around the grip, or the hand is another.
    ShapeError
        If what belongs to the object is not told by True and False.
    """
    if gripper.name != grasp.gripper:
        raise InputError("gripper", got=gripper.name, expected=grasp.gripper)
    is_object = np.asarray(is_object)
    if is_object.dtype != bool or is_object.shape != (len(cloud),):
        raise ShapeError(
            "is_object",
            got=f"{is_object.dtype} {is_object.shape}",
            expected=f"True or False for each point, ({len(cloud)},)",
            mend="labels == label makes it of labels.",
        )
    piece = cloud.selected(is_object)
    seen = np.isfinite(piece.normals).all(axis=1)
    own = grasp.T_base_hand.inverse()
    surface = SurfaceShape.thinned(
        own.apply(piece.points[seen]), own.rotate(piece.normals[seen])
    )
    return GraspRecord(
        surface=around_grip(surface, SE3.identity(), gripper, grasp.preshape),
        gripper=grasp.gripper,
        preshape=grasp.preshape,
        opening=grasp.opening,
        width=grasp.width,
        held=held,
        prototype=grasp.prototype,
        source=source,
    )


def save_records(
    records: Iterable[GraspRecord], folder: str | os.PathLike[str]
) -> None:
    """Write records into a new folder; the list goes last, when all is there.

    Raises
    ------
    OutputError
        If the folder holds records already, or can't be written.
    """
    folder = Path(folder)
    if is_there(folder / _LINES):
        raise OutputError(folder / _LINES, "it holds other records")
    try:
        (folder / _SURFACES).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(folder, error.strerror or str(error)) from error
    lines = []
    for number, record in enumerate(records):
        name = f"{_SURFACES}/{number:06d}.ply"
        write_atomic(folder / name, surface_bytes(record.surface))
        lines.append(json.dumps(_facts(record, name)))
    write_atomic(folder / _LINES, "\n".join([*lines, ""]))


def load_records(folder: str | os.PathLike[str]) -> tuple[GraspRecord, ...]:
    """Read the records of a folder.

    Raises
    ------
    ConfigError
        Naming file, line and what is wrong.
    """
    return tuple(_records(Path(folder)))


def _records(folder: Path) -> Iterator[GraspRecord]:
    path = folder / _LINES
    if not why_not_there(folder, "file"):
        raise ConfigError(
            str(folder), got="a file", expected=f"a folder of records with {_LINES}"
        )
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        where = f"{path}, line {number}"
        try:
            facts = json_content(line)
            if facts["schema"] != SCHEMA:
                raise ConfigError(where, got=repr(facts["schema"]), expected=SCHEMA)
            file = Path(facts["surface"])
            if file.is_absolute() or ".." in file.parts:
                raise ConfigError(
                    where, got=str(file), expected="a file inside the folder"
                )
            held = facts["held"]
            if not isinstance(held, bool):
                raise ConfigError(where, got=repr(held), expected="held: true or false")
            yield GraspRecord(
                surface=read_surface(folder / file, "seen"),
                gripper=str(facts["gripper"]),
                preshape=str(facts["preshape"]),
                opening=float(facts["opening"]),
                width=float(facts["width"]),
                held=held,
                prototype=str(facts.get("prototype", "")),
                source=str(facts.get("source", "")),
            )
        except KeyError as error:
            raise ConfigError(
                where, got=f"no field {error}", expected=f"the fields of {SCHEMA}"
            ) from error
        except InputError:
            raise
        except (TypeError, AttributeError, ValueError) as error:
            raise ConfigError(
                where, got=str(error), expected=f"a line of {SCHEMA}"
            ) from error


def _facts(record: GraspRecord, surface: str) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "surface": surface,
        "gripper": record.gripper,
        "preshape": record.preshape,
        "opening": round(record.opening, 6),
        "width": round(record.width, 6),
        "held": record.held,
        "prototype": record.prototype,
        "source": record.source,
    }
