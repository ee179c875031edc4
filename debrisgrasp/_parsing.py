"""Content of YAML and JSON, or one complaint that has its place in the text."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from typing import Any

import yaml

from debrisgrasp._words import shortened
from debrisgrasp.errors import ConfigError

__all__ = ["json_content", "json_found", "parse_json", "parse_yaml"]

_MISPLACED = "a line that stands at another place than those before it"
_ALIKE = "Indent all entries of one level alike."
_ODD_KEY = "a list or fields where the name of a field must be"
_OTHER_KIND = "a value of another kind than its tag (!!) says"
_NO_TAG = "Leave the tag out."

_IN_YAML = {
    "tab character": ("a tab", "Indent by spaces."),
    "mapping values": (
        "a second colon, or a line that stands too far to the right",
        "Indent all fields of one level alike, and quote text that holds a colon.",
    ),
    "expected ',' or": (
        "a bracket that is not closed",
        "Close it, there or on a line before.",
    ),
    "expected ':'": ("a field without a colon", "Write `field: value`."),
    "block end": (_MISPLACED, _ALIKE),
    "expected key": (_MISPLACED, _ALIKE),
    "expected '-'": (
        "a line that belongs to no entry of the list before it",
        "Begin it by `- `, or indent it like the entry that it belongs to.",
    ),
    "another document": ("a second document", "Keep one, without a line `---`."),
    "end of stream": ("its end within quotes", "Close them, here or before."),
    "cannot start any token": (
        "text that begins with a character of its own meaning",
        "Quote it, or indent by spaces if it is a tab.",
    ),
    "undefined alias": (
        "a * before a name that no & has given",
        "Quote it if it is text.",
    ),
    "second occurrence": ("a name after & a second time", "Give it another name."),
    "hexdecimal": (
        "a backslash within double quotes that begins no character",
        "Use single quotes.",
    ),
    "escape": (
        "a backslash within double quotes that begins no character",
        "Use single quotes.",
    ),
    "unhashable": (_ODD_KEY, "Give it a name."),
    "2002:value'": ("a lone =", "Quote it."),
    "constructor for the tag": ("a tag (!) that means nothing here", _NO_TAG),
    "base64": ("letters that are no base64", _NO_TAG),
    "for merging": (
        "<< before something that has no fields",
        "Write a * and the name that such fields have after an &.",
    ),
    "but found": (_OTHER_KIND, _NO_TAG),
}
"""What people understand, and what they may do, by what the parser's message has."""

_KINDS = {
    "bool": "neither true nor false",
    "float": "no number",
    "int": "no whole number that can be read",
    "timestamp": "no date or time",
}
"""What a value is not, by the tag that it has or looks like."""

_NESTED = "too many brackets in one another"
_DEEPEST = 100
"""More levels in one another no file has; comparing such ones overflows a stack."""
_MOST = 1_000_000
"""More values no file has by names (&, *): to write them in a message takes forever."""
_CUT_SHORT = "It was cut short: restore it, or do without it and begin anew."
_SHALLOW = 1000
_DIGITS = sys.float_info.max_10_exp
"""Whole numbers of more fit into no other kind of number."""


def parse_yaml(text: str, name: str) -> Any:
    """Content of YAML, with safe types only.

    Raises
    ------
    ConfigError
        Naming the file, and the line where it can be told.
    """
    try:
        content = yaml.load(text, Loader=_loader(text))  # a safe loader
        _require_shallow(content)
        if "*" in text and _size(content, {}) > max(_MOST, len(text)):
            raise ConfigError(
                name,
                got="names (&, *) that stand for more and more of each other",
                expected=f"at most {_MOST} values in all",
            )
    except yaml.reader.ReaderError as error:
        sign = chr(error.character)
        raise ConfigError(
            f"{name}, line {text[: text.find(sign)].count(chr(10)) + 1}",
            got=f"a character that can't be seen ({sign!r})",
            expected="well-formed YAML",
            mend="Delete it.",
        ) from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {mark.line + 1}" if mark else ""
        said = str(getattr(error, "problem", None) or error)
        known = (words for part, words in _IN_YAML.items() if part in said)
        own = (said, getattr(error, "mend", ""))
        got, mend = own if isinstance(error, _OddError) else next(known, own)
        raise ConfigError(
            f"{name}{line}", got=got, expected="well-formed YAML", mend=mend
        ) from error
    except RecursionError as error:
        raise ConfigError(name, got=_NESTED, expected="well-formed YAML") from error
    return content


def parse_json(text: str, name: str) -> Any:
    """Content of JSON; NaN and infinity are refused, as the format demands.

    Raises
    ------
    ConfigError
        Naming the file, and the line where it can be told.
    """
    try:
        return json_content(text)
    except ValueError as error:
        line = mend = ""
        if isinstance(error, json.JSONDecodeError):
            line = f", line {error.lineno}"
            mend = "" if text[error.pos :].strip() else _CUT_SHORT
        raise ConfigError(
            f"{name}{line}",
            got=json_found(text, error),
            expected="well-formed JSON",
            mend=mend,
        ) from error


def json_content(text: str) -> Any:
    """Content of JSON; the errors are for `json_found` to tell.

    Raises
    ------
    ValueError
        A `json.JSONDecodeError` if it is cut short or malformed.
    """
    try:
        content = json.loads(text, parse_constant=_refuse_constant, parse_int=_whole)
        _require_shallow(content)
    except RecursionError as error:
        raise ValueError(_NESTED) from error
    return content


def json_found(text: str, error: ValueError) -> str:
    """Say what stands where a text is no JSON any more."""
    if not isinstance(error, json.JSONDecodeError):
        return str(error)
    if not text.strip():
        return "nothing"
    rest = text[error.pos :].split("\n")[0].strip()
    if not rest:
        return "the end of it"
    return f"{shortened(rest)!r} in column {error.colno}"


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name}, which JSON does not have")


def _whole(digits: str) -> int:
    """Whole number, if it is one that can be compared with any other number."""
    if len(digits) > _DIGITS:
        raise ValueError("a number of too many digits")
    return int(digits)


def _require_shallow(content: object) -> None:
    """Raise `RecursionError`, as parsers do, if all lies too deep in one another.

    It goes level by level, for a call in a call would overflow as what it is to find.
    What a name of YAML's stands for is looked at once, however often it is named.
    """
    level, seen = [content], set[int]()
    for _ in range(_DEEPEST):
        inside: list[object] = []
        for item in level:
            if isinstance(item, (Mapping, list)) and id(item) not in seen:
                seen.add(id(item))
                inside += item.values() if isinstance(item, Mapping) else item
        level = inside
        if not level:
            return
    raise RecursionError


def _size(item: object, known: dict[int, int]) -> int:
    """Count values with what names of YAML's stand for, as often as they are named."""
    if not isinstance(item, (Mapping, list)):
        return 1
    if id(item) not in known:
        known[id(item)] = 1  # in itself it is shown as dots
        inside = item.values() if isinstance(item, Mapping) else item
        known[id(item)] = 1 + sum(_size(each, known) for each in inside)
    return known[id(item)]


class _OddError(yaml.constructor.ConstructorError):
    """Something that the parser takes, or trips over."""

    def __init__(self, problem: str, node: yaml.Node, mend: str) -> None:
        super().__init__(problem=problem, problem_mark=node.start_mark)
        self.mend = mend


class _Once(yaml.constructor.SafeConstructor):
    """Refuses a field that is given twice: only one of them would count."""

    def construct_object(
        self,
        node: yaml.Node,
        deep: bool = False,  # noqa: FBT001, FBT002
    ) -> Any:
        """Content of a node, or a complaint that has its place."""
        try:
            return super().construct_object(node, deep=deep)
        except (AttributeError, LookupError, TypeError, ValueError) as error:
            if not isinstance(node, yaml.ScalarNode):
                raise _OddError(_OTHER_KIND, node, _NO_TAG) from error
            kind = node.tag.rpartition(":")[2]
            is_not = _KINDS.get(kind, f"no {kind}")
            shown = shortened(str(node.value))
            raise _OddError(
                f"{shown!r}, which is {is_not}", node, "Quote it if it is text."
            ) from error

    def construct_mapping(
        self,
        node: yaml.MappingNode,
        deep: bool = False,  # noqa: FBT001, FBT002
    ) -> dict[Any, Any]:
        """Content of a mapping; its keys are names, and differ."""
        if not isinstance(node, yaml.MappingNode):
            raise _OddError(_OTHER_KIND, node, _NO_TAG)
        given: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise _OddError(_ODD_KEY, key, "Give it a name.")
            if key.tag == "tag:yaml.org,2002:merge":
                continue
            if key.value in given:
                raise _OddError(
                    f"field {key.value!r} a second time", key, "Keep one of them."
                )
            given.add(key.value)
        content: dict[Any, Any] = super().construct_mapping(node, deep=deep)
        return content


class _Loader(_Once, yaml.SafeLoader):
    """Safe, for any text."""


class _FastLoader(_Once, getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]  # PyYAML may come without libyaml
    """The same in a tenth of the time, but deep nesting would overflow its stack."""


def _loader(text: str) -> type[_Loader | _FastLoader]:
    """Choose by how deep a text can be nested."""
    depth = sum(text.count(sign) for sign in "[{-:?")
    return _FastLoader if depth < _SHALLOW else _Loader
