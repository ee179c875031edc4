"""The kinds of debris: what they are made of, how large and how heavy they come."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import Rng, require_range
from debrisgrasp._checked import checked
from debrisgrasp.errors import InputError, UnknownNameError

from . import shapes
from .body import Body, Part

__all__ = ["KINDS", "Kind", "draw_body", "make_body"]

_COUNTS = ("bays", "rungs", "slats")
_MOST = 50
_THINNEST, _LONGEST = 0.001, 5.0
"""Between these all lengths are [m]; beyond, they are most likely millimetres."""
_WOOD = (181, 142, 92)
_STEEL = (140, 146, 152)
_CONCRETE = (165, 163, 158)


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of debris."""

    shape: Callable[..., tuple[Part, ...]]
    """Builds the convex parts from the sizes."""
    sizes: Mapping[str, tuple[float, float]]
    """Range of each argument of ``shape``; lengths in [m], counts whole."""
    mass: tuple[float, float]
    """Range of the mass [kg]."""
    color: tuple[int, int, int]
    """Red, green, blue of the material."""


KINDS: Mapping[str, Kind] = {
    "truss_ladder": Kind(
        shapes.flat_truss,
        {"length": (0.6, 1.2), "depth": (0.14, 0.26), "radius": (0.01, 0.018),
         "bays": (3, 6)},
        (1.5, 4.0),
        _STEEL,
    ),
    "truss_triangle": Kind(
        shapes.triangular_truss,
        {"length": (0.5, 1.0), "side": (0.14, 0.24), "radius": (0.009, 0.015),
         "bays": (2, 4)},
        (2.0, 5.0),
        _STEEL,
    ),
    "lumber_2x4": Kind(
        shapes.bar,
        {"length": (0.4, 1.1), "width": (0.089, 0.089), "height": (0.038, 0.038)},
        (0.7, 2.0),
        _WOOD,
    ),
    "lumber_4x4": Kind(
        shapes.bar,
        {"length": (0.35, 0.8), "width": (0.089, 0.089), "height": (0.089, 0.089)},
        (1.5, 3.5),
        _WOOD,
    ),
    "board": Kind(
        shapes.bar,
        {"length": (0.35, 0.9), "width": (0.15, 0.45), "height": (0.012, 0.025)},
        (0.8, 4.0),
        (201, 170, 120),
    ),
    "pallet": Kind(
        shapes.pallet,
        {"length": (0.5, 0.8), "width": (0.4, 0.6), "height": (0.1, 0.14),
         "slats": (4, 5)},
        (5.0, 8.0),
        (170, 135, 90),
    ),
    "ladder": Kind(
        shapes.ladder,
        {"length": (0.8, 1.3), "width": (0.28, 0.4), "rungs": (3, 5)},
        (2.5, 5.0),
        (176, 180, 184),
    ),
    "pipe": Kind(
        shapes.rod,
        {"length": (0.4, 1.0), "radius": (0.02, 0.055)},
        (0.8, 4.0),
        (120, 128, 134),
    ),
    "pipe_wide": Kind(
        shapes.tube,
        {"length": (0.35, 0.6), "radius": (0.07, 0.11), "wall": (0.006, 0.012)},
        (1.0, 4.0),
        (196, 120, 60),
    ),
    "pipe_elbow": Kind(
        shapes.elbow,
        {"length": (0.25, 0.45), "arm": (0.15, 0.25), "radius": (0.025, 0.05)},
        (0.8, 3.0),
        (92, 104, 112),
    ),
    "cone": Kind(
        shapes.traffic_cone,
        {"height": (0.45, 0.7), "base": (0.26, 0.36), "radius": (0.08, 0.13)},
        (1.0, 3.0),
        (230, 96, 36),
    ),
    "bucket": Kind(
        shapes.bucket,
        {"height": (0.22, 0.36), "radius_low": (0.09, 0.13),
         "radius_high": (0.12, 0.15), "wall": (0.004, 0.008)},
        (0.6, 1.5),
        (60, 110, 180),
    ),
    "cinder_block": Kind(
        shapes.cinder_block,
        {"length": (0.36, 0.4), "width": (0.14, 0.2), "height": (0.18, 0.2),
         "wall": (0.028, 0.035)},
        (5.0, 8.0),
        _CONCRETE,
    ),
    "brick": Kind(
        shapes.bar,
        {"length": (0.19, 0.24), "width": (0.09, 0.115), "height": (0.055, 0.075)},
        (1.8, 3.2),
        (165, 80, 60),
    ),
    "crate": Kind(
        shapes.crate,
        {"length": (0.3, 0.45), "width": (0.22, 0.34), "height": (0.18, 0.28),
         "wall": (0.008, 0.014)},
        (0.8, 3.0),
        (80, 130, 90),
    ),
    "crate_handle": Kind(
        shapes.crate_with_handle,
        {"length": (0.3, 0.45), "width": (0.22, 0.34), "height": (0.18, 0.28),
         "wall": (0.01, 0.014), "rise": (0.09, 0.14), "grip": (0.011, 0.017)},
        (1.0, 4.0),
        (90, 120, 70),
    ),
    "hedgehog": Kind(
        shapes.hedgehog,
        {"length": (0.5, 0.8), "flange": (0.05, 0.08), "wall": (0.008, 0.012)},
        (4.0, 8.0),
        (110, 84, 70),
    ),
    "barrier": Kind(
        shapes.folding_barrier,
        {"width": (0.6, 0.9), "height": (0.6, 0.85), "board": (0.14, 0.2),
         "spread": (0.35, 0.6)},
        (4.0, 8.0),
        (225, 175, 40),
    ),
    "jersey": Kind(
        shapes.jersey_barrier,
        {"length": (0.5, 0.8), "height": (0.35, 0.5), "base": (0.24, 0.34)},
        (5.0, 8.0),
        (215, 110, 50),
    ),
}  # fmt: skip
"""All kinds by name. The masses are what a manipulator of 1 m reach can carry; bricks
and blocks are the light (aerated) ones, barriers the plastic ones."""


@checked
def make_body(
    kind: str, sizes: Mapping[str, float], mass: float, *, name: str | None = None
) -> Body:
    """Build a body of a kind, its frame at its centre of mass.

    Parameters
    ----------
    kind
        One of `KINDS`.
    sizes
        One value for each of ``KINDS[kind].sizes``, which tells the usual range of
        each: lengths in [m], and whole counts of bays, rungs or slats.
    mass
        [kg].
    name
        Of the body; its kind by default.

    Raises
    ------
    UnknownNameError
        If there is no such kind.
    InputError
        If sizes are missing, unknown, out of range, or don't fit together.
    """
    if kind not in KINDS:
        raise UnknownNameError("kind of debris", kind, KINDS)
    known = KINDS[kind].sizes
    if set(sizes) != set(known):
        raise InputError(
            f"sizes of a {kind}", got=sorted(sizes), expected=", ".join(known)
        )
    for size, value in sizes.items():
        if size in _COUNTS:
            require_range(f"{size} of a {kind}", value, 1, _MOST)
            if value != round(value):
                raise InputError(f"{size} of a {kind}", got=value, expected="a count")
        else:
            require_range(f"{size} of a {kind} [m]", value, _THINNEST, _LONGEST)
    try:
        parts = KINDS[kind].shape(**sizes)
    except InputError as error:
        raise InputError(
            f"sizes of a {kind}",
            got=dict(sizes),
            expected="sizes that fit together",
            mend=f"They give {error.what} of {error.got}.",
        ) from error
    body = Body(name or kind, kind, parts, mass, color=KINDS[kind].color, sizes=sizes)
    return body.recentered()


@checked
def draw_body(
    kind: str, *, rng: Rng, name: str | None = None, mass: float | None = None
) -> Body:
    """Draw a body of a kind, its sizes and, unless given, its mass [kg] at random.

    Raises
    ------
    UnknownNameError
        If there is no such kind.
    """
    if kind not in KINDS:
        raise UnknownNameError("kind of debris", kind, KINDS)
    ranges = KINDS[kind].sizes
    sizes = {
        size: float(rng.integers(int(low), int(high) + 1))
        if size in _COUNTS
        else float(rng.uniform(low, high))
        for size, (low, high) in ranges.items()
    }
    if mass is None:
        mass = float(np.exp(rng.uniform(*np.log(KINDS[kind].mass))))
    return make_body(kind, sizes, mass, name=name)
