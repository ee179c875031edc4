"""The command line: ``debrisgrasp COMMAND ...``."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module

from debrisgrasp._signals import ENDINGS, signals_wait

__all__ = ["main"]

_INTERRUPTED = 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status.

    The commands are loaded in here, because that takes a second in which a person may
    already press Ctrl-C. A SIGTERM, as services are ended with, does the same, and so
    does the SIGHUP of a terminal that is lost.
    """
    try:
        with _ended_as_by_a_person():
            with signals_wait():
                program = import_module("debrisgrasp.cli.program")
            status: int = program.run(argv)
    except KeyboardInterrupt:
        with suppress(OSError):  # the terminal may be what was lost
            print("debrisgrasp: interrupted; no file is half-written", file=sys.stderr)
        return _INTERRUPTED
    return status


@contextmanager
def _ended_as_by_a_person() -> Iterator[None]:
    """Take what ends a command for Ctrl-C: arms stop, and workers are let go."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # What is ignored stays ignored, as a lost terminal is under nohup.
    before = {
        number: signal.signal(number, signal.default_int_handler)
        for number in ENDINGS
        if signal.getsignal(number) is not signal.SIG_IGN
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
