"""What every reader of captures returns, and how it reports a file it can't read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from debrisgrasp._arrays import FloatArray
from debrisgrasp._words import shown_path
from debrisgrasp.errors import CaptureError, ConfigError, InputError
from debrisgrasp.geometry import SE3, Intrinsics

__all__ = [
    "CaptureFields",
    "finite_vector",
    "is_count",
    "naming_the_file",
    "numeric",
    "read_bytes",
]


_DIGITS = 16
"""Of numbers that no file has so many bytes as; Python reads no more than 4300."""


class CaptureFields(TypedDict, total=False):
    """Arguments of a `Capture` as a file gives them, not yet checked."""

    depth: NDArray[Any]
    intrinsics: Intrinsics
    points: NDArray[Any]
    viewpoint: NDArray[Any]
    T_base_camera: SE3
    T_level_camera: SE3
    rgb: NDArray[Any]
    mask: NDArray[Any]
    labels: NDArray[Any]


@contextmanager
def naming_the_file(path: Path) -> Iterator[None]:
    """Say in every complaint about the content which file it comes from."""
    try:
        yield
    except ConfigError:
        raise  # comes from a file of settings, and names it
    except InputError as error:
        raise CaptureError(
            f"{shown_path(path)}: {error.what}",
            got=error.got,
            expected=error.expected,
            mend=error.mend,
        ) from error


def numeric(array: NDArray[Any], name: str) -> NDArray[Any]:
    """Return the array, or raise `CaptureError` if it doesn't hold real numbers."""
    if array.dtype.kind not in "fiu":
        raise CaptureError(name, got=f"dtype {array.dtype}", expected="real numbers")
    return array


def finite_vector(values: list[str], name: str) -> FloatArray:
    """Parse words as finite numbers."""
    try:
        vector = np.array([float(value) for value in values])
    except ValueError as error:
        raise CaptureError(name, got=" ".join(values), expected="numbers") from error
    if not np.isfinite(vector).all():
        raise CaptureError(name, got=" ".join(values), expected="finite numbers")
    return vector


def is_count(word: str) -> bool:
    """Whether a word of a header is a number of things that a file can hold."""
    return word.isdecimal() and len(word) < _DIGITS


def read_bytes(path: Path) -> bytes:
    """Content of a file, or `CaptureError` saying why not."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise CaptureError(
            "capture", got=error.strerror or str(error), expected="a readable file"
        ) from error
