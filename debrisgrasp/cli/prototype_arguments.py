"""Arguments of ``prototype new``, ``from-mesh`` and ``record``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, get_args

from debrisgrasp.prototypes import Grip

from .capture_arguments import add_capture
from .site_arguments import add_grippers, add_site
from .values import add_region, number, some_path, whole

__all__ = ["SIZES", "add_mesh", "add_new", "add_record"]

SIZES = ("diameter", "width", "height", "length", "thickness", "depth", "standoff")
"""That shapes have; each is an option."""
_SHAPES = ("bar", "box", "cylinder", "edge", "handle", "rim")


def add_new(actions: Any) -> argparse.ArgumentParser:
    """Add ``new``."""
    parser: argparse.ArgumentParser = actions.add_parser(
        "new",
        help="from a shape and its sizes",
        description="Make a prototype of a shape; its place in the hand, its width and "
        "its opening are found by closing the fingers on it. Lengths in metres.",
    )
    parser.add_argument("--shape", required=True, choices=_SHAPES, help="its kind")
    for size in (*SIZES, "plate"):
        parser.add_argument(f"--{size}", type=number, metavar="M", help="if it has one")
    parser.add_argument("--radius", type=number, metavar="M", help="half the diameter")
    parser.add_argument(
        "--ends", help="open, closed, one or both, as the shape has them"
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--grip",
        choices=get_args(Grip),
        default="tip",
        help="near side between the fingertips, far side level with them, or near the "
        "palm (default: tip)",
    )
    where.add_argument(
        "--position",
        nargs=3,
        type=number,
        metavar=("X", "Y", "Z"),
        help="in the palm, instead",
    )
    parser.add_argument(
        "--rpy-deg", nargs=3, type=number, metavar=("R", "P", "Y"), help="turn of it"
    )
    _add_shared(parser)
    _add_site_and_json(parser)
    return parser


def add_mesh(actions: Any) -> argparse.ArgumentParser:
    """Add ``from-mesh``."""
    parser: argparse.ArgumentParser = actions.add_parser(
        "from-mesh", help="from an STL, OBJ or PLY mesh of an object"
    )
    parser.add_argument("mesh", type=some_path, help="the file")
    parser.add_argument(
        "--scale",
        type=number,
        default=1.0,
        help="metres in a unit of the file: 0.001 for millimetres (default: 1)",
    )
    hand = _add_chosen(parser)
    hand.add_argument(
        "--pose",
        metavar="POSE",
        help="palm in the frame of the mesh: x,y,z,roll,pitch,yaw or a file with a 4x4",
    )
    _add_shared(parser)
    _add_site_and_json(parser)
    return parser


def add_record(actions: Any) -> argparse.ArgumentParser:
    """Add ``record``."""
    parser: argparse.ArgumentParser = actions.add_parser(
        "record", help="from a piece of a capture and a taught or proposed hand pose"
    )
    add_capture(parser)
    parser.add_argument("--object", type=whole, metavar="N", help="this object")
    add_region(parser, "only what is in this box")
    hand = _add_chosen(parser)
    hand.add_argument(
        "--pose",
        metavar="POSE",
        help="taught palm in the base frame: x,y,z,roll,pitch,yaw or a file with a 4x4",
    )
    hand.add_argument(
        "--joints",
        metavar="NAME=VALUE,...",
        help="joint values of the arm that stands at the grasp, rad",
    )
    parser.add_argument("--robot", help="default: the site's, or roman")
    parser.add_argument("--arm", help="default: the arm that carries the hand")
    _add_shared(parser)
    return parser


def _add_shared(parser: argparse.ArgumentParser) -> None:
    """Add what all of them take: which hand, and what is written where."""
    parser.add_argument("--name", required=True, help="a-z, 0-9 and _")
    parser.add_argument("--gripper", help="default: the site's, or robotiq_3f")
    parser.add_argument("--preshape", help="of the fingers; default: what fits")
    parser.add_argument(
        "--out",
        type=some_path,
        default=Path("prototypes"),
        metavar="DIR",
        help="folder to write to (default: prototypes)",
    )
    parser.add_argument(
        "--force",
        action="store_true",
        help="replace files, and write what does not fit the hand",
    )
    parser.add_argument(
        "--kind",
        choices=("generic", "object-specific"),
        help="sought on every object, or only where a mask or region is given",
    )
    parser.add_argument("--description", default="", help="a line for its file")
    add_grippers(parser)


def _add_site_and_json(parser: argparse.ArgumentParser) -> None:
    """Add what comes with the capture where there is one."""
    add_site(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")


def _add_chosen(parser: argparse.ArgumentParser) -> Any:
    """Add how a proposed pose of the hand is chosen; return the place of given ones."""
    parser.add_argument(
        "--closed", type=number, metavar="M", help="width when closed, metres"
    )
    hand = parser.add_mutually_exclusive_group()
    hand.add_argument(
        "--choice",
        type=whole,
        default=1,
        metavar="N",
        help="which of the proposed poses to take (default: 1, the best)",
    )
    return hand
