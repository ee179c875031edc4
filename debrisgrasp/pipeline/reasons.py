"""Why an object is passed over, and why a plan is empty, in words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._words import counted
from debrisgrasp.geometry import MAX_CELLS, Bounds, voxel_count
from debrisgrasp.kinematics import KinematicChain
from debrisgrasp.planning import PassedOver, SceneConfig
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.segmentation import GroundConfig, GroundReport, Segmentation

from .config import PipelineConfig

__all__ = [
    "NOT_TRIED",
    "is_ground",
    "too_far",
    "too_large",
    "too_small",
    "unfit",
    "why_empty",
]

NOT_TRIED = "not tried: the deadline had passed"
_FAR = 1.5
"""What is so far beyond the arms is not worth a search, nor advice on it [m]."""
_MOSTLY = 0.9
"""Share of an object's points in the plane of the ground that makes it ground."""


def too_small(points: FloatArray, spacing: float, least: int) -> str | None:
    """Reason to pass over points (n, 3) of an object that fill few cells, or None.

    Parameters
    ----------
    spacing
        Edge of a cell [m].
    least
        Number of cells from which on it is worth a search.
    """
    n_cells = voxel_count(points, spacing)
    return None if n_cells >= least else _small([n_cells], least)


def _small(counts: Sequence[int], least: int) -> str:
    """One reason for all that are too small: a sparse cloud holds dozens."""
    fewest, most = min(counts), max(counts)
    between = f"{fewest} to " if fewest < most else ""
    seen = f"{between}{counted(most, 'cell')}"
    return f"too small: {seen} of surface seen, {least} are needed"


def too_large(region: Bounds, config: SceneConfig) -> str | None:
    """Reason to pass over an object whose region fills too many cells, or None."""
    size = region.size + 2 * config.hand_reach
    cells = float(np.prod(size / config.spacing + 3))
    if cells <= MAX_CELLS:
        return None
    sides = " x ".join(f"{side:.2f}" for side in region.size)
    return (
        f"too large: {cells / 1e6:.0f} million cells, at most {MAX_CELLS / 1e6:.0f}, "
        f"in a region of {sides} m and {config.hand_reach:g} m around it: lower "
        "region_margin or scene.hand_reach, or raise scene.spacing"
    )


def too_far(points: FloatArray, chains: Sequence[KinematicChain]) -> str | None:
    """Reason to pass over points (n, 3) that no arm comes near to, or None.

    Nor would one with a long hand, or after a short drive of the base.
    """
    if not chains or not len(points):
        return None
    for chain in chains:
        joints = np.vstack([chain.points, chain.T_base_tip_at_zero.p])
        slides = np.where(chain.is_revolute, 0.0, np.maximum(-chain.lower, chain.upper))
        span = np.linalg.norm(np.diff(joints, axis=0), axis=1).sum() + slides.sum()
        if np.linalg.norm(points - joints[0], axis=1).min() < span + _FAR:
            return None
    return (
        f"more than {_FAR:g} m beyond what the arms span: is the depth in metres, and "
        "the pose of the camera right?"
    )


def is_ground(
    points: FloatArray, report: GroundReport, config: GroundConfig
) -> str | None:
    """Reason to pass over points (n, 3) of a ground that was not removed, or None.

    A bare floor is left in the cloud, because its removal would leave nothing, and
    comes out of segmentation as an object.
    """
    plane = report.plane
    if report.status == "removed" or plane is None or not len(points):
        return None
    if report.tilt > config.max_tilt or abs(report.height) > config.max_height:
        return None
    is_low = np.abs(points @ plane[:3] + plane[3]) < config.clearance
    if np.count_nonzero(is_low) < _MOSTLY * len(points):
        return None
    return f"it is the ground, which was left in the cloud: {report.reason}"


def unfit(
    label: int,
    points: FloatArray,
    region: Bounds,
    report: GroundReport,
    config: PipelineConfig,
    chains: Sequence[KinematicChain],
) -> PassedOver | None:
    """Find why an object with points (n, 3) and region V is passed over, if it is."""
    scene, least = config.planner.scene, config.min_object_points
    n_cells = voxel_count(points, scene.spacing)
    if n_cells < least:
        return PassedOver(label, _small([n_cells], least), n_cells)
    reason = (
        too_far(points, chains)
        or too_large(region, scene)
        or is_ground(points, report, config.segmentation.ground)
    )
    return PassedOver(label, reason) if reason else None


def why_empty(
    segmentation: Segmentation,
    passed_over: Sequence[PassedOver],
    least: int,
    hands: Iterable[GripperModel],
) -> str:
    """One sentence for a plan without grasps, and one for each hand that may be why.

    Parameters
    ----------
    least
        Number of cells from which on an object is worth a search.
    """
    if not segmentation.segments:
        return (
            f"no object was found in the capture (ground: {segmentation.ground.reason})"
        )
    if not passed_over:
        n = counted(len(segmentation.segments), "object")
        return f"the selection policy put none of {n} into its order"
    labels: dict[str, list[str]] = {}
    counts = [one.n_cells for one in passed_over if one.n_cells is not None]
    for passed in passed_over:
        reason = passed.reason if passed.n_cells is None else _small(counts, least)
        labels.setdefault(reason, []).append(str(passed.label))
    reasons = "; ".join(
        reason if names == ["0"] else f"{_objects(names)}: {reason}"
        for reason, names in labels.items()
    )
    doubts = dict.fromkeys(hand.palm_doubt for hand in hands if hand.palm_doubt)
    said = f"no object offers a grasp: {reasons}"
    return ". ".join([said, *(doubt[0].upper() + doubt[1:] for doubt in doubts)])


def _objects(labels: Sequence[str]) -> str:
    return f"object{'s' if len(labels) > 1 else ''} {', '.join(labels)}"
