"""Parse the arguments, run the command, and turn its end into an exit status.

0 is done, 1 an honest 'no' (no grasp was found), 2 bad input; 130 means interrupted.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from importlib import import_module

from debrisgrasp import __version__
from debrisgrasp.errors import DebrisGraspError

__all__ = ["build_parser", "run"]

_COMMANDS = {
    "demo": ("commands", "add_demo"),
    "plan": ("commands", "add_plan"),
    "segment": ("commands", "add_segment"),
    "select": ("commands", "add_select"),
    "ik": ("ik_command", "add"),
    "motion": ("motion_command", "add"),
    "reach": ("reach_commands", "add"),
    "prototype": ("prototype_commands", "add"),
    "calibrate": ("calibrate_command", "add"),
    "clear": ("clear_command", "add"),
    "replay": ("clear_command", "add"),
    "campaign": ("campaign_command", "add"),
    "doctor": ("doctor_command", "add"),
    "view": ("view_command", "add"),
}
"""Where each command is described."""


def run(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status."""
    given = list(sys.argv[1:] if argv is None else argv)
    only = given[0] if given and given[0] in _COMMANDS else None
    arguments = build_parser(only).parse_args(given)
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


def build_parser(only: str | None = None) -> argparse.ArgumentParser:
    """Describe the commands and their arguments; those of one alone load faster."""
    parser = argparse.ArgumentParser(
        prog="debrisgrasp",
        description="From one depth image of a pile of debris to ranked grasps.",
        epilog="Exit status: 0 done, 1 an honest no (nothing found, or a result "
        "refused), 2 bad input. COMMAND --help tells more.",
    )
    parser.add_argument(
        "--version", action="version", version=f"debrisgrasp {__version__}"
    )
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    wanted = [home for name, home in _COMMANDS.items() if only in (None, name)]
    for module, function in dict.fromkeys(wanted):
        getattr(import_module(f".{module}", __package__), function)(subparsers)
    return parser
