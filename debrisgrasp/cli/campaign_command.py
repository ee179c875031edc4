"""``campaign``: many runs of the task, their outcomes, and comparisons of them."""

from __future__ import annotations

import argparse
from pathlib import Path

from .site_arguments import add_site
from .values import count, seed, some_path

__all__ = ["add"]


def add(parser: argparse.ArgumentParser) -> None:
    """Add ``campaign``."""
    parser.description = (
        "Run the task many times, with or without injected faults, and "
        "count the outcomes. The same command goes on with an interrupted campaign."
    )
    parser.add_argument(
        "--n", type=count(1, 1_000_000), default=30, help="runs (default: 30)"
    )
    parser.add_argument("--seed", type=seed, default=0, help="default: 0")
    parser.add_argument(
        "--faults",
        metavar="RATES",
        help="YAML file of fault rates, the name of a shipped one, or 'random' for one "
        "or two faults at any state of each run (default: none)",
    )
    parser.add_argument(
        "--no-recovery",
        action="store_true",
        help="end each run at its first fault instead of answering it",
    )
    parser.add_argument(
        "--world",
        choices=("fake", "mujoco"),
        default="fake",
        help="robot in memory, or physics (extra 'sim') (default: fake)",
    )
    parser.add_argument(
        "--level",
        choices=("hand", "arm"),
        default="hand",
        help="in physics: one grasp by a flying hand, or the whole task by both arms "
        "(default: hand)",
    )
    parser.add_argument(
        "--tier",
        help="kind of scene: single, few, pile, handle, or a scene of the paper; with "
        "mujoco: isolated, stacked, pile, ... (default: few, or pile)",
    )
    add_site(parser)
    parser.add_argument(
        "--max-removals",
        type=count(1, 10_000),
        metavar="N",
        help="end a run after so many",
    )
    parser.add_argument(
        "--workers",
        type=count(0, 1024),
        default=0,
        help="processes, no more than runs (default: 0, one for each core)",
    )
    parser.add_argument(
        "--cluster", metavar="ADDRESS", help="Dask scheduler instead (extra 'cluster')"
    )
    parser.add_argument(
        "--out",
        type=some_path,
        default=Path("campaign"),
        metavar="DIR",
        help="records, results.json, results.csv, campaign.png (default: campaign)",
    )
    parser.add_argument(
        "--compare",
        nargs=2,
        type=some_path,
        metavar=("OLD", "NEW"),
        help="compare two campaigns (folders or results.json) instead of running one",
    )
    parser.add_argument("--json", action="store_true", help="tables for machines")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run or compare campaigns."""
    from .campaign_running import run_campaigns  # slow to load

    return run_campaigns(arguments)
