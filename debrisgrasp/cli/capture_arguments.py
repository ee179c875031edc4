"""Arguments of the commands that look at a capture or plan on it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

import debrisgrasp
from debrisgrasp._arrays import require_range
from debrisgrasp.errors import ConfigError
from debrisgrasp.io import Capture
from debrisgrasp.io.calibration_json import load_calibration
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.pipeline import PipelineConfig, without_robot
from debrisgrasp.pipeline.inputs import LEAST_MASS, MOST_MASS
from debrisgrasp.planning import PlannerConfig
from debrisgrasp.settings import Settings

from .policy_arguments import add_policy, policy_of
from .site_arguments import add_grippers, add_site, site_of
from .values import (
    add_region,
    joint,
    joints_of,
    number,
    region_of,
    seed,
    some_path,
    whole,
)

__all__ = [
    "add_capture",
    "add_planning",
    "load_capture",
    "planned",
    "progress",
    "refuse_planning",
    "tell",
]

_COUNTS = {
    "n_best": "so many distinct grasps at most, the best of each part of the object "
    f"before the second best of any (default: {PlannerConfig().n_best})",
    "n_per_hand": "at most so many of them of each hand",
    "n_per_prototype": "at most so many of them of each prototype",
}
"""Fields of `PlannerConfig` that say how many grasps there are, and what they mean."""


def add_capture(
    parser: argparse.ArgumentParser,
    what: str = "a .npz, .ply or .pcd file, a 16-bit depth .png, or a folder",
) -> None:
    """Add the capture, the pose and lens of its camera, the site, and ``--json``."""
    parser.add_argument(
        "capture",
        type=some_path,
        help=what,
    )
    camera = parser.add_argument_group("where the camera is, and what it is")
    camera.add_argument(
        "--camera-pose",
        metavar="POSE",
        help="pose of the camera in the base frame, instead of the one in the capture: "
        "a file with a 4x4 matrix, x,y,z,roll,pitch,yaw, or 'level' for a stored level "
        "frame",
    )
    camera.add_argument(
        "--calibration",
        type=some_path,
        metavar="FILE",
        help="result of `debrisgrasp calibrate`, taken for the pose of the camera",
    )
    camera.add_argument(
        "--camera-file",
        type=some_path,
        metavar="FILE",
        help="JSON or YAML camera of a depth PNG",
    )
    camera.add_argument(
        "--viewpoint",
        nargs=3,
        type=number,
        metavar=("X", "Y", "Z"),
        help="position of the sensor in the frame of a cloud, metres",
    )
    add_site(parser)
    parser.add_argument(
        "--json", action="store_true", help="print JSON for machines instead of text"
    )


def load_capture(
    arguments: argparse.Namespace,
    settings: Settings | None = None,
    joints: Sequence[tuple[str, float]] | None = None,
    robot: RobotModel | None = None,
) -> Capture:
    """Read the capture as the arguments and the site say.

    With the ``--joints`` of `add_planning`, where there are those, and for a robot.
    """
    settings = settings or site_of(arguments)
    return settings.capture(
        arguments.capture,
        camera_file=arguments.camera_file,
        viewpoint=arguments.viewpoint,
        joints=None if joints is None else joints_of(joints),
        robot=robot,
    )


def add_planning(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that say with what, on what and for how long to plan."""
    search = parser.add_argument_group("with what, on what and for how long")
    search.add_argument(
        "--robot",
        help="a shipped robot, a YAML file, or 'none' for a floating hand "
        "(default: roman)",
    )
    add_policy(search)
    search.add_argument("--arm", help="use only this arm")
    search.add_argument("--gripper", help="use only this hand")
    search.add_argument(
        "--prototypes", type=some_path, metavar="DIR", help="folder of prototype files"
    )
    add_grippers(search)
    add_region(search, "seek grasps only in this box")
    search.add_argument(
        "--object", type=whole, metavar="N", help="seek grasps only on this object"
    )
    for name, words in _COUNTS.items():
        search.add_argument(_option(name), type=whole, metavar="N", help=words)
    search.add_argument("--seed", type=seed, help="default: 0")
    search.add_argument(
        "--deadline",
        type=number,
        metavar="S",
        help="settle for what the search has after so many seconds from the start; "
        "seeing the scene and checking a grasp are done whole all the same",
    )
    search.add_argument(
        "--mass",
        type=number,
        metavar="KG",
        help="what the first object that is tried weighs, if known",
    )
    search.add_argument(
        "--joints",
        nargs="+",
        type=joint,
        metavar="NAME=VALUE",
        help="leave out what shows the robot itself, and know where a camera is that "
        "an arm carries: its joints when the picture was taken, in rad or m; arms not "
        "named are idle, other joints at rest",
    )


def tell(notes: Iterable[str]) -> None:
    """Say on stderr, where results are not disturbed, what a reader should know."""
    for note in notes:
        print(f"note: {note}", file=sys.stderr)


def refuse_planning(arguments: argparse.Namespace, where: str) -> None:
    """Refuse arguments of a search where there is none."""
    search = ("arm", "gripper", "prototypes", "policy", "priority_point", "pick")
    others = ["region", "object", "mass"]
    calibration = site_of(arguments).calibration
    if calibration is None or load_calibration(calibration).link is None:
        others.append("joints")  # else they tell where the camera is
    for name in (*search, *others, *_COUNTS):
        if getattr(arguments, name) is not None:
            raise ConfigError(
                _option(name),
                got="one",
                expected=f"none {where}, where nothing is searched",
            )


def _option(name: str) -> str:
    """Write a name as it is given on the command line."""
    return "--" + name.replace("_", "-")


def planned(
    arguments: argparse.Namespace, settings: Settings, *, advise: bool = False
) -> debrisgrasp.PlanningResult:
    """Plan as the arguments say; what can be wrong with them is found first."""
    if arguments.object is not None:
        require_range("--object", arguments.object, 1)
        if arguments.pick is not None:
            raise ConfigError(
                "object", got="both --object and --pick", expected="one of them"
            )
    if arguments.mass is not None:
        require_range("--mass [kg]", arguments.mass, LEAST_MASS, MOST_MASS)
    config = PipelineConfig(planner=_planner(arguments))
    region = region_of(arguments)
    # Only a calibration asks whose it is, before the pipeline is made.
    robot = None if settings.calibration is None else settings.robot_model()
    capture = load_capture(arguments, settings, arguments.joints, robot)
    for name in ("pick", "object"):
        if capture.mask is not None and getattr(arguments, name) is not None:
            raise ConfigError(
                f"--{name}",
                got="one, and a mask in the capture, which says what to take",
                expected="one of them",
            )
    pipeline = debrisgrasp.Pipeline.from_settings(settings, config)
    pipeline.policy = policy_of(arguments, pipeline.policy)
    if arguments.joints is not None:
        capture = _bare(capture, pipeline, joints_of(arguments.joints))
    result = pipeline.plan(
        capture,
        region=region,
        object_label=arguments.object,
        seed=settings.seed,
        deadline=settings.deadline,
        mass=arguments.mass,
        advise=advise,
        progress=progress(arguments),
    )
    tell(result.plan.notes)
    return result


def _planner(arguments: argparse.Namespace) -> PlannerConfig:
    """Make settings of the planner with as many grasps as the arguments say."""
    counts = {name: getattr(arguments, name) for name in _COUNTS}
    given = {name: count for name, count in counts.items() if count is not None}
    config = PlannerConfig()
    for name, count in given.items():
        require_range(_option(name), count, 1, config.max_ranked)
    return replace(config, **given)


def _bare(
    capture: Capture, pipeline: debrisgrasp.Pipeline, joints: dict[str, float]
) -> Capture:
    """Leave out what of a capture shows the robot itself."""
    if pipeline.robot is None:
        raise ConfigError(
            "--joints", got="some", expected="none for a hand without a robot"
        )
    bare = without_robot(capture, pipeline.robot, joints)
    n = _n_missing(bare) - _n_missing(capture)
    tell([f"{n} points show the robot itself, and were left out"])
    return bare


def _n_missing(capture: Capture) -> int:
    """Count what has no number."""
    values = capture.points if capture.depth is None else capture.depth[..., None]
    assert values is not None
    return int(np.isnan(values).any(axis=-1).sum())


def progress(arguments: argparse.Namespace) -> debrisgrasp.Progress | None:
    """Show the stage on one line of the terminal, if there is one."""
    if getattr(arguments, "json", False) or not sys.stderr.isatty():
        return None

    def show(stage: str, share: float) -> None:
        end = "\r" + " " * 40 + "\r" if share >= 1.0 else ""
        print(f"\r{stage:<16} {100 * share:4.0f} % {end}", end="", file=sys.stderr)

    return show
