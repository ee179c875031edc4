"""The command line: ``debrisgrasp COMMAND ...``."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module

from .loading import signals_wait

__all__ = ["main"]

_INTERRUPTED = 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status.

    The commands are loaded in here, because that takes a second in which a person may
    already press Ctrl-C. A SIGTERM, as services are ended with, does the same.
    """
    try:
        with _ended_as_by_a_person():
            with signals_wait():
                program = import_module("debrisgrasp.cli.program")
            status: int = program.run(argv)
    except KeyboardInterrupt:
        print("debrisgrasp: interrupted; no file is half-written", file=sys.stderr)
        return _INTERRUPTED
    return status


@contextmanager
def _ended_as_by_a_person() -> Iterator[None]:
    """Take SIGTERM for Ctrl-C: arms are stopped, and workers are let go."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
