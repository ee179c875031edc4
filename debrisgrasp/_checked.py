"""Arguments of the public functions, checked against their annotations."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, wraps
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from debrisgrasp.errors import InputError

__all__ = ["checked", "checked_fields"]

P = ParamSpec("P")
T = TypeVar("T")

_WORDS = {
    NoneType: "None",
    Callable: "a function",
    Integral: "an integer",
    Mapping: "a dictionary",
    Real: "a number",
    Sequence: "a sequence",
    bool: "True or False",
    os.PathLike: "a path",
    str: "a text",
}
_MENDS = {
    "Bounds": "Bounds(lower, upper) makes one.",
    "Capture": "Capture.load(path) reads one.",
    "PlanningResult": "debrisgrasp.plan(capture) makes one.",
    "Segmentation": "debrisgrasp.segment(capture) makes one.",
    "SelectionPolicy": "PriorityPoint(), for instance, of debrisgrasp.segmentation.",
    "Settings": "Settings.load(path) reads one.",
}
_LONGEST = 40


def checked(function: Callable[P, T]) -> Callable[P, T]:
    """Make a function refuse arguments that are not what their annotations say.

    Classes, protocols with methods, unions, functions, numbers, texts and paths are
    told apart; arrays, and what a mapping holds, are not looked at.

    Raises
    ------
    InputError
        When it is called with another type; names the argument, and what makes a right
        one.
    """
    signature = inspect.signature(function)

    @wraps(function)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            given = signature.bind(*args, **kwargs).arguments
        except TypeError:
            return function(*args, **kwargs)  # which says what is missing
        kinds = _kinds(function)
        for name, value in given.items():
            allowed = kinds.get(name, ())
            if allowed and not any(_is_a(value, kind) for kind in allowed):
                raise _complaint(name, value, allowed)
        return function(*args, **kwargs)

    return guarded


def checked_fields(record: type[T]) -> type[T]:
    """Make a dataclass refuse fields that are not what their annotations say."""
    setattr(record, "__init__", checked(record.__init__))  # noqa: B010 - for mypy
    return record


@cache
def _kinds(function: Callable[..., Any]) -> dict[str, tuple[Any, ...]]:
    """Find what each argument may be; nothing where it may be anything."""
    hints = get_type_hints(function)
    kinds = {name: tuple(_alternatives(hint)) for name, hint in hints.items()}
    return {name: () if None in allowed else allowed for name, allowed in kinds.items()}


def _alternatives(hint: Any) -> Iterator[Any]:
    """Classes of an annotation; None for what isn't checked."""
    origin = get_origin(hint)
    if origin in (Union, UnionType):
        for part in get_args(hint):
            yield from _alternatives(part)
        return
    kind = {int: Integral, float: Real}.get(hint, origin or hint)
    # What can become an array is for whoever takes it to say.
    yield kind if isinstance(kind, type) and kind is not np.ndarray else None


def _is_a(value: Any, kind: Any) -> bool:
    if getattr(kind, "_is_protocol", False) and kind is not os.PathLike:
        names = [n for n in vars(kind) if not n.startswith("_")]
        return not isinstance(value, type) and all(hasattr(value, n) for n in names)
    if isinstance(value, bool) and kind in (Integral, Real):
        return False
    return isinstance(value, kind)


def _complaint(name: str, value: object, allowed: tuple[Any, ...]) -> InputError:
    got = type(value).__name__
    if isinstance(value, str | Real) and len(repr(value)) <= _LONGEST:
        got = f"{value!r} ({got})"
    names = [k for k in allowed if not (k is str and os.PathLike in allowed)]
    words = [_WORDS.get(kind) or _with_article(kind.__name__) for kind in names]
    return InputError(
        name,
        got="None" if value is None else got,
        expected=" or ".join(dict.fromkeys(words)),
        mend=next((m for k in names if (m := _MENDS.get(k.__name__))), ""),
    )


def _with_article(name: str) -> str:
    return f"{'an' if name[0] in 'AEIOU' else 'a'} {name}"
