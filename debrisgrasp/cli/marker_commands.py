"""The actions of ``calibrate`` that get at the fiducial: find it, have it picked."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from debrisgrasp.calibration import MarkerConfig, MarkerMissing, find_marker
from debrisgrasp.errors import CaptureError, ConfigError, OutputError
from debrisgrasp.io import Capture
from debrisgrasp.io.observations_file import SCHEMA, load_observations

__all__ = ["add_find", "add_pick", "require_free_places"]


def add_find(actions: Any) -> None:
    """Add ``find``."""
    parser = actions.add_parser("find", help="find a lit marker in a capture")
    parser.add_argument("capture", type=Path, help="colour and depth, LED on")
    parser.add_argument(
        "--off", type=Path, metavar="CAPTURE", help="the same view with the LED off"
    )
    parser.add_argument(
        "--expected",
        nargs=3,
        type=float,
        required=True,
        metavar=("X", "Y", "Z"),
        help="where it should be, camera frame, metres",
    )
    parser.add_argument(
        "--color",
        nargs=3,
        type=float,
        metavar=("R", "G", "B"),
        help="of its light (default: blue)",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=run_find)


def run_find(arguments: argparse.Namespace) -> int:
    """Find a marker; status 1 if it is not there."""
    on = Capture.load(arguments.capture)
    off = Capture.load(arguments.off) if arguments.off else None
    for capture in (on, off):
        if capture is not None and (capture.rgb is None or capture.depth is None):
            raise CaptureError(
                f"capture {capture.name}",
                got="no colour image" if capture.rgb is None else "no depth image",
                expected="both, registered to one another",
            )
    if on.rgb is None or on.depth is None or on.intrinsics is None:
        raise AssertionError("checked above")
    color = arguments.color
    config = MarkerConfig() if color is None else MarkerConfig(color=tuple(color))
    found = find_marker(
        on.rgb,
        on.depth,
        on.intrinsics,
        arguments.expected,
        rgb_off=None if off is None else off.rgb,
        config=config,
    )
    if isinstance(found, MarkerMissing):
        facts: dict[str, Any] = {"found": False, "reason": found.reason}
    else:
        facts = {
            "found": True,
            "point": found.point_camera.round(6).tolist(),
            "pixel": found.pixel.round(3).tolist(),
            "depths": found.n_depths,
        }
    if arguments.json:
        print(json.dumps(facts))
    elif isinstance(found, MarkerMissing):
        print(f"no marker: {found.reason}")
    else:
        x, y, z = found.point_camera
        u, v = found.pixel
        print(
            f"point: [{x:.5f}, {y:.5f}, {z:.5f}]  # pixel ({u:.2f}, {v:.2f}), "
            f"depth from {found.n_depths} around it"
        )
    return 0 if facts["found"] else 1


def add_pick(actions: Any) -> None:
    """Add ``pick``."""
    parser = actions.add_parser(
        "pick", help="a page on which a person clicks the fiducial"
    )
    parser.add_argument(
        "captures", nargs="+", type=Path, metavar="CAPTURE", help="one a posture"
    )
    parser.add_argument(
        "--into",
        type=Path,
        metavar="FILE",
        help="observations whose points are to be picked, in the order of the captures "
        "(`calibrate choose --out FILE` writes them)",
    )
    parser.add_argument(
        "--report", type=Path, required=True, metavar="FILE", help="the page, .html"
    )
    parser.set_defaults(run=run_pick)


def run_pick(arguments: argparse.Namespace) -> int:
    """Write the page."""
    require_free_places(arguments.captures[0], {".html": arguments.report})
    captures = [Capture.load(path) for path in arguments.captures]
    header: dict[str, Any] = {"schema": SCHEMA}
    rows: list[dict[str, Any]] = [
        {"name": f"look_{i}", "joints": {}} for i in range(1, len(captures) + 1)
    ]
    if arguments.into:
        given = load_observations(arguments.into)
        if len(given.rows) < len(captures):
            raise ConfigError(
                f"observations in {arguments.into}",
                got=len(given.rows),
                expected=f"one for each of {len(captures)} captures",
            )
        names = {"robot": given.robot, "fiducial": given.fiducial}
        header |= {k: v for k, v in names.items() if v is not None}
        rows = [{"name": r.name, "joints": dict(r.joints)} for r in given.rows]
    pick = import_module("debrisgrasp.viz.pick")
    views = [
        pick.PickView(capture=capture, observation=row)
        for capture, row in zip(captures, rows, strict=False)
    ]
    pick.pick_html(arguments.report, views, header=header)
    print(f"wrote {arguments.report}: open it, click the fiducial, save the file")
    return 0


def require_free_places(source: Path, places: Mapping[str, Path | None]) -> None:
    """Raise before any work if a result could not be written after it."""
    for suffix, path in places.items():
        if path is None:
            continue
        if path.suffix.lower() != suffix:
            raise ConfigError(
                "name of a result", got=str(path), expected=f"one that ends in {suffix}"
            )
        if not path.parent.is_dir():
            raise OutputError(path, f"there is no folder {path.parent}")
        if path.resolve() == source.resolve():
            raise OutputError(path, "it is what is read")
