"""``motion``: plan how an arm carries out the first grasp for which it can."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from debrisgrasp import api
from debrisgrasp._files import require_own
from debrisgrasp._words import arm_called
from debrisgrasp.errors import ConfigError
from debrisgrasp.io.motion_json import MOTION_SCHEMA
from debrisgrasp.motion import UnknownSpace
from debrisgrasp.pipeline import MotionsConfig, recall_plan

from .capture_arguments import (
    add_capture,
    add_planning,
    load_capture,
    planned,
    progress,
    refuse_planning,
)
from .reports import PICTURE_FORMS, print_written, require_places, telling_written
from .site_arguments import site_of
from .tables import columns
from .values import some_path

if TYPE_CHECKING:
    from debrisgrasp.pipeline import GraspMotions, PlanningResult

__all__ = ["add"]

_UNKNOWN = {
    "hidden": UnknownSpace.HIDDEN,
    "all": UnknownSpace.ALL,
    "ignored": UnknownSpace.IGNORED,
}


def add(parser: argparse.ArgumentParser) -> None:
    """Add ``motion``."""
    parser.description = (
        "Find grasps, then the first of them for which the arm can reach "
        "the pre-grasp, approach and lift without touching anything."
    )
    add_capture(parser)
    add_planning(parser)
    parser.add_argument(
        "--grasps",
        type=some_path,
        metavar="FILE",
        help="a plan of this capture (`plan --out`), instead of planning anew",
    )
    parser.add_argument(
        "--unknown",
        choices=tuple(_UNKNOWN),
        default="hidden",
        help="space not seen that is an obstacle: behind measured surfaces, or also "
        "where nothing was measured (default: hidden)",
    )
    parser.add_argument("--out", type=some_path, metavar="FILE", help="motions as JSON")
    parser.add_argument(
        "--report", type=some_path, metavar="FILE", help="picture of the motion as .png"
    )
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    report, out = arguments.report, arguments.out
    require_places([report], PICTURE_FORMS, out, source=arguments.capture)
    if out:
        require_own(out, MOTION_SCHEMA, "motions")
    settings = site_of(arguments)
    if settings.robot == "none":
        raise ConfigError("robot", got="none", expected="one with an arm to move")
    if arguments.grasps is None:
        result = planned(arguments, settings)
    else:
        refuse_planning(arguments, "beside --grasps")
        robot = settings.robot_model()
        result = recall_plan(
            arguments.grasps,
            load_capture(arguments, settings, arguments.joints, robot),
            robot,
            grippers=settings.grippers,
        )
    found = api.plan_motion(
        result,
        unknown=_UNKNOWN[arguments.unknown],
        config=MotionsConfig(speed=settings.limits.hand_speed),
        seed=settings.seed,
        deadline=settings.deadline,
        progress=progress(arguments),
    )
    chosen = found.chosen
    with telling_written(out, report):
        if out:
            found.save(out)
        if report and chosen is not None:
            _draw(result, found, report)
    if arguments.json:
        print(json.dumps(found.to_json(), indent=1))
    else:
        print(_summary(result, found))
        print_written(out, None if chosen is None else report)
    return 1 if chosen is None else 0


def _summary(result: PlanningResult, found: GraspMotions) -> str:
    chosen, lines = found.chosen, []
    for index, reason in found.tried:
        lines.append(f"grasp {index + 1} passed over: {reason}")
    if chosen is None:
        why = found.why_none if result.plan.grasps else result.plan.why_empty
        why = why or "the plan holds no grasp"
        return "\n".join([*lines, f"no motion: {why}"])
    grasp = chosen.grasp
    lines.append(
        f"grasp {chosen.index + 1} of {len(result.plan.grasps)}: {grasp.prototype} on "
        f"object {grasp.object_label}, {arm_called(chosen.arm)}\n"
    )
    rows = [
        [name, f"{motion.duration:.2f}", str(len(motion.times))]
        for name, motion in chosen.trajectories.items()
    ]
    lines.append(columns(["motion", "seconds", "knots"], rows))
    return "\n".join(lines)


def _draw(result: PlanningResult, found: GraspMotions, path: Path) -> None:
    from debrisgrasp.viz.motion import MotionTrack, motion_png  # slow to load

    chosen, robot = found.chosen, result.robot
    assert chosen is not None
    assert robot is not None
    pieces = chosen.trajectories
    seconds = ", ".join(
        f"{name} {piece.duration:.1f} s" for name, piece in pieces.items()
    )
    motion_png(
        path,
        f"{chosen.grasp.prototype} on object {chosen.grasp.object_label} of "
        f"{result.capture.name}",
        robot,
        chosen.arm,
        [
            MotionTrack(
                label=arm_called(chosen.arm),
                trajectories=tuple(pieces.values()),
                limits=robot.limits(chosen.arm).planner,
            )
        ],
        cloud=result.cloud,
        gripped=result.segmentation.labels == chosen.grasp.object_label,
        note=f"{seconds}; postures from light to dark, path of the palm in purple, "
        "object in orange",
    )
