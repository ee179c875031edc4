"""Reading settings, finding shipped data and writing results whole or not at all."""

from __future__ import annotations

import json
import os
import secrets
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import yaml

from debrisgrasp._words import shortened
from debrisgrasp.errors import ConfigError, InputError, OutputError

__all__ = [
    "PULL",
    "UNREADABLE_ARRAY",
    "data_path",
    "is_pointer",
    "is_yaml",
    "json_found",
    "last_changed",
    "naming_fields",
    "read_json",
    "read_schema",
    "read_text",
    "read_yaml",
    "refuse_constant",
    "require_folder",
    "require_writable",
    "schema_found",
    "why_unreadable",
    "write_atomic",
]

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
}
"""What people understand, by what NumPy's message has in it."""

_POINTER = b"version https://git-lfs.github.com/spec/"
PULL = "Run `git lfs pull` where it was cloned."
"""How the large file itself is had."""

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
    "block end": (
        "a line that stands at another place than those before it",
        "Indent all entries of one level alike.",
    ),
    "expected key": (
        "a line that stands at another place than those before it",
        "Indent all entries of one level alike.",
    ),
    "another document": ("a second document", "Keep one, without a line `---`."),
    "end of stream": ("its end within quotes", "Close them, here or before."),
    "cannot start any token": (
        "text that begins with a character of its own meaning",
        "Quote it, or indent by spaces if it is a tab.",
    ),
}
"""What people understand, and what they may do, by what the parser's message has."""

_KEPT = (
    "What was there is left as it was; give another place or make this one writable."
)
"""What to do where other results may have been written before."""

PathLike = str | os.PathLike[str]


def why_unreadable(error: BaseException) -> str:
    """Say in a user's words why NumPy could not read a file."""
    said = getattr(error, "strerror", None) or str(error) or type(error).__name__
    known = (words for part, words in _IN_WORDS.items() if part in said)
    return next(known, said.rstrip("."))


def is_pointer(path: PathLike) -> bool:
    """Whether a file is only what Git LFS left in the place of a large one."""
    path = Path(path)
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(_POINTER)) == _POINTER


def is_yaml(name_or_path: PathLike) -> bool:
    """Whether this is the path of a YAML file, and not the name of what ships."""
    return Path(name_or_path).suffix.lower() in (".yaml", ".yml")


def data_path(*parts: str) -> Path:
    """Path of shipped data, for instance ``data_path("robots", "roman.yaml")``.

    The data lie inside an installed package, and beside the package in a checkout.
    """
    package = Path(str(files("debrisgrasp")))
    installed = package / "data"
    root = installed if installed.is_dir() else package.parent / "data"
    return root.joinpath(*parts)


def last_changed(path: Path) -> tuple[tuple[str, int, int], ...]:
    """Name, time of the last change and size of a file, or of all in a folder.

    What was read of it is as it was, as long as these are.
    """
    found = sorted(path.iterdir()) if path.is_dir() else [path]
    stats = ((file, file.stat()) for file in found)
    return tuple((str(file), stat.st_mtime_ns, stat.st_size) for file, stat in stats)


def read_yaml(path: PathLike) -> Any:
    """Content of a YAML file, with safe types only.

    Raises
    ------
    ConfigError
        Naming the file, and the line if it can be read but not parsed.
    """
    text = read_text(path)
    try:
        return yaml.load(text, Loader=_loader(text))  # a safe loader
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {mark.line + 1}" if mark else ""
        said = str(getattr(error, "problem", None) or error)
        known = (words for part, words in _IN_YAML.items() if part in said)
        got, mend = next(known, (said, ""))
        raise ConfigError(
            f"{path}{line}", got=got, expected="well-formed YAML", mend=mend
        ) from error
    except RecursionError as error:
        raise ConfigError(
            str(path),
            got="too many brackets in one another",
            expected="well-formed YAML",
        ) from error


def read_json(path: PathLike) -> Any:
    """Content of a JSON file; NaN and infinity are refused, as the format demands.

    Raises
    ------
    ConfigError
        Naming the file, and the line if it can be read but not parsed.
    """
    text = read_text(path)
    try:
        return json.loads(text, parse_constant=refuse_constant)
    except json.JSONDecodeError as error:
        raise ConfigError(
            f"{path}, line {error.lineno}",
            got=json_found(text, error),
            expected="well-formed JSON",
            mend="" if text[error.pos :].strip() else _CUT_SHORT,
        ) from error
    except (ValueError, RecursionError) as error:
        raise ConfigError(
            str(path), got=str(error), expected="well-formed JSON"
        ) from error


def json_found(text: str, error: ValueError | RecursionError) -> str:
    """Say what stands where a text is no JSON any more."""
    if not isinstance(error, json.JSONDecodeError):
        return str(error)
    if not text.strip():
        return "nothing"
    rest = text[error.pos :].split("\n")[0].strip()
    if not rest:
        return "the end of it"
    return f"{shortened(rest)!r} in column {error.colno}"


def schema_found(content: object) -> str:
    """Say of what schema the content of a file is."""
    if content is None:
        return "nothing"
    if not isinstance(content, Mapping):
        return shortened(repr(content))
    return shortened(f"schema {content['schema']}") if "schema" in content else "none"


def read_schema(path: PathLike, schema: str) -> dict[str, Any]:
    """Content of a JSON file of one schema, or `ConfigError` naming the file."""
    content = read_json(path)
    if not isinstance(content, dict) or content.get("schema") != schema:
        raise ConfigError(
            f"schema of {Path(path)}", got=schema_found(content), expected=schema
        )
    return content


@contextmanager
def naming_fields(path: PathLike, schema: str) -> Iterator[None]:
    """Turn what goes wrong with the content of a file into `ConfigError` naming it."""
    try:
        yield
    except KeyError as error:
        raise ConfigError(
            f"{path}", got=f"no field {error}", expected=f"the fields of {schema}"
        ) from error
    except InputError as error:
        raise ConfigError.about(f"{path}: {error.what}", error) from error
    except (AttributeError, TypeError, ValueError, OverflowError) as error:
        raise ConfigError(
            f"{path}", got=str(error), expected=f"values as in {schema}"
        ) from error


def write_atomic(path: PathLike, data: bytes | str) -> None:
    """Write a file so that readers see the old content or the new, never a part.

    Raises
    ------
    OutputError
        If it can't be written; what was there before is untouched.
    """
    target = Path(os.path.realpath(path))
    content = data.encode() if isinstance(data, str) else data
    _require_replaceable(target)
    # In the same folder, because a rename is atomic only within one file system.
    temporary = target.with_name(f".{target.name[:100]}.{secrets.token_hex(4)}.tmp")
    try:
        with temporary.open("xb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(target)
    except OSError as error:
        with suppress(OSError):
            temporary.unlink()
        raise OutputError(path, error.strerror or str(error), mend=_KEPT) from error


def require_writable(path: PathLike) -> None:
    """Raise `OutputError` unless a file can be written there; leaves no trace."""
    target = Path(os.path.realpath(path))
    _require_replaceable(target)
    if not target.parent.is_dir():
        raise OutputError(path, f"there is no folder {Path(path).parent}")
    require_folder(target.parent, path)


def require_folder(folder: PathLike, path: PathLike | None = None) -> None:
    """Raise `OutputError` unless files can be put there; makes no folder.

    Parameters
    ----------
    folder
        One that is there, or that would be made.
    path
        What the error names; the folder by default.
    """
    there = Path(os.path.realpath(folder))
    while not there.exists():
        there = there.parent
    try:
        TemporaryFile(dir=there).close()
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(path or folder, reason) from error


def read_text(path: PathLike) -> str:
    """Content of a text file, or `ConfigError` saying why not."""
    try:
        if Path(path).is_char_device():  # some have no end
            raise ConfigError(str(path), got="a device", expected="a text file")
        return Path(path).read_text(encoding="utf-8")
    except OSError as error:
        reason = error.strerror or str(error)
        raise ConfigError(str(path), got=reason, expected="a readable file") from error
    except UnicodeDecodeError as error:
        got = f"a byte that is no UTF-8 at offset {error.start}"
        if zipfile.is_zipfile(path):
            got = "arrays (.npz), such as a capture"
        raise ConfigError(str(path), got=got, expected="a text file") from error


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
        except (AttributeError, TypeError, ValueError) as error:
            kind = node.tag.rpartition(":")[2]
            raise yaml.constructor.ConstructorError(
                problem=f"{shortened(str(node.value))!r}, which is no {kind}; "
                "quote it if it is text",
                problem_mark=node.start_mark,
            ) from error

    def construct_mapping(
        self,
        node: yaml.MappingNode,
        deep: bool = False,  # noqa: FBT001, FBT002
    ) -> dict[Any, Any]:
        """Content of a mapping; its keys are names, and differ."""
        if not isinstance(node, yaml.MappingNode):
            raise yaml.constructor.ConstructorError(
                problem="a list where fields were promised",
                problem_mark=node.start_mark,
            )
        given: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise yaml.constructor.ConstructorError(
                    problem="a list or fields where the name of a field must be",
                    problem_mark=key.start_mark,
                )
            if key.tag == "tag:yaml.org,2002:merge":
                continue
            if key.value in given:
                raise yaml.constructor.ConstructorError(
                    problem=f"field {key.value!r} a second time",
                    problem_mark=key.start_mark,
                )
            if isinstance(key.value, str):
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


_CUT_SHORT = "It was cut short: restore it, or do without it and begin anew."
_SHALLOW = 1000


def refuse_constant(name: str) -> None:
    """Refuse what JSON does not have: NaN and infinity."""
    raise ValueError(f"{name}, which JSON does not have")


def _require_replaceable(target: Path) -> None:
    if target.name == "-":
        reason = "a result goes to a file; --json prints to the terminal"
        raise OutputError("-", reason)
    if target.is_dir():
        raise OutputError(target, "it is a folder")
    if target.exists():
        # A rename would silently replace a device or a write-protected file.
        if not target.is_file():
            raise OutputError(target, "it is not a regular file")
        if not os.access(target, os.W_OK):
            raise OutputError(target, "it is write-protected")
