"""Array aliases and the checks that every record makes of its arrays."""

from __future__ import annotations

from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from debrisgrasp.errors import ConfigError, InputError, ShapeError

__all__ = [
    "BoolArray",
    "Float32Array",
    "FloatArray",
    "IntArray",
    "Rng",
    "as_floats",
    "as_rows",
    "bounded",
    "finite",
    "frozen",
    "is_sealed",
    "require_count",
    "require_finite",
    "require_generator",
    "require_metres",
    "require_range",
    "require_trailing",
    "rounded",
    "sealed",
    "shared",
    "snapped",
    "unmasked",
]

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.integer[Any]]
BoolArray = NDArray[np.bool_]
Rng = np.random.Generator
_MILLIMETRES = "If these are millimetres, divide by 1000."
_FARTHEST = 20.0
"""Coordinates of places near a robot beyond this [m] can only be millimetres."""


def bounded(values: NDArray[Any], low: ArrayLike, high: ArrayLike) -> NDArray[Any]:
    """Bring values within bounds: `numpy.clip`, at a tenth of its cost for a few."""
    found: NDArray[Any] = np.minimum(np.maximum(values, low), high)
    return found


def as_floats(
    array: ArrayLike, name: str, trailing: tuple[int | None, ...]
) -> FloatArray:
    """Give an array as float64, not copied if it is one, and check its trailing shape.

    What is masked becomes NaN.

    Raises
    ------
    ShapeError
        If it holds anything but numbers, or in another shape.
    """
    try:
        floats = np.asarray(unmasked(array), dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise _no_array(array, name, np.float64) from error
    require_trailing(floats, name, trailing)
    return floats


def as_rows(points: ArrayLike, name: str = "points") -> FloatArray:
    """Give points as float64, one to a row, shape (n, 3).

    Raises
    ------
    ShapeError
        If they have another shape, as those of an image.
    """
    rows = as_floats(points, name, (3,))
    if rows.ndim != 2:
        mend = f"{name}.reshape(-1, 3) makes rows." if rows.ndim > 2 else ""
        raise ShapeError(
            f"shape of {name}", got=rows.shape, expected="(n, 3)", mend=mend
        )
    return rows


def as_given(array: ArrayLike, name: str) -> NDArray[Any]:
    """Give marks, labels or indices as an array, of whatever type they are.

    Raises
    ------
    ShapeError
        If they are lists of unequal lengths.
    InputError
        If one is masked: no NaN could stand for it.
    """
    if np.ma.is_masked(array):
        raise InputError(
            name,
            got="a masked array",
            expected="one without a mask",
            mend="Fill what is masked: array.filled(0).",
        )
    try:
        return np.asarray(array)
    except (TypeError, ValueError, OverflowError) as error:
        got = f"a {type(array).__name__} that is no array"
        raise ShapeError(name, got=got, expected="lists of equal lengths") from error


def unmasked(array: Any) -> Any:
    """Put NaN where an array is masked: NumPy takes what lies behind the mask.

    Raises
    ------
    TypeError
        If no NaN fits in, or the array is complex, of which NumPy takes a half.
    """
    if isinstance(array, np.ndarray) and array.dtype.kind == "c":
        raise TypeError
    if isinstance(array, np.ma.MaskedArray) and np.ma.is_masked(array):
        return array.filled(np.nan)
    return array


def _no_array(array: ArrayLike, name: str, dtype: Any) -> ShapeError:
    return ShapeError(
        name,
        got=type(array).__name__,
        expected=f"an array convertible to {np.dtype(dtype).name}",
    )


def require_trailing(
    array: NDArray[Any], name: str, trailing: tuple[int | None, ...]
) -> None:
    """Raise `ShapeError` unless the last axes have the sizes ``trailing``.

    ``None`` stands for any size; further leading axes are allowed.
    """
    shape = array.shape
    if shape[-len(trailing) :] == trailing:
        return
    fits = len(shape) >= len(trailing) and all(
        want is None or want == have
        for want, have in zip(
            trailing, shape[len(shape) - len(trailing) :], strict=True
        )
    )
    if not fits:
        wanted = ", ".join("any" if size is None else str(size) for size in trailing)
        raise ShapeError(
            f"shape of {name}", got=shape, expected=f"trailing axes ({wanted})"
        )


def require_finite(array: NDArray[Any], name: str) -> None:
    """Raise `InputError` if any element is NaN or infinite."""
    bad = int(array.size - np.count_nonzero(np.isfinite(array)))
    if bad:
        raise InputError(
            name,
            got=f"{bad} of {array.size} values NaN or infinite",
            expected="finite numbers",
        )


def require_count(name: str, value: object, least: int = 0) -> None:
    """Raise `InputError` unless this is a whole number, ``least`` or more."""
    if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
        raise InputError(name, got=value, expected=f"an integer, {least} or more")


def require_range(name: str, value: float, low: float, high: float = np.inf) -> None:
    """Raise `ConfigError` unless the setting is a finite number in [low, high].

    An infinite one would switch off what it is the limit of.
    """
    if not (isinstance(value, Real) and low <= value <= high and value < np.inf):
        is_open = not high < np.inf
        limit = (
            f"a finite number, {low:g} or more" if is_open else f"{low:g} to {high:g}"
        )
        is_length = name.endswith(("[m]", "[m/s]"))
        is_far = is_length and isinstance(value, Real) and value > high
        raise ConfigError(
            name, got=value, expected=limit, mend=_MILLIMETRES if is_far else ""
        )


def require_metres(name: str, coordinates: ArrayLike) -> None:
    """Raise `InputError` unless coordinates are finite.

    Raises
    ------
    ConfigError
        If they can only be millimetres.
    """
    coordinates = np.asarray(coordinates)
    require_finite(coordinates, name)
    largest = float(np.abs(coordinates).max(initial=0.0))
    if largest > _FARTHEST:
        raise ConfigError(
            name,
            got=f"a coordinate of {largest:g}",
            expected=f"metres, at most {_FARTHEST:g}",
            mend=_MILLIMETRES,
        )


def frozen(
    array: ArrayLike,
    name: str,
    trailing: tuple[int | None, ...],
    dtype: Any = np.float64,
) -> NDArray[Any]:
    """Copy to ``dtype``, check the trailing shape, and make it read-only.

    What comes out of `sealed` needs no copy.
    """
    try:
        if isinstance(array, _Sealed) and array.dtype == dtype:
            copy = array.view(np.ndarray)
        else:
            copy = np.array(unmasked(array), dtype=dtype)
    except (TypeError, ValueError, OverflowError) as error:
        raise _no_array(array, name, dtype) from error
    require_trailing(copy, name, trailing)
    copy.flags.writeable = False
    return copy


def finite(array: ArrayLike, name: str, shape: tuple[int | None, ...]) -> FloatArray:
    """Copy numbers of one shape, without further axes, and make them read-only.

    Raises
    ------
    ShapeError
        If they have another shape; ``None`` stands for any size.
    InputError
        If one of them is NaN or infinite.
    """
    copy = frozen(array, name, ())
    fits = copy.ndim == len(shape) and all(
        want in (None, have) for want, have in zip(shape, copy.shape, strict=True)
    )
    if not fits:
        wanted = str(shape).replace("None", "n")
        raise ShapeError(f"shape of {name}", got=copy.shape, expected=wanted)
    require_finite(copy, name)
    return copy


class _Sealed(np.ndarray[Any, Any]):
    """An array on its way into a record, that nobody else can write to.

    Its write flag alone would not say so: whoever owns an array, or has an earlier view
    of it, can write to it again.
    """


def sealed(array: NDArray[Any]) -> NDArray[Any]:
    """Hand over a new array, of which nobody has a view, read-only."""
    array.flags.writeable = False
    return array if array.base is not None else array.view(_Sealed)


def shared(array: NDArray[Any]) -> NDArray[Any]:
    """Hand what one record holds to another: it came out of `frozen`."""
    return array.view(_Sealed)


def is_sealed(array: object) -> bool:
    """Whether an array comes out of `sealed`, and so from a record or our own work."""
    return isinstance(array, _Sealed)


def require_generator(rng: object) -> None:
    """Refuse a seed, or all of numpy.random, where a generator is wanted."""
    if not isinstance(rng, Rng):
        raise InputError(
            "rng",
            got=type(rng).__name__,
            expected="a Generator",
            mend="numpy.random.default_rng(seed) makes one.",
        )


def rounded(values: ArrayLike, digits: int) -> Any:
    """Round to digits after the point, as (nested lists of) numbers for a file."""
    # Adding zero turns -0.0, which would be other bytes for the same number, into 0.0.
    return (np.round(np.asarray(values, dtype=np.float64), digits) + 0.0).tolist()


def snapped(values: FloatArray, tolerance: float) -> FloatArray:
    """Replace entries that miss 0, 1 or -1 by rounding only."""
    nearest = np.round(values)
    is_near = (np.abs(values - nearest) < tolerance) & (np.abs(nearest) <= 1.0)
    return np.where(is_near, nearest, values)
