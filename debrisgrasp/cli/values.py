"""Values of arguments: paths, numbers and boxes."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from debrisgrasp._arrays import require_metres
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import Bounds

__all__ = [
    "add_region",
    "count",
    "joint",
    "joints_of",
    "number",
    "region_of",
    "seed",
    "some_path",
    "whole",
]

_EXAMPLE = "0.7 -0.3 0 1.3 0.3 0.6"


def some_path(text: str) -> Path:
    """Parse a path; an empty one would mean the working folder."""
    if not text.strip():
        raise argparse.ArgumentTypeError("it is empty, expected a file or folder")
    return Path(text)


def number(text: str) -> float:
    """Parse a number; NaN and infinity are none."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a finite number")
    return value


def whole(text: str) -> int:
    """Parse a whole number."""
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number") from None


def count(low: int, high: int) -> Callable[[str], int]:
    """Make a parser of whole numbers whose complaint names their range.

    Whether a number is within it is checked where it is used, from Python too.
    """

    def parse(text: str) -> int:
        try:
            return whole(text)
        except argparse.ArgumentTypeError as error:
            words = f"{error}, expected {low} to {high}"
            raise argparse.ArgumentTypeError(words) from None

    return parse


def joint(text: str) -> tuple[str, float]:
    """Parse the value of a joint, ``NAME=VALUE``."""
    name, _, value = text.partition("=")
    if not name or not value:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=VALUE [rad or m]")
    return name, number(value)


def joints_of(pairs: Sequence[tuple[str, float]]) -> dict[str, float]:
    """Collect the values of joints by name.

    Raises
    ------
    ConfigError
        If a joint has two.
    """
    joints = dict(pairs)
    if len(joints) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ConfigError(
            "--joints", got=f"{twice} twice", expected="one value for each joint"
        )
    return joints


def seed(text: str) -> int:
    """Parse a seed; numpy takes no negative ones."""
    try:
        number = int(text)
    except ValueError:
        number = -1
    if number < 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not an integer of 0 or more")
    return number


def add_region(
    parser: argparse._ActionsContainer, what: str, example: str = _EXAMPLE
) -> None:
    """Add ``--region``; of its help ``what`` says what the box is for."""
    parser.add_argument(
        "--region",
        nargs=6,
        type=number,
        metavar=("X0", "Y0", "Z0", "X1", "Y1", "Z1"),
        help=f"{what}: its lower corner, then its upper one, in metres in the base "
        "frame (x forward, y left, z up from the ground under the robot), for instance "
        + example,
    )


def region_of(arguments: argparse.Namespace) -> Bounds | None:
    """Box that ``--region`` gives, if it does.

    Raises
    ------
    ConfigError
        If it can only be in millimetres.
    InputError
        If it is no box.
    """
    if arguments.region is None:
        return None
    corners = np.array(arguments.region)
    require_metres("region", corners)
    return Bounds(corners[:3], corners[3:])
