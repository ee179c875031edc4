"""The commands that work on a capture: demo, plan, segment, select."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import debrisgrasp
from debrisgrasp.errors import ConfigError, OutputError
from debrisgrasp.geometry import Bounds
from debrisgrasp.io import (
    Capture,
    data_path,
    save_labels,
)
from debrisgrasp.io.plan_json import plan_to_json
from debrisgrasp.segmentation import GroundReport
from debrisgrasp.settings import Settings

from .policy_arguments import add_policy, policy_of
from .reports import (
    PICTURE_FORMS,
    REPORT_FORMS,
    add_reports,
    require_places,
    write_plan_reports,
    write_segmentation_picture,
    write_selection_report,
)
from .site_arguments import add_site, site_of
from .tables import columns, plan_summary

if TYPE_CHECKING:
    from debrisgrasp.pipeline import PlanningResult

Subparsers = Any  # argparse gives its subparsers no public type


def version() -> str:
    """Text of ``--version``."""
    return f"debrisgrasp {debrisgrasp.__version__}"


def add_demo(subparsers: Subparsers) -> None:
    """Add ``demo``."""
    parser = subparsers.add_parser(
        "demo", help="plan on a bundled capture; writes grasps and reports"
    )
    parser.add_argument(
        "--out-dir",
        type=Path,
        default=Path(),
        metavar="DIR",
        help="where to write grasps.json, report.png and report.html (default: here)",
    )
    parser.add_argument("--seed", type=_seed, default=0, help="default: 0")
    parser.set_defaults(run=run_demo)


def run_demo(arguments: argparse.Namespace) -> int:
    """Plan on the bundled capture with the shipped robot."""
    out = arguments.out_dir
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(out, error.strerror or str(error)) from error
    result = debrisgrasp.plan(
        Capture.load(data_path("captures", "pile.npz")),
        seed=arguments.seed,
        progress=_progress(),
    )
    print(plan_summary(result.plan))
    print(f"\ntook {_seconds(result)}")
    grasps, reports = out / "grasps.json", [out / "report.png", out / "report.html"]
    result.save(grasps)
    write_plan_reports(result, reports, title="debrisgrasp demo")
    print("wrote " + ", ".join(str(path) for path in (grasps, *reports)))
    return 0 if result.plan.grasps else 1


def add_plan(subparsers: Subparsers) -> None:
    """Add ``plan``."""
    parser = subparsers.add_parser(
        "plan",
        help="find grasps on the object that is easiest to take",
        description="Find grasps on the first object of the order that offers one.",
    )
    _add_capture(parser)
    parser.add_argument(
        "--robot",
        help="a shipped robot, a YAML file, or 'none' for a floating hand "
        "(default: roman)",
    )
    add_policy(parser)
    parser.add_argument("--arm", help="use only this arm")
    parser.add_argument("--gripper", help="use only this hand")
    parser.add_argument("--prototypes", metavar="DIR", help="folder of prototype files")
    parser.add_argument(
        "--grippers", metavar="DIR", help="folder of files of further hands"
    )
    parser.add_argument(
        "--region",
        nargs=6,
        type=float,
        metavar=("X0", "Y0", "Z0", "X1", "Y1", "Z1"),
        help="seek grasps only in this box, base frame, metres",
    )
    parser.add_argument(
        "--object", type=int, metavar="N", help="seek grasps only on this object"
    )
    parser.add_argument("--seed", type=_seed, help="default: 0")
    parser.add_argument(
        "--deadline", type=float, metavar="S", help="settle after so many seconds"
    )
    parser.add_argument(
        "--mass", type=float, metavar="KG", help="what the object weighs, if known"
    )
    parser.add_argument(
        "--advice",
        action="store_true",
        help="say what would help even where the plan is good",
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="grasps as JSON")
    add_reports(parser, "report")
    parser.set_defaults(run=run_plan)


def run_plan(arguments: argparse.Namespace) -> int:
    """Plan on the user's capture."""
    settings = site_of(arguments)
    if settings.camera_pose == "level" and settings.robot != "none":
        print(
            "note: the origin of the level frame is not the robot's base; joints mean "
            "nothing there, and --robot none plans for the hand alone",
            file=sys.stderr,
        )
    require_places(
        arguments.report, REPORT_FORMS, arguments.out, source=arguments.capture
    )
    if arguments.object is not None and arguments.pick is not None:
        raise ConfigError(
            "object", got="both --object and --pick", expected="one of them"
        )
    box = arguments.region
    capture = _load(arguments, settings)
    pipeline = debrisgrasp.Pipeline.from_settings(settings)
    pipeline.policy = policy_of(arguments, pipeline.policy)
    result = pipeline.plan(
        capture,
        region=None if box is None else Bounds(np.array(box[:3]), np.array(box[3:])),
        object_label=arguments.object,
        seed=settings.seed,
        deadline=settings.deadline,
        mass=arguments.mass,
        advise=arguments.advice,
        progress=None if arguments.json else _progress(),
    )
    if arguments.out:
        result.save(arguments.out)
    write_plan_reports(result, arguments.report, title=arguments.capture.name)
    ground = result.segmentation.ground
    if arguments.json:
        _tell_doubt(ground)
        print(plan_to_json(result.plan))
    else:
        if ground.status == "skipped":
            print(f"ground left in the scene: {ground.reason}")
        _print_surroundings(ground)
        print(plan_summary(result.plan))
        print(f"\ntook {_seconds(result)}")
        written = [arguments.out] * bool(arguments.out) + arguments.report
        if written:
            print("wrote " + ", ".join(str(path) for path in written))
    return 0 if result.plan.grasps else 1


def _tell_doubt(ground: GroundReport) -> None:
    """Say on stderr, where JSON is not disturbed, that the pose is in doubt."""
    if ground.pose_doubt:
        print(f"note: camera pose in doubt: {ground.pose_doubt}", file=sys.stderr)


def add_segment(subparsers: Subparsers) -> None:
    """Add ``segment``."""
    parser = subparsers.add_parser("segment", help="divide a capture into objects")
    _add_capture(parser)
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="labels as .npz, one per input point"
    )
    parser.add_argument("--report", type=Path, metavar="FILE", help="picture as .png")
    parser.set_defaults(run=run_segment)


def run_segment(arguments: argparse.Namespace) -> int:
    """Segment, and say what was found."""
    require_places(
        [arguments.report], PICTURE_FORMS, arguments.out, source=arguments.capture
    )
    capture = _load(arguments)
    segmentation = debrisgrasp.segment(capture)
    if arguments.out:
        save_labels(capture, segmentation.labels, arguments.out)
    if arguments.report:
        write_segmentation_picture(capture, segmentation, (), arguments.report)
    ground = segmentation.ground
    if arguments.json:
        facts = {
            "ground": {
                "status": ground.status,
                "reason": ground.reason,
                "pose_doubt": ground.pose_doubt,
                "removed_points": ground.counts,
            },
            "objects": [
                {
                    "label": s.label,
                    "points": s.n_points,
                    "centroid": s.centroid.round(6).tolist(),
                    "extents": s.extents.round(6).tolist(),
                }
                for s in segmentation.segments
            ],
        }
        print(json.dumps(facts, indent=1))
    else:
        print(f"ground {ground.status}: {ground.reason}")
        _print_surroundings(ground)
        rows = [
            [
                str(s.label),
                str(s.n_points),
                *(f"{v:.2f}" for v in s.centroid),
                " x ".join(f"{100 * v:.0f}" for v in s.extents),
            ]
            for s in segmentation.segments
        ]
        print(columns(["object", "points", "x", "y", "z", "extents [cm]"], rows))
    return 0 if segmentation.segments else 1


def _print_surroundings(ground: GroundReport) -> None:
    """Say what was taken away besides objects, and whether the pose is in doubt."""
    if ground.pose_doubt:
        print(f"camera pose in doubt: {ground.pose_doubt}")
    for item in ground.surroundings:
        print(f"{item.kind.name.lower()}: {item.n_points} points, {item.reason}")
    counts = ", ".join(f"{kind} {count}" for kind, count in ground.counts.items())
    print(f"points taken away: {counts or 'none'}")


def add_select(subparsers: Subparsers) -> None:
    """Add ``select``."""
    parser = subparsers.add_parser(
        "select", help="the order in which objects would be taken, and why"
    )
    _add_capture(parser)
    add_reports(parser, "who lies on whom,")
    add_policy(parser)
    parser.set_defaults(run=run_select)


def run_select(arguments: argparse.Namespace) -> int:
    """Order the objects, and give the reasons."""
    require_places(arguments.report, REPORT_FORMS, source=arguments.capture)
    capture = _load(arguments)
    segmentation = debrisgrasp.segment(capture)
    _tell_doubt(segmentation.ground)
    policy = policy_of(arguments, site_of(arguments).selection())
    order = debrisgrasp.select(capture, segmentation, policy)
    for path in arguments.report:
        write_selection_report(capture, segmentation, order, path)
    if arguments.json:
        facts = [
            {"object": c.label, "cost": round(c.cost, 6), "reason": c.reason}
            for c in order
        ]
        print(json.dumps(facts, indent=1))
    else:
        rows = [[str(i), str(c.label), c.reason] for i, c in enumerate(order, start=1)]
        print(columns(["turn", "object", "because"], rows))
    return 0 if order else 1


def _add_capture(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "capture",
        type=_path,
        help="a .npz, .ply or .pcd file, a 16-bit depth .png, or a folder",
    )
    parser.add_argument(
        "--camera-pose",
        metavar="POSE",
        help="pose of the camera in the base frame, if the capture has none: a file "
        "with a 4x4 matrix, x,y,z,roll,pitch,yaw, or 'level' for a stored level frame; "
        "write --camera-pose=-0.1,... where it starts with a minus",
    )
    parser.add_argument(
        "--calibration",
        type=Path,
        metavar="FILE",
        help="result of `debrisgrasp calibrate`, taken for the pose of the camera",
    )
    parser.add_argument(
        "--camera-file", metavar="FILE", help="JSON or YAML camera of a depth PNG"
    )
    parser.add_argument(
        "--viewpoint",
        nargs=3,
        type=float,
        metavar=("X", "Y", "Z"),
        help="position of the sensor in the frame of a cloud, metres",
    )
    add_site(parser)
    parser.add_argument(
        "--json", action="store_true", help="print JSON for machines instead of text"
    )


def _load(arguments: argparse.Namespace, settings: Settings | None = None) -> Capture:
    settings = settings or site_of(arguments)
    return settings.capture(arguments.capture, viewpoint=arguments.viewpoint)


def _path(text: str) -> Path:
    """Parse a path; an empty one would mean the working folder."""
    if not text.strip():
        raise argparse.ArgumentTypeError("it is empty, expected a file or folder")
    return Path(text)


def _seed(text: str) -> int:
    """Parse a seed; numpy takes no negative ones."""
    try:
        seed = int(text)
    except ValueError:
        seed = -1
    if seed < 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not an integer of 0 or more")
    return seed


def _progress() -> debrisgrasp.Progress | None:
    """Show the stage on one line of the terminal, if there is one."""
    if not sys.stderr.isatty():
        return None

    def show(stage: str, share: float) -> None:
        end = "\r" + " " * 40 + "\r" if share >= 1.0 else ""
        print(f"\r{stage:<16} {100 * share:4.0f} % {end}", end="", file=sys.stderr)

    return show


def _seconds(result: PlanningResult) -> str:
    stages = result.plan.seconds
    parts = ", ".join(f"{name} {spent:.2f}" for name, spent in stages.items())
    return f"{sum(stages.values()):.2f} s ({parts})"
