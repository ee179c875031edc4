"""The command ``prototype``: look at the dictionary, check it, and add to it."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from debrisgrasp._words import counted
from debrisgrasp.prototypes import (
    GraspPrototype,
    PrototypeLibrary,
    check,
    coverage,
    duplicates,
    half_turns,
    load_grippers,
)

from .prototype_adapt import add_adapt
from .prototype_learn import add_learn
from .prototype_makers import add_makers
from .reports import (
    PICTURE_FORMS,
    REPORT_FORMS,
    require_places,
    write_coverage,
    write_prototype_sheet,
)
from .site_arguments import add_grippers, add_site, site_of
from .tables import columns
from .values import some_path

__all__ = ["add"]


def add(parser: argparse.ArgumentParser) -> None:
    """Add ``prototype`` and its actions."""
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")

    listing = actions.add_parser("list", help="names and sizes")
    listing.set_defaults(run=run_list)

    show = actions.add_parser("show", help="picture of prototypes with their hands")
    show.add_argument("names", nargs="*", help="or a folder of them; default: all")
    show.add_argument(
        "--out",
        type=some_path,
        default=Path("prototypes.png"),
        metavar="FILE",
        help="picture as .png, or page as .html (default: prototypes.png)",
    )
    show.set_defaults(run=run_show)

    checking = actions.add_parser(
        "check", help="does each fit its hand? can the hand close on it?"
    )
    checking.add_argument("names", nargs="*", help="or a folder of them; default: all")
    checking.set_defaults(run=run_check)

    covering = actions.add_parser(
        "coverage", help="which sizes are covered, by hand and approach, and the gaps"
    )
    covering.add_argument("--out", type=some_path, metavar="FILE", help="map as .png")
    covering.set_defaults(run=run_coverage)

    for action in (listing, show, checking, covering):
        action.add_argument(
            "--prototypes",
            type=some_path,
            metavar="DIR",
            help="folder of files (default: the site's, or shipped)",
        )
        add_grippers(action)
        add_site(action)
        action.add_argument("--json", action="store_true", help="print JSON")
    add_makers(actions)
    add_adapt(actions)
    add_learn(actions)


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
    require_places([arguments.out], REPORT_FORMS)
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
    twins = duplicates(prototypes.prototypes, _library(arguments))
    if arguments.json:
        facts = {name: [str(f) for f in found] for name, found in findings.items()}
        for pair in twins:
            facts[pair.names[0]].append(str(pair))
        print(json.dumps(facts))
        return 1 if n_findings else 0
    for name, found in findings.items():
        for finding in found:
            print(f"{name}: {finding}")
    for pair in twins:
        print(f"{pair.names[0]}: {pair}")
    if arguments.names and not _folder(arguments):
        for prototype in prototypes:
            turns = ", ".join(half_turns(prototype)) or "none"
            print(f"{prototype.name}: half turns that change nothing: {turns}")
    print(
        f"{counted(len(prototypes), 'prototype')} checked, "
        f"{counted(n_findings, 'finding')}, {counted(len(twins), 'near duplicate')}"
    )
    return 1 if n_findings else 0


def run_coverage(arguments: argparse.Namespace) -> int:
    """Say which sizes the dictionary covers."""
    require_places([arguments.out], PICTURE_FORMS)
    library = _library(arguments)
    found = coverage(library, library.grippers)
    if arguments.out:
        write_coverage(arguments.out, found)
    if arguments.json:
        sizes = [round(float(size), 3) for size in found.sizes]
        rows = [
            {"hand": hand, "approach": approach, "prototypes": counts.tolist()}
            for (hand, approach), counts in zip(found.rows, found.counts, strict=True)
        ]
        print(json.dumps({"sizes": sizes, "rows": rows, "gaps": list(found.gaps())}))
        return 0
    header = ["hand", "approach", *(f"{100 * size:.0f}" for size in found.sizes)]
    table = [
        [
            hand,
            approach,
            *(
                str(count) if count else "-" if usable else "."
                for count, usable in zip(counts, in_range, strict=True)
            ),
        ]
        for (hand, approach), counts, in_range in zip(
            found.rows, found.counts, found.in_range, strict=True
        )
    ]
    print(columns(header, table))
    print("\nprototypes within 1 cm of each size [cm]; - a gap, . out of range\n")
    for gap in found.gaps():
        print(f"gap: {gap}")
    if arguments.out:
        print(f"wrote {arguments.out}")
    return 0


def _library(arguments: argparse.Namespace) -> PrototypeLibrary:
    settings = site_of(arguments)
    hands = load_grippers(settings.grippers)
    folder = _folder(arguments) or settings.prototypes
    return PrototypeLibrary.load(folder, grippers=hands)


def _folder(arguments: argparse.Namespace) -> Path | None:
    """Folder, or file, that stands in the place of names; None for names."""
    names = getattr(arguments, "names", [])
    if len(names) != 1 or arguments.prototypes or not Path(names[0]).exists():
        return None
    return Path(names[0])


def _chosen(arguments: argparse.Namespace) -> PrototypeLibrary:
    names = None if _folder(arguments) else arguments.names or None
    return _library(arguments).select(names=names)


def _facts(prototype: GraspPrototype) -> dict[str, object]:
    return {
        "name": prototype.name,
        "gripper": prototype.gripper,
        "preshape": prototype.preshape,
        "width": prototype.width,
        "opening": prototype.opening,
        "kind": prototype.kind,
    }
