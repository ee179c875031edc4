"""Arguments that name a robot, its fiducial, and where its camera has to be right."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from debrisgrasp._calibrating import Rig, View, WristRig, limits_with, rig_of
from debrisgrasp.calibration import CalibrationConfig
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import Bounds
from debrisgrasp.io.calibration_json import StoredCalibration
from debrisgrasp.io.depth_images import load_camera
from debrisgrasp.io.observations_file import ObservationFile
from debrisgrasp.settings import Settings

from .site_arguments import add_site, site_of
from .values import number

__all__ = [
    "add_fiducial_sigma",
    "add_robot",
    "limits_of",
    "require_same_fiducial",
    "rig_given",
    "view_of",
]


def add_robot(parser: argparse.ArgumentParser, words: str) -> None:
    """Add ``--robot``, of which ``words`` say more, ``--fiducial`` and ``--site``."""
    parser.add_argument("--robot", help=f"a shipped robot or a YAML file; {words}")
    parser.add_argument(
        "--fiducial",
        type=_fiducial,
        metavar="LINK",
        help="link that carries it; if an arm carries the camera, a link that stands "
        "still, or its place in base: X,Y,Z in metres",
    )
    add_site(parser)


def add_fiducial_sigma(parser: argparse.ArgumentParser) -> None:
    """Add ``--fiducial-sigma``."""
    parser.add_argument(
        "--fiducial-sigma",
        type=number,
        metavar="M",
        help="how well the place of the fiducial is known (default: 0.02 m)",
    )


def _fiducial(text: str) -> str | tuple[float, ...]:
    """Parse the name of a link, or three numbers with commas between them."""
    if "," not in text:
        return text
    place = tuple(number(word) for word in text.split(","))
    if len(place) != 3:
        raise argparse.ArgumentTypeError(f"{text!r} is no place X,Y,Z in base [m]")
    return place


def limits_of(
    site: Settings, rig: Rig | None, given: ObservationFile
) -> CalibrationConfig:
    """Limits on the error over the workspace of the site, where it has one.

    Not of a camera that an arm carries: that workspace does not move with it.
    """
    box = None if isinstance(rig, WristRig) else site.workspace
    workspace = None if box is None else Bounds(*map(np.array, box))
    return limits_with(CalibrationConfig(workspace=workspace), given)


def view_of(site: Settings) -> View:
    """Take what the camera of the site sees, or a usual one."""
    path = site.camera_file
    return View() if path is None else View(intrinsics=load_camera(path))


def rig_given(
    arguments: argparse.Namespace, given: ObservationFile, path: Path
) -> Rig | None:
    """Rig of the arguments, the observations or, where these name none, the site."""
    robot = arguments.robot
    has_fiducial = arguments.fiducial is not None or given.fiducial is not None
    if arguments.site is not None and given.robot is None and has_fiducial:
        robot = site_of(arguments).robot
    return rig_of(given, path, robot, arguments.fiducial)


def require_same_fiducial(stored: StoredCalibration, rig: Rig | None) -> None:
    """Refuse another fiducial where that of the calibration was not where it should be.

    Raises
    ------
    ConfigError
        If its shift would be added to another place.
    """
    given = None if rig is None else rig.fiducial
    if given is None or stored.fiducial_given is None or not stored.fiducial.any():
        return
    named = given if isinstance(given, str) else tuple(given)
    if named != stored.fiducial_given:
        raise ConfigError(
            "fiducial of the looks",
            got=named,
            expected=f"{stored.fiducial_given}, as calibration {stored.path} has it, "
            f"which found it {1e3 * np.linalg.norm(stored.fiducial):.0f} mm from there",
            mend="Name the same; where it was found instead is known from there.",
        )
