"""The rig and the looks that an observations file describes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from debrisgrasp._files import is_yaml
from debrisgrasp._unreadable import why_not_there
from debrisgrasp.calibration import CalibrationConfig, Observations
from debrisgrasp.errors import ConfigError
from debrisgrasp.io.calibration_json import StoredCalibration
from debrisgrasp.io.observations_file import ObservationFile
from debrisgrasp.kinematics import RobotModel

from .rig import CalibrationRig
from .rows import kinematic_sigma_of, points_of, sigmas_of
from .wrist import WristRig, is_carried

__all__ = [
    "Rig",
    "limits_with",
    "observations_of",
    "require_same_robot",
    "rig_of",
]

Rig = CalibrationRig | WristRig
"""What moves before what: the fiducial before the camera, or the other way round."""


def observations_of(given: ObservationFile, rig: Rig | None) -> Observations:
    """Observations of a file; without a robot their positions must be written down."""
    if rig is not None:
        return rig.observations(given)
    for row in given.rows:
        if row.position is None or row.joints:
            raise ConfigError(
                f"observation {row.name}",
                got="joint values, but no robot",
                expected="a position in base, or `robot` and `fiducial` of the file",
                mend="Name the robot and the fiducial's link: --robot, --fiducial.",
            )
    places = [row.position or () for row in given.rows]
    return Observations(
        np.array(places).reshape(-1, 3),
        points_of(given),
        sigmas_of(given),
        names=tuple(row.name for row in given.rows),
        kinematic_sigma=kinematic_sigma_of(given),
    )


def limits_with(config: CalibrationConfig, given: ObservationFile) -> CalibrationConfig:
    """Limits with what a file states about the place of its fiducial."""
    if given.fiducial_sigma is None:
        return config
    return replace(config, fiducial_sigma=given.fiducial_sigma)


def rig_of(
    given: ObservationFile,
    path: Path,
    robot: str | Path | None = None,
    fiducial: str | Sequence[float] | None = None,
) -> Rig | None:
    """Rig that a file, or the caller instead, names; None if neither names a robot.

    A robot's file that the observations name is sought from where they are, ``path``.

    Raises
    ------
    ConfigError, UnknownNameError
        If the robot can't be had, or no fiducial is named that its camera could see.
    """
    name = robot or given.robot
    place = given.fiducial if fiducial is None else fiducial
    if name is None:
        return None
    if place is None:
        raise ConfigError(
            "fiducial",
            got="none",
            expected="the link of the robot that carries it, or, if an arm carries the "
            "camera, its place in base",
            mend="Name it in the observations (`fiducial:`) or with --fiducial.",
        )
    if robot is None and is_yaml(name):
        name = path.parent / name
        if why := why_not_there(name, "file"):
            raise ConfigError(
                f"robot of {path}",
                got=f"{why}: {name}",
                expected="a robot's file; its path is relative to that one",
                mend="Correct `robot` in it, or give the robot's file as --robot.",
            )
    model = RobotModel.load(name)
    if is_carried(model):
        return WristRig(robot=model, fiducial=place)
    if not isinstance(place, str):
        raise ConfigError(
            "fiducial",
            got=f"a place, {tuple(place)}, which never moves, nor does the camera",
            expected="the link of the arm that carries it",
            mend="If an arm carries the camera, name its optical frame as `camera` in "
            "the robot's file.",
        )
    return CalibrationRig(robot=model, fiducial=place)


def require_same_robot(stored: StoredCalibration, rig: Rig | None) -> None:
    """Refuse a calibration of another robot or camera, as far as both are known.

    Raises
    ------
    ConfigError
        If they are not the same.
    """
    if rig is not None:
        stored.require_of(rig.robot.name)
    link = rig.link if isinstance(rig, WristRig) else None
    if stored.link != link:
        raise ConfigError(
            f"calibration {stored.path}",
            got=f"one of a camera on {stored.link or 'no link of an arm'}",
            expected=f"one of a camera on {link or 'no link of an arm'}",
        )
