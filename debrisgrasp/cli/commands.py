"""The commands that work on a capture: demo, plan, segment, select."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

import debrisgrasp
from debrisgrasp._files import require_folder, require_own
from debrisgrasp.errors import OutputError
from debrisgrasp.io import (
    Capture,
    data_path,
    save_labels,
)
from debrisgrasp.io.plan_json import SCHEMA as PLAN_SCHEMA
from debrisgrasp.io.plan_json import plan_to_json
from debrisgrasp.pipeline import ground_notes
from debrisgrasp.segmentation import (
    GroundReport,
    LccpConfig,
    SegmentationConfig,
    SingulationConfig,
)

from .capture_arguments import (
    add_capture,
    add_planning,
    load_capture,
    planned,
    progress,
    tell,
)
from .policy_arguments import add_policy, policy_of
from .reports import (
    PICTURE_FORMS,
    REPORT_FORMS,
    add_reports,
    print_written,
    require_own_labels,
    require_places,
    telling_written,
    write_plan_reports,
    write_segmentation_picture,
    write_selection_report,
)
from .site_arguments import site_of
from .tables import columns, plan_summary
from .values import seed, some_path

if TYPE_CHECKING:
    from debrisgrasp.pipeline import PlanningResult

_NOTHING = "no object was found beside the ground and what else was taken away"
_METHODS = {"singulation": SingulationConfig, "lccp": LccpConfig}
_LIKELY = 0.5
"""Scores below which a plan is proposed to be asked for advice."""


def version() -> str:
    """Text of ``--version``."""
    return f"debrisgrasp {debrisgrasp.__version__}"


def add_demo(parser: argparse.ArgumentParser) -> None:
    """Add ``demo``."""
    parser.add_argument(
        "--out-dir",
        type=some_path,
        default=Path("demo"),
        metavar="DIR",
        help="where to write grasps.json, report.png and report.html (default: demo)",
    )
    parser.add_argument("--seed", type=seed, default=0, help="default: 0")
    parser.set_defaults(run=run_demo)


def run_demo(arguments: argparse.Namespace) -> int:
    """Plan on the bundled capture with the shipped robot."""
    out = arguments.out_dir
    require_folder(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(out, error.strerror or str(error)) from error
    grasps, reports = out / "grasps.json", [out / "report.png", out / "report.html"]
    require_places(reports, REPORT_FORMS, grasps)
    require_own(grasps, PLAN_SCHEMA, "a plan")
    result = debrisgrasp.plan(
        Capture.load(data_path("captures", "pile.npz")),
        seed=arguments.seed,
        progress=progress(arguments),
    )
    print(plan_summary(result.plan))
    print(f"\ntook {_seconds(result)}")
    with telling_written(grasps, *reports):
        result.save(grasps)
        write_plan_reports(result, reports)
    print_written(grasps, *reports)
    return 0 if result.plan.grasps else 1


def add_plan(parser: argparse.ArgumentParser) -> None:
    """Add ``plan``."""
    parser.description = "Find grasps on the first object of the order that offers one."
    add_capture(parser)
    add_planning(parser)
    parser.add_argument(
        "--advice",
        action="store_true",
        help="say what would help even where there are grasps",
    )
    parser.add_argument("--out", type=some_path, metavar="FILE", help="grasps as JSON")
    add_reports(parser, "report")
    parser.set_defaults(run=run_plan)


def run_plan(arguments: argparse.Namespace) -> int:
    """Plan on the user's capture."""
    settings = site_of(arguments)
    require_places(
        arguments.report, REPORT_FORMS, arguments.out, source=arguments.capture
    )
    if arguments.out:
        require_own(arguments.out, PLAN_SCHEMA, "a plan")
    result = planned(arguments, settings, advise=arguments.advice)
    if settings.camera_pose == "level" and settings.robot != "none":
        tell(
            [
                "the origin of the level frame is not the robot's base; joints mean "
                "nothing there, and --robot none plans for the hand alone"
            ]
        )
    ground = result.segmentation.ground
    if arguments.json:
        print(plan_to_json(result.plan))
    else:
        _print_ground_left(ground)
        _print_surroundings(ground)
        print(plan_summary(result.plan, limit=arguments.n_best or 10))
        best = next(iter(result.plan.grasps), None)
        if best is not None and best.score < _LIKELY and not arguments.advice:
            print("\nnone is likely to hold; --advice says what would help")
        print(f"\ntook {_seconds(result)}")
    with telling_written(arguments.out, *arguments.report):
        if arguments.out:
            result.save(arguments.out)
        write_plan_reports(result, arguments.report)
    if not arguments.json:
        print_written(arguments.out, *arguments.report)
    return 0 if result.plan.grasps else 1


def add_segment(parser: argparse.ArgumentParser) -> None:
    """Add ``segment``."""
    add_capture(parser)
    parser.add_argument(
        "--method",
        choices=_METHODS,
        default="singulation",
        help="singulation (default), or lccp: the paper's, with which to compare",
    )
    parser.add_argument(
        "--out",
        type=some_path,
        metavar="FILE",
        help="labels as .npz, one per input point",
    )
    parser.add_argument(
        "--report", type=some_path, metavar="FILE", help="picture as .png"
    )
    parser.set_defaults(run=run_segment)


def run_segment(arguments: argparse.Namespace) -> int:
    """Segment, and say what was found."""
    require_places(
        [arguments.report], PICTURE_FORMS, arguments.out, source=arguments.capture
    )
    if arguments.out:
        require_own_labels(arguments.out)
    capture = load_capture(arguments)
    config = SegmentationConfig(method=_METHODS[arguments.method]())
    segmentation = debrisgrasp.segment(capture, config)
    tell(ground_notes(segmentation.ground))
    ground = segmentation.ground
    if arguments.json:
        facts = {
            "method": segmentation.method,
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
                    "certainty": round(s.certainty, 6),
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
                *(f"{v:z.2f}" for v in s.centroid),
                " x ".join(f"{100 * v:.0f}" for v in s.extents),
            ]
            for s in segmentation.segments
        ]
        print(
            columns(
                ["object", "points", "x [m]", "y [m]", "z [m]", "extents [cm]"], rows
            )
            if rows
            else _NOTHING
        )
    with telling_written(arguments.out, arguments.report):
        if arguments.out:
            save_labels(capture, segmentation.labels, arguments.out)
        if arguments.report:
            write_segmentation_picture(capture, segmentation, (), arguments.report)
    if not arguments.json:
        print_written(arguments.out, arguments.report)
    return 0 if segmentation.segments else 1


def _print_ground_left(ground: GroundReport) -> None:
    """Say if the ground may be among the objects."""
    if ground.status == "skipped":
        print(f"ground left in the scene: {ground.reason}")


def _print_surroundings(ground: GroundReport) -> None:
    """Say what was taken away besides objects."""
    for item in ground.surroundings:
        print(f"{item.kind.name.lower()}: {item.n_points} points, {item.reason}")
    counts = ", ".join(f"{kind} {count}" for kind, count in ground.counts.items())
    print(f"points taken away: {counts or 'none'}")


def add_select(parser: argparse.ArgumentParser) -> None:
    """Add ``select``."""
    add_capture(parser)
    add_reports(parser, "who lies on whom,")
    add_policy(parser)
    parser.set_defaults(run=run_select)


def run_select(arguments: argparse.Namespace) -> int:
    """Order the objects, and give the reasons."""
    require_places(arguments.report, REPORT_FORMS, source=arguments.capture)
    capture = load_capture(arguments)
    segmentation = debrisgrasp.segment(capture)
    tell(ground_notes(segmentation.ground))
    site = site_of(arguments)
    own = site.selection()
    if arguments.site is not None:  # its hands may open to other widths
        own = debrisgrasp.Pipeline.from_settings(site).policy
    order = debrisgrasp.select(capture, segmentation, policy_of(arguments, own))
    with telling_written(*arguments.report):
        for path in arguments.report:
            write_selection_report(capture, segmentation, order, path)
    if arguments.json:
        facts = [
            {
                "object": c.label,
                "cost": round(c.cost, 6),
                "reason": c.reason,
                "warning": c.warning,
            }
            for c in order
        ]
        print(json.dumps(facts, indent=1))
    else:
        _print_ground_left(segmentation.ground)
        rows = [[str(i), str(c.label), c.reason] for i, c in enumerate(order, start=1)]
        print(columns(["turn", "object", "because"], rows) if rows else _NOTHING)
        print_written(*arguments.report)
    return 0 if order else 1


def _seconds(result: PlanningResult) -> str:
    stages = result.plan.seconds
    parts = ", ".join(f"{name} {spent:.2f}" for name, spent in stages.items())
    return f"{sum(stages.values()):.2f} s ({parts})"
