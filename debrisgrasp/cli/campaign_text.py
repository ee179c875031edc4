"""Tables of a campaign, for the terminal and as a picture."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from debrisgrasp._words import counted
from debrisgrasp.campaign import (
    Comparison,
    FlightGroup,
    SameScenes,
    Share,
    Stage,
    Tables,
    system_reliability,
)
from debrisgrasp.viz.campaign import Bar, campaign_png

from .tables import columns

__all__ = [
    "comparison_text",
    "draw_tables",
    "flights_text",
    "header_text",
    "same_scenes_text",
    "tables_text",
]

_MOST_NAMES = 20


def header_text(n_runs: int, header: Mapping[str, Any]) -> str:
    """Say in one line of what runs a campaign was."""
    parts = [counted(n_runs, "run"), f"tier {header['tier']}"]
    if header["world"] != "fake":
        who = {"hand": "a flying hand", "arm": "both arms"}[header["level"]]
        parts.append(f"in physics with {who}")
    if header["site"]:
        parts.append(f"site {Path(header['site']).name}")
    faults = header["faults"]
    parts.append(f"faults {Path(faults).name}" if faults else "no injected faults")
    if not header["recovery"]:
        parts.append("no recovery")
    if header["max_removals"]:
        parts.append(f"at most {header['max_removals']} removed")
    return ", ".join((*parts, f"seed {header['seed']}"))


def tables_text(tables: Tables) -> str:
    """Outcomes with both denominators, stages, what mending buys, and the checks."""
    parts = [_outcomes(tables), _series(tables), _stages(tables)]
    if tables.checks:
        parts.append(_checks(tables))
    return "\n\n".join(parts)


def _outcomes(tables: Tables) -> str:
    rows = [
        [
            name.replace("_", " "),
            str(share.count),
            *_percent(share),
            str(grasped.count),
            *_percent(grasped),
            str(first),
        ]
        for (name, share), (_, grasped), (_, first) in zip(
            tables.of_all, tables.of_grasps, tables.by_first_fault, strict=True
        )
    ]
    all_runs, grasps = tables.success.total, tables.grasp_success.total
    header = ["outcome", "runs", f"% of {all_runs}", "95 %"]
    header += ["with a grasp", f"% of {grasps}", "95 % ", "by first fault"]
    removed = tables.removed
    share, interval = _percent(removed)
    words = f"objects out of the way: {removed.count} of {removed.total}"
    if removed.total:
        words += f", {share} % ({interval})"
    return f"{columns(header, rows)}\n\n{words}"


def _series(tables: Tables) -> str:
    """Classes in series, each with what it would buy to mend it."""
    system = system_reliability(tables.classes)
    assert system is not None
    rows = []
    for stage, (_, mended) in zip(tables.classes, tables.mended, strict=True):
        gain = "?" if mended is None else f"{100 * float(mended):.1f}"
        rows.append([*_row(stage), gain])
    header = ["class in series", "reached", "failed", "r %", "95 %", "success if never"]
    return (
        f"{columns(header, rows)}\n"
        f"product of all r: {100 * float(system):.2f} % = "
        f"{tables.success.count} of {tables.success.total}"
    )


def _stages(tables: Tables) -> str:
    ends = dict(tables.ended_in)
    rows = [
        [*_row(stage), str(ends.get(stage.name, "-"))]
        for stage in tables.stages
        if stage.failed or ends.get(stage.name)
    ]
    if not rows:
        return "no run ended in any stage"
    header = ["stage of the task", "reached", "no further", "r %", "95 %", "ended in"]
    return columns(header, rows)


def _row(stage: Stage) -> list[str]:
    passed = Share(stage.reached - stage.failed, stage.reached)
    name = stage.name.replace("_", " ")
    return [name, str(stage.reached), str(stage.failed), *_percent(passed)]


def _checks(tables: Tables) -> str:
    rows = [[name.replace("_", " "), str(count)] for name, count in tables.checks]
    return columns(["must be 0", "count"], rows)


def flights_text(groups: Sequence[FlightGroup]) -> str:
    """How often grasps held, a table for each property of the flights."""
    tables: dict[str, list[list[str]]] = {}
    for group in groups:
        held = group.held
        told = ", ".join(
            f"{count} {name.replace('_', ' ')}"
            for name, count in group.failures.items()
        )
        row = [group.name or "-", f"{held.count}/{held.total}", *_percent(held)]
        row += [str(group.pulled_clear), told]
        tables.setdefault(group.by, []).append(row)
    return "\n\n".join(
        columns([by, "held", "%", "95 %", "pulled clear", "failures"], rows)
        for by, rows in tables.items()
    )


def _percent(share: Share) -> tuple[str, str]:
    if not share.total:
        return "-", "-"
    low, high = share.interval
    return f"{100 * share.value:.1f}", f"{100 * low:.0f} to {100 * high:.0f}"


def comparison_text(rows: Sequence[Comparison], by: str = "outcome") -> str:
    """Two campaigns beside each other; ``*`` marks what is no accident."""
    lines = []
    for row in rows:
        name = row.name.replace("_", " ") if by == "outcome" else row.name
        low, high = row.interval
        difference, interval = "-", "-"
        if row.old.total and row.new.total:
            difference = f"{100 * row.difference:+.1f}"
            interval = f"{100 * low:+.0f} to {100 * high:+.0f}"
        lines.append(
            [
                name or "-",
                f"{row.old.count} of {row.old.total}",
                _percent(row.old)[0],
                f"{row.new.count} of {row.new.total}",
                _percent(row.new)[0],
                difference,
                interval,
                "*" if row.is_clear else "",
            ]
        )
    header = [by, "old", "%", "new", "% ", "difference", "95 %", ""]
    mark = "\n* the interval leaves 0 out" if any(row.is_clear for row in rows) else ""
    return columns(header, lines) + mark


def same_scenes_text(same: SameScenes) -> str:
    """Which runs of the same scenes only one of two campaigns did."""
    gained, lost = (_named(names) for names in (same.gained, same.lost))
    return (
        f"of {counted(same.runs, 'run')} of the same scenes {gained} in the new one "
        f"alone and {lost} in the old one alone; luck alone is as unequal in "
        f"{100 * same.chance:.3g} % of all cases"
    )


def _named(names: Sequence[str]) -> str:
    shown = ", ".join(names[:_MOST_NAMES])
    more = ", ..." if len(names) > _MOST_NAMES else ""
    return f"{len(names)} succeed{f' ({shown}{more})' if names else ''}"


def draw_tables(
    path: str | os.PathLike[str], title: str, note: str, tables: Tables
) -> None:
    """Write the tables as a picture."""
    system = system_reliability(tables.classes)
    assert system is not None
    total = tables.success.total
    mended = []
    for name, value in tables.mended:
        share = float("nan") if value is None else float(value)
        words = "?" if value is None else f"{100 * share:.1f} %"
        mended.append(Bar(name, share, share, share, words))
    campaign_png(
        path,
        title,
        note,
        of_all=[_bar(name, share) for name, share in tables.of_all],
        of_grasps=[_bar(name, share) for name, share in tables.of_grasps],
        stages=[
            _bar(s.name, Share(s.reached - s.failed, s.reached)) for s in tables.classes
        ],
        mended=mended,
        system=float(system) if total else 0.0,
    )


def _bar(name: str, share: Share) -> Bar:
    low, high = share.interval
    return Bar(name, share.value, low, high, f"{share.count} of {share.total}")
