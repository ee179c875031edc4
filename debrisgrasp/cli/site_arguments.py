"""The argument ``--site``, and what other arguments change of the settings."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from debrisgrasp.errors import ConfigError
from debrisgrasp.io import parse_camera_pose
from debrisgrasp.prototypes import GripperModel, load_grippers
from debrisgrasp.settings import Settings

from .values import some_path

__all__ = ["add_grippers", "add_site", "hands_of", "site_of"]

_PLAIN = ("robot", "arm", "gripper", "policy", "priority_point", "seed", "deadline")
_PATHS = ("grippers", "prototypes")


def add_site(parser: argparse.ArgumentParser) -> None:
    """Add ``--site``."""
    parser.add_argument(
        "--site",
        type=some_path,
        metavar="FILE",
        help="settings that stay the same from capture to capture; other arguments go "
        "before them",
    )


def add_grippers(parser: Any) -> None:
    """Add ``--grippers`` to a parser, or to a group of its arguments."""
    parser.add_argument(
        "--grippers",
        type=some_path,
        metavar="DIR",
        help="folder of files of further hands",
    )


def hands_of(arguments: argparse.Namespace) -> dict[str, GripperModel]:
    """Load the shipped hands, and those of the arguments or of the site.

    Raises
    ------
    ConfigError
        As `site_of` and `load_grippers` do.
    """
    return load_grippers(site_of(arguments).grippers)


def site_of(arguments: argparse.Namespace) -> Settings:
    """Load the settings of the site, changed by the arguments that were given.

    Raises
    ------
    ConfigError, UnknownNameError
        As `Settings.load` does; also if the camera's pose is given twice.
    """
    path = getattr(arguments, "site", None)
    settings = Settings() if path is None else Settings.load(path)
    changes: dict[str, Any] = {}
    for name in _PLAIN:
        if (value := getattr(arguments, name, None)) is not None:
            changes[name] = value
    for name in _PATHS:
        if (value := getattr(arguments, name, None)) is not None:
            changes[name] = Path(value)
    if "robot" in changes:
        # Arms have other names on another robot.
        changes.setdefault("arm", None)
        changes["drop_off"] = {}
    return replace(settings, **changes, **_camera(arguments))


def _camera(arguments: argparse.Namespace) -> dict[str, Any]:
    pose = getattr(arguments, "camera_pose", None)
    calibration = getattr(arguments, "calibration", None)
    if pose is not None and calibration is not None:
        raise ConfigError(
            "camera pose",
            got="both --camera-pose and --calibration",
            expected="one of them",
        )
    if pose is not None:
        return {"camera_pose": parse_camera_pose(pose), "calibration": None}
    if calibration is not None:
        return {"camera_pose": None, "calibration": Path(calibration)}
    return {}
