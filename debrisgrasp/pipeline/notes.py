"""What the reader of a plan should know of how it came about."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from debrisgrasp._arrays import BoolArray
from debrisgrasp._words import arm_called, shortened
from debrisgrasp.kinematics import ArmReach, mobility
from debrisgrasp.planning import PlannerConfig
from debrisgrasp.prototypes import GraspPrototype
from debrisgrasp.segmentation import (
    WHOLE_SHARE,
    Candidate,
    GroundReport,
    PointKind,
    Segmentation,
)

from .second_look import BestSoFar

__all__ = [
    "deadline_notes",
    "ground_notes",
    "mask_notes",
    "mass_notes",
    "part_notes",
    "pipeline_notes",
    "warning_notes",
]

_DUG = 0.02
"""A pit with fewer points than this, in shares of the ground, may be a reflection."""
_LIGHT = 0.05
"""Debris is hardly ever lighter: a tenth of what most pieces weigh at least [kg]."""


def deadline_notes(deadline: float | None, *, is_cut: bool) -> tuple[str, ...]:
    """Say that a deadline [s] cut the search short, if it did."""
    if deadline is None or not is_cut:
        return ()
    return (
        f"the deadline of {deadline:g} s cut the search short; "
        "a longer one may find better grasps",
    )


def ground_notes(ground: GroundReport) -> tuple[str, ...]:
    """Say what speaks against the pose of the camera, and what lies in a pit."""
    notes = []
    if ground.pose_doubt:
        notes.append(f"camera pose in doubt: {ground.pose_doubt}")
    for item in ground.surroundings:
        if item.kind is PointKind.PIT and item.n_points > _DUG * ground.n_removed:
            notes.append(
                f"{item.n_points} points lie {item.reason}, as in a trench, and are of "
                "no object: nothing there is gripped while the ground is taken away"
            )
    return tuple(notes)


def mass_notes(
    mass: float | None, best: BestSoFar, liftable: float = np.inf
) -> tuple[str, ...]:
    """Say that a given mass is too much or too little, and for what it was taken.

    Parameters
    ----------
    mass
        What the first object that was tried weighs [kg], if anybody said so.
    liftable
        What the strongest arm in use lifts [kg].
    """
    first, chosen = best.first_tried, best.target
    if mass is None or first is None:
        return ()
    notes: tuple[str, ...] = ()
    if mass > liftable:
        notes += (
            f"no arm in use lifts the {mass:.6g} kg given: the strongest lifts "
            f"{liftable:.3g} kg; is the mass in kilograms?",
        )
    if mass < _LIGHT:
        notes += (
            f"the {mass:.6g} kg given are {1e3 * mass:.3g} g: hardly any debris is so "
            "light; is the mass in kilograms?",
        )
    if len(best.tried) == 1 or (chosen is first and best.is_found):
        return notes
    words = f"the {mass:.6g} kg given were taken for object {first.label}, the first "
    if chosen is not None and best.is_found:
        words += f"tried; what object {chosen.label} weighs is estimated"
    else:
        words += "tried; what others weigh is estimated"
    return (*notes, words)


def part_notes(
    is_chosen: BoolArray, whole: BoolArray, is_marked: BoolArray | None
) -> tuple[str, ...]:
    """Say that a mask or a region holds only a part of an object, if it does.

    Parameters
    ----------
    is_chosen, whole
        Which points are sought, and which are lifted with them, shapes (n,).
    """
    share = np.count_nonzero(is_chosen) / max(1, int(np.count_nonzero(whole)))
    if share > WHOLE_SHARE:
        return ()
    holder = "region" if is_marked is None else "mask"
    return (
        f"the {holder} holds {share:.0%} of what was seen of the object: it is gripped "
        "there, and weighed and pulled out as a whole",
    )


def mask_notes(
    is_marked: BoolArray | None, segmentation: Segmentation
) -> tuple[str, ...]:
    """Say that a mask covers the ground, or several objects at once, if it does.

    Parameters
    ----------
    is_marked
        Which points the mask covers, shape (n,); None without a mask.
    segmentation
        Of the cloud with that mask.
    """
    if is_marked is None or not is_marked.any():
        return ()
    ground = 1.0 - np.count_nonzero(segmentation.labels[is_marked]) / is_marked.sum()
    if ground > 0.5:
        return (
            f"{ground:.0%} of the mask lies on the ground or on what is no object; "
            "is it the right mask?",
        )
    shares = segmentation.marked_shares
    if shares is None or len(shares) < 2:
        return ()
    told = ", ".join(f"{share:.0%}" for share in shares[:-1])
    told += f" and {shares[-1]:.0%}"
    return (
        f"the mask covers {len(shares)} objects, with {told} of what stands in it; "
        "they are taken for one",
    )


def pipeline_notes(
    arms: Sequence[ArmReach],
    prototypes: Iterable[GraspPrototype],
    config: PlannerConfig,
) -> tuple[str, ...]:
    """Say which arms no grasp was sought for, or is met by, and what scores grasps."""
    hands = {prototype.gripper for prototype in prototypes}
    notes = tuple(
        f"no grasp is sought for the {arm_called(arm.name)}: no prototype that was "
        f"tried is for its hand, {arm.gripper}"
        for arm in arms
        if arm.gripper not in hands
    )
    notes += tuple(
        f"hardly a grasp is found for the {arm_called(arm.name)}: it moves its palm in "
        f"{ways} of six ways, and grasps are sought at poses that take all six"
        for arm in arms
        if (ways := mobility(arm.chain)) < 6
    )
    if config.success is None:
        if config.similarity.measure != "evidence":
            notes += ("scores are no probabilities: they were fitted to another S",)
        return notes
    told = ", ".join(filter(None, (config.success.date, config.success.campaign)))
    told = shortened(told, most=300) or "they don't say of when, nor fitted to what"
    return (*notes, f"scores come from coefficients that were given: {told}")


def warning_notes(order: Iterable[Candidate], best: BestSoFar) -> tuple[str, ...]:
    """Pass on what the policy warns of where the object chosen is pulled out."""
    if best.target is None or not best.is_found:
        return ()
    return tuple(
        candidate.warning
        for candidate in order
        if candidate.label == best.target.label and candidate.warning
    )
