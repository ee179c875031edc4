"""The actions of ``calibrate`` that get at the fiducial: find it, have it picked."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Sequence
from dataclasses import replace
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from debrisgrasp._files import is_yaml
from debrisgrasp.calibration import MarkerConfig, MarkerMissing, find_marker
from debrisgrasp.errors import CaptureError, ConfigError
from debrisgrasp.io import Capture
from debrisgrasp.io.observations_file import (
    SCHEMA,
    load_observations,
    observations_to_dict,
)

from .reports import PAGE_FORMS, require_places
from .values import number, some_path

__all__ = ["add_find", "add_pick"]

_SAME_POSE = 0.005
"""How far the camera may have moved between two pictures of one view [m, rad]."""
_SAME_DEPTH = 0.03
"""Share of a depth that noise may change."""


def add_find(actions: Any) -> None:
    """Add ``find``."""
    parser = actions.add_parser("find", help="find a lit marker in a capture")
    parser.add_argument("capture", type=some_path, help="colour and depth, LED on")
    parser.add_argument(
        "--off",
        type=some_path,
        metavar="CAPTURE",
        help="the same view with the LED off",
    )
    parser.add_argument(
        "--expected",
        nargs=3,
        type=number,
        required=True,
        metavar=("X", "Y", "Z"),
        help="where it should be, camera frame, metres",
    )
    parser.add_argument(
        "--color",
        nargs=3,
        type=number,
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
    if off is not None:
        _require_same_view(on, off)
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


def _require_same_view(on: Capture, off: Capture) -> None:
    """Raise `CaptureError` if the two were not taken from one place of one scene."""
    a, b = on.depth, off.depth
    if a is None or b is None:
        raise AssertionError("checked by the caller")
    got = ""
    if a.shape != b.shape:
        sizes = [f"{d.shape[1]} x {d.shape[0]}" for d in (b, a)]
        got = f"an image of {sizes[0]} pixels, not {sizes[1]}"
    elif on.intrinsics != off.intrinsics:
        got = "other intrinsics"
    elif on.T_base_camera is not None and off.T_base_camera is not None:
        change = on.T_base_camera.inverse() @ off.T_base_camera
        if np.abs(change.log()).max() > _SAME_POSE:
            got = f"another camera pose, {1e3 * np.linalg.norm(change.p):.0f} mm away"
    if not got:
        # NaN, where nothing was measured, compares as False.
        with np.errstate(invalid="ignore"):
            both = (a > 0) & (b > 0)
            differs = both & (np.abs(a - b) > _SAME_DEPTH * np.fmax(a, b))
        if both.any() and differs.sum() > 0.5 * both.sum():
            share = 100.0 * differs.sum() / both.sum()
            got = f"other depth at {share:.0f} % of the pixels"
    if got:
        raise CaptureError(
            f"capture {off.name} with the LED off",
            got=got,
            expected=f"the view of {on.name}, the LED apart",
            mend="Take both with camera and arm at rest, or leave --off out.",
        )


def add_pick(actions: Any) -> None:
    """Add ``pick``."""
    parser = actions.add_parser(
        "pick", help="a page on which a person clicks the fiducial"
    )
    parser.add_argument(
        "captures", nargs="+", type=some_path, metavar="CAPTURE", help="one a posture"
    )
    parser.add_argument(
        "--into",
        type=some_path,
        metavar="FILE",
        help="observations whose points are to be picked, in the order of the captures "
        "(`calibrate choose --out FILE` writes them)",
    )
    parser.add_argument(
        "--report",
        type=some_path,
        required=True,
        metavar="FILE",
        help="the page, .html",
    )
    parser.set_defaults(run=run_pick)


def run_pick(arguments: argparse.Namespace) -> int:
    """Write the page."""
    require_places([arguments.report], PAGE_FORMS, source=arguments.captures[0])
    captures = [Capture.load(path) for path in arguments.captures]
    _require_distinct(arguments.captures, captures)
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
        if given.robot is not None and is_yaml(given.robot):
            # A browser saves what was picked wherever it likes.
            beside = (arguments.into.parent / given.robot).resolve()
            given = replace(given, robot=str(beside))
        header = observations_to_dict(given)
        rows = header.pop("observations")
    pick = import_module("debrisgrasp.viz.pick")
    views = [
        pick.PickView(capture=capture, observation=row)
        for capture, row in zip(captures, rows, strict=False)
    ]
    pick.pick_html(arguments.report, views, header=header)
    without = [str(row["name"]) for row in rows[len(captures) :]]
    if without:
        print(f"no capture for {', '.join(without)}: not on the page")
    print(f"wrote {arguments.report}: open it, click the fiducial, save the file")
    return 0


def _require_distinct(paths: Sequence[Path], captures: Sequence[Capture]) -> None:
    """Raise `CaptureError` if two captures are one: its posture would be another's."""
    first: dict[str, Path] = {}
    for path, capture in zip(paths, captures, strict=True):
        image = sha256()
        for array in (capture.depth, capture.points, capture.rgb):
            if array is not None:
                image.update(np.ascontiguousarray(array).tobytes())
        earlier = first.setdefault(image.hexdigest(), path)
        if earlier is path:
            continue
        is_same = os.path.realpath(earlier) == os.path.realpath(path)
        raise CaptureError(
            f"capture {path}",
            got="the same file twice" if is_same else f"the same image as {earlier}",
            expected="another look for each posture",
            mend="Leave it out, or capture again in its posture.",
        )
