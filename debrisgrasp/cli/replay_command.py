"""``replay``: a run again, decision by decision, or as the run of a campaign."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from debrisgrasp._words import counted
from debrisgrasp.errors import ConfigError, InputError

from .commands import version
from .task_files import contents_of
from .values import some_path

if TYPE_CHECKING:
    from debrisgrasp.executive.record import StoredRun
    from debrisgrasp.executive.simulated import SimulatedTask

__all__ = ["add"]


def add(parser: argparse.ArgumentParser) -> None:
    """Add ``replay``."""
    parser.description = (
        "Do a recorded run, or the run of a campaign, again with this "
        "version, or compare it with another record, and say where they differ."
    )
    parser.add_argument(
        "run_record",
        type=some_path,
        metavar="RUN",
        help="record of a run: the folder that `clear --record` wrote, or the file of "
        "the run of a campaign (runs/000017.json)",
    )
    parser.add_argument(
        "--against",
        type=some_path,
        metavar="RUN",
        help="compare with this record instead",
    )
    parser.add_argument(
        "--json", action="store_true", help="print JSON for machines instead of text"
    )
    parser.set_defaults(run=_replay)


def _replay(arguments: argparse.Namespace) -> int:
    of_campaign = arguments.run_record.is_file()
    other = arguments.against
    if other is not None and other.exists() and other.is_file() != of_campaign:
        folder, file = sorted((arguments.run_record, other), key=Path.is_file)
        raise InputError(
            "records to compare",
            got=f"the folder of a run ({folder}) and a file ({file})",
            expected="two folders, or two files of campaigns (runs/*.json)",
        )
    return (_replay_of_campaign if of_campaign else _replay_of_decisions)(arguments)


def _replay_of_campaign(arguments: argparse.Namespace) -> int:
    from debrisgrasp.campaign import (  # slow to load
        RunRecord,
        RunSpec,
        asked_apart,
        changes,
        done_again,
        edited_since,
    )

    path: Path = arguments.run_record
    before = RunRecord.load(path)
    folder, files = path.resolve().parent.parent, list[str]()
    if arguments.against:
        now = RunRecord.load(arguments.against)
    else:
        try:
            RunSpec.from_json(before.spec)
        except InputError as error:
            raise ConfigError.about(f"{path}, spec: {error.what}", error) from error
        files = edited_since(folder, before.spec)
        now = done_again(before)
        if now.end == "interrupted":
            raise KeyboardInterrupt  # it would be compared with a run that was not
    apart, found = asked_apart(before, now), changes(before, now)
    is_same = not (apart or found)
    versions = {"before": before.version or "an older version", "now": now.version}
    if arguments.json:
        facts = {"same": is_same, "versions": versions, "edited": files, "tasks": apart}
        print(json.dumps({**facts, "differences": [str(change) for change in found]}))
        return 0 if is_same else 1
    print(f"run {before.name}: {versions['before']} before, {versions['now']} now")
    for words in files:
        print(f"not as before: {words}")
    same = _tell_apart(apart)
    print("\n".join(map(str, found)) or f"{same}: {now.outcome}, {now.end}")
    if now.error:
        print(now.error.strip())
    return 0 if is_same else 1


def _replay_of_decisions(arguments: argparse.Namespace) -> int:
    from debrisgrasp.executive.replay import differences, tasks_apart
    from debrisgrasp.executive.simulated import SimulatedTask

    before = _begun(arguments.run_record)
    lacking = {str(arguments.run_record): before.missing}
    apart: list[str] = []
    other = None
    if arguments.against:
        other = _begun(arguments.against)
        for run in (before, other):
            _task(run)
        events, by = other.events, _made_by(other.inputs)
        usual = {field.name: field.default for field in fields(SimulatedTask)}
        apart = tasks_apart(before.inputs, other.inputs, usual)
        lacking[str(arguments.against)] = other.missing
    else:
        events, by = _done_again(before), version()
    versions = {"before": _made_by(before.inputs), "now": by}
    files = _edited(before, other)
    taken, events = _comparable(before, events, other)
    found = differences(taken, events)
    if arguments.json:
        facts = {
            "same": not (apart or found),
            "is_whole": before.is_whole,
            "missing": before.missing,
            "versions": versions,
            "edited": files,
            "tasks": apart,
        }
        if other is not None:
            facts["missing_against"] = other.missing
        print(json.dumps({**facts, "differences": [str(d) for d in found]}))
    else:
        print(", ".join(f"{when}: {what}" for when, what in versions.items()))
        for words in files:
            print(f"not as before: {words}")
        same = _tell_apart(apart)
        for path, missing in lacking.items():
            if missing:
                print(f"{path} lacks {', '.join(missing)}")
        n = counted(len(taken), "decision")
        print("\n".join(map(str, found)) or f"{same} {n}")
    return 1 if apart or found or any(lacking.values()) else 0


def _edited(before: StoredRun, other: StoredRun | None) -> list[str]:
    """Say which files of a run are others now, or in another record.

    Nothing is said of a record by an older version, which kept no digests.
    """
    from debrisgrasp.campaign import edited  # slow to load

    kept = before.inputs.get("contents")
    now = contents_of(_task(before)) if other is None else other.inputs.get("contents")
    if not isinstance(kept, dict) or not isinstance(now, dict):
        return []
    return edited(kept, now)


def _done_again(run: StoredRun) -> list[dict[str, Any]]:
    """Do a run again, and return its events."""
    from debrisgrasp.executive.record import MemoryRecord

    from .live import ToldRun

    again, task = MemoryRecord(), _task(run)
    try:
        task.run(ToldRun(again))
    except InputError as error:
        raise ConfigError.about(f"{run.folder}: {error.what}", error) from error
    if again.events[-1].get("end") == "interrupted":
        raise KeyboardInterrupt  # it would be compared with a run that was not
    return again.events


def _task(run: StoredRun) -> SimulatedTask:
    """Read what a run was asked for."""
    from debrisgrasp.executive.simulated import SimulatedTask

    try:
        return SimulatedTask.from_json(run.inputs)
    except InputError as error:
        raise ConfigError.about(f"{run.folder}: {error.what}", error) from error


def _comparable(
    run: StoredRun, events: Sequence[Mapping[str, Any]], other: StoredRun | None
) -> tuple[Sequence[Mapping[str, Any]], Sequence[Mapping[str, Any]]]:
    """Decisions of a run, and of another's events, as far as both got.

    Parameters
    ----------
    other
        Whose events these are; None: they were not stored.
    """
    from debrisgrasp.executive.replay import decisions

    taken, now = decisions(run.events), decisions(events)
    for stored, mine in ((run, taken), (other, now)):
        if stored is None:
            continue
        if stored.end is not None and stored.end.get("end") == "interrupted":
            # What followed came of the interruption, which is no decision.
            stops = [i for i, event in enumerate(mine) if event["event"] == "stop"]
            del mine[stops[-1] if stops else len(mine) :]
        elif stored.is_whole:
            continue
        del taken[len(mine) :], now[len(mine) :]
    return taken, now


def _begun(folder: Path) -> StoredRun:
    """Read the record of a run that decided anything, or raise `ConfigError`."""
    from debrisgrasp.executive.record import load_run
    from debrisgrasp.executive.replay import decisions

    run = load_run(folder)
    if not decisions(run.events):
        raise ConfigError(f"{folder}", got="no decision", expected="at least one")
    return run


def _tell_apart(apart: Sequence[str]) -> str:
    """Print in what two tasks differ; return how to call what came out alike."""
    if not apart:
        return "the same"
    print("the records are of different tasks:")
    for words in apart:
        print(f"  {words}")
    return "and yet the same"


def _made_by(inputs: Mapping[str, object]) -> str:
    """Version that made a record; those made from Python once had none."""
    return str(inputs.get("version") or "an unknown version")
