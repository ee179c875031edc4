"""What every benchmark prints, and what it writes with ``--json``."""

from __future__ import annotations

import argparse
import json
import platform
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import debrisgrasp
from debrisgrasp.cli.tables import columns
from debrisgrasp.errors import MissingExtraError

__all__ = ["arguments", "begin", "publish"]


def arguments(description: str) -> argparse.Namespace:
    """Parse the arguments that all benchmarks share."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help="figures for machines"
    )
    return parser.parse_args()


def publish(figures: Mapping[str, float], json_path: Path | None) -> None:
    """Print the figures as a table, and write them as JSON if a path is given."""
    print(columns(["figure", "value"], [[k, f"{v:.4g}"] for k, v in figures.items()]))
    if json_path is not None:
        content = {
            "figures": dict(figures),
            "machine": f"{platform.machine()} {platform.system()}",
            "version": debrisgrasp.__version__,
        }
        json_path.write_text(json.dumps(content, indent=1) + "\n")


def begin(main: Callable[[], None]) -> None:
    """Begin a benchmark; an extra that it lacks is told in one line, with status 2."""
    try:
        main()
    except MissingExtraError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
