"""Arguments that say which object to take first, and the policy they mean."""

from __future__ import annotations

import argparse

from debrisgrasp.segmentation import OperatorPick, SelectionPolicy
from debrisgrasp.settings import POLICIES

from .values import number

__all__ = ["add_policy", "policy_of"]


def add_policy(parser: argparse._ActionsContainer) -> None:
    """Add the arguments that order the objects."""
    parser.add_argument(
        "--policy",
        choices=POLICIES,
        help="what comes first: what carries nothing and comes out freely, or what is "
        "nearest to the priority point (Eq. 1) (default: support)",
    )
    parser.add_argument(
        "--priority-point",
        nargs=3,
        type=number,
        metavar=("X", "Y", "Z"),
        help="objects near it are preferred, base frame, metres (default: 0.9 0 1)",
    )
    parser.add_argument(
        "--pick",
        type=_pick,
        metavar="OBJECT",
        help="take this object first: its label, a pixel U,V of the depth image, or a "
        "point X,Y,Z in the base frame, metres",
    )


def policy_of(
    arguments: argparse.Namespace, others: SelectionPolicy
) -> SelectionPolicy:
    """Put what the operator picks before the order of another policy."""
    if arguments.pick is None:
        return others
    return OperatorPick(arguments.pick, others)


def _pick(text: str) -> int | tuple[int, int] | tuple[float, float, float]:
    """Parse a label, a pixel or a point."""
    parts = text.split(",")
    try:
        if len(parts) == 1:
            return int(text)
        if len(parts) == 2:
            return int(parts[0]), int(parts[1])
        x, y, z = (float(part) for part in parts)
    except ValueError as error:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a label N, a pixel U,V or a point X,Y,Z"
        ) from error
    return x, y, z
