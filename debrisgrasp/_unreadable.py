"""Whether there is a file, and why one can't be read."""

from __future__ import annotations

import os
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Literal

__all__ = [
    "PULL",
    "UNREADABLE_ARRAY",
    "PathLike",
    "is_device",
    "is_pointer",
    "is_there",
    "why_not_there",
    "why_nothing_there",
    "why_unreadable",
]

PathLike = str | os.PathLike[str]

UNREADABLE_ARRAY = (
    EOFError,
    KeyError,
    MemoryError,  # a damaged header may claim any size
    NotImplementedError,
    OSError,
    RuntimeError,
    SyntaxError,
    TypeError,
    ValueError,  # also raised for pickled objects, which are never loaded
    struct.error,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What NumPy raises for damaged, encrypted or pickled files."""

_IN_WORDS = {
    "Object arrays": "objects rather than numbers",
    "pickled": "no arrays at all",
    # NumPy takes for an archive what begins as one; the list of contents is at its end.
    "not a zip file": "a damaged file, whose end is cut off",
    "Bad CRC-32": "a damaged file",
    "Bad magic number": "a damaged file",
    "while decompressing": "a damaged file",
    "number of columns changed": "rows of different lengths",
    "could not convert string": "words rather than numbers",
    "No data left": "nothing",
    "context manager": "a single array",
    "not a file in the archive": "other arrays",
}
"""What people understand, by what NumPy's message has in it."""

_POINTER = b"version https://git-lfs.github.com/spec/"
PULL = "Run `git lfs pull` where it was cloned."
"""How the large file itself is had."""


def why_unreadable(error: BaseException) -> str:
    """Say in a user's words why NumPy could not read a file."""
    said = getattr(error, "strerror", None) or str(error) or type(error).__name__
    known = (words for part, words in _IN_WORDS.items() if part in said)
    return next(known, said.rstrip("."))


def is_pointer(path: PathLike) -> bool:
    """Whether a file is only what Git LFS left in the place of a large one."""
    path = Path(path)
    if why_not_there(path, "file"):
        return False
    with path.open("rb") as file:
        return file.read(len(_POINTER)) == _POINTER


def is_there(path: PathLike) -> bool:
    """Whether there is a file or folder at a path; none has a name too long for one."""
    return not why_nothing_there(path)


def why_nothing_there(path: PathLike) -> str:
    """Say why there is neither file nor folder at a path; empty if there is one."""
    return _why_not(Path(path).exists, "no such file or folder")


def why_not_there(path: Path, kind: Literal["file", "folder"]) -> str:
    """Say why there is no file or folder at a path; empty if there is one."""
    is_it = path.is_file if kind == "file" else path.is_dir
    return _why_not(is_it, f"no {kind} there")


def is_device(path: Path) -> bool:
    """Whether there is a device at a path: some have no end, and aren't read."""
    return path.is_char_device() or path.is_block_device()


def _why_not(is_it: Callable[[], bool], words: str) -> str:
    try:
        return "" if is_it() else words
    except OSError as error:  # as of a name that no file can have
        return error.strerror or str(error)
