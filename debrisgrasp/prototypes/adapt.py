"""A dictionary for another hand: the shapes that there are, taken by its fingers."""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass, fields, replace
from itertools import chain, count
from typing import Any, cast

import numpy as np

from debrisgrasp._checked import checked
from debrisgrasp.errors import ChoiceError, ConfigError
from debrisgrasp.geometry import SE3

from .check import Finding
from .gripper import GripperModel
from .library import PrototypeLibrary
from .likeness import duplicates
from .placing import Grip, grip_depths, placed
from .prototype import KINDS, PrototypeDefinition
from .shapes import SHAPES, BarShape, CylinderShape, EdgeShape, RimShape, Shape
from .surface_shape import SurfaceShape

__all__ = ["Adaptation", "adapt"]

_BESIDE = 0.04
"""How far a shape that goes on reaches beyond the fingers on each side [m]."""
_ANOTHER = 0.02
"""Two depths of one shape in the hand are two prototypes from here on [m]."""
_LONGEST_NAME = 60
"""So much of a hand's name goes into those of its prototypes, which name files."""
_TOLD = {"bar": ("width", "height"), "box": ("width", "length", "height")}
"""Sizes that a name tells; of other shapes the first that they have."""
_WORDS: dict[Grip, str] = {
    "tip": "between the fingertips",
    "deep": "as deep as the ground allows",
}


@dataclass(frozen=True, slots=True, eq=False)
class Adaptation:
    """What `adapt` made, and what it could not make."""

    library: PrototypeLibrary
    """The new prototypes; `check` finds nothing about any of them."""
    left_out: tuple[Finding, ...]
    """Prototypes whose shapes the hand can't take, and why."""


@checked
def adapt(
    source: PrototypeLibrary,
    gripper: GripperModel,
    *,
    preshape: str | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> Adaptation:
    """Make prototypes of a hand from the shapes of those of others.

    Each shape is taken between the fingertips and, where that is another grasp, as deep
    as is possible with the fingertips on the ground that it lies on. Of the preshapes
    the first in the hand's file with which `check` finds nothing is used. Bars, pipes
    and edges that go on are cut to the breadth of the hand. Of prototypes that are
    alike one is kept.

    Parameters
    ----------
    source
        Whose shapes, for instance ``PrototypeLibrary.load()``: those that ship.
    preshape
        Only this one, whose name that of each prototype then has.
    progress
        Called with the name of a prototype of the source and the share done.

    Raises
    ------
    ChoiceError
        If the source has no prototype.
    ConfigError
        If the palm frame of the hand can't be where its file has it.
    InputError
        If an argument is not what its annotation says.
    UnknownNameError
        If the hand has no such preshape.
    """
    if not len(source):
        raise ChoiceError("prototypes", got="none", expected="at least one")
    if gripper.palm_doubt:
        raise ConfigError(
            f"base of {gripper.name}",
            got=f"a doubtful palm frame ({gripper.palm_doubt})",
            expected="one in which shapes can be placed before the palm",
        )
    preshapes = [gripper.preshape(preshape).name] if preshape else gripper.preshapes
    hand = gripper.name if preshape is None else f"{gripper.name}_{preshape}"
    made: dict[str, PrototypeDefinition] = {}
    left_out, seen = [], set()
    # A shape that is generic in one prototype is, whatever it is in others.
    generic_first = sorted(source, key=lambda each: KINDS.index(each.kind))
    for number, prototype in enumerate(generic_first):
        if progress is not None:
            progress(prototype.name, number / len(source))
        definition = prototype.definition
        if isinstance(definition.shape, SurfaceShape):
            problem = "points as its hand held them; record them with this hand"
            left_out.append(Finding(prototype.name, problem))
            continue
        key = _cut(definition.shape, 0.0), definition.T_hand_shape.R.round(6).tobytes()
        if key in seen:
            continue
        seen.add(key)
        taken, problem = _taken(definition, gripper, preshapes)
        if not taken:
            left_out.append(Finding(prototype.name, problem))
        for grip, each in taken.items():
            name = _free_name(_name(hand, each, grip), made)
            text = f"the shape of {prototype.name}, {_WORDS[grip]}"
            made[name] = replace(each, name=name, tags=(grip,), description=text)
    if progress is not None:
        progress("all shapes", 1.0)
    hands = {**source.grippers, gripper.name: gripper}
    library = PrototypeLibrary.build(made.values(), hands)
    return Adaptation(_without_twins(library), tuple(left_out))


def _taken(
    definition: PrototypeDefinition, gripper: GripperModel, preshapes: Iterable[str]
) -> tuple[dict[Grip, PrototypeDefinition], str]:
    """Prototypes of one shape by grip, or what a preshape of about its size lacks."""
    problem = ""
    for name in preshapes:
        least, most = gripper.preshape(name).widths
        thickness = _sizes(definition.shape)[1][0]
        if not least <= thickness <= most:
            bound = f"{1e3 * most:.0f} mm at most"
            if thickness < least:
                bound = f"{1e3 * least:.0f} mm at least"
            problem = problem or (
                f"{1e3 * thickness:.0f} mm thick, and preshape {name} takes {bound}"
            )
            continue
        own = _in_hand(definition, gripper, name)
        depths = grip_depths(own, gripper)
        grips: list[Grip] = ["tip"]
        # Marked objects are few, and what holds them is next to their near side.
        is_other = depths["tip"] - depths["deep"] >= _ANOTHER
        if own.kind == "generic" and is_other:
            grips.append("deep")
        found = {grip: placed(own, gripper, grip) for grip in grips}
        sound = {grip: each for grip, (each, faults) in found.items() if not faults}
        if sound:
            return sound, ""
        problem = str(found["tip"][1][0])
    return {}, problem


def _in_hand(
    definition: PrototypeDefinition, gripper: GripperModel, preshape: str
) -> PrototypeDefinition:
    """Return a shape before the palm of another hand, cut to the breadth of that."""
    middle = sum(gripper.preshape(preshape).widths) / 2
    breadth = 2 * float(gripper.closing_region(preshape, middle).half_extents[1])
    return replace(
        definition,
        gripper=gripper.name,
        preshape=preshape,
        width=middle,
        opening=float(gripper.preshape(preshape).openings[0]),
        shape=_cut(definition.shape, breadth + 2 * _BESIDE),
        T_hand_shape=SE3.from_parts(definition.T_hand_shape.R),
    )


def _cut(shape: Shape, length: float) -> Shape:
    """Shorten what goes on beyond its ends, to whole centimetres, 10 at least."""
    goes_on = isinstance(shape, BarShape | RimShape) or (
        isinstance(shape, CylinderShape | EdgeShape) and shape.ends == "open"
    )
    if not goes_on:
        return shape
    most = float(np.floor(1e2 * max(length, 0.1)) / 1e2)
    cut: Shape = replace(cast(Any, shape), length=min(cast(Any, shape).length, most))
    return cut


def _sizes(shape: Shape) -> tuple[str, list[float]]:
    """Kind of a shape, and its sizes [m]; the fingers close on the first."""
    kind = next(name for name, kind in SHAPES.items() if type(shape) is kind)
    first = fields(cast(Any, shape))[0].name
    return kind, [getattr(shape, name) for name in _TOLD.get(kind, (first,))]


def _name(hand: str, definition: PrototypeDefinition, grip: Grip) -> str:
    """Hand, shape, what the fingers close on [mm], and how."""
    shape, R = definition.shape, definition.T_hand_shape.R
    kind, sizes = _sizes(shape)
    hand = re.sub("[^a-z0-9]+", "_", hand.lower()).strip("_")
    words = [hand[:_LONGEST_NAME].rstrip("_") or "hand", kind]
    words.append("x".join(f"{1e3 * size:03.0f}" for size in sizes))
    ends = getattr(shape, "ends", "open")
    if abs(R[2, 1]) > np.cos(np.pi / 4):
        words.append("end")
    elif ends != "open":
        words.append(ends)
    elif np.trace(R) < 3.0 - 1e-6:
        words.append("turned")
    return "_".join([*words, *(["deep"] if grip == "deep" else [])])


def _free_name(name: str, taken: Container[str]) -> str:
    others = (f"{name}_{number}" for number in count(2))
    return next(each for each in chain([name], others) if each not in taken)


def _without_twins(library: PrototypeLibrary) -> PrototypeLibrary:
    dropped: set[str] = set()
    for pair in duplicates(library.prototypes):
        if not dropped.intersection(pair.names):
            dropped.add(pair.names[1])
    return library.select(names=[n for n in library.names if n not in dropped])
