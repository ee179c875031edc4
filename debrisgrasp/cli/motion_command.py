"""``motion``: plan how an arm carries out the first grasp for which it can."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

import debrisgrasp
from debrisgrasp import api
from debrisgrasp.io.motion_json import motion_to_dict, save_motion
from debrisgrasp.motion import UnknownSpace
from debrisgrasp.pipeline import MotionsConfig

from .commands import Subparsers, _add_capture, _load, _progress, _seed
from .policy_arguments import add_policy, policy_of
from .reports import PICTURE_FORMS, require_places
from .site_arguments import site_of
from .tables import columns

if TYPE_CHECKING:
    from debrisgrasp.pipeline import GraspMotions, PlanningResult

__all__ = ["add"]

_UNKNOWN = {
    "hidden": UnknownSpace.HIDDEN,
    "all": UnknownSpace.ALL,
    "ignored": UnknownSpace.IGNORED,
}


def add(subparsers: Subparsers) -> None:
    """Add ``motion``."""
    parser = subparsers.add_parser(
        "motion",
        help="plan reach, approach and lift for the first grasp that allows them",
        description="Find grasps, then the first of them for which the arm can reach "
        "the pre-grasp, approach and lift without touching anything.",
    )
    _add_capture(parser)
    parser.add_argument(
        "--robot", help="a shipped robot or a YAML file (default: roman)"
    )
    add_policy(parser)
    parser.add_argument("--arm", help="use only this arm")
    parser.add_argument("--object", type=int, metavar="N", help="grip this object")
    parser.add_argument("--seed", type=_seed, help="default: 0")
    parser.add_argument(
        "--deadline", type=float, metavar="S", help="settle after so many seconds"
    )
    parser.add_argument(
        "--unknown",
        choices=tuple(_UNKNOWN),
        default="hidden",
        help="space not seen that is an obstacle: behind measured surfaces, or also "
        "where nothing was measured (default: hidden)",
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="motions as JSON")
    parser.add_argument(
        "--report", type=Path, metavar="FILE", help="picture of the motion as .png"
    )
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    report, out = arguments.report, arguments.out
    require_places([report], PICTURE_FORMS, out, source=arguments.capture)
    progress = None if arguments.json else _progress()
    settings = site_of(arguments)
    capture = _load(arguments, settings)
    pipeline = debrisgrasp.Pipeline.from_settings(settings)
    pipeline.policy = policy_of(arguments, pipeline.policy)
    result = pipeline.plan(
        capture,
        object_label=arguments.object,
        seed=settings.seed,
        deadline=settings.deadline,
        progress=progress,
    )
    found = api.plan_motion(
        result,
        unknown=_UNKNOWN[arguments.unknown],
        config=MotionsConfig(speed=settings.limits.hand_speed),
        seed=settings.seed,
        deadline=settings.deadline,
        progress=progress,
    )
    chosen = found.chosen
    content = motion_to_dict(
        {} if chosen is None else chosen.trajectories,
        robot=result.plan.robot,
        arm=None if chosen is None else chosen.arm,
        index=None if chosen is None else chosen.index,
        passed_over=found.passed_over,
    )
    if out:
        save_motion(content, out)
    if report and chosen is not None:
        _draw(result, found, report)
    if arguments.json:
        print(json.dumps(content, indent=1))
    else:
        print(_summary(result, found))
    return 1 if chosen is None else 0


def _summary(result: PlanningResult, found: GraspMotions) -> str:
    chosen, lines = found.chosen, []
    for index, reason in found.passed_over:
        lines.append(f"grasp {index + 1} passed over: {reason}")
    if chosen is None:
        why = found.why_none if result.plan.grasps else result.plan.why_empty
        return "\n".join([*lines, f"no motion: {why}"])
    grasp = chosen.grasp
    lines.append(
        f"grasp {chosen.index + 1} of {len(result.plan.grasps)}: {grasp.prototype} on "
        f"object {grasp.object_label}, {chosen.arm} arm\n"
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
        f"{chosen.grasp.prototype} on object {chosen.grasp.object_label}",
        robot,
        chosen.arm,
        [
            MotionTrack(
                label=f"{chosen.arm} arm",
                trajectories=tuple(pieces.values()),
                limits=robot.limits(chosen.arm).planner,
            )
        ],
        cloud=result.cloud,
        gripped=result.segmentation.labels == chosen.grasp.object_label,
        note=f"{seconds}; postures from light to dark, path of the palm in purple, "
        "object in orange",
    )
