"""The YAML file of one prototype: read and checked, or written."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import fields as fields_of
from pathlib import Path
from typing import Any, cast

import numpy as np
import yaml

from debrisgrasp._arrays import FloatArray
from debrisgrasp._checked import checked
from debrisgrasp._fields import MAX_LENGTH, Fields
from debrisgrasp._files import read_yaml, require_suffix, write_together
from debrisgrasp._unreadable import is_there
from debrisgrasp.errors import ConfigError, OutputError, UnknownNameError

from .gripper import FURTHER_HANDS, GripperModel
from .pose_fields import read_pose
from .prototype import KINDS, PrototypeDefinition, require_name
from .shapes import SHAPES, Shape
from .surface_file import read_surface, surface_bytes
from .surface_shape import SIDES, SurfaceShape

__all__ = [
    "HEADER",
    "definition_from",
    "prototype_files",
    "prototype_text",
    "read_prototype",
    "write_new_prototype",
]

DEFAULT_CLEARANCE = 0.04
"""How much wider than the object the hand stays open if a file doesn't say [m]: 1 cm
on each side for the error of the pose, and as much for what lies beside the object."""

HEADER = """\
# Grasp prototype of debrisgrasp: a piece of surface as the hand holds it.
# Copy, edit, and run `debrisgrasp prototype check`. Metres; angles in degrees.
# Hand frame: origin on the palm face, +z out of the palm, +x from the thumb to the
# finger pair (the fingers close along it), y across the fingers.
#   width     distance between the finger pads when closed on the shape
#   opening   distance during the approach; without it: width + 0.04, as far as it goes
#   shape     bar: width (x) height (z) length (y), both ends going on
#             box: width (x) height (z) length (y), a whole block
#             cylinder: diameter length, about y; ends: open or closed
#             edge: thickness (x) length (y) depth (z) of a board that goes on along +z;
#                   ends along y: open, one (a corner) or both (the end of a plank)
#             rim: thickness diameter length depth of a round wall along +z that curves
#                  towards +x
#             handle: diameter, length between its posts, standoff, plate
#             rung: diameter, length between the rails; rail_width (y) rail_height (z)
#                   rail_length (x)
#             cell: thickness (x) and depth (z) of a wall of a hollow block; length (y)
#                   of the cell behind it at +x, web (y) and reach (x) of its end walls
#             surface: file, a PLY of points with normals beside this one; sides: all,
#                      or seen if it is what one camera saw
#             position, rpy_deg: where it is in the hand frame; its origin is the
#             centre, for edge and rim the middle of the edge, for handle of the bar
#   kind      generic, or object-specific: tried on marked objects only
#   symmetry  shape: turns that map the shape onto itself are grasps too; or none
"""


def read_prototype(
    path: str | os.PathLike[str], grippers: Mapping[str, GripperModel]
) -> PrototypeDefinition:
    """Read the file of a prototype for one of the hands.

    Raises
    ------
    ConfigError
        Naming file, field and range.
    UnknownNameError
        For a hand, preshape, shape or field that doesn't exist; it lists those that do.
    """
    return definition_from(read_yaml(path), grippers, Path(path))


def definition_from(
    content: object, grippers: Mapping[str, GripperModel], source: Path
) -> PrototypeDefinition:
    """Check the content of a prototype's file.

    Parameters
    ----------
    content
        What the file says, as `yaml.safe_load` gives it.
    source
        The file, for messages and for the points beside it; it need not exist.

    Raises
    ------
    ConfigError, UnknownNameError
        As `read_prototype` does.
    """
    fields = Fields(content, str(source))
    name = fields.text("gripper")
    if name not in grippers:
        raise UnknownNameError(
            f"value in {fields.where('gripper')}", name, grippers, mend=FURTHER_HANDS
        )
    gripper = grippers[name]
    preshape = gripper.preshape(fields.choice("preshape", gripper.preshapes))
    width = fields.length("width", *preshape.widths)
    max_opening = float(preshape.openings[0])
    opening = min(width + DEFAULT_CLEARANCE, max_opening)
    if "opening" in fields:
        opening = fields.length("opening", width, max_opening)
    shape_fields = fields.child("shape")
    shape = _read_shape(shape_fields, source.parent)
    definition = PrototypeDefinition(
        name=_read_name(fields),
        gripper=gripper.name,
        preshape=preshape.name,
        width=width,
        opening=opening,
        shape=shape,
        T_hand_shape=read_pose(shape_fields),
        kind=fields.choice("kind", KINDS, "generic"),
        has_shape_symmetry=fields.choice("symmetry", ("shape", "none"), "shape")
        == "shape",
        tags=_read_tags(fields),
        description=fields.text("description", ""),
    )
    shape_fields.finish()
    fields.finish()
    return definition


def prototype_text(definition: PrototypeDefinition) -> str:
    """Text of the file that `read_prototype` reads back."""
    angles = np.rad2deg(_rpy(definition.T_hand_shape.R))
    shape = _shape_content(definition)
    shape["position"] = _plain(definition.T_hand_shape.p)
    if np.abs(angles).max() > 1e-9:
        shape["rpy_deg"] = _plain(angles)
    content = {
        "name": definition.name,
        "gripper": definition.gripper,
        "preshape": definition.preshape,
        "width": _plain(definition.width),
        "opening": _plain(definition.opening),
        "shape": shape,
        "kind": definition.kind,
        "symmetry": "shape" if definition.has_shape_symmetry else "none",
        "tags": list(definition.tags),
    }
    if description := definition.description.strip():
        content["description"] = description
    return HEADER + yaml.safe_dump(
        content, sort_keys=False, allow_unicode=True, default_flow_style=None
    )


def prototype_files(
    definition: PrototypeDefinition, path: Path
) -> dict[Path, bytes | str]:
    """Give the content of a prototype's file, and of a surface's ``<name>.ply``."""
    files: dict[Path, bytes | str] = {path: prototype_text(definition)}
    if isinstance(definition.shape, SurfaceShape):
        surface = surface_bytes(definition.shape)
        files[path.parent / _surface_name(definition)] = surface
    return files


@checked
def write_new_prototype(
    definition: PrototypeDefinition, path: str | os.PathLike[str], *, force: bool
) -> tuple[Path, ...]:
    """Write a prototype where there is none yet, or anyway.

    Returns
    -------
    tuple[Path, ...]
        The files that were written.

    Raises
    ------
    ConfigError
        If the name of the file does not end in .yaml: no dictionary would read it.
    OutputError
        If a file is in the way and ``force`` is not given, or it can't be written.
    """
    target = Path(path)
    require_suffix(target, (".yaml", ".yml"), "a prototype's file")
    files = prototype_files(definition, target)
    for file in files:
        if file.exists() and not force:
            raise OutputError(file, "it exists; --force (force=True) replaces it")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(target.parent, error.strerror or str(error)) from error
    write_together(files)
    return tuple(files)


def _read_name(fields: Fields) -> str:
    return require_name(fields.text("name"), fields.where("name"))


def _read_tags(fields: Fields) -> tuple[str, ...]:
    if "tags" not in fields:
        return ()
    tags = fields.raw("tags")
    if not isinstance(tags, list) or not all(isinstance(tag, str) for tag in tags):
        raise ConfigError(
            fields.where("tags"), got=repr(tags), expected="a list of words"
        )
    return tuple(tags)


def _read_shape(fields: Fields, folder: Path) -> Shape:
    kind = fields.text("type")
    if kind == _SURFACE:
        file, sides = fields.text("file"), fields.choice("sides", SIDES, "seen")
        if not is_there(folder / file):
            raise ConfigError(
                fields.where("file"),
                got=f"{file}, which is not there",
                expected="a PLY beside this file",
                mend="What was measured is two files: copy, rename and keep both.",
            )
        return read_surface(folder / file, sides)
    if kind not in SHAPES:
        known = [*SHAPES, _SURFACE]
        raise UnknownNameError(f"shape in {fields.where('type')}", kind, known)
    values: dict[str, Any] = {}
    for item in fields_of(cast(Any, SHAPES[kind])):
        if item.name not in fields and isinstance(item.default, float | str):
            continue
        if "known" in item.metadata:
            values[item.name] = fields.choice(item.name, item.metadata["known"])
        else:
            low, high = item.metadata["low"], item.metadata["high"]
            values[item.name] = fields.length(item.name, low, min(high, MAX_LENGTH))
    return SHAPES[kind](**values)


_SURFACE = "surface"


def _surface_name(definition: PrototypeDefinition) -> str:
    return f"{definition.name}.ply"


def _shape_content(definition: PrototypeDefinition) -> dict[str, Any]:
    shape = definition.shape
    if isinstance(shape, SurfaceShape):
        file = _surface_name(definition)
        return {"type": _SURFACE, "file": file, "sides": shape.sides}
    kind = next(name for name, kind in SHAPES.items() if type(shape) is kind)
    names = [item.name for item in fields_of(cast(Any, shape))]
    return {"type": kind} | {name: _plain(getattr(shape, name)) for name in names}


def _plain(value: Any) -> Any:
    """Numbers as a person would write them: to the micrometre, without -0."""
    if isinstance(value, str):
        return value
    if isinstance(value, np.ndarray):
        return [_plain(float(item)) for item in value]
    return round(float(value), 6) + 0.0


def _rpy(R: FloatArray) -> FloatArray:
    """Roll, pitch and yaw [rad] of a rotation; yaw is 0 at a pitch of 90 degrees."""
    level = np.hypot(R[0, 0], R[1, 0])
    pitch = np.arctan2(-R[2, 0], level)
    if level < 1e-9:
        return np.array([np.arctan2(-R[1, 2], R[1, 1]), pitch, 0.0])
    return np.array([np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])])
