"""Reading settings field by field, with errors that name file, field and range."""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._words import shortened
from debrisgrasp.errors import ConfigError, UnknownNameError

__all__ = ["MAX_LENGTH", "Fields", "is_number", "is_number_as_text", "require_distinct"]

MAX_LENGTH = 1.0
"""Longest length in a file of hands and prototypes [m]; above it, it is millimetres."""

_METRES = "Lengths are in metres: 50 mm is 0.05."
_AS_TEXT = (
    "That is text in YAML, where a number has no quotes and, before an exponent, a "
    "point, and in it a sign: 1.0e+9."
)
_AS_NAME = "YAML takes on, off, yes, no and numbers for values: put text in quotes."
_UNIT = "Write the number without its unit; lengths are in metres: 50 mm is 0.05."
_COMMA = "Decimals come after a point: 0.5, not 0,5."

_WITH_UNIT = re.compile(r"[-+]?\d*[.,]?\d+ ?(mm|cm|dm|m|in|inch|deg|rad|°|kg|g|N)")
_MISSPELT = 0.75
"""Names as alike as this are one misspelt; rail_length and rail_height are less so."""


def require_distinct(what: str, names: Iterable[str]) -> None:
    """Raise `ConfigError` if one of the names that ``what`` tells of comes again."""
    for name, n in Counter(names).items():
        if n > 1:
            raise ConfigError(what, got=f"{name!r} {n} times", expected="each once")


class Fields:
    """The fields of one section of a file.

    Every reader takes the field's name and returns its checked value; a field without
    default is required. `finish` refuses the fields that nobody has asked for.
    """

    def __init__(self, content: object, file: str, section: str = "") -> None:
        self.file, self.section = file, section
        if not isinstance(content, Mapping):
            raise ConfigError(
                self.where(),
                got=_shown(content),
                expected="a mapping of field names to values",
            )
        self._content = content
        self._known: set[str] = set()

    def where(self, name: str | None = None) -> str:
        """Return file and dotted field, as messages call them."""
        field = ".".join(part for part in (self.section, name) if part)
        return f"{self.file}, field {field}" if field else self.file

    def __contains__(self, name: str) -> bool:
        self._known.add(name)
        return name in self._content

    def raw(self, name: str) -> Any:
        """Value of a required field, unchecked."""
        self._known.add(name)
        if name not in self._content:
            raise ConfigError(
                self.where(name),
                got="nothing: it is missing",
                expected="a value",
                mend=self._meant(name),
            )
        return self._content[name]

    def text(self, name: str, default: str | None = None) -> str:
        """Read text that is not empty."""
        if default is not None and name not in self:
            return default
        value = self.raw(name)
        if not isinstance(value, str) or not value.strip():
            mend = _AS_NAME if isinstance(value, int | float) else ""
            raise ConfigError(
                self.where(name), got=_shown(value), expected="text", mend=mend
            )
        return value.strip()

    def choice(
        self, name: str, known: Iterable[str], default: str | None = None
    ) -> str:
        """One of the known words."""
        value, known = self.text(name, default), tuple(known)
        if value not in known:
            raise UnknownNameError(f"value in {self.where(name)}", value, known)
        return value

    def number(
        self,
        name: str,
        low: float,
        high: float,
        *,
        default: float | None = None,
        mend: str = "",
    ) -> float:
        """Read a finite number within [low, high]; ``mend`` says what it is one of."""
        if default is not None and name not in self:
            return default
        wanted = f" ({low:g} to {high:g})" if np.isfinite(high) else ""
        value = _number(self.raw(name), self.where(name), wanted, mend)
        if not low <= value <= high:
            raise ConfigError(
                self.where(name),
                got=value,
                expected=f"a number in {low:g} to {high:g}",
                mend=mend or (_METRES if high <= MAX_LENGTH < value else ""),
            )
        return value

    def count(self, name: str) -> int:
        """Read an integer of 0 or more."""
        value = self.raw(name)
        if not isinstance(value, int) or isinstance(value, bool) or value < 0:
            raise ConfigError(
                self.where(name), got=_shown(value), expected="an integer of 0 or more"
            )
        return value

    def length(self, name: str, low: float, high: float = MAX_LENGTH) -> float:
        """Read a length [m] within [low, high]."""
        return self.number(name, low, high)

    def numbers(
        self,
        name: str,
        count: int | None = None,
        default: Iterable[float] | None = None,
    ) -> FloatArray:
        """Read a list of finite numbers, shape (count,)."""
        if default is not None and name not in self:
            return np.array(list(default), dtype=np.float64)
        value = self.raw(name)
        if isinstance(value, np.ndarray | tuple):
            value = list(value)
        if not isinstance(value, list) or (count is not None and len(value) != count):
            wanted = "a list" if count is None else f"a list of {count}"
            raise ConfigError(
                self.where(name), got=_shown(value), expected=f"{wanted} numbers"
            )
        return np.array([_number(item, self.where(name)) for item in value])

    def position(self, name: str = "position") -> FloatArray:
        """Position [m], shape (3,); the origin if it isn't given."""
        position = self.numbers(name, 3, (0.0, 0.0, 0.0))
        if np.abs(position).max() > MAX_LENGTH:
            raise ConfigError(
                self.where(name),
                got=position.tolist(),
                expected=f"coordinates within {MAX_LENGTH:g} m of the origin",
                mend=_METRES,
            )
        return position

    def child(self, name: str) -> Fields:
        """Read a required section."""
        return Fields(self.raw(name), self.file, self._inside(name))

    def children(self, name: str) -> Iterator[Fields]:
        """Read the sections of a list, empty if it isn't given."""
        value = self.raw(name) if name in self else []
        if not isinstance(value, list):
            raise ConfigError(self.where(name), got=_shown(value), expected="a list")
        for index, item in enumerate(value):
            yield Fields(item, self.file, f"{self._inside(name)}[{index}]")

    def names(self) -> tuple[str, ...]:
        """Return the names of the fields, for sections whose fields are free."""
        for name in self._content:
            if not isinstance(name, str) or not name.strip():
                raise ConfigError(
                    self.where(), got=_shown(name), expected="a name", mend=_AS_NAME
                )
        return tuple(self._content)

    def finish(self) -> None:
        """Refuse fields that nobody has asked for: they are typing errors."""
        for name in self._content:
            if name not in self._known:
                # YAML takes {a: 0,5} for the fields a and 5.
                mend = _COMMA if isinstance(name, int) else ""
                raise UnknownNameError(
                    f"field in {self.where()}", name, sorted(self._known), mend=mend
                )

    def _meant(self, name: str) -> str:
        """Say which fields there are, and which may be the missing one, misspelt."""
        present = f"Present are: {', '.join(map(str, self._content)) or 'none'}."
        unknown = [str(n) for n in self._content if n not in self._known]
        near = get_close_matches(name, unknown, n=1, cutoff=_MISSPELT)
        if near:
            return f"Did you mean {name!r} where it says {near[0]!r}? {present}"
        return present

    def _inside(self, name: str) -> str:
        return f"{self.section}.{name}" if self.section else name


def is_number(value: object) -> bool:
    """Whether a value is a number that a float can be, and finite."""
    if isinstance(value, np.number):
        value = value.item()
    # No float is as large as an integer can be.
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and abs(value) <= sys.float_info.max
    )


def _number(value: Any, where: str, wanted: str = "", mend: str = "") -> float:
    if not is_number(value):
        raise ConfigError(
            where,
            got=_shown(value),
            expected=f"a finite number{wanted}",
            mend=_mend_of_text(value) or mend,
        )
    return float(value)


def _mend_of_text(value: object) -> str:
    """Say how a text is written as the number that it may be meant for."""
    if is_number_as_text(value):
        return _AS_TEXT
    if isinstance(value, str) and is_number_as_text(value.replace(",", ".", 1)):
        return _COMMA
    if isinstance(value, str) and _WITH_UNIT.fullmatch(value.strip()):
        return _UNIT
    return ""


def is_number_as_text(value: object) -> bool:
    """Whether a value is text that reads as a finite number."""
    try:
        return isinstance(value, str) and bool(np.isfinite(float(value)))
    except ValueError:
        return False


def _shown(value: object) -> str:
    text = "nothing" if value is None else repr(value)
    return shortened(text)
