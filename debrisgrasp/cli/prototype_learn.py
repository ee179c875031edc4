"""``prototype learn``: a dictionary from recorded grasps."""

from __future__ import annotations

import argparse
import json
import os
from typing import Any

from debrisgrasp._files import require_new_folder
from debrisgrasp._words import counted
from debrisgrasp.errors import ConfigError
from debrisgrasp.workbench import LearnConfig, learn, load_records

from .site_arguments import add_grippers, add_site, hands_of
from .tables import columns
from .values import number, some_path, whole

__all__ = ["add_learn"]

_DEFAULT = LearnConfig()


def add_learn(actions: Any) -> None:
    """Add ``learn``."""
    learning = actions.add_parser(
        "learn", help="a dictionary from recorded grasps and their outcomes"
    )
    learning.add_argument(
        "runs",
        nargs="+",
        type=some_path,
        help="folders with grasps.jsonl and surfaces/",
    )
    learning.add_argument(
        "--out", required=True, type=some_path, metavar="DIR", help="a new folder"
    )
    learning.add_argument(
        "--radius",
        type=number,
        default=_DEFAULT.radius,
        metavar="M",
        help="surfaces within this distance are of one kind (default: %(default)s)",
    )
    learning.add_argument(
        "--least",
        type=whole,
        default=_DEFAULT.least,
        metavar="N",
        help="grasps that a kind needs (default: %(default)s)",
    )
    learning.add_argument(
        "--least-rate",
        type=number,
        default=_DEFAULT.least_rate,
        metavar="SHARE",
        help="share of them that must have held (default: %(default)s)",
    )
    add_grippers(learning)
    add_site(learning)
    learning.add_argument("--json", action="store_true", help="print JSON")
    learning.set_defaults(run=run_learn)


def run_learn(arguments: argparse.Namespace) -> int:
    """Learn a dictionary from recorded grasps."""
    require_new_folder(arguments.out)
    config = LearnConfig(
        radius=arguments.radius,
        least=arguments.least,
        least_rate=arguments.least_rate,
    )
    folders = [os.path.realpath(folder) for folder in arguments.runs]
    if len(set(folders)) < len(folders):
        raise ConfigError(
            "folders of records",
            got="one twice, whose grasps would count double",
            expected="each once",
        )
    records = [each for folder in arguments.runs for each in load_records(folder)]
    learned = learn(records, hands_of(arguments), config)
    learned.library.save(arguments.out)
    header = ["prototype", "hand", "preshape", "grasps", "held", "rate"]
    rows = [
        [
            cluster.name or "-",
            cluster.gripper,
            cluster.preshape,
            str(len(cluster.members)),
            str(cluster.held),
            f"{cluster.rate:.2f}",
        ]
        for cluster in learned.clusters
    ]
    if arguments.json:
        facts = [dict(zip(header, row, strict=True)) for row in rows]
        print(json.dumps({"covered": round(learned.covered, 4), "kinds": facts}))
        return 0
    print(columns(header, rows))
    print(
        f"\n{counted(len(learned.library), 'prototype')} from "
        f"{counted(len(records), 'grasp')}; "
        f"{learned.covered:.0%} of the held ones are of these kinds"
    )
    print(f"wrote {arguments.out}")
    return 0
