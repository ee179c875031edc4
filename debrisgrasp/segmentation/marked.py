"""Which objects a mark of one object covers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, as_given
from debrisgrasp._checked import checked
from debrisgrasp.errors import ShapeError

from .segmentation import Segmentation

__all__ = ["WHOLE_SHARE", "checked_mark", "covered_shares", "with_mark"]

_SEVERAL = 0.2
"""With such a share of itself a mark covers an object, and not just touches it."""
WHOLE_SHARE = 0.8
"""With such a share of an object in it, a mark or a region covers it as a whole."""
_CRUMB = 0.02
"""Whole objects with less than such a share of the largest are crumbs at the edge."""


def covered_shares(
    marked: FloatArray | IntArray, size: FloatArray | IntArray
) -> FloatArray:
    """List how much of a mark lies on each object that it covers.

    Parameters
    ----------
    marked, size
        Marked and all points, or cells, of each object, shapes (o,).

    Returns
    -------
    FloatArray
        As shares of what is marked, largest first, shape (k,).
    """
    share = marked / max(float(marked.sum()), 1.0)
    is_whole = (marked > WHOLE_SHARE * size) & (marked > _CRUMB * marked.max(initial=0))
    covered: FloatArray = np.sort(share[(share > _SEVERAL) | is_whole])[::-1]
    return covered


def checked_mark(of_interest: ArrayLike, n: int) -> BoolArray:
    """Give a mark of n points as an array; raise `ShapeError` if it is none."""
    mark = as_given(of_interest, "of_interest")
    if mark.shape != (n,) or mark.dtype != np.bool_:
        raise ShapeError(
            "of_interest",
            got=f"{mark.dtype} {mark.shape}",
            expected=f"True or False for each point, ({n},)",
        )
    return mark


@checked
def with_mark(
    segmentation: Segmentation, of_interest: BoolArray | None
) -> Segmentation:
    """Add what a mark (n,) covers, unless that is known or there is none.

    Raises
    ------
    ShapeError
        If the mark is not one for each point.
    """
    if of_interest is None or segmentation.marked_shares is not None:
        return segmentation
    of_interest = checked_mark(of_interest, segmentation.labels.size)
    # What no mark has joined can be counted as it is.
    size = np.bincount(segmentation.labels, minlength=1)
    marked = np.bincount(segmentation.labels[of_interest], minlength=len(size))
    return replace(segmentation, marked_shares=covered_shares(marked[1:], size[1:]))
