"""The record of a run: a folder that tells everything, and can be replayed.

``inputs.json`` says what was asked for, ``events.jsonl`` what happened, a line each,
and ``captures/`` what was seen. A line is written whole or not at all, so that a record
can be read whenever a run ends: by an end, by a person, or by a full disk.
"""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from weakref import finalize
from zipfile import is_zipfile

import numpy as np

from debrisgrasp._files import read_json, read_text, write_atomic
from debrisgrasp._locks import locked
from debrisgrasp._parsing import json_content, json_found
from debrisgrasp._unreadable import is_there, why_not_there
from debrisgrasp._words import shortened, shown_path
from debrisgrasp.errors import ConfigError, OutputError
from debrisgrasp.io import Capture

__all__ = ["MemoryRecord", "NoRecord", "RunRecord", "StoredRun", "load_run"]

SCHEMA = "debrisgrasp/run/1"
_INPUTS, _EVENTS, _CAPTURES = "inputs.json", "events.jsonl", "captures"
_KINDS = (
    "state", "trace", "kept", "done", "fault", "recovered", "attempt", "stop", "end",
)  # fmt: skip
"""Of events."""


@dataclass(eq=False)
class MemoryRecord:
    """A record that is kept in memory: for tests, replays and pages."""

    inputs: Mapping[str, Any] = field(default_factory=dict)
    events: list[dict[str, Any]] = field(default_factory=list)
    captures: dict[str, Capture] = field(default_factory=dict)

    def write(self, kind: str, facts: Mapping[str, object]) -> None:
        """Add an event."""
        self.events.append({"event": kind, **plain(facts)})

    def keep(self, capture: Capture, name: str) -> None:
        """Store a capture."""
        self.captures[name] = capture

    def capture(self, name: str) -> Capture | None:
        """Capture by its name, if there was one."""
        return self.captures.get(name)


class NoRecord:
    """A record that keeps nothing."""

    def write(self, kind: str, facts: Mapping[str, object]) -> None:
        """Forget it."""

    def keep(self, capture: Capture, name: str) -> None:
        """Forget it."""


class RunRecord:
    """A record in a folder, written as the run goes on.

    Parameters
    ----------
    folder
        A new folder, or one without a run.
    inputs
        What the run was asked for: enough to do it again.

    Raises
    ------
    OutputError
        If the folder can't be written, or holds a run already, or is about to.
    """

    def __init__(
        self, folder: str | os.PathLike[str], inputs: Mapping[str, object]
    ) -> None:
        self.folder = Path(folder)
        content = {"schema": SCHEMA, **plain(inputs)}
        captures = self.folder / _CAPTURES
        places = (captures, self.folder, *self.folder.parents)
        made = [place for place in places if not is_there(place)]
        try:
            taken = self._taken()
            if not taken:
                captures.mkdir(exist_ok=True)
                text = json.dumps(content, indent=1) + "\n"
                write_atomic(self.folder / _INPUTS, text)
                write_atomic(self.folder / _EVENTS, "")
        except OSError as error:
            self._taken_back(made)
            if isinstance(error, OutputError):
                raise
            reason = error.strerror or str(error)
            raise OutputError(shown_path(folder), reason) from error
        if taken:
            raise OutputError(self.folder, taken)
        self._size = 0
        self.fault = ""
        """Why the record ends early, if it does; the run goes on without it."""

    def _taken(self) -> str:
        """Make the folder this record's own, or say whose it is."""
        self.folder.mkdir(parents=True, exist_ok=True)
        try:
            self._lock = locked(self.folder)
        except BlockingIOError:
            return "another run is about to be recorded into it"
        finalize(self, self._lock.close)
        if _holds_a_run(self.folder / _EVENTS):
            return "it holds the record of another run"
        others = _others_in(self.folder)
        return f"it holds other files, as {others[0]}" if others else ""

    def write(self, kind: str, facts: Mapping[str, object]) -> None:
        """Add a line, or, if the disk is full, keep those before it whole."""
        if self.fault:
            return
        line = json.dumps({"event": kind, **plain(facts)}) + "\n"
        path, data = self.folder / _EVENTS, line.encode()
        try:
            with path.open("r+b", buffering=0) as stream:
                stream.seek(self._size)
                written = stream.write(data)
                if written != len(data):
                    stream.truncate(self._size)
                    self._end("the disk is full")
                    return
        except OSError as error:
            self._cut(path)
            self._end(error.strerror or str(error))
            return
        self._size += len(data)
        self._lock.close()  # what is written keeps others out from now on

    def keep(self, capture: Capture, name: str) -> None:
        """Store a capture, whole or not at all."""
        if self.fault:
            return
        try:
            capture.save(self.folder / _CAPTURES / f"{name}.npz")
        except OSError as error:
            reason = error.reason if isinstance(error, OutputError) else str(error)
            self._end(f"{reason} ({_CAPTURES}/{name}.npz)")
        self.write("kept", {"capture": name})

    def _end(self, fault: str) -> None:
        """Go on without it, and tell at once: the run may take long yet."""
        self.fault = fault
        words = "the record in %s ends here, and the run goes on: %s"
        logging.getLogger(__name__).warning(words, self.folder, fault)

    def _taken_back(self, made: Sequence[Path]) -> None:
        """Leave nothing of a record that could not be begun, in new folders (n,)."""
        with suppress(OSError):
            if self.folder in made and is_there(self.folder):
                for name in (_INPUTS, _EVENTS):
                    (self.folder / name).unlink(missing_ok=True)
            for place in made:
                if is_there(place):
                    place.rmdir()

    def _cut(self, path: Path) -> None:
        """Take back what a failed write may have left of a line."""
        try:
            os.truncate(path, self._size)
        except OSError:
            return  # the reader leaves out a last line that is not whole


def _holds_a_run(events: Path) -> bool:
    try:
        return events.stat().st_size > 0
    except OSError:
        return False


def _others_in(folder: Path) -> list[str]:
    """Names of what is no part of a record; hidden files are nobody's."""
    try:
        names = sorted(path.name for path in folder.iterdir())
    except OSError:
        return []
    own = (_INPUTS, _EVENTS, _CAPTURES)
    return [name for name in names if name not in own and not name.startswith(".")]


@dataclass(frozen=True, eq=False, kw_only=True)
class StoredRun:
    """A record that was read."""

    folder: Path
    inputs: Mapping[str, Any]
    events: Sequence[Mapping[str, Any]]
    is_whole: bool
    """Whether it has an end; a run that was killed has none."""

    @property
    def end(self) -> Mapping[str, Any] | None:
        """The last line of a run that came to an end."""
        return self.events[-1] if self.is_whole else None

    @property
    def reached(self) -> str:
        """How far it goes, in words."""
        begun = [e for e in self.events if e.get("event") == "state"]
        if not begun:
            return "nothing of the run"
        number = 1 + sum(event.get("event") == "attempt" for event in self.events)
        return f"the run up to {begun[-1].get('state')} in attempt {number}"

    @property
    def missing(self) -> tuple[str, ...]:
        """What a whole record of this run has besides: its end, whole captures."""
        lacking = () if self.is_whole else (f"the end of {_EVENTS}",)
        number, names = 1, []
        for event in self.events:
            if event.get("event") == "attempt":
                number = int(event.get("number", number)) + 1
            if event.get("event") == "kept" and "capture" in event:
                names.append(f"{event['capture']}.npz")
            if event.get("event") == "done" and event.get("state") == "capture":
                # Older records number captures by the attempt.
                names.append(f"capture_{event.get('look', number):03d}.npz")
        folder = self.folder / _CAPTURES
        # The list of what a .npz holds stands at its end: one cut short has none.
        gone = [name for name in dict.fromkeys(names) if not is_zipfile(folder / name)]
        return (*lacking, *(f"{_CAPTURES}/{name}" for name in gone))

    def capture(self, name: str) -> Capture | None:
        """Capture by its name, if it was stored, and is still whole."""
        path = self.folder / _CAPTURES / f"{name}.npz"
        return Capture.load(path) if is_zipfile(path) else None


def load_run(folder: str | os.PathLike[str]) -> StoredRun:
    """Read a record.

    Raises
    ------
    ConfigError
        If the folder holds none, or a line other than the last is damaged, or one is
        no event.
    """
    folder = Path(folder)
    if why_not_there(folder / _INPUTS, "file"):
        why = why_not_there(folder, "folder")
        raise ConfigError(
            f"{folder}",
            got=why or f"no {_INPUTS} in it that can be read",
            expected="the record of a run",
            mend="`debrisgrasp clear --record DIR` writes one.",
        )
    inputs = read_json(folder / _INPUTS)
    if not isinstance(inputs, dict) or inputs.get("schema") != SCHEMA:
        got = inputs.get("schema") if isinstance(inputs, dict) else type(inputs)
        raise ConfigError(
            f"{folder / _INPUTS}, field schema", got=got, expected=repr(SCHEMA)
        )
    for name, kind in (("version", str), ("contents", dict)):
        if not isinstance(inputs.get(name, kind()), kind):
            raise ConfigError(
                f"{folder / _INPUTS}, field {name}",
                got=shortened(repr(inputs[name])),
                expected="text" if kind is str else "digests by file",
            )
    for file, digest in inputs.get("contents", {}).items():
        if not isinstance(digest, str):
            raise ConfigError(
                f"{folder / _INPUTS}, field contents of {shortened(file)}",
                got=shortened(repr(digest)),
                expected="a digest as text",
            )
    events = list(_lines(folder / _EVENTS))
    is_whole = bool(events) and events[-1].get("event") == "end"
    return StoredRun(folder=folder, inputs=inputs, events=events, is_whole=is_whole)


def _lines(path: Path) -> Iterator[dict[str, Any]]:
    lines = read_text(path).splitlines()
    for number, line in enumerate(lines, start=1):
        try:
            event = json_content(line)
        except ValueError as error:
            if isinstance(error, json.JSONDecodeError) and number == len(lines):
                return  # cut off while it was written
            raise ConfigError(
                f"{path}, line {number}",
                got=json_found(line, error),
                expected="well-formed JSON",
            ) from error
        if not isinstance(event, dict):
            raise ConfigError(
                f"{path}, line {number}", got=line, expected="an object: {...}"
            )
        _require_kinds(event, f"{path}, line {number}")
        yield event


def _require_kinds(event: Mapping[str, Any], where: str) -> None:
    """Raise `ConfigError` unless what readers count, add or format is what it says."""
    if event.get("event") not in _KINDS:
        raise ConfigError(
            f"{where}, event",
            got=json.dumps(event.get("event")),
            expected=f"one of {', '.join(_KINDS)}",
        )
    kinds: dict[str, tuple[type, ...]] = {}
    if event.get("event") == "state":
        kinds |= {"state": (str,), "time": (int, float)}
    if event.get("event") == "attempt":
        kinds["number"] = (int,)
    if event.get("event") == "done":
        kinds |= {"state": (str,), "look": (int,)}
    if event.get("event") == "kept":
        kinds["capture"] = (str,)
    if event.get("event") == "trace" and not _is_table(event.get("rows")):
        raise ConfigError(
            f"{where}, rows",
            got=shortened(json.dumps(event.get("rows"))),
            expected="rows of three numbers",
        )
    if event.get("event") == "end" and not isinstance(event.get("left", {}), dict):
        raise ConfigError(
            f"{where}, left",
            got=shortened(json.dumps(event.get("left"))),
            expected="an object: {...}",
        )
    for name, kind in kinds.items():
        value = event.get(name)
        is_name = "\0" not in str(value)  # no file is called so
        is_kind = type(value) in kind and value != float("inf")
        if name not in event or (is_kind and is_name):
            continue
        raise ConfigError(
            f"{where}, {name}",
            got=json.dumps(value),
            expected="text" if kind == (str,) else "a number",
        )


def _is_table(rows: Any) -> bool:
    """Whether these are times with a force and a torque each, which may be none."""
    return isinstance(rows, list) and all(
        isinstance(row, list)
        and len(row) == 3
        and all(value is None or type(value) in (int, float) for value in row)
        for row in rows
    )


def plain(value: Any) -> Any:
    """Return the same as JSON has it; numbers that are none become null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, (bool, str)) or value is None:
        return value
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    return str(value)
