"""The YAML file of one prototype: read and checked, or written."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import fields as fields_of
from pathlib import Path
from typing import Any, cast

import numpy as np
import yaml

from debrisgrasp._arrays import FloatArray
from debrisgrasp._files import read_yaml, write_atomic
from debrisgrasp.errors import ConfigError, UnknownNameError

from ._fields import MAX_LENGTH, Fields
from .gripper import GripperModel
from .prototype import KINDS, PrototypeDefinition
from .shapes import SHAPES, Shape

__all__ = ["HEADER", "prototype_text", "read_prototype", "write_prototype"]

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
#             position, rpy_deg: where it is in the hand frame; its origin is the
#             centre, for edge and rim the middle of the edge, for handle of the bar
#   kind      generic, or object-specific: tried on marked objects only
#   symmetry  shape: turns that map the shape onto itself are grasps too; or none
"""

_NAME = re.compile(r"[a-z0-9][a-z0-9_]*")


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
    fields = Fields(read_yaml(path), Path(path).name)
    gripper = grippers[fields.choice("gripper", grippers)]
    preshape = gripper.preshape(fields.choice("preshape", gripper.preshapes))
    width = fields.length("width", *preshape.widths)
    max_opening = float(preshape.openings[0])
    opening = min(width + DEFAULT_CLEARANCE, max_opening)
    if "opening" in fields:
        opening = fields.length("opening", width, max_opening)
    shape_fields = fields.child("shape")
    shape = _read_shape(shape_fields)
    definition = PrototypeDefinition(
        name=_read_name(fields),
        gripper=gripper.name,
        preshape=preshape.name,
        width=width,
        opening=opening,
        shape=shape,
        T_hand_shape=shape_fields.pose(),
        kind=fields.choice("kind", KINDS, "generic"),
        has_shape_symmetry=fields.choice("symmetry", ("shape", "none"), "shape")
        == "shape",
        tags=_read_tags(fields),
        description=fields.text("description", "-"),
    )
    shape_fields.finish()
    fields.finish()
    return definition


def prototype_text(definition: PrototypeDefinition) -> str:
    """Text of the file that `read_prototype` reads back."""
    angles = np.rad2deg(_rpy(definition.T_hand_shape.R))
    shape = {"type": _shape_name(definition.shape)}
    shape |= {
        item.name: _plain(getattr(definition.shape, item.name))
        for item in fields_of(cast(Any, definition.shape))
    }
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
        "description": definition.description or "-",
    }
    return HEADER + yaml.safe_dump(
        content, sort_keys=False, allow_unicode=True, default_flow_style=None
    )


def write_prototype(
    definition: PrototypeDefinition, path: str | os.PathLike[str]
) -> None:
    """Write the file of a prototype, whole or not at all."""
    write_atomic(path, prototype_text(definition))


def _read_name(fields: Fields) -> str:
    name = fields.text("name")
    if not _NAME.fullmatch(name):
        raise ConfigError(
            fields.where("name"),
            got=repr(name),
            expected="lower-case letters, digits and underscores",
        )
    return name


def _read_tags(fields: Fields) -> tuple[str, ...]:
    if "tags" not in fields:
        return ()
    tags = fields.raw("tags")
    if not isinstance(tags, list) or not all(isinstance(tag, str) for tag in tags):
        raise ConfigError(
            fields.where("tags"), got=repr(tags), expected="a list of words"
        )
    return tuple(tags)


def _read_shape(fields: Fields) -> Shape:
    kind = fields.text("type")
    if kind not in SHAPES:
        raise UnknownNameError(f"shape in {fields.where('type')}", kind, SHAPES)
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


def _shape_name(shape: Shape) -> str:
    return next(name for name, kind in SHAPES.items() if type(shape) is kind)


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
