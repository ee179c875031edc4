"""The pictures that markers and tags are sought in."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from debrisgrasp.errors import InputError, ShapeError

__all__ = ["checked_picture"]


def checked_picture(
    picture: ArrayLike, name: str, *shapes: tuple[int, ...]
) -> NDArray[np.uint8]:
    """Check a picture, of one of these shapes, whose brightness is of 255.

    Raises
    ------
    ShapeError, InputError
        If it is none: in one of numbers from 0 to 1, say, nothing would be seen.
    """
    array = np.asarray(picture)
    if array.shape not in shapes:
        wanted = " or ".join(map(str, shapes))
        raise ShapeError(f"shape of {name}", got=array.shape, expected=wanted)
    if array.dtype != np.uint8:
        raise InputError(
            name,
            got=f"numbers of type {array.dtype}",
            expected="uint8, from 0 to 255",
            mend="Of numbers from 0 to 1: np.rint(255 * picture).astype(np.uint8).",
        )
    return array
