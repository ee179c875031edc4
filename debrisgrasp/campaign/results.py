"""What a campaign leaves for people and programs: one JSON file, and one CSV."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from debrisgrasp._files import read_json, schema_found, write_together
from debrisgrasp.errors import ConfigError

from .accounting import Comparison, Share, Stage, Tables, system_reliability
from .flights import FlightGroup, grouped
from .header import CONTENTS, RUNS, read_header
from .record import CHECKS, RunRecord, flight_of
from .runner import load_records

__all__ = [
    "comparison_to_json",
    "flights_to_json",
    "load_flights",
    "load_results",
    "save_results",
    "tables_to_json",
]

_SCHEMA = "debrisgrasp/campaign-results/1"
_PLAIN = (
    "outcome",
    "end",
    "failed_stage",
    "fault",
    "first_fault",
    "n_objects",
    "n_removed",
    "seconds",
)


def save_results(
    folder: str | os.PathLike[str],
    records: Sequence[RunRecord],
    tables: Tables,
    header: Mapping[str, Any],
) -> tuple[Path, Path]:
    """Write ``results.json`` and ``results.csv``; returns their paths.

    Raises
    ------
    OutputError
        If one can't be written; then none is.
    """
    place = Path(folder)
    content: dict[str, Any] = {
        "schema": _SCHEMA,
        "campaign": dict(header),
        "tables": tables_to_json(tables),
        "runs": [
            json.loads(replace(record, details={}).to_json()) for record in records
        ],
    }
    if flights := [flight for record in records if (flight := flight_of(record))]:
        content["flights"] = flights_to_json(grouped(flights))
    paths = place / "results.json", place / "results.csv"
    texts = json.dumps(content, indent=1) + "\n", _csv(records)
    write_together(dict(zip(paths, texts, strict=True)))
    return paths


def load_header(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read what the runs of a campaign have in common, as `load_results` takes it.

    ``runs`` counts those that were asked for. What an older file lacks is left out.
    """
    place = Path(path)
    header: Any
    if place.is_dir():
        header = content = read_header(place / "campaign.json")
    else:
        content = read_json(place)
        header = content.get("campaign") if isinstance(content, dict) else None
    if not isinstance(header, dict):
        return {}
    known = {k: v for k, v in header.items() if k not in ("schema", CONTENTS)}
    runs = content.get(RUNS)
    return {**known, RUNS: len(runs)} if isinstance(runs, list) else known


def load_results(path: str | os.PathLike[str]) -> tuple[RunRecord, ...]:
    """Read the runs of a results file, or of the folder of a campaign.

    Raises
    ------
    ConfigError
        If it is neither.
    """
    if Path(path).is_dir():
        return load_records(path)
    content = read_json(path)
    if not isinstance(content, dict) or content.get("schema") != _SCHEMA:
        raise ConfigError(
            str(path), got=schema_found(content), expected="results.json of a campaign"
        )
    runs = content.get("runs")
    if not isinstance(runs, list):
        raise ConfigError(f"{path}, runs", got=repr(runs), expected="a list")
    return tuple(
        RunRecord.from_json(entry, f"{path}, run {i + 1}")
        for i, entry in enumerate(runs)
    )


def load_flights(path: str | os.PathLike[str]) -> tuple[FlightGroup, ...]:
    """Read the groups of flights of a results file, or of the folder of a campaign.

    Raises
    ------
    ConfigError
        If the file tells of them otherwise than `save_results` does.
    """
    if Path(path).is_dir():
        flights = map(flight_of, load_records(path))
        return grouped(flight for flight in flights if flight)
    content = read_json(path)
    try:
        return tuple(
            FlightGroup(
                by=str(entry["by"]),
                name=str(entry["name"]),
                held=Share(int(entry["held"]["count"]), int(entry["held"]["total"])),
                pulled_clear=int(entry["pulled_clear"]),
                failures=dict(entry["failures"]),
                through=int(entry.get("through", 0)),  # none in older ones
            )
            for entry in content.get("flights", ())
        )
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ConfigError(
            f"{path}, flights",
            got=f"{type(error).__name__} {error}",
            expected="groups with by, name, held, pulled_clear, failures",
        ) from error


def tables_to_json(tables: Tables) -> dict[str, Any]:
    """Give the numbers of the tables as plain JSON values."""
    system = system_reliability(tables.classes)
    return {
        "all_runs": {name: _share(share) for name, share in tables.of_all},
        "runs_with_a_grasp": {name: _share(share) for name, share in tables.of_grasps},
        "by_first_fault": dict(tables.by_first_fault),
        "objects_removed": _share(tables.removed),
        "classes_in_series": [_stage(stage) for stage in tables.classes],
        "stages_in_series": [_stage(stage) for stage in tables.stages],
        "ended_in": dict(tables.ended_in),
        "system": None if system is None else float(system),
        "if_never": {
            name: None if value is None else float(value)
            for name, value in tables.mended
        },
        "checks": dict(tables.checks),
    }


def flights_to_json(groups: Sequence[FlightGroup]) -> list[dict[str, Any]]:
    """Give groups of flights as plain JSON values."""
    return [
        {
            "by": group.by,
            "name": group.name,
            "held": _share(group.held),
            "pulled_clear": group.pulled_clear,
            "failures": dict(group.failures),
            "through": group.through,
        }
        for group in groups
    ]


def comparison_to_json(rows: Sequence[Comparison]) -> list[dict[str, Any]]:
    """Give a comparison as plain JSON values."""
    return [
        {
            "name": row.name,
            "old": _share(row.old),
            "new": _share(row.new),
            "difference": row.difference if row.old.total and row.new.total else None,
            "interval": list(row.interval),
            "is_clear": row.is_clear,
        }
        for row in rows
    ]


def _share(share: Share) -> dict[str, Any]:
    value = share.value if share.total else None
    interval = list(share.interval)
    return {
        "count": share.count,
        "total": share.total,
        "share": value,
        "interval": interval,
    }


def _stage(stage: Stage) -> dict[str, Any]:
    return {
        "name": stage.name,
        "reached": stage.reached,
        "failed": stage.failed,
        "reliability": float(stage.reliability),
        "interval": list(stage.interval),
    }


def _csv(records: Sequence[RunRecord]) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    lists = ("injected", "faults")
    writer.writerow(["run", "seed", "tier", *_PLAIN, "got_to_a_grasp", *lists, *CHECKS])
    for record in records:
        writer.writerow(
            [
                record.name,
                record.spec.get("seed", ""),
                record.spec.get("tier", ""),
                *("" if (v := getattr(record, n)) is None else v for n in _PLAIN),
                int(record.got_to_a_grasp),
                *(" ".join(getattr(record, name)) for name in lists),
                *(record.checks.get(name, "") for name in CHECKS),
            ]
        )
    return stream.getvalue()
