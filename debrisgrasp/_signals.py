"""Signals that end a command, and what none of them may fall into."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["ENDINGS", "signals_wait"]

ENDINGS = tuple(
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP")
    if hasattr(signal, name)
)
"""Ctrl-C, how services are ended, and a terminal that is lost."""


@contextmanager
def signals_wait() -> Iterator[None]:
    """Hold signals that end a command back in this thread, and in what it starts.

    What is being loaded may take an interrupt for an error of its own, and go on
    without what failed, or explain that at length.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDINGS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
