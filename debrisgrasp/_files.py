"""Reading settings, finding shipped data and writing results whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from debrisgrasp._parsing import parse_json, parse_yaml
from debrisgrasp._signals import signals_wait
from debrisgrasp._unreadable import (
    PathLike,
    is_device,
    why_not_there,
    why_nothing_there,
)
from debrisgrasp._words import shortened
from debrisgrasp.errors import ConfigError, InputError, OutputError

__all__ = [
    "data_path",
    "is_yaml",
    "last_changed",
    "naming_fields",
    "read_json",
    "read_schema",
    "read_text",
    "read_yaml",
    "require_folder",
    "require_new_folder",
    "require_own",
    "require_picture",
    "require_suffix",
    "require_writable",
    "schema_found",
    "write_atomic",
    "write_together",
    "yaml_files",
]

_WRITABLE = "Nothing was changed; give another place or make this one writable."
_KEPT = (
    "What was there is left as it was; give another place or make this one writable."
)
"""What to do where other results may have been written before."""


def is_yaml(name_or_path: PathLike) -> bool:
    """Whether this is the path of a YAML file, and not the name of what ships."""
    return Path(name_or_path).suffix.lower() in (".yaml", ".yml")


def yaml_files(folder: PathLike, what: str) -> list[Path]:
    """Find the YAML files of a folder, sorted; hidden ones, as of a Mac, are left out.

    Parameters
    ----------
    folder
        Where they are.
    what
        What they are of, for the error.

    Raises
    ------
    ConfigError
        If this is no folder, or one that can't be looked into, or if what is called so
        is no file.
    """
    try:
        found = sorted(Path(folder).iterdir())
    except OSError as error:
        raise ConfigError(
            f"{folder}",
            got=why_nothing_there(folder) or error.strerror,
            expected=f"a folder of files of {what}",
        ) from error
    named = [file for file in found if is_yaml(file) and not file.name.startswith(".")]
    for file in named:
        # To read a pipe is to wait for whoever writes into it.
        if file.exists() and not file.is_file():
            raise ConfigError(
                str(file),
                got="a folder" if file.is_dir() else "a pipe or a device",
                expected=f"a file of {what}",
                mend="Move it elsewhere, or name it otherwise.",
            )
    return named


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
    return parse_yaml(read_text(path), str(path))


def read_json(path: PathLike) -> Any:
    """Content of a JSON file; NaN and infinity are refused, as the format demands.

    Raises
    ------
    ConfigError
        Naming the file, and the line if it can be read but not parsed.
    """
    return parse_json(read_text(path), str(path))


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
    write_together({path: data})


def write_together(contents: Mapping[Any, bytes | str]) -> None:
    """Write files, by their paths, as `write_atomic` does; all of them or none.

    Raises
    ------
    OutputError
        If one can't be written; what was there before is untouched.
    """
    targets = {path: _resolved(path) for path in contents}
    for target in targets.values():
        _require_replaceable(target)
    # In the same folder, because a rename is atomic only within one file system.
    temporaries = {
        path: target.with_name(f".{target.name[:100]}.{secrets.token_hex(4)}.tmp")
        for path, target in targets.items()
    }
    path: PathLike = ""
    try:
        for path, data in contents.items():
            _write_new(temporaries[path], data, like=targets[path])
        with signals_wait():
            for path, temporary in temporaries.items():
                temporary.replace(targets[path])
    except OSError as error:
        raise OutputError(path, error.strerror or str(error), mend=_KEPT) from error
    finally:
        for temporary in temporaries.values():
            with suppress(OSError):
                temporary.unlink(missing_ok=True)


def _write_new(path: Path, data: bytes | str, *, like: Path) -> None:
    """Write a new file, with the permissions of another if that is there."""
    # The names of files, which pages show, may hold bytes that are no text.
    content = data.encode(errors="replace") if isinstance(data, str) else data
    with path.open("xb") as stream:
        if like.exists():
            with suppress(OSError):  # some disks know no permissions
                shutil.copymode(like, path)
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())


def require_writable(path: PathLike) -> None:
    """Raise `OutputError` unless a file can be written there; leaves no trace."""
    target = _resolved(path)
    _require_replaceable(target)
    if why_not_there(target.parent, "folder"):
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
    there = _resolved(folder)
    try:
        while not there.exists():
            there = there.parent
        TemporaryFile(dir=there).close()
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(path or folder, reason, mend=_WRITABLE) from error


def require_new_folder(folder: PathLike) -> None:
    """Raise `OutputError` unless files can be put into a folder that has none yet."""
    require_folder(folder)
    if Path(folder).exists() and any(Path(folder).iterdir()):
        raise OutputError(folder, "it is not empty; give a new folder")


def require_suffix(path: PathLike, suffixes: Sequence[str], what: str) -> None:
    """Raise `ConfigError` unless the name of ``what`` ends in one of the suffixes."""
    if Path(path).suffix.lower() not in suffixes:
        raise ConfigError(
            f"name of {what}",
            got=str(path),
            expected="a name that ends in " + " or ".join(suffixes),
        )


def require_picture(path: PathLike, suffixes: Sequence[str], what: str) -> None:
    """Raise if a picture or page does not belong to a place.

    Raises
    ------
    ConfigError
        If its name does not end in one of the suffixes.
    OutputError
        If a depth image is there, which nothing here draws.
    """
    require_suffix(path, suffixes, what)
    if _is_depth_image(Path(path)):
        raise OutputError(path, "what is there is a depth image, and would be lost")


def require_own(path: PathLike, schema: str, what: str = "a result") -> None:
    """Raise if a result as JSON does not belong to a place.

    Parameters
    ----------
    schema
        Of such results, whatever their version; an empty file is nobody's.
    what
        To call it in the error.

    Raises
    ------
    ConfigError
        If its name does not end in .json.
    OutputError
        If a file is there that is no earlier result, but somebody's own.
    """
    require_suffix(path, (".json",), what)
    path = Path(path)
    if why_not_there(path, "file") or not path.stat().st_size:
        return
    family, _, _ = schema.rpartition("/")
    try:
        content = read_json(path)
    except ConfigError:
        content = None
    found = content.get("schema") if isinstance(content, dict) else None
    if str(found).rpartition("/")[0] != family:
        raise OutputError(path, f"what is there is not of {family}, and would be lost")


def read_text(path: PathLike) -> str:
    """Content of a text file, or `ConfigError` saying why not."""
    path = Path(path)
    try:
        # A pipe has an end, as what a shell gives for `<(...)`.
        is_endless = is_device(path)
        text = "" if is_endless else path.read_text(encoding="utf-8-sig")
    except IsADirectoryError as error:
        got, expected = "a folder", "a readable file"
        raise ConfigError(str(path), got=got, expected=expected) from error
    except OSError as error:
        reason = error.strerror or str(error)
        raise ConfigError(str(path), got=reason, expected="a readable file") from error
    except UnicodeDecodeError as error:
        got = f"a byte that is no UTF-8 at offset {error.start}"
        # A pipe can't be read again.
        if path.is_file() and zipfile.is_zipfile(path):
            got = "arrays (.npz), such as a capture"
        raise ConfigError(str(path), got=got, expected="a text file") from error
    except ValueError as error:
        raise ConfigError(
            repr(str(path)), got="a zero byte in its name", expected="a readable file"
        ) from error
    if is_endless:
        raise ConfigError(str(path), got="a device", expected="a text file")
    return text


def _is_depth_image(path: Path) -> bool:
    """Whether there is a PNG of one channel of 16 bits."""
    if why_not_there(path, "file"):
        return False
    head = b""
    with suppress(OSError), path.open("rb") as file:
        head = file.read(26)
    # Its last bytes are the bits of a channel, and the kind of colours.
    return head.startswith(b"\x89PNG") and head.endswith(b"\x10\x00")


def _resolved(path: PathLike) -> Path:
    """Where a path leads, links followed, or `OutputError` if it can lead nowhere."""
    try:
        return Path(os.path.realpath(path))
    except ValueError as error:
        raise OutputError(repr(path), "a zero byte in its name") from error


def _require_replaceable(target: Path) -> None:
    if target.name == "-":
        reason = "a result goes to a file; --json prints to the terminal"
        raise OutputError("-", reason)
    try:
        is_there, is_file = target.exists(), target.is_file()
    except OSError as error:  # as of a name that no file can have
        raise OutputError(target, error.strerror or str(error)) from error
    if target.is_dir():
        raise OutputError(target, "it is a folder")
    if is_there:
        # A rename would silently replace a device or a write-protected file.
        if not is_file:
            raise OutputError(target, "it is not a regular file")
        if not os.access(target, os.W_OK):
            raise OutputError(target, "it is write-protected", mend=_WRITABLE)
