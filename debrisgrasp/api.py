"""The facade: from a capture to ranked grasps in one call, or step by step."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from debrisgrasp import __version__
from debrisgrasp._calibrating import (
    Rig,
    limits_with,
    observations_of,
    require_same_robot,
    rig_of,
)
from debrisgrasp._checked import checked
from debrisgrasp.calibration import (
    Calibration,
    CalibrationConfig,
    Known,
    Observations,
)
from debrisgrasp.calibration import calibrate as calibrate_observations
from debrisgrasp.errors import InputError
from debrisgrasp.executive import RunRecord, Simulated, SimulatedTask
from debrisgrasp.geometry import Bounds
from debrisgrasp.io import Capture
from debrisgrasp.io.calibration_json import load_calibration
from debrisgrasp.io.observations_file import ObservationFile, load_observations
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.motion import UnknownSpace
from debrisgrasp.pipeline import (
    GraspMotions,
    MotionsConfig,
    Passage,
    Pipeline,
    PipelineConfig,
    PlanningResult,
    Progress,
    first_executable,
    motion_space,
    segmented,
)
from debrisgrasp.pipeline.inputs import require_limits
from debrisgrasp.prototypes import PrototypeLibrary
from debrisgrasp.segmentation import (
    Candidate,
    Segmentation,
    SegmentationConfig,
    SelectionPolicy,
    SupportAware,
    ordered,
)

__all__ = ["calibrate", "clear", "looks", "plan", "plan_motion", "segment", "select"]


@checked
def segment(capture: Capture, config: SegmentationConfig | None = None) -> Segmentation:
    """Divide a capture into objects (section 5.1 of the paper).

    Raises
    ------
    CaptureError
        If the capture has no pose in the base frame.
    """
    return segmented(capture, capture.cloud(), config)


@checked
def select(
    capture: Capture,
    segmentation: Segmentation,
    policy: SelectionPolicy | None = None,
) -> tuple[Candidate, ...]:
    """Order the objects of a capture, first choice first.

    Parameters
    ----------
    policy
        `SupportAware` by default; `PriorityPoint` is the paper's (Eq. 1), and
        `OperatorPick` puts what a person chose first.

    Raises
    ------
    CaptureError
        If the capture has no pose in the base frame.
    InputError
        If the policy returns anything else than an order (docs/selection.md).
    """
    policy = policy or SupportAware()
    return ordered(policy, segmentation, capture.cloud())


@checked
def plan(
    capture: Capture,
    *,
    robot: str | os.PathLike[str] | RobotModel = "roman",
    arm: str | None = None,
    gripper: str | None = None,
    prototypes: str | os.PathLike[str] | PrototypeLibrary | None = None,
    grippers: str | os.PathLike[str] | None = None,
    policy: SelectionPolicy | None = None,
    region: Bounds | None = None,
    object_label: int | None = None,
    seed: int = 0,
    deadline: float | None = None,
    mass: float | None = None,
    advise: bool = False,
    config: PipelineConfig | None = None,
    progress: Progress | None = None,
) -> PlanningResult:
    """Plan grasps on the easiest object of a capture; see `Pipeline`."""
    pipeline = Pipeline(
        robot=robot,
        arm=arm,
        gripper=gripper,
        prototypes=prototypes,
        grippers=grippers,
        policy=policy,
        config=config,
    )
    return pipeline.plan(
        capture,
        region=region,
        object_label=object_label,
        seed=seed,
        deadline=deadline,
        mass=mass,
        advise=advise,
        progress=progress,
    )


@checked
def plan_motion(
    result: PlanningResult,
    *,
    present: Mapping[str, float] | None = None,
    unknown: UnknownSpace = UnknownSpace.HIDDEN,
    config: MotionsConfig | None = None,
    seed: int = 0,
    deadline: float | None = None,
    progress: Progress | None = None,
) -> GraspMotions:
    """Plan how the arm carries out the first grasp for which it can (docs/motion.md).

    Parameters
    ----------
    result
        What `plan` returned, for a robot; `recall_plan` makes it of a saved one.
    present
        Joint values now [rad or m]; the present posture of the robot's file by default.
    unknown
        Which space that the camera did not see is an obstacle.
    seed
        The same seed gives the same motion.
    deadline
        Seconds after which no further grasp is tried, and a long search gives up.

    Raises
    ------
    InputError
        If the plan is for a floating hand.
    ConfigError
        If the seed is negative, or the deadline not a positive time.
    """
    require_limits(seed, deadline, None)
    if result.robot is None:
        raise InputError(
            "plan", got="one for a floating hand", expected="one for a robot's arm"
        )
    space = motion_space(result.capture, result.cloud, result.segmentation, unknown)
    return first_executable(
        result.plan,
        result.robot,
        space,
        passage=Passage(
            space.measured_points,
            result.object_points,
            result.grippers,
            along=result.kin_points,
        ),
        present=present,
        config=config,
        rng=np.random.default_rng(seed),
        deadline=deadline,
        progress=progress,
    )


@checked
def calibrate(
    observations: str | os.PathLike[str],
    *,
    robot: str | None = None,
    fiducial: str | Sequence[float] | None = None,
    previous: str | os.PathLike[str] | None = None,
    config: CalibrationConfig | None = None,
) -> Calibration:
    """Find where the camera is from a file of observations (docs/calibration.md).

    The result says how well it is known: look at `Calibration.decision` before using
    `Calibration.T_base_camera`, for instance with `Capture.posed`; `T_link_camera` of a
    camera that an arm carries.

    Parameters
    ----------
    observations
        YAML, JSON or CSV file.
    robot, fiducial
        The robot, and the link that carries the fiducial, or its place in base [m]
        before a camera that an arm carries; if the file does not name them or others
        are meant.
    previous
        Calibration file to start from, of the same camera.
    config
        Limits of acceptance.

    Raises
    ------
    ConfigError, InputError
        If a file is malformed, or the observations have no honest result.
    """
    given, rig = _looks(observations, robot, fiducial)
    config = limits_with(config or CalibrationConfig(), given)
    known = None if rig is None else Known(head=rig.head)
    if previous is not None:
        stored = load_calibration(previous)
        require_same_robot(stored, rig)
        known = stored.known
    reference = rig.reference if rig is not None and len(rig.reference) else None
    return calibrate_observations(
        observations_of(given, rig), known, reference=reference, config=config
    )


@checked
def clear(
    task: SimulatedTask | None = None,
    *,
    record: str | os.PathLike[str] | None = None,
    pipeline: Pipeline | None = None,
) -> Simulated:
    """Clear a pile with the robot in memory (docs/clearing.md).

    Parameters
    ----------
    task
        Which pile, and what is to be done; by default a pile of 3 to 8 bodies.
    record
        A new folder for the record of the run, which ``debrisgrasp replay`` reads.
    pipeline
        To plan with; the default one by default.

    Raises
    ------
    OutputError
        If the record can't be begun. One that ends early, as on a full disk, is warned
        of, for the run goes on.
    """
    task = task or SimulatedTask()
    inputs = {**task.to_json(), "version": f"debrisgrasp {__version__}"}
    taken = None if record is None else RunRecord(record, inputs)
    return task.run(taken, pipeline=pipeline)


@checked
def looks(
    observations: str | os.PathLike[str],
    *,
    robot: str | None = None,
    fiducial: str | Sequence[float] | None = None,
) -> Observations:
    """Read a file of observations, and put its joints through forward kinematics.

    For `DriftMonitor.seen`; parameters and errors as for `calibrate`.
    """
    return observations_of(*_looks(observations, robot, fiducial))


def _looks(
    observations: str | os.PathLike[str],
    robot: str | None,
    fiducial: str | Sequence[float] | None,
) -> tuple[ObservationFile, Rig | None]:
    path = Path(observations)
    given = load_observations(path)
    return given, rig_of(given, path, robot, fiducial)
