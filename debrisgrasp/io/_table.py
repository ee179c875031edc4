"""Columns of numbers, as PLY and PCD files hold them."""

from __future__ import annotations

from io import BytesIO
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from debrisgrasp._arrays import FloatArray
from debrisgrasp._unreadable import why_unreadable
from debrisgrasp.errors import CaptureError

__all__ = ["binary_table", "positions", "text_table"]


def text_table(body: bytes, layout: np.dtype[Any], n_rows: int) -> NDArray[Any]:
    """Parse the first rows of white-space separated numbers, but for comments (#).

    Parameters
    ----------
    body
        What follows the header.
    layout
        Structured type of one row.
    n_rows
        How many rows the header promises.
    """
    if n_rows == 0:
        return np.empty(0, dtype=layout)
    if n_rows > len(body):
        raise CaptureError(
            "rows of numbers",
            got=f"{len(body)} bytes",
            expected=f"{n_rows} rows, as the header says",
            mend="The file is cut short, or its header is wrong.",
        )
    rows = (line.partition(b"#")[0].strip() for line in BytesIO(body))
    first = islice(filter(None, rows), n_rows)
    try:
        numbers = np.loadtxt(first, ndmin=2, comments=None, encoding="latin-1")
    except ValueError as error:
        raise CaptureError(
            "rows of numbers", got=why_unreadable(error), expected="numbers only"
        ) from error
    widths = [
        layout[name].shape[0] if layout[name].shape else 1
        for name in layout.names or ()
    ]
    wanted = (n_rows, sum(widths))
    if numbers.shape != wanted:
        raise CaptureError(
            "rows of numbers",
            got="{} rows of {}".format(*numbers.shape),
            expected="{} rows of {}".format(*wanted),
            mend="The file is cut short, or its header is wrong.",
        )
    table = np.empty(n_rows, dtype=layout)
    column = 0
    # Columns that aren't positions may hold anything, also NaN among integers.
    with np.errstate(invalid="ignore", over="ignore"):
        for name, width in zip(layout.names or (), widths, strict=True):
            values = numbers[:, column : column + width]
            table[name] = values if layout[name].shape else values[:, 0]
            column += width
    return table


def binary_table(body: bytes, layout: np.dtype[Any], n_rows: int) -> NDArray[Any]:
    """View the first rows of packed records; what follows them is ignored."""
    needed = n_rows * layout.itemsize
    if len(body) < needed:
        raise CaptureError(
            "data",
            got=f"{len(body)} bytes",
            expected=f"{needed} bytes for {n_rows} points",
            mend="The file is cut short, or its header is wrong.",
        )
    return np.frombuffer(body, dtype=layout, count=n_rows)


def positions(table: NDArray[Any]) -> FloatArray:
    """Columns x, y, z of a table, shape (n, 3)."""
    names = table.dtype.names or ()
    missing = [axis for axis in "xyz" if axis not in names]
    if missing:
        raise CaptureError(
            "columns", got=", ".join(names) or "none", expected="x, y and z"
        )
    points = np.empty((len(table), 3))
    for index, axis in enumerate("xyz"):
        if table[axis].ndim != 1 or table[axis].dtype.kind != "f":
            raise CaptureError(
                f"column {axis}",
                got=str(table.dtype[axis]),
                expected="one floating-point number [m]",
            )
        with np.errstate(invalid="ignore"):  # signalling NaN are missing points too
            points[:, index] = table[axis]
    return points
