"""The folder of a campaign, on which one process works at a time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from debrisgrasp._locks import locked
from debrisgrasp.errors import InputError, OutputError

__all__ = ["alone_in", "make_folder"]


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Keep others out of a folder; one that was made for it and is empty goes again.

    Twice the same runs would only take twice the time.
    """
    is_new = not folder.exists()
    make_folder(folder)
    try:
        with locked(folder):
            yield
    except BlockingIOError as error:
        raise InputError(
            f"campaign in {folder}",
            got="another process that is at work on it",
            expected="one at a time",
            mend="Wait for its end, or give another folder.",
        ) from error
    finally:
        if is_new:
            with suppress(OSError):
                folder.rmdir()


def make_folder(folder: Path) -> None:
    """Make a folder, or raise `OutputError`."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise OutputError(folder, "it must be a folder, but a file is there") from error
    except OSError as error:
        raise OutputError(folder, error.strerror or str(error)) from error
