"""Arguments of the public functions, checked against their annotations."""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, wraps
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from debrisgrasp.errors import ConfigError, InputError

__all__ = ["checked", "checked_fields"]

P = ParamSpec("P")
T = TypeVar("T")

_WORDS = {
    NoneType: "None",
    Callable: "a function",
    Integral: "an integer",
    Mapping: "a dictionary",
    Real: "a finite number",
    Sequence: "a sequence",
    bool: "True or False",
    os.PathLike: "a path",
    str: "a text",
}
_MENDS = {
    "Bounds": "Bounds(lower, upper) makes one.",
    "Capture": "Capture.load(path) reads one.",
    "Compliance": "Compliance.diagonal(translation, rotation), for instance.",
    "Generator": "numpy.random.default_rng(seed) makes one.",
    "GripperModel": "GripperModel.load(name or path) reads one.",
    "Intrinsics": "Intrinsics.from_matrix(K, depth.shape) makes one.",
    "KinematicChain": "RobotModel.load(name or path).chain(arm) makes one.",
    "LimitSet": "One of a LimitFamily: its .planner to plan, its .controller to move.",
    "Observations": "debrisgrasp.calibrate(path) reads a file of them.",
    "PlanningResult": "debrisgrasp.plan(capture) makes one.",
    "PointCloud": "Capture.cloud() makes one.",
    "Report": "Report.of(result, title) makes one.",
    "Robot": "fake_robot(model, world, rng=rng).robot, for instance.",
    "RobotModel": "RobotModel.load(name or path) reads one.",
    "SE3": "SE3.from_matrix(matrix) makes one.",
    "Segmentation": "debrisgrasp.segment(capture) makes one.",
    "SelectionPolicy": "SupportAware(), for instance, of debrisgrasp.segmentation.",
    "Settings": "Settings.load(path) reads one.",
    "UnknownSpace": "UnknownSpace.HIDDEN, for instance, of debrisgrasp.motion.",
    "Workers": "OwnWorkers(lambda: ThreadPoolExecutor(4)), for instance.",
    "SuccessModel": "SuccessModel.load(path) reads one.",
    "World": "let_down(named_scene(name)).world, for instance.",
}
_LARGEST = sys.float_info.max
_LONGEST = 40
_AN = (*"AEIOU", "SE3")
"""How names begin that are spoken with a vowel."""


def checked(function: Callable[P, T]) -> Callable[P, T]:
    """Make a function refuse arguments that are not what their annotations say.

    Classes, protocols with methods, unions, functions, numbers, texts and paths are
    told apart, in tuples and sequences too; a list or an array may stand for a tuple,
    NumPy's True for True, and no number is NaN. Where an array is wanted, and what a
    mapping holds, is not looked at.

    Raises
    ------
    InputError
        When it is called with another type; names the argument, and what makes a right
        one.
    """
    return _guarded(function, InputError)


def checked_fields(record: type[T]) -> type[T]:
    """Make a dataclass refuse fields that are not what their annotations say.

    Raises
    ------
    InputError
        See `checked`; a `ConfigError` if the name of the class ends in ``Config``.
    """
    is_config = record.__name__.endswith("Config")
    init = _guarded(record.__init__, ConfigError if is_config else InputError)
    setattr(record, "__init__", init)  # noqa: B010 - for mypy
    return record


def _guarded(function: Callable[P, T], kind: type[InputError]) -> Callable[P, T]:
    """Make a function refuse wrong arguments with this kind of error."""
    signature = inspect.signature(function)

    @wraps(function)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> T:
        given = None
        with suppress(TypeError):
            given = signature.bind(*args, **kwargs)
        if given is None:
            return function(*args, **kwargs)  # which says what is missing
        kinds = _kinds(function)
        for name, value in given.arguments.items():
            allowed = kinds.get(name, ())
            if tuple in map(_holder, allowed):
                given.arguments[name] = value = _tupled(value, allowed)
            elif bool in allowed and isinstance(value, np.bool_):
                given.arguments[name] = value = bool(value)
            if fault := _fault(name, value, allowed):
                is_kind = isinstance(fault, kind)
                raise fault if is_kind else ConfigError.about(fault.what, fault)
        return function(*given.args, **given.kwargs)

    return guarded


@dataclass(frozen=True, slots=True)
class _Items:
    """A tuple or a sequence, and what each of its items may be."""

    holder: Any
    kinds: tuple[tuple[Any, ...], ...]
    is_any_number: bool

    def of(self, n: int) -> tuple[tuple[Any, ...], ...]:
        """Tell what each of n items may be; anything, where there are too many."""
        kinds = self.kinds * n if self.is_any_number else self.kinds
        return (*kinds, *((),) * n)[:n]

    def fault(self, name: str, value: Any) -> InputError | None:
        """Complain about the first item that is not right, or about their number."""
        n = len(value)
        if not self.is_any_number and n != len(self.kinds):
            return InputError(name, got=f"{n} values", expected=str(len(self.kinds)))
        faults = (
            _fault(f"{name}[{i}]", item, kind)
            for i, (item, kind) in enumerate(zip(value, self.of(n), strict=True))
        )
        return next(filter(None, faults), None)


def _tupled(value: Any, allowed: tuple[Any, ...]) -> Any:
    """Return lists as tuples, those in them too, and arrays where one is wanted."""
    wanted = next((kind for kind in allowed if _holder(kind) is tuple), None)
    if wanted is not None and hasattr(value, "__array__") and np.ndim(value):
        value = np.asarray(value).tolist()
    if not (isinstance(value, list) or type(value) is tuple):
        return value
    n = len(value)
    kinds = wanted.of(n) if isinstance(wanted, _Items) else ((),) * n
    return tuple(map(_tupled, value, kinds))


@cache
def _kinds(function: Callable[..., Any]) -> dict[str, tuple[Any, ...]]:
    """Find what each argument may be; nothing where it may be anything."""
    hints = get_type_hints(function)
    kinds = {name: tuple(_alternatives(hint)) for name, hint in hints.items()}
    return {name: _known(allowed) for name, allowed in kinds.items()}


def _known(kinds: tuple[Any, ...]) -> tuple[Any, ...]:
    return () if None in kinds else kinds


def _alternatives(hint: Any) -> Iterator[Any]:
    """Classes of an annotation; None for what isn't checked."""
    origin = get_origin(hint)
    if origin in (tuple, Sequence):
        items = [item for item in get_args(hint) if item is not Ellipsis]
        kinds = tuple(_known(tuple(_alternatives(item))) for item in items)
        yield _Items(origin, kinds, origin is Sequence or Ellipsis in get_args(hint))
        return
    if origin in (Union, UnionType):
        for part in get_args(hint):
            yield from _alternatives(part)
        return
    kind = {int: Integral, float: Real}.get(hint, origin or hint)
    # What can become an array is for whoever takes it to say.
    yield kind if isinstance(kind, type) and kind is not np.ndarray else None


def _fault(name: str, value: Any, allowed: tuple[Any, ...]) -> InputError | None:
    """Complain about a value that is none of what is allowed."""
    for kind in allowed:
        if isinstance(kind, _Items):
            if isinstance(value, kind.holder) and not isinstance(value, str):
                return kind.fault(name, value)
        elif _is_a(value, kind):
            return None
    return _complaint(name, value, allowed) if allowed else None


def _is_a(value: Any, kind: Any) -> bool:
    if getattr(kind, "_is_protocol", False) and kind is not os.PathLike:
        names = [n for n in vars(kind) if not n.startswith("_")]
        return not isinstance(value, type) and all(hasattr(value, n) for n in names)
    if kind in (Integral, Real):
        is_number = isinstance(value, kind) and not isinstance(value, bool)
        return is_number and bool(value == value) and not _is_too_large(value, kind)
    return isinstance(value, kind)


def _is_too_large(value: Any, kind: Any) -> bool:
    """Tell of a whole number that no float holds, where one is wanted."""
    return kind is Real and isinstance(value, int) and abs(value) > _LARGEST


def _complaint(name: str, value: object, allowed: tuple[Any, ...]) -> InputError:
    got = type(value).__name__
    if isinstance(value, str | Real) and len(repr(value)) <= _LONGEST:
        got = f"{value!r} ({got})"
    names = [k for k in allowed if not (k is str and os.PathLike in allowed)]
    words = [_named(kind) for kind in names]
    is_nan = isinstance(value, Real) and value != value
    return (ConfigError if is_nan else InputError)(
        name,
        got="None" if value is None else got,
        expected=" or ".join(dict.fromkeys(words)),
        mend=next((m for k in names if (m := _MENDS.get(_holder(k).__name__))), ""),
    )


def _holder(kind: Any) -> Any:
    return kind.holder if isinstance(kind, _Items) else kind


def _named(kind: Any) -> str:
    holder = _holder(kind)
    name = holder.__name__
    words = _WORDS.get(holder, f"{'an' if name.startswith(_AN) else 'a'} {name}")
    if isinstance(kind, _Items) and not kind.is_any_number:
        words += f" of {len(kind.kinds)}"
    return words
