"""Reading the file of a site; what its fields mean stands in `settings`."""

from __future__ import annotations

import os
from dataclasses import fields as dataclass_fields
from pathlib import Path
from typing import Any, Literal

import numpy as np

from debrisgrasp._fields import Fields
from debrisgrasp._files import is_yaml
from debrisgrasp._site_limits import SiteLimits
from debrisgrasp._unreadable import why_not_there
from debrisgrasp._words import shortened
from debrisgrasp.errors import ConfigError
from debrisgrasp.io import CameraPose, parse_camera_pose

__all__ = ["POLICIES", "values_of_site"]

_SCHEMA = "debrisgrasp/site/1"
POLICIES = ("support", "priority")
"""Names of the policies: `SupportAware`, and `PriorityPoint` (Eq. 1)."""


def values_of_site(fields: Fields) -> dict[str, Any]:
    """Read what `Settings` takes, by name; paths are relative to the file."""
    fields.choice("schema", (_SCHEMA,))
    return _top(fields) | _camera(fields) | _selection(fields) | _limits(fields)


def _top(fields: Fields) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for name in ("robot", "arm", "gripper"):
        if name in fields:
            values[name] = fields.text(name)
    if is_yaml(values.get("robot", "")):
        values["robot"] = str(_file(fields, "robot"))
    for name in ("grippers", "prototypes"):
        if name in fields:
            values[name] = _there(fields, name, "folder")
    if "success" in fields:
        values["success"] = _file(fields, "success")
    if "drop_off" in fields:
        places = fields.child("drop_off")
        values["drop_off"] = {
            arm: tuple(places.numbers(arm, 2).tolist()) for arm in places.names()
        }
    if "workspace" in fields:
        box = fields.numbers("workspace", 6).tolist()
        values["workspace"] = tuple(box[:3]), tuple(box[3:])
    if "deadline" in fields:
        values["deadline"] = fields.number("deadline", -np.inf, np.inf)
    if "seed" in fields:
        values["seed"] = fields.count("seed")
    return values


def _camera(fields: Fields) -> dict[str, Any]:
    if "camera" not in fields:
        return {}
    camera = fields.child("camera")
    values: dict[str, Any] = {}
    if "calibration" in camera:
        values["calibration"] = _file(camera, "calibration")
    if "file" in camera:
        values["camera_file"] = _file(camera, "file")
    if "pose" in camera:
        values["camera_pose"] = _pose(camera)
    camera.finish()
    return values


def _pose(camera: Fields) -> CameraPose:
    """Six numbers, or a file with the 4x4 matrix."""
    given = camera.raw("pose")
    if isinstance(given, str):
        return parse_camera_pose(
            "level" if given == "level" else str(_file(camera, "pose"))
        )
    numbers = camera.numbers("pose", 6)
    try:
        return parse_camera_pose(",".join(map(repr, numbers.tolist())))
    except ConfigError as error:
        raise ConfigError.about(camera.where("pose"), error) from error


def _selection(fields: Fields) -> dict[str, Any]:
    if "selection" not in fields:
        return {}
    selection = fields.child("selection")
    values: dict[str, Any] = {}
    if "policy" in selection:
        values["policy"] = selection.choice("policy", POLICIES)
    if "priority_point" in selection:
        values["priority_point"] = selection.numbers("priority_point", 3)
    selection.finish()
    return values


def _limits(fields: Fields) -> dict[str, Any]:
    if "limits" not in fields:
        return {}
    limits = fields.child("limits")
    given = {
        item.name: limits.number(item.name, -np.inf, np.inf)
        for item in dataclass_fields(SiteLimits)
        if item.name in limits
    }
    limits.finish()
    try:
        return {"limits": SiteLimits(**given)}
    except ConfigError as error:
        raise ConfigError.about(f"{fields.file}, field {error.what}", error) from error


def _file(fields: Fields, name: str) -> Path:
    return _there(fields, name, "file")


def _there(fields: Fields, name: str, kind: Literal["file", "folder"]) -> Path:
    given = os.path.expanduser(fields.text(name))  # noqa: PTH111  # Path's raises
    path = Path(fields.file).parent / given
    if why := why_not_there(path, kind):
        raise ConfigError(
            fields.where(name),
            got=f"{why}: {shortened(str(path), most=200)}",
            expected=f"an existing {kind}",
            mend="Paths are relative to the file of settings.",
        )
    return path
