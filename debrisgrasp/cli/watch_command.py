"""The command ``calibrate watch``: whether the camera has moved."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from debrisgrasp._calibrating import observations_of, require_same_robot
from debrisgrasp.calibration import DriftMonitor, DriftReport, DriftStatus
from debrisgrasp.errors import ConfigError
from debrisgrasp.io.calibration_json import StoredCalibration, load_calibration
from debrisgrasp.io.observations_file import load_observations

from .rig_arguments import (
    add_robot,
    require_same_fiducial,
    rig_given,
)
from .tables import columns
from .values import some_path

__all__ = ["add_watch"]


def add_watch(actions: Any) -> None:
    """Add ``calibrate watch``."""
    parser = actions.add_parser(
        "watch", help="has the camera moved since it was calibrated?"
    )
    parser.add_argument("calibration", type=some_path, help="JSON of an accepted one")
    parser.add_argument(
        "looks", type=some_path, help="observations since then, oldest first"
    )
    add_robot(parser, "overrides the one in the looks")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=run_watch)


def run_watch(arguments: argparse.Namespace) -> int:
    """Judge looks one after the other; status 1 if the last one alarms."""
    stored = load_calibration(arguments.calibration)
    stored.require_accepted()
    given = load_observations(arguments.looks)
    rig = rig_given(arguments, given, arguments.looks)
    require_same_robot(stored, rig)
    require_same_fiducial(stored, rig)
    looks = observations_of(given, rig)
    _require_same_head(stored, looks.readings.shape[1])
    monitor, reports = DriftMonitor(calibration=stored), []
    for i in range(len(looks)):
        monitor, report = monitor.seen(looks.selected([i]))
        reports.append(report)
    wrong = {name for report in reports for name in report.wrong_picks}
    if arguments.json:
        facts = [
            {
                "look": name,
                "status": r.status.value,
                "gap": round(r.gap, 6),
                "shift": r.shift.round(6).tolist(),
                "p_value": r.p_value,
                "suspect": r.suspect,
                "wrong_pick": name in wrong,
            }
            for name, r in zip(looks.names, reports, strict=True)
        ]
        print(json.dumps(facts, indent=1))
    else:
        _print_watched(looks.names, reports, wrong)
    return 1 if reports[-1].status is DriftStatus.ALARM else 0


def _print_watched(
    names: tuple[str, ...], reports: Sequence[DriftReport], wrong: set[str]
) -> None:
    rows = [
        [
            name,
            r.status.value,
            f"{1e3 * r.gap:.1f}",
            f"{1e3 * np.linalg.norm(r.shift):.1f}",
            f"{r.p_value:.1g}",
            "wrong pick" if name in wrong else r.suspect or "-",
        ]
        for name, r in zip(names, reports, strict=True)
    ]
    header = ["look", "status", "gap [mm]", "shift [mm]", "p", "suspect"]
    print(columns(header, rows))
    if wrong:
        listed = ", ".join(name for name in names if name in wrong)
        print(
            "\nleft out as a wrong pick, the looks before and after it agree: " + listed
        )
    elif reports[-1].status is DriftStatus.ALARM and not reports[-1].suspect:
        print("\nno cause is clear yet: look again before you calibrate")
    trend = reports[-1].trend
    if trend is not None and trend.looks_left is not None:
        print(
            f"\ngrowing by {1e3 * trend.per_look:.2f} mm a look: "
            f"{trend.looks_left} looks until grasps begin to miss"
        )


def _require_same_head(stored: StoredCalibration, n_joints: int) -> None:
    if stored.head.n_joints != n_joints:
        raise ConfigError(
            "looks",
            got=f"{n_joints} joints of the head",
            expected=f"{stored.head.n_joints}, as the calibration has",
            mend="Name the same robot and fiducial as for the calibration.",
        )
