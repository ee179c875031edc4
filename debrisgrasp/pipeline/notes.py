"""What the reader of a plan should know of how it came about."""

from __future__ import annotations

import numpy as np

from debrisgrasp._arrays import BoolArray, IntArray
from debrisgrasp.segmentation import GroundReport

from .second_look import BestSoFar

__all__ = ["deadline_notes", "mask_notes", "mass_notes", "part_notes", "pose_notes"]

_MOST = 0.8
"""With such a share of its points in it, an object is in a mask as a whole."""
_SEVERAL = 0.2
"""With such a share of its points a mask covers an object, and not just touches it."""
_GRAZED = 0.02
"""Whole objects with less than such a share of its points are crumbs at its edge."""


def deadline_notes(deadline: float | None, *, is_late: bool) -> tuple[str, ...]:
    """Say that a deadline [s] cut the search short, if it did."""
    if deadline is None or not is_late:
        return ()
    return (
        f"the deadline of {deadline:g} s cut the search short; "
        "a longer one may find better grasps",
    )


def pose_notes(ground: GroundReport) -> tuple[str, ...]:
    """Say what speaks against the pose of the camera, if anything does."""
    if not ground.pose_doubt:
        return ()
    return (f"camera pose in doubt: {ground.pose_doubt}",)


def mass_notes(
    mass: float | None, best: BestSoFar, liftable: float = np.inf
) -> tuple[str, ...]:
    """Say that a given mass is too much, and for which object it was taken.

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
    if chosen is not None and chosen.label == first.label and best.is_found:
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
    if share > _MOST:
        return ()
    holder = "region" if is_marked is None else "mask"
    return (
        f"the {holder} holds {share:.0%} of what was seen of the object: it is gripped "
        "there, and weighed and pulled out as a whole",
    )


def mask_notes(is_marked: BoolArray | None, labels: IntArray) -> tuple[str, ...]:
    """Say that a mask covers the ground, or several objects at once, if it does.

    Parameters
    ----------
    is_marked
        Which points the mask covers, shape (n,); None without a mask.
    labels
        Object of each point, 0 for the ground, shape (n,).
    """
    if is_marked is None or not is_marked.any():
        return ()
    count = np.bincount(labels[is_marked], minlength=int(labels.max()) + 1)
    share = count / np.count_nonzero(is_marked)
    notes = []
    if share[0] > 0.5:
        notes.append(
            f"{share[0]:.0%} of the mask lies on the ground or on what is no object; "
            "is it the right mask?"
        )
    is_whole = (count > _MOST * np.bincount(labels)) & (share > _GRAZED)
    covered = np.flatnonzero((share > _SEVERAL) | is_whole)
    covered = covered[covered > 0]
    if len(covered) > 1:
        named = ", ".join(f"{label} ({share[label]:.0%})" for label in covered)
        notes.append(
            f"the mask covers {len(covered)} objects, {named} of it; they are taken "
            "for one"
        )
    return tuple(notes)
