"""Plan on every capture of some folders, and print one table.

Captures without a measured camera pose are taken in their stored level frame, or, where
they have none, as seen from 0.9 m above a floor, looking straight down; for those only
the hand is planned, not the arm.

Run: python examples/03_plan_a_folder.py FOLDER [FOLDER ...] [--reports DIR]
"""

import argparse
from pathlib import Path

import debrisgrasp
from debrisgrasp.cli.tables import columns
from debrisgrasp.geometry import SE3
from debrisgrasp.viz import Report, report_html, report_png

LOOKING_DOWN = SE3.from_parts([[0, -1, 0], [-1, 0, 0], [0, 0, -1]], [1.0, 0.0, 0.9])
STAGES = ("cloud", "segmentation", "scene", "search", "inspection", "reachability")
SUFFIXES = (".npz", ".ply", ".pcd")


def posed(capture: debrisgrasp.Capture) -> tuple[debrisgrasp.Capture, str]:
    """Return the capture with a pose, and the robot that can use it."""
    if capture.T_base_camera is not None:
        return capture, "roman"
    if capture.T_level_camera is not None:
        return capture.posed("level"), "none"
    return capture.posed(LOOKING_DOWN), "none"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--reports", type=Path, help="write a picture and a page each")
    arguments = parser.parse_args()
    pipelines = {name: debrisgrasp.Pipeline(robot=name) for name in ("roman", "none")}
    rows = []
    files = [
        file
        for folder in arguments.folders
        for file in (sorted(folder.iterdir()) if folder.is_dir() else [folder])
    ]
    for path in (file for file in files if file.suffix in SUFFIXES):
        capture, robot = posed(debrisgrasp.Capture.load(path))
        result = pipelines[robot].plan(capture)
        plan, times = result.plan, result.plan.seconds
        numbers = [len(result.cloud), len(result.segmentation.segments)]
        best = f"{plan.grasps[0].Q:.2f}" if plan.grasps else "-"
        tried = 1 + len(plan.passed_over) if plan.grasps else len(plan.passed_over)
        rows.append(
            [
                path.stem,
                robot,
                *map(str, numbers),
                str(tried),
                str(len(plan.grasps)),
                best,
            ]
            + [f"{times.get(stage, 0.0):.2f}" for stage in STAGES]
            + [f"{sum(times.values()):.2f}"]
        )
        if arguments.reports:
            arguments.reports.mkdir(parents=True, exist_ok=True)
            report, stem = (
                Report.of(result, capture.name),
                arguments.reports / path.stem,
            )
            report_png(stem.with_suffix(".png"), report)
            report_html(stem.with_suffix(".html"), report)
    header = ["capture", "robot", "points", "segments", "tried", "grasps", "best Q"]
    print(columns(header + [f"{s} [s]" for s in (*STAGES, "total")], rows))


if __name__ == "__main__":
    main()
