"""The command line: ``debrisgrasp COMMAND ...``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module

__all__ = ["main"]

_INTERRUPTED = 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status.

    The commands are loaded in here, because that takes a second in which a person may
    already press Ctrl-C.
    """
    try:
        status: int = import_module("debrisgrasp.cli.program").run(argv)
    except KeyboardInterrupt:
        print("debrisgrasp: interrupted; no file is half-written", file=sys.stderr)
        return _INTERRUPTED
    return status
