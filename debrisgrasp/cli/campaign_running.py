"""What ``campaign`` does: run or compare campaigns, and show their tables."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import debrisgrasp
from debrisgrasp._arrays import Rng
from debrisgrasp._files import data_path
from debrisgrasp._workers import cores
from debrisgrasp.campaign import (
    FAKE_TIERS,
    UNCLASSIFIED,
    Campaign,
    ClusterWorkers,
    FaultRates,
    LocalWorkers,
    Progress,
    RunRecord,
    compare,
    compare_ends,
    compare_groups,
    comparison_to_json,
    contents_of_site,
    damaged_runs,
    digest,
    draw_flight,
    draw_specs,
    flight_of,
    flights_to_json,
    grouped,
    load_flights,
    load_header,
    load_results,
    pipeline_of,
    random_faults,
    run_function,
    same_scenes,
    save_results,
    tables_to_json,
    tabulate,
)
from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.executive import SimulatedTask
from debrisgrasp.robot import Injection
from debrisgrasp.sim import TIERS
from debrisgrasp.sim._mujoco import mujoco

from .campaign_text import (
    comparison_text,
    draw_tables,
    flights_text,
    header_text,
    same_scenes_text,
    tables_text,
)
from .live import show_line

__all__ = ["run_campaigns"]

_INTERRUPTED = 130
_RANDOM = "random"
_ALIKE = (
    "world", "mujoco", "level", "tier", "site", "faults", "recovery", "max_removals",
)  # fmt: skip
"""What two campaigns that are compared should have in common."""


def run_campaigns(arguments: argparse.Namespace) -> int:
    """Run or compare campaigns; 1 if something happened that never must."""
    if arguments.compare is not None:
        return _compare(*arguments.compare, as_json=arguments.json)
    campaign = _campaign(arguments)
    workers = (
        _local(arguments.workers, arguments.n)
        if arguments.cluster is None
        else ClusterWorkers(arguments.cluster)
    )
    try:
        records = campaign.run(workers, on_progress=_show)
    except KeyboardInterrupt:
        done = len(campaign.finished())
        words = f"interrupted: {done} of {len(campaign.specs)} runs are done in "
        words += f"{campaign.folder}; the same command goes on"
        print(f"\n{words}", file=sys.stderr)
        return _INTERRUPTED
    tables = tabulate(records)
    groups = grouped(flight for record in records if (flight := flight_of(record)))
    # They are told first, whatever of them can't be written.
    if arguments.json:
        told = tables_to_json(tables)
        if groups:
            told["flights"] = flights_to_json(groups)
        print(json.dumps(told))
    else:
        print(tables_text(tables))
        if groups:
            print(f"\n{flights_text(groups)}")
        _print_broken(records)
    paths = save_results(campaign.folder, records, tables, campaign.header)
    picture = campaign.folder / "campaign.png"
    draw_tables(picture, "Campaign", header_text(len(records), campaign.header), tables)
    if not arguments.json:
        print("\nwrote " + ", ".join(str(path) for path in (*paths, picture)))
    _draw_failures(campaign.folder, records)
    is_broken = any(count for _, count in tables.checks)
    return int(is_broken or any(record.outcome == UNCLASSIFIED for record in records))


def _local(count: int, n_runs: int) -> LocalWorkers:
    """Workers on this machine, no more of them than runs."""
    asked = LocalWorkers(count)
    return replace(asked, count=min(count or cores(), n_runs))


def _campaign(arguments: argparse.Namespace) -> Campaign:
    known = {"fake": tuple(FAKE_TIERS), "mujoco": tuple(TIERS)}[arguments.world]
    tier = arguments.tier
    if tier is None:
        tier = {"fake": "few", "mujoco": "pile"}[arguments.world]
    if tier not in known:
        raise UnknownNameError(f"tier of world {arguments.world}", tier, known)
    if arguments.world != "fake" and (arguments.faults or arguments.no_recovery):
        raise ConfigError(
            "--faults, --no-recovery",
            got=f"with --world {arguments.world}",
            expected="--world fake",
            mend="Only the robot in memory can be struck by faults.",
        )
    if arguments.world == "fake" and arguments.level != "hand":
        raise ConfigError(
            "--level",
            got=f"{arguments.level} with --world fake",
            expected="--world mujoco",
            mend="The robot in memory always has its arms.",
        )
    is_flight = arguments.world == "mujoco" and arguments.level == "hand"
    if is_flight and arguments.max_removals is not None:
        raise ConfigError(
            "--max-removals",
            got="with --world mujoco --level hand",
            expected="--world fake, or --level arm",
            mend="A flying hand is given one object.",
        )
    common: dict[str, Any] = {
        "seed": arguments.seed,
        "world": arguments.world,
        "tier": tier,
        "level": arguments.level,
        "site": _site(arguments),
        "recovery": not arguments.no_recovery,
        "max_removals": arguments.max_removals,
    }
    source = _faults(arguments.faults)
    contents = {} if common["site"] is None else contents_of_site(common["site"])
    if (rates := _rates_file(arguments.faults)) is not None:
        contents[arguments.faults] = digest(rates)
    header = {**common, "version": debrisgrasp.__version__, "faults": arguments.faults}
    if arguments.world == "mujoco":
        header["mujoco"] = mujoco().__version__  # also lest each of the runs end by it
    return Campaign(
        specs=draw_specs(arguments.n, faults=source, **common),
        run_one=run_function(arguments.world, arguments.level),
        folder=arguments.out,
        header=header,
        contents=contents,
    )


def _draw_failures(folder: Path, records: tuple[RunRecord, ...]) -> None:
    """Draw each failed flight that has no picture yet; it is flown again for that."""
    failed = [
        record
        for record in records
        if (flight := flight_of(record)) and not flight.is_success
    ]
    pictures = folder / "failures"
    for i, record in enumerate(failed):
        path = pictures / f"{record.name}.png"
        if not path.exists():
            pictures.mkdir(exist_ok=True)
            draw_flight(record, path)
            show_line(
                f"{i + 1} of {len(failed)} failures drawn", is_last=i + 1 == len(failed)
            )
    if failed:
        print(f"{len(failed)} pictures of failures in {pictures}", file=sys.stderr)


def _site(arguments: argparse.Namespace) -> str | None:
    """File of settings, if it is one that such runs can be made with."""
    if arguments.site is None:
        return None
    site: str = os.path.realpath(arguments.site)
    is_flying = arguments.world == "mujoco" and arguments.level == "hand"
    pipeline = pipeline_of(site)
    if is_flying:
        return site
    if pipeline.robot is None:
        raise ConfigError(
            "robot of the site",
            got="none",
            expected="a robot with arms",
            mend="Only the flying hand of --world mujoco --level hand has no arm.",
        )
    SimulatedTask(site=site).settings(pipeline)  # drop-offs that none of the runs reach
    return site


def _faults(name: str | None) -> Callable[[Rng], tuple[Injection, ...]] | None:
    if name == _RANDOM:
        return random_faults
    path = _rates_file(name)
    return None if path is None else FaultRates.load(path).drawn


def _rates_file(name: str | None) -> Path | None:
    if name is None or name == _RANDOM:
        return None
    shipped = {path.stem: path for path in data_path("campaigns").glob("*.yaml")}
    if name not in shipped and not Path(name).suffix:
        known = (_RANDOM, *sorted(shipped), "the path of a .yaml file")
        raise UnknownNameError("rates of faults", name, known)
    return shipped.get(name, Path(name))


def _compare(old: Path, new: Path, *, as_json: bool) -> int:
    runs = load_results(old), load_results(new)
    for words in _unlike((old, new), runs):
        print(f"note: {words}", file=sys.stderr)
    for path, records in zip((old, new), runs, strict=True):
        if not records:
            raise ConfigError(
                f"runs of {path}", got="none", expected="one or more finished runs"
            )
    groups = compare_groups(load_flights(old), load_flights(new))
    rows = compare(*map(tabulate, runs))
    if groups:  # flights tell more of their ends than the classes of faults do
        rows = (*rows[:2], *compare_ends(*runs))
    if as_json:
        print(json.dumps(comparison_to_json(rows)))
    else:
        for by, some in groups.items():
            print(comparison_text(some, by) + "\n")
        print(comparison_text(rows))
        if (same := same_scenes(*runs)).runs:
            print(same_scenes_text(same))
    return 0


def _unlike(
    paths: tuple[Path, Path], runs: tuple[tuple[RunRecord, ...], ...]
) -> Iterator[str]:
    """Say in what two campaigns differ beside their versions, or are not whole."""
    headers = [load_header(path) for path in paths]
    for name in _ALIKE:
        if all(name in header for header in headers):
            old, new = (header[name] for header in headers)
            if old != new:
                yield f"they differ in {name}: {old} in the old one, {new} in the new"
    for path, header, records in zip(paths, headers, runs, strict=True):
        asked = header.get("runs", len(records))
        if len(records) < asked:
            yield f"{path} has {len(records)} of {asked} runs"
        for name in damaged_runs(path) if path.is_dir() else ():
            yield f"{path}: runs/{name}.json is damaged, and left out"


def _show(progress: Progress) -> None:
    """Keep one line of the terminal up to date, if there is one."""
    latest = "" if progress.latest is None else progress.latest.outcome
    words = f"{progress.done} of {progress.total} runs  {latest:<24}"
    show_line(words, is_last=progress.done == progress.total)


def _print_broken(records: tuple[RunRecord, ...]) -> None:
    """Name the runs that did what must never happen, so that they can be repeated."""
    for record in records:
        broken = [f"{count} {name}" for name, count in record.checks.items() if count]
        if record.error:
            broken.append(record.error.strip().splitlines()[-1])
        if (flight := flight_of(record)) and flight.is_through:
            deep = f"{1e3 * flight.deepest:.1f} mm"
            broken.append(f"{record.end} means little: the hand went {deep} into it")
        if broken:
            print(f"run {record.name}: {'; '.join(broken)}")
