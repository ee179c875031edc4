"""Arguments that name a robot, its fiducial, and where its camera has to be right."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from debrisgrasp._calibrating import CalibrationRig, View, rig_of
from debrisgrasp.calibration import CalibrationConfig
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import Bounds
from debrisgrasp.io.calibration_json import StoredCalibration
from debrisgrasp.io.depth_images import load_camera
from debrisgrasp.io.observations_file import ObservationFile
from debrisgrasp.settings import Settings

from .site_arguments import add_site, site_of

__all__ = ["add_robot", "limits_of", "require_same_robot", "rig_given", "view_of"]


def add_robot(parser: argparse.ArgumentParser, words: str) -> None:
    """Add ``--robot``, of which ``words`` say more, ``--fiducial`` and ``--site``."""
    parser.add_argument("--robot", help=f"a shipped robot or a YAML file; {words}")
    parser.add_argument("--fiducial", metavar="LINK", help="link that carries it")
    add_site(parser)


def limits_of(site: Settings) -> CalibrationConfig:
    """Limits on the error over the workspace of the site, where it has one."""
    if site.workspace is None:
        return CalibrationConfig()
    return CalibrationConfig(workspace=Bounds(*map(np.array, site.workspace)))


def view_of(site: Settings) -> View:
    """Take what the camera of the site sees, or a usual one."""
    path = site.camera_file
    return View() if path is None else View(intrinsics=load_camera(path))


def rig_given(
    arguments: argparse.Namespace, given: ObservationFile, folder: Path
) -> CalibrationRig | None:
    """Rig of the arguments, the observations or, where these name none, the site."""
    robot = arguments.robot
    has_fiducial = arguments.fiducial is not None or given.fiducial is not None
    if arguments.site is not None and given.robot is None and has_fiducial:
        robot = site_of(arguments).robot
    return rig_of(given, folder, robot, arguments.fiducial)


def require_same_robot(stored: StoredCalibration, rig: CalibrationRig | None) -> None:
    """Refuse a calibration of another robot, as far as both are known.

    Raises
    ------
    ConfigError
        If they are not the same.
    """
    if rig is not None and stored.robot not in (None, rig.robot.name):
        raise ConfigError(
            f"calibration {stored.path}",
            got=f"one of the robot {stored.robot!r}",
            expected=f"one of {rig.robot.name!r}",
        )
