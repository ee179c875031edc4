"""What to advise on a plan: what would free the poses that were ruled out."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial import cKDTree

from debrisgrasp._arrays import IntArray, Rng
from debrisgrasp.geometry import Bounds, PointCloud
from debrisgrasp.kinematics import ArmReach
from debrisgrasp.planning import Advice, GraspPlanner, SearchResult, Situation

from .perception import Perception
from .targets import Target

__all__ = ["advice_on"]


def advice_on(
    result: SearchResult,
    planner: GraspPlanner,
    seen: Perception,
    target: Target,
    arms: Sequence[ArmReach],
    *,
    rng: Rng,
    is_late: Callable[[], bool],
) -> tuple[Advice, ...]:
    """Ask what would free the poses that a search ruled out.

    Parameters
    ----------
    seen, target, arms
        What was searched, and for which arms.
    is_late
        Tells when there is no time for further questions.
    """
    if not len(result.ruled_out):
        return ()
    scene = seen.scene(target)
    situation = Situation(
        scene=scene,
        ruled_out=result.ruled_out,
        arms=arms,
        distance=seen.obstacles,
        owners=_owners(scene.cloud, seen.cloud, seen.segmentation.labels),
        footprint=_footprint(arms),
        least_mass=result.least_mass,
        idle=_idle(arms),
        is_late=is_late,
    )
    return planner.advise(situation, rng=rng)


def _owners(thinned: PointCloud, cloud: PointCloud, labels: IntArray) -> IntArray:
    """Label of each point of a part of the cloud."""
    if thinned.pixels is not None and cloud.pixels is not None:
        of_pixel = np.zeros(int(cloud.pixels.max()) + 1, dtype=np.int64)
        of_pixel[cloud.pixels] = labels
        return of_pixel[thinned.pixels]
    _, nearest = cKDTree(cloud.points).query(thinned.points)
    return np.asarray(labels[nearest])


def _idle(arms: Sequence[ArmReach]) -> list[ArmReach]:
    """Arms of the robot that are not in use."""
    if not arms:
        return []
    robot, used = arms[0].robot, {arm.name for arm in arms}
    return [ArmReach(robot, name) for name in robot.arms if name not in used]


def _footprint(arms: Sequence[ArmReach]) -> Bounds | None:
    """Box around what no arm moves; None if nothing drives."""
    if not arms or not arms[0].robot.drives:
        return None
    parts = arms[0].collision.body.parts
    still = [part.solid.bounds for part in parts if not part.segment]
    if not still:
        return None
    lower, upper = zip(*((b.lower, b.upper) for b in still), strict=True)
    return Bounds(np.min(lower, axis=0), np.max(upper, axis=0))
