"""``view``: look at a capture, plan, prototype, calibration or run in the browser."""

from __future__ import annotations

import argparse
from importlib import import_module
from typing import Any

from debrisgrasp import api
from debrisgrasp.errors import ConfigError
from debrisgrasp.io import Capture
from debrisgrasp.pipeline import MotionsConfig

from .capture_arguments import (
    add_capture,
    add_planning,
    load_capture,
    planned,
    refuse_planning,
)
from .site_arguments import site_of
from .values import some_path, whole

__all__ = ["add"]


def add(parser: argparse.ArgumentParser) -> None:
    """Add ``view``."""
    parser.description = (
        "Serve a page with the scene in three dimensions until Ctrl-C. A "
        "plan read from a file knows how many poses were ruled out; with --plan it is "
        "made anew and shows each of them, and what it would hit."
    )
    add_capture(
        parser,
        "a capture, a plan (grasps.json), a prototype or a folder of them, a "
        "calibration, or the folder of a run",
    )
    parser.add_argument(
        "--capture",
        dest="of_plan",
        type=some_path,
        metavar="FILE",
        help="the capture that a plan (grasps.json) was made on",
    )
    parser.add_argument(
        "--plan", action="store_true", help="plan on the capture, and show the plan"
    )
    parser.add_argument(
        "--motion",
        nargs="?",
        const="",
        metavar="FILE",
        help="motions of a saved plan; without FILE, and with --plan, plan them",
    )
    add_planning(parser)
    parser.add_argument(
        "--port", type=whole, default=8080, help="default: 8080; 0 takes a free one"
    )
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        help="address to listen on; 0.0.0.0 lets other machines look (default: "
        "127.0.0.1)",
    )
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    viewer = import_module("debrisgrasp.viewer")  # slow to load
    if not 0 <= arguments.port <= 65535:
        raise ConfigError("--port", got=arguments.port, expected="0 to 65535")
    _require_effect(arguments)
    motions = None
    if arguments.plan:
        thing, motions = _planned(arguments)
    else:
        thing = viewer.content_of(
            arguments.capture,
            capture=_capture(arguments),
            robot=arguments.robot,
            motion=arguments.motion,
            grippers=arguments.grippers,
        )
    window = viewer.show(
        thing, motions=motions, port=arguments.port, host=arguments.host
    )
    print(f"open {window.url} in a browser; Ctrl-C ends", flush=True)
    window.wait()
    return 0


def _require_effect(arguments: argparse.Namespace) -> None:
    """Refuse options that would do nothing."""
    if arguments.plan:
        return
    refuse_planning(arguments, "without --plan")
    is_saved_plan = arguments.capture.suffix.lower() == ".json"
    if arguments.motion == "" or (arguments.motion and not is_saved_plan):
        raise ConfigError(
            "--motion",
            got=f"{arguments.capture}",
            expected="a saved plan with a file of its motions, or --plan",
        )


def _capture(arguments: argparse.Namespace) -> Capture | None:
    """Capture that goes with the file, or that is the file."""
    path = arguments.capture
    if path.suffix.lower() in (".json", ".yaml", ".yml"):
        if arguments.of_plan is None:
            return None
        plan_path, arguments.capture = path, arguments.of_plan
        try:
            return load_capture(arguments, joints=arguments.joints)
        finally:
            arguments.capture = plan_path
    if path.is_file():
        return load_capture(arguments, joints=arguments.joints)
    return None


def _planned(arguments: argparse.Namespace) -> tuple[Any, Any]:
    if arguments.motion:
        raise ConfigError(
            "--motion",
            got=arguments.motion,
            expected="no file beside --plan",
            mend="Motions belong to the plan that they were made for: give grasps.json "
            "and --capture.",
        )
    settings = site_of(arguments)
    result = planned(arguments, settings, advise=True)
    if arguments.motion is None:
        return result, None
    config = MotionsConfig(speed=settings.limits.hand_speed)
    return result, api.plan_motion(result, config=config, seed=settings.seed)
