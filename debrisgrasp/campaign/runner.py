"""Many runs on many workers, each with a record on disk; none is lost."""

from __future__ import annotations

import json
import os
import pickle
import re
import threading
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from debrisgrasp._checked import checked
from debrisgrasp._files import read_json, write_atomic
from debrisgrasp.errors import ConfigError, InputError

from .contents import edited
from .folder import alone_in, make_folder
from .header import CONTENTS, RUNS, SCHEMA, read_header
from .record import RunRecord
from .workers import Crew, LocalWorkers, Workers

__all__ = [
    "Campaign",
    "Progress",
    "RunFunction",
    "Spec",
    "damaged_runs",
    "guarded",
    "load_records",
]

_LIVES = 2
"""A run that ends its worker so many times, alone on it, is recorded as such."""
_WRITTEN = ("runs/*.json", "results.json", "results.csv", "campaign.png")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")


class Spec(Protocol):
    """All that one run needs; can be pickled."""

    @property
    def name(self) -> str:
        """Unique in its campaign; the name of the record's file."""

    def to_json(self) -> dict[str, Any]:
        """Everything that repeats the run."""


RunFunction = Callable[[Any], RunRecord]
"""Does one run; a function of a module, so that other processes find it."""


class Progress(NamedTuple):
    """How far a campaign is."""

    done: int
    total: int
    latest: RunRecord | None
    """The run that was just finished; None at the start."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Campaign:
    """Runs to be done, and the folder for their records.

    Records are written when a run ends, whole or not at all. A campaign that was
    interrupted goes on where it was: records that fit their spec are kept, all others
    are done again.
    """

    specs: Sequence[Spec]
    run_one: RunFunction
    folder: Path
    header: Mapping[str, Any] = field(default_factory=dict)
    """What all runs have in common. A folder with another header is refused, since it
    holds the records of another campaign."""
    contents: Mapping[str, str] = field(default_factory=dict)
    """Digests of the files that decide what the runs are, by path. A folder that was
    begun with other contents is refused, too."""

    def __post_init__(self) -> None:
        folder = _checked_folder(self.folder, self.specs, self.run_one)
        object.__setattr__(self, "folder", folder)
        names = [spec.name for spec in self.specs]
        bad = [name for name in names if not _NAME.fullmatch(name)]
        if bad or len(set(names)) < len(names):
            raise InputError(
                "names of the runs",
                got=repr(bad[0]) if bad else "a name twice",
                expected="different names of letters, digits, '_', '-' and '.'",
            )
        try:
            pickle.dumps((self.run_one, list(self.specs)))
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise InputError(
                "run function or specs",
                got=str(error),
                expected="what other processes can be sent",
                mend="Define the function at the top of a module.",
            ) from error

    @checked
    def run(
        self,
        workers: Workers | None = None,
        *,
        on_progress: Callable[[Progress], None] = lambda _: None,
    ) -> tuple[RunRecord, ...]:
        """Do all runs that have no record yet.

        When a worker dies, the runs that were on it and beside it are done again, one
        at a time, so that only the guilty one is recorded as unclassified.

        Parameters
        ----------
        workers
            `LocalWorkers` by default; other executors come through `OwnWorkers`.

        Returns
        -------
        tuple of RunRecord
            In the order of the specs.

        Raises
        ------
        InputError
            If the folder holds another campaign, another process works on it, or no
            worker can be had.
        OutputError
            If a record can't be written.
        KeyboardInterrupt
            After Ctrl-C; workers are ended, and finished runs kept.
        """
        crews = workers if workers is not None else LocalWorkers()
        with alone_in(self.folder):
            return self._run(crews, on_progress)

    def _run(
        self, crews: Workers, on_progress: Callable[[Progress], None]
    ) -> tuple[RunRecord, ...]:
        self._refuse_other_campaign()
        records = self.finished()
        on_progress(Progress(len(records), len(self.specs), None))

        def keep(record: RunRecord) -> None:
            write_atomic(self._path(record.name), record.to_json())
            records[record.name] = record
            on_progress(Progress(len(records), len(self.specs), record))

        waiting = deque(spec for spec in self.specs if spec.name not in records)
        if not waiting:
            self._claim_folder()
        while waiting:
            with crews.open() as crew:
                self._claim_folder()  # not before: there may be no workers
                suspects = self._drain(crew, waiting, keep)
            self._run_alone(crews, deque(spec for spec, _ in suspects), keep)
        return tuple(records[spec.name] for spec in self.specs)

    def finished(self) -> dict[str, RunRecord]:
        """Read the records of earlier runs that fit their spec, by name."""
        found = {}
        for spec in self.specs:
            record = _loaded(self._path(spec.name))
            if record is not None and record.spec == _as_read(spec.to_json()):
                found[spec.name] = record
        return found

    def _path(self, name: str) -> Path:
        return self.folder / "runs" / f"{name}.json"

    def _full_header(self) -> Any:
        return _as_read({"schema": SCHEMA, **self.header, CONTENTS: self.contents})

    def _refuse_other_campaign(self) -> None:
        path, header = self.folder / "campaign.json", self._full_header()
        if path.exists() and (found := _difference(read_header(path), header)):
            raise InputError(
                f"campaign in {self.folder}",
                got=found,
                expected="an empty folder, or the same campaign to go on with",
                mend="Give another folder.",
            )
        if not path.exists() and (others := _written(self.folder)):
            raise InputError(
                f"campaign in {self.folder}",
                got=f"{others[0]}, but no campaign.json that says of what",
                expected="an empty folder, or a campaign to go on with",
                mend="Put the file back, or give another folder.",
            )
        if (self.folder / "events.jsonl").exists():
            raise InputError(
                f"folder {self.folder}",
                got="the record of a single run",
                expected="an empty folder, or a campaign to go on with",
                mend="Give another folder.",
            )

    def _claim_folder(self) -> None:
        path = self.folder / "campaign.json"
        make_folder(self.folder / "runs")
        content = {**self._full_header(), RUNS: [spec.name for spec in self.specs]}
        if not path.exists() or read_json(path) != content:
            write_atomic(path, json.dumps(content, indent=1) + "\n")

    def _drain(
        self, crew: Crew, waiting: deque[Spec], keep: Callable[[RunRecord], None]
    ) -> list[tuple[Spec, Exception]]:
        """Work until nothing waits, or a worker dies; returns what was under way."""
        pending: dict[Future[RunRecord], Spec] = {}
        lost: list[tuple[Spec, Exception]] = []
        # What is under way beside a death either ends well or is lost too.
        while pending or (waiting and not lost):
            while waiting and not lost and len(pending) < crew.width:
                spec = waiting.popleft()
                try:
                    future = crew.executor.submit(
                        guarded, self.run_one, spec, crew.time_limit
                    )
                except BrokenExecutor as error:
                    lost.append((spec, error))
                else:
                    pending[future] = spec
            done, _ = wait(pending, return_when=FIRST_COMPLETED)
            # In the order of the specs: where one can't be written, those before are.
            for future in [future for future in pending if future in done]:
                spec = pending.pop(future)
                try:
                    record = future.result()
                except Exception as error:  # noqa: BLE001 - `guarded` raises none
                    lost.append((spec, error))
                else:
                    keep(record)
        return lost

    def _run_alone(
        self, crews: Workers, waiting: deque[Spec], keep: Callable[[RunRecord], None]
    ) -> None:
        deaths: Counter[str] = Counter()
        while waiting:
            with crews.open() as crew:
                lost = self._drain(crew._replace(width=1), waiting, keep)
            for spec, error in lost:
                deaths[spec.name] += 1
                if deaths[spec.name] == _LIVES:
                    words = f"its worker died {_LIVES} times: {error!r}"
                    keep(_failed(spec, words))
                else:
                    waiting.appendleft(spec)


@checked
def _checked_folder(
    folder: str | os.PathLike[str],
    specs: Sequence[Spec],  # noqa: ARG001 - looked at by `checked`, as is the next
    run_one: RunFunction,  # noqa: ARG001
) -> Path:
    return Path(folder)


def load_records(folder: str | os.PathLike[str]) -> tuple[RunRecord, ...]:
    """Read the whole records of a campaign's folder, in the order of their names.

    Those of a longer campaign that was there before are left out.

    Raises
    ------
    ConfigError
        If the folder holds no campaign.
    """
    return tuple(record for _, record in _present(folder) if record is not None)


def damaged_runs(folder: str | os.PathLike[str]) -> tuple[str, ...]:
    """Name the runs of a campaign's folder whose records can't be read, or are others'.

    A campaign that goes on does them again.

    Raises
    ------
    ConfigError
        If the folder holds no campaign.
    """
    return tuple(name for name, record in _present(folder) if record is None)


def _present(
    folder: str | os.PathLike[str],
) -> Iterator[tuple[str, RunRecord | None]]:
    """Read the records of the present campaign; None: one that is not whole."""
    place = Path(folder)
    header = read_header(place / "campaign.json")
    paths = sorted((place / "runs").glob("*.json"))
    names = set(header.get(RUNS, [path.stem for path in paths]))  # none in older ones
    for path in paths:
        if path.stem in names:
            yield path.stem, _loaded(path)


def _written(folder: Path) -> list[str]:
    """Names of what a campaign would write over, and people may have otherwise."""
    files = (path for each in _WRITTEN for path in folder.glob(each))
    return [str(path.relative_to(folder)) for path in files]


def _loaded(path: Path) -> RunRecord | None:
    """Read a record; None of one that is not whole, or a copy of another run's."""
    try:
        record = RunRecord.load(path)
    except ConfigError:
        return None
    return record if record.name == path.stem else None


def guarded(
    run_one: RunFunction, spec: Spec, time_limit: float | None = None
) -> RunRecord:
    """Run it; whatever it raises becomes a record, so that none is lost."""
    with _ending_worker_after(time_limit):
        try:
            return run_one(spec)
        except Exception:  # noqa: BLE001 - the record keeps it, the tables count it
            return _failed(spec, traceback.format_exc())


@contextmanager
def _ending_worker_after(seconds: float | None) -> Iterator[None]:
    """End the process unless the context is left in time: only that ends any loop."""
    if seconds is None:
        yield
        return
    timer = threading.Timer(seconds, os._exit, args=(1,))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _failed(spec: Spec, error: str) -> RunRecord:
    return RunRecord.unclassified(spec.name, _as_read(spec.to_json()), error)


def _as_read(content: Mapping[str, Any]) -> Any:
    """As it is after writing and reading: tuples become lists."""
    return json.loads(json.dumps(content, allow_nan=False))


def _difference(there: Mapping[str, Any], wanted: Mapping[str, Any]) -> str:
    before, now = (content.get(CONTENTS, {}) for content in (there, wanted))
    names = sorted((there.keys() | wanted.keys()) - {CONTENTS, RUNS})
    words = [
        f"{name} {there.get(name)!r} instead of {wanted.get(name)!r}"
        for name in names
        if there.get(name) != wanted.get(name)
    ]
    return "; ".join(words + edited(before, now))
