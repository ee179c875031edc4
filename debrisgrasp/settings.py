"""The settings of a site: one file that says which robot works where, and how."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray, frozen, require_metres
from debrisgrasp._calibrating import pose_on_arm
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp._fields import Fields
from debrisgrasp._files import read_yaml
from debrisgrasp._site_file import POLICIES, values_of_site
from debrisgrasp._site_limits import SiteLimits
from debrisgrasp._words import arm_called
from debrisgrasp.errors import ChoiceError, ConfigError, InputError, UnknownNameError
from debrisgrasp.geometry import so3
from debrisgrasp.io import CameraPose, Capture
from debrisgrasp.io.calibration_json import load_calibration
from debrisgrasp.io.depth_images import lacks_camera
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.segmentation import (
    DEFAULT_POINT,
    PriorityPoint,
    SelectionPolicy,
    SupportAware,
)

logger = logging.getLogger(__name__)

__all__ = ["POLICIES", "Settings", "SiteLimits"]

_SAME = 0.002
"""Poses of a camera that differ by less [m, rad] are the same."""
Corners = tuple[tuple[float, float, float], tuple[float, float, float]]


@checked_fields
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Settings:
    """Everything that stays the same from capture to capture."""

    robot: str = "roman"
    """A shipped robot, the path of a robot's file, or ``"none"``: a floating hand."""
    arm: str | None = None
    """Use only this arm."""
    gripper: str | None = None
    """Use only this hand."""
    grippers: Path | None = None
    """Folder of files of further hands."""
    prototypes: Path | None = None
    """Folder of prototype files; None for the shipped ones."""
    success: Path | None = None
    """File of coefficients of the score (`SuccessModel`); None: the shipped ones."""
    calibration: Path | None = None
    """Result of ``debrisgrasp calibrate`` that says where the camera is."""
    camera_pose: CameraPose | None = None
    """Pose of the camera in the base frame, where there is no calibration."""
    camera_file: Path | None = None
    """Intrinsics of depth images that have none beside them."""
    policy: str = "support"
    """Which objects come first, one of `POLICIES`."""
    priority_point: FloatArray = field(default_factory=lambda: np.array(DEFAULT_POINT))
    """Objects near it are preferred, base frame [m], shape (3,)."""
    drop_off: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Where an arm puts things down, by its name: (x, y) in the base frame [m]."""
    workspace: Corners | None = None
    """Of the box of the way that is to be cleared, lower and upper corner, base frame
    [m]; None: as `TaskSettings` has it."""
    limits: SiteLimits = SiteLimits()
    seed: int = 0
    deadline: float | None = None
    """Seconds after which a search settles for what it has."""
    path: Path | None = None
    """The file that they come from."""

    def __post_init__(self) -> None:
        point = frozen(self.priority_point, "priority_point", (3,))
        object.__setattr__(self, "priority_point", point)
        require_metres("priority_point", point)
        for arm, place in self.drop_off.items():
            require_metres(f"drop_off.{arm}", frozen(place, f"drop_off.{arm}", (2,)))
        if self.workspace is not None:
            low, high = frozen(self.workspace, "workspace", (2, 3))
            require_metres("workspace", (low, high))
            if not (low < high).all():
                raise ConfigError(
                    "workspace",
                    got=self.workspace,
                    expected="a lower corner x, y, z, and then an upper one",
                )
        if self.policy not in POLICIES:
            raise UnknownNameError("selection.policy", self.policy, POLICIES)
        if self.seed < 0:
            raise ConfigError("seed", got=self.seed, expected="an integer of 0 or more")
        if self.deadline is not None and not self.deadline > 0:
            raise ConfigError(
                "deadline",
                got=f"{self.deadline} s",
                expected="a positive number of seconds, or none",
            )
        if self.calibration is not None and self.camera_pose is not None:
            raise ConfigError(
                "camera pose",
                got="both a calibration and a pose",
                expected="one of them",
            )

    @classmethod
    @checked
    def load(cls, path: str | os.PathLike[str]) -> Settings:
        """Read a site's file (docs/configuration.md); paths in it are relative to it.

        Raises
        ------
        ConfigError
            Naming file, field and range; also for files and folders that are not there.
        UnknownNameError
            For a field or a word that means nothing; near ones are named.
        """
        path = Path(path)
        fields = Fields(read_yaml(path), str(path))
        values = values_of_site(fields)
        try:
            settings = cls(**values, path=path)
        except UnknownNameError as error:
            kind = f"{error.kind} in {path}"
            raise UnknownNameError(kind, error.name, error.known) from error
        except ConfigError as error:
            raise ConfigError.about(f"{path}, field {error.what}", error) from error
        fields.finish()
        return settings

    def robot_model(self) -> RobotModel | None:
        """Load the robot with the limits of the site; None for a floating hand.

        Raises
        ------
        ConfigError, UnknownNameError
            As `RobotModel.load` and `SiteLimits.of_robot` do; also for a drop-off of an
            arm that the robot does not have. The file of these settings is named.
        """
        if self.robot == "none":
            return None
        with self.named():
            robot = RobotModel.load(self.robot)
        for arm in self.drop_off:
            if arm not in robot.arms:
                place = "drop_off" if self.path is None else f"drop_off of {self.path}"
                kind = f"arm in {place}, of robot {robot.name}"
                raise UnknownNameError(kind, arm, robot.arms)
        with self.in_field():
            return self.limits.of_robot(robot)

    @contextmanager
    def named(self) -> Iterator[None]:
        """Say of a robot, arm or hand that can't be had that their file may name it.

        Raises
        ------
        ConfigError, UnknownNameError
            The one that is raised inside, with the file.
        """
        beside = f", in {self.path} or given beside it"
        try:
            yield
        except UnknownNameError as error:
            own = (self.robot, self.arm, self.gripper)
            if self.path is None or error.name not in own:
                raise
            kind = error.kind + beside
            raise UnknownNameError(kind, error.name, error.known) from error
        except ChoiceError as error:
            if self.path is None:
                raise
            raise ConfigError.about(error.what + beside, error) from error

    @contextmanager
    def in_field(self, name: str = "") -> Iterator[None]:
        """Say of a complaint which field of their file it is about.

        Parameters
        ----------
        name
            Of the field; if empty, it is what the complaint is about.

        Raises
        ------
        InputError
            The one that is raised inside; with a file, a `ConfigError` that names it.
        """
        try:
            yield
        except InputError as error:
            if self.path is None:
                raise
            where = f"{self.path}, field {name or error.what}"
            raise ConfigError.about(where, error) from error

    @contextmanager
    def in_limits(self, robot: RobotModel, arm: str) -> Iterator[None]:
        """Say of a complaint about a limit whose it is: this site's, if it sets it.

        Raises
        ------
        InputError
            As `in_field` does; about the robot's own limit, a `ConfigError`.
        """
        try:
            yield
        except InputError as error:
            if self.limits.sets(error.what):
                with self.in_field():
                    raise
            where = f"{error.what} of the {arm_called(arm)} of robot {robot.name}"
            raise ConfigError.about(where, error) from error

    def pose_of_camera(
        self, joints: Mapping[str, float] | None = None, robot: RobotModel | None = None
    ) -> CameraPose | None:
        """Pose of the camera in the base frame; None if captures bring their own.

        If an arm carries the camera, ``joints`` are needed: by name [rad or m], when
        the picture is taken. A ``robot`` is the one for whose grasps it is taken.

        Raises
        ------
        ConfigError
            If the calibration can't be read, was refused, or is of another robot; as
            `pose_on_arm` does.
        """
        if self.calibration is None:
            return self.camera_pose
        stored = load_calibration(self.calibration)
        stored.require_accepted()
        if robot is not None:
            stored.require_of(robot.name)
        if stored.link is None:
            return stored.T_base_camera
        return pose_on_arm(stored, robot or self.robot_model(), joints)

    @checked
    def capture(
        self,
        path: str | os.PathLike[str],
        *,
        camera_file: str | os.PathLike[str] | None = None,
        viewpoint: ArrayLike | None = None,
        joints: Mapping[str, float] | None = None,
        robot: RobotModel | None = None,
    ) -> Capture:
        """Read a capture with the pose and the intrinsics of this site's camera.

        A pose of the site replaces that of the capture; where they differ by more than
        2 mm or 2 mrad, a warning is logged.

        Parameters
        ----------
        path
            As for `Capture.load`.
        camera_file
            As for `Capture.load`. If there is none, that of the site is taken for depth
            images without one beside them.
        viewpoint
            Of the sensor that saw a cloud, in its frame [m], shape (3,).
        joints, robot
            As for `pose_of_camera`.

        Raises
        ------
        CaptureError, ConfigError
            As `Capture.load` and `pose_of_camera` do.
        """
        if camera_file is None and self.camera_file is not None and lacks_camera(path):
            camera_file = self.camera_file
        capture = Capture.load(path, camera_file=camera_file, viewpoint=viewpoint)
        pose = self.pose_of_camera(joints, robot)
        if pose is None:
            return capture
        posed = capture.posed(pose)
        _tell_if_replaced(capture, posed)
        return posed

    def selection(self, openings: tuple[float, ...] = ()) -> SelectionPolicy:
        """Policy that orders objects.

        Parameters
        ----------
        openings
            Widest opening of each hand in use [m]; none given: those of RoMan's hands.
        """
        if self.policy == "priority":
            return PriorityPoint(self.priority_point)
        if not openings:
            return SupportAware(point=self.priority_point)
        return SupportAware(point=self.priority_point, openings=openings)


def _tell_if_replaced(own: Capture, posed: Capture) -> None:
    """Log how far a pose lies from that of the capture itself, if it has another."""
    if own.T_base_camera is None or posed.T_base_camera is None:
        return
    change = own.T_base_camera.inverse() @ posed.T_base_camera
    way = float(np.linalg.norm(change.p))
    turn = float(np.linalg.norm(so3.log(change.R)))
    if way > _SAME or turn > _SAME:
        logger.warning(
            "%s has a camera pose of its own, which is not used: the one given lies "
            "%.0f mm and %.1f deg from it",
            *(own.name, 1e3 * way, np.degrees(turn)),
        )
