"""``prototype adapt``: a dictionary for another hand."""

from __future__ import annotations

import argparse
import json
from typing import Any

from debrisgrasp._files import require_new_folder
from debrisgrasp._words import counted
from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.prototypes import FURTHER_HANDS, PrototypeLibrary, adapt

from .capture_arguments import progress
from .site_arguments import add_grippers, add_site, hands_of, site_of
from .tables import columns
from .values import some_path

__all__ = ["add_adapt"]


def add_adapt(actions: Any) -> None:
    """Add ``adapt``."""
    parser = actions.add_parser(
        "adapt",
        help="a dictionary for another hand, of the shapes that there are",
        description="Make prototypes of a hand from the shapes of other hands' "
        "prototypes; what `check` finds something about is left out.",
    )
    parser.add_argument("--gripper", help="the hand (default: the site's)")
    parser.add_argument(
        "--preshape", help="of the fingers; default: the first that fits"
    )
    parser.add_argument(
        "--out", required=True, type=some_path, metavar="DIR", help="a new folder"
    )
    parser.add_argument(
        "--shapes",
        type=some_path,
        metavar="DIR",
        help="folder of prototypes whose shapes are taken (default: those shipped)",
    )
    add_grippers(parser)
    add_site(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=run_adapt)


def run_adapt(arguments: argparse.Namespace) -> int:
    """Make a dictionary for a hand; status 1 if it takes none of the shapes."""
    require_new_folder(arguments.out)
    hands, name = hands_of(arguments), site_of(arguments).gripper
    if name is None:
        raise ConfigError(
            "--gripper", got="nothing", expected="a hand", mend=FURTHER_HANDS
        )
    if name not in hands:
        raise UnknownNameError("--gripper", name, hands, mend=FURTHER_HANDS)
    source = PrototypeLibrary.load(arguments.shapes, grippers=hands)
    made = adapt(
        source,
        hands[name],
        preshape=arguments.preshape,
        progress=progress(arguments),
    )
    library = made.library
    if len(library):
        library.save(arguments.out)
    if arguments.json:
        left_out = {finding.prototype: str(finding) for finding in made.left_out}
        facts = {"prototypes": list(library.names), "left_out": left_out}
        print(json.dumps(facts, indent=1))
        return 0 if len(library) else 1
    header = ["prototype", "preshape", "closes to [mm]", "opens [mm]"]
    rows = [
        [p.name, p.preshape, f"{1e3 * p.width:.0f}", f"{1e3 * p.opening:.0f}"]
        for p in library
    ]
    if rows:
        print(columns(header, rows) + "\n")
    for finding in made.left_out:
        print(f"left out {finding.prototype}: {finding}")
    number = counted(len(library), "prototype")
    where = f"wrote {arguments.out}" if len(library) else "wrote nothing"
    print(f"{number} for {name}; {where}")
    return 0 if len(library) else 1
