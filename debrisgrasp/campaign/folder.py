"""The folder of a campaign, on which one process works at a time."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from debrisgrasp.errors import InputError, OutputError

try:
    import fcntl
except ImportError:  # on Windows
    fcntl = None  # type: ignore[assignment]

__all__ = ["alone_in", "make_folder"]


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Keep others out of a folder; one that was made for it and is empty goes again.

    Twice the same runs would only take twice the time. The lock ends with the process,
    however that ends; where a platform or file system has none, nobody is kept out.
    """
    is_new = not folder.exists()
    make_folder(folder)
    try:
        with _locked(folder):
            yield
    finally:
        if is_new:
            with suppress(OSError):
                folder.rmdir()


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    if fcntl is None:
        yield
        return
    place = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise InputError(
                f"campaign in {folder}",
                got="another process that is at work on it",
                expected="one at a time",
                mend="Wait for its end, or give another folder.",
            ) from error
        except OSError:
            pass  # a file system without locks
        yield
    finally:
        os.close(place)


def make_folder(folder: Path) -> None:
    """Make a folder, or raise `OutputError`."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise OutputError(folder, "it must be a folder, but a file is there") from error
    except OSError as error:
        raise OutputError(folder, error.strerror or str(error)) from error
