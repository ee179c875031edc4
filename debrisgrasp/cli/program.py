"""Parse the arguments, run the command, and turn its end into an exit status.

0 is done, 1 an honest 'no' (no grasp was found), 2 bad input; 130 means interrupted.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import re
import sys
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from importlib import import_module
from typing import Any, NoReturn, TextIO

from debrisgrasp import __version__
from debrisgrasp._signals import signals_wait
from debrisgrasp._words import shortened
from debrisgrasp.errors import ConfigError, DebrisGraspError, InputError, OutputError

from .output import steady_output

__all__ = ["build_parser", "run"]

_COMMANDS = {
    "demo": "plan on a bundled capture; writes grasps and reports",
    "plan": "find grasps on the object that is easiest to take",
    "segment": "divide a capture into objects",
    "select": "the order in which objects would be taken, and why",
    "ik": "joints that bring the palm to given poses",
    "motion": "plan reach, approach and lift for the first grasp that allows them",
    "reach": "what the arms can grip, from which side, and where the base should go",
    "prototype": "look at, check and make prototypes",
    "calibrate": "find where the camera is, and how well that is known",
    "clear": "clear a pile with the robot in memory, and record every decision",
    "replay": "do a recorded run again, and compare decision by decision",
    "campaign": "many seeded runs; outcome tables with intervals",
    "doctor": "check the installation and a site's settings; plan on a shipped capture",
    "view": "look at a capture, plan, prototype, calibration or run in the browser",
}
"""What each command does."""
_HOMES = {
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
    "replay": ("replay_command", "add"),
    "campaign": ("campaign_command", "add"),
    "doctor": ("doctor_command", "add"),
    "view": ("view_command", "add"),
}
"""Where the arguments of each command are described."""
_UNTOLD = (
    "The work was done, and other files that were asked for are written; make room, "
    "or print elsewhere."
)


def run(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status.

    It goes on where nothing can be printed any more, as on a full disk; that is an
    error once it is done, unless whoever read has gone, as with ``| head``.
    """
    given = [_with_home(word) for word in (sys.argv[1:] if argv is None else argv)]
    with steady_output() as out:
        status = _answered(given)
        out.flush()
        if out.fault is None or isinstance(out.fault, BrokenPipeError):
            return status
        reason = out.fault.strerror or str(out.fault)
        error = OutputError("standard output", reason, _UNTOLD)
        return _refused(error, given)


def _with_home(word: str) -> str:
    """Put the home folder into ``--option=~/path``, where no shell does."""
    option, equals, path = word.partition("=")
    if not (option.startswith("--") and path.startswith("~")):
        return word
    return option + equals + os.path.expanduser(path)  # noqa: PTH111  # Path's raises


def _answered(given: Sequence[str]) -> int:
    """Run one command; what is wrong is told in one line."""
    try:
        arguments = build_parser(given).parse_args(given)
        with _warnings_shown():
            status: int = arguments.run(arguments)
    except DebrisGraspError as error:
        return _refused(error, given)
    except OSError as error:  # as of a name that no file can have
        if error.filename is None:
            raise
        reason = error.strerror or str(error)
        place = shortened(str(error.filename))
        return _refused(
            ConfigError(place, got=reason, expected="a file or folder"), given
        )
    return status


def _refused(error: DebrisGraspError, given: Sequence[str]) -> int:
    """Tell what is wrong; returns the exit status."""
    facts = {"error": type(error).__name__, "message": _in_options(error, given)}
    if "--json" in given:
        print(json.dumps(facts), file=sys.stderr)
    else:
        print(f"debrisgrasp: error: {facts['message']}", file=sys.stderr)
    return 2


@contextmanager
def _warnings_shown() -> Iterator[None]:
    """Print what the library warns of while a command runs as notes on stderr."""
    show = warnings.showwarning

    def as_note(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        if category is UserWarning:  # others are for programmers, who need the line
            print(f"note: {message}", file=sys.stderr)
        else:
            show(message, category, filename, lineno, file, line)

    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("note: %(message)s"))
    logger = logging.getLogger("debrisgrasp")
    logger.addHandler(handler)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = as_note
            yield
    finally:
        logger.removeHandler(handler)


_SETTING = re.compile(r"(?:[A-Z]\w*\.)?([a-z][a-z_ ]*?)( \[.*\])?")
"""What errors call a setting: its name, maybe after its class or before its unit."""


def _in_options(error: DebrisGraspError, given: Sequence[str]) -> str:
    """Message of an error, in which a setting is called by the option that gave it."""
    found = _SETTING.fullmatch(error.what) if isinstance(error, InputError) else None
    if not isinstance(error, InputError) or found is None:
        return str(error)
    option = "--" + re.sub("[_ ]", "-", found[1])
    if option not in {word.partition("=")[0] for word in given}:
        return str(error)
    return str(error).replace(error.what, option + (found[2] or ""), 1)


_TOO_FEW = re.compile(r"argument (--[\w-]+): expected \d+ arguments")
"""How an option complains of the number of its values, without saying which."""


_MISSPELT = 0.75
"""Options as alike as this are one misspelt; `--record` and `--report` are less so."""


def _near(word: str, options: Iterable[str]) -> str:
    """Return the option that a word is meant to be, or may be the beginning of."""
    # Dashes would make all of them alike.
    names = {option.lstrip("-"): option for option in options}
    bare = word.lstrip("-")
    near = get_close_matches(bare, names, n=1, cutoff=_MISSPELT)
    if bare != word:
        near += [name for name in names if name.startswith(f"{bare}-")]
    return names[near[0]] if near else ""


class UsageError(DebrisGraspError):
    """Arguments that no command takes."""


class _Parser(argparse.ArgumentParser):
    """Refuses arguments in one line, as everything else is refused."""

    def __init__(self, **settings: Any) -> None:
        # A beginning of an option may become that of another one, or mean one already.
        super().__init__(allow_abbrev=False, **settings)
        # Rows of numbers, as pixels and poses are, are no options either.
        self._negative_number_matcher = re.compile(r"-[\d.]")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Refuse what is unknown here, where it is known what could be meant."""
        found, unknown = super().parse_known_args(args, namespace)
        if unknown:
            near = _near(unknown[0].partition("=")[0], self._option_string_actions)
            meant = f" (did you mean {near}?)" if near else ""
            self.error(f"unrecognized arguments: {' '.join(unknown)}{meant}")
        return found, unknown

    def error(self, message: str) -> NoReturn:
        """Raise `UsageError` with the message."""
        prog = self.prog if " " in self.prog else f"{self.prog} COMMAND"
        found = _TOO_FEW.search(message)
        names = self._option_string_actions[found[1]].metavar if found else None
        if isinstance(names, tuple):
            message += f", {' '.join(names)}, with spaces between them"
        more = f"`{prog} --help` tells what can be given"
        raise UsageError(f"{message}. {more}.")


def build_parser(given: Sequence[str]) -> argparse.ArgumentParser:
    """Describe the commands, and the arguments of the one that is given.

    Those of all would take a second to load.
    """
    parser = _Parser(
        prog="debrisgrasp",
        description="From one depth image of a pile of debris to ranked grasps.",
        epilog="Exit status: 0 done, 1 an honest no (nothing found, or a result "
        "refused), 2 bad input. COMMAND --help tells more.",
    )
    parser.add_argument(
        "--version", action="version", version=f"debrisgrasp {__version__}"
    )
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    wanted = next((word for word in given if word in _COMMANDS), None)
    for name, told in _COMMANDS.items():
        command = subparsers.add_parser(name, help=told)
        if name == wanted:
            module, function = _HOMES[name]
            with signals_wait():
                home = import_module(f".{module}", __package__)
            getattr(home, function)(command)
    return parser
