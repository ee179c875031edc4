"""Folders in which one process works at a time."""

from __future__ import annotations

import os
from contextlib import ExitStack
from pathlib import Path

try:
    import fcntl
except ImportError:  # on Windows
    fcntl = None  # type: ignore[assignment]

__all__ = ["locked"]


def locked(folder: Path) -> ExitStack:
    """Keep others out of a folder until what is returned is closed.

    The lock ends with the process, however that ends; where a platform or file system
    has none, nobody is kept out.

    Raises
    ------
    BlockingIOError
        If another one is in there.
    """
    with ExitStack() as lock:
        if fcntl is not None:
            try:
                place = os.open(folder, os.O_RDONLY)
                lock.callback(os.close, place)
                fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise
            except OSError:
                pass  # no such locks there
        return lock.pop_all()
