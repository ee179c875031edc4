"""The command ``prototype``: look at the dictionary, check files written by hand."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from debrisgrasp.prototypes import (
    GraspPrototype,
    PrototypeLibrary,
    check,
    load_grippers,
)

from .reports import write_prototype_sheet
from .tables import columns

__all__ = ["add"]


def add(subparsers: Any) -> None:
    """Add ``prototype list|show|check``."""
    parser = subparsers.add_parser("prototype", help="look at and check prototypes")
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")

    listing = actions.add_parser("list", help="names and sizes")
    listing.set_defaults(run=run_list)

    show = actions.add_parser("show", help="picture of prototypes with their hands")
    show.add_argument("names", nargs="*", help="default: all")
    show.add_argument(
        "--out", type=Path, default=Path("prototypes.png"), metavar="FILE"
    )
    show.set_defaults(run=run_show)

    checking = actions.add_parser(
        "check", help="does each fit its hand? can the hand close on it?"
    )
    checking.add_argument("names", nargs="*", help="default: all")
    checking.set_defaults(run=run_check)

    for action in (listing, show, checking):
        action.add_argument(
            "--prototypes", metavar="DIR", help="folder of files (default: shipped)"
        )
        action.add_argument(
            "--grippers", metavar="DIR", help="folder of files of further hands"
        )
        action.add_argument("--json", action="store_true", help="print JSON")


def run_list(arguments: argparse.Namespace) -> int:
    """List the dictionary."""
    prototypes = _library(arguments)
    if arguments.json:
        print(json.dumps([_facts(p) for p in prototypes], indent=1))
        return 0
    header = ["name", "hand", "preshape", "width", "opening", "kind"]
    rows = [
        [
            p.name,
            p.gripper,
            p.preshape,
            f"{p.width:.3f}",
            f"{p.opening:.3f}",
            p.kind,
        ]
        for p in prototypes
    ]
    print(columns(header, rows))
    return 0


def run_show(arguments: argparse.Namespace) -> int:
    """Draw prototypes."""
    library = _chosen(arguments)
    write_prototype_sheet(arguments.out, library.prototypes, library.grippers)
    if arguments.json:
        print(json.dumps({"wrote": str(arguments.out)}))
    else:
        print(f"wrote {arguments.out}")
    return 0


def run_check(arguments: argparse.Namespace) -> int:
    """Check prototypes against their hands; status 1 if anything is found."""
    prototypes = _chosen(arguments)
    hands = prototypes.grippers
    findings = {p.name: check(p, hands[p.gripper]) for p in prototypes}
    n_findings = sum(len(found) for found in findings.values())
    if arguments.json:
        print(json.dumps({n: [str(f) for f in fs] for n, fs in findings.items()}))
        return 1 if n_findings else 0
    for name, found in findings.items():
        for finding in found:
            print(f"{name}: {finding}")
    print(f"{len(prototypes)} prototypes checked, {n_findings} findings")
    return 1 if n_findings else 0


def _library(arguments: argparse.Namespace) -> PrototypeLibrary:
    hands = load_grippers(arguments.grippers)
    return PrototypeLibrary.load(arguments.prototypes, grippers=hands)


def _chosen(arguments: argparse.Namespace) -> PrototypeLibrary:
    return _library(arguments).select(names=arguments.names or None)


def _facts(prototype: GraspPrototype) -> dict[str, object]:
    return {
        "name": prototype.name,
        "gripper": prototype.gripper,
        "preshape": prototype.preshape,
        "width": prototype.width,
        "opening": prototype.opening,
        "kind": prototype.kind,
    }
