"""Work on a second core, beside that of the caller."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import copy_context
from typing import TypeVar

__all__ = ["beside", "cores"]

T = TypeVar("T")


def cores() -> int:
    """How many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):  # not on every system
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def beside(work: Callable[[], T], *, workers: int) -> Iterator[Callable[[], T]]:
    """Begin some work on a thread of its own; its result is asked for when needed.

    This pays for operations on large arrays only, during which the interpreter is free.
    A search takes many steps on small ones, and two threads of it are slower than one.

    Parameters
    ----------
    work
        What to do. What it raises, asking for the result raises.
    workers
        With one, or on a machine with one core, the work is done when the result is
        asked for, by the caller.

    Yields
    ------
    Callable
        Gives the result; asked at most once.
    """
    if min(workers, cores()) < 2:
        yield work
        return
    # What the caller set, as for invalid floating point values, holds there too.
    with ThreadPoolExecutor(1) as pool:
        yield pool.submit(copy_context().run, work).result
