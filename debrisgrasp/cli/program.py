"""Parse the arguments, run the command, and turn its end into an exit status.

0 is done, 1 an honest 'no' (no grasp was found), 2 bad input; 130 means interrupted.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence

from debrisgrasp.errors import DebrisGraspError

from . import (
    calibrate_command,
    campaign_command,
    clear_command,
    commands,
    doctor_command,
    ik_command,
    motion_command,
    prototype_commands,
    reach_commands,
    view_command,
)

__all__ = ["build_parser", "run"]


def run(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status."""
    arguments = build_parser().parse_args(argv)
    try:
        status: int = arguments.run(arguments)
    except DebrisGraspError as error:
        _complain(error, as_json=getattr(arguments, "json", False))
        return 2
    except BrokenPipeError:
        # Whoever read our output has gone, as with `| head`.
        sys.stderr.close()
        return 0
    return status


def _complain(error: DebrisGraspError, *, as_json: bool) -> None:
    if as_json:
        facts = {"error": type(error).__name__, "message": str(error)}
        print(json.dumps(facts), file=sys.stderr)
    else:
        print(f"debrisgrasp: error: {error}", file=sys.stderr)


def build_parser() -> argparse.ArgumentParser:
    """Describe the commands and their arguments."""
    parser = argparse.ArgumentParser(
        prog="debrisgrasp",
        description="From one depth image of a pile of debris to ranked grasps.",
        epilog="Exit status: 0 done, 1 no grasp or object found, 2 bad input.",
    )
    parser.add_argument("--version", action="version", version=commands.version())
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    commands.add_demo(subparsers)
    commands.add_plan(subparsers)
    commands.add_segment(subparsers)
    commands.add_select(subparsers)
    ik_command.add(subparsers)
    motion_command.add(subparsers)
    reach_commands.add(subparsers)
    prototype_commands.add(subparsers)
    calibrate_command.add(subparsers)
    clear_command.add(subparsers)
    campaign_command.add(subparsers)
    doctor_command.add(subparsers)
    view_command.add(subparsers)
    return parser
