"""Motions that several steps share: to rest, out of the pile, down to the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp.control import CartesianLeg, LegPlanner, TarePolicy
from debrisgrasp.control._rigid import Wrench
from debrisgrasp.geometry import SE3, PointCloud, Solid
from debrisgrasp.kinematics import Trajectory
from debrisgrasp.kinematics.urdf import UrdfShape
from debrisgrasp.motion import (
    MotionPlan,
    MotionPlanner,
    MotionSpace,
    UnknownSpace,
)

from .context import Context, LimbState
from .drive import Drive, LegEnd
from .fingers import loosen
from .pacing import careful, hand_corners
from .result import FaultFound

__all__ = [
    "are_near",
    "back_out",
    "box_around",
    "free_share",
    "is_folded",
    "let_go",
    "lying",
    "planned",
    "put_down",
    "reversed_motion",
    "space_of",
    "to_rest",
]

_BACK = 0.12
"""How far a hand backs out of the pile [m]."""
_SPARE = 0.02
"""Before the last bit of a way that an arm can't go it could hardly go back [m]."""
_UP = 0.12
"""Where it finds no way from, a hand rises so far [m] ..."""
_RISES = 3
"""... and so often."""
_FIRST = 10
"""Looks at the weight before any may count as less."""
_UNSURE = 0.015
"""How much farther than its points what was let go may reach [m]."""
_GRAIN = 0.025
"""Spacing of the points that stand for it [m]."""
_STANDS_FREE = 0.02
"""Where an arm stands there is nothing, whatever noise and boxes say, nor so near [m]:
else no way out would begin."""
_BARE = np.array([0.0, 0.0, 1.0, 0.0])


def reversed_motion(trajectory: Trajectory) -> Trajectory:
    """Return the same motion from its end to its start."""
    return replace(
        trajectory,
        times=trajectory.times[-1] - trajectory.times[::-1],
        q=trajectory.q[::-1],
        dq=-trajectory.dq[::-1],
    )


def space_of(
    context: Context,
    without: int | None = None,
    *,
    unknown: UnknownSpace,
    stands: tuple[MotionPlanner, FloatArray] | None = None,
    with_guesses: bool = True,
) -> MotionSpace:
    """Obstacles by the last look, and what was put down since.

    Parameters
    ----------
    without
        Label of an object that is no obstacle, because the hand holds it.
    stands
        Of an arm, and its posture (d,): points so near to where it stands are left out.
    with_guesses
        Whether what was put down is also where nobody has seen it.
    """
    seen = context.cycle.seen or context.last_seen
    if seen is None:
        return MotionSpace(measured=None, unknown=None, ground_plane=_BARE)
    points = seen.cloud.points
    if context.cycle.around is not None:
        points = context.cycle.around
    elif without is not None:
        points = points[seen.segmentation.labels != without]
    guesses = [*context.dropped, *context.fallen] if with_guesses else []
    points = np.concatenate([points, *context.lain, *guesses])
    if stands is not None:
        balls = stands[0].balls_at(stands[1], _STANDS_FREE)
        rows = cKDTree(points).query_ball_point(balls[:, :3], balls[:, 3])
        points = np.delete(points, np.unique(np.concatenate(rows)).astype(int), axis=0)
        links = context.model.links_solids(context.joint_values())
        robot = [solid for _, solid in links]  # the arms that stand still, too
        points = points[~are_near(points, robot, _STANDS_FREE)]
    normals = np.full(points.shape, np.nan)
    everything = PointCloud(points, normals, seen.cloud.viewpoint)
    plane = seen.ground_plane
    return MotionSpace.build(
        everything, seen.sight, _BARE if plane is None else plane, unknown=unknown
    )


def are_near(points: FloatArray, solids: Sequence[Solid], within: float) -> BoolArray:
    """Which points (n, 3) are so near to a solid [m], shape (n,)."""
    found = np.zeros(len(points), dtype=bool)
    for solid in solids:
        low, high = solid.bounds.lower - within, solid.bounds.upper + within
        rows = np.flatnonzero(((points > low) & (points < high)).all(axis=1))
        found[rows] |= solid.signed_distance(points[rows]) < within
    return found


def planned(
    context: Context,
    limb: LimbState,
    goal: SE3 | FloatArray,
    space: MotionSpace,
    planner: MotionPlanner | None = None,
    known: FloatArray | None = None,
) -> MotionPlan | FaultFound:
    """Plan from where the arm stands.

    Parameters
    ----------
    planner
        For an arm with something in its hand; None: for the arm alone.
    known
        Postures (k, d) of a way that it has gone.
    """
    planner = planner or limb.planner
    q = _inside(limb, context.posture(limb))
    if isinstance(q, str):
        return FaultFound("start_outside_limits", q, limb.name)
    plan = planner.plan(q, goal, space, rng=context.rng, known=known)
    if plan.is_solved:
        return plan
    return FaultFound("plan_collision", plan.reason, limb.name)


def _inside(limb: LimbState, q: FloatArray) -> FloatArray | str:
    """Posture within the planner's limits, unless it is far outside."""
    limits = limb.limits.planner
    nearest = np.clip(q, limits.lower, limits.upper)
    if np.abs(nearest - q).max() > 0.02 + 1e-9:
        return limits.violation(q)
    return nearest


def lying(T_base_hand: SE3, points_hand: FloatArray) -> FloatArray:
    """Surface of what a hand leaves where it is, base frame [m], shape (n, 3).

    A box around all of it, for little of it was seen, a bit larger than that.
    """
    box = box_around(points_hand)
    half = 0.5 * np.array(box.size) + _UNSURE
    sides = [np.linspace(-h, h, int(np.ceil(2.0 * h / _GRAIN)) + 1) for h in half]
    grid = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    surface = grid[(np.abs(grid) > half - 1e-6).any(axis=1)]
    return (T_base_hand @ box.T_link_shape).apply(surface)


def box_around(points: FloatArray) -> UrdfShape:
    """Box along the principal axes of points (n, 3), in their frame."""
    middle = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - middle, full_matrices=False)
    if np.linalg.det(axes) < 0.0:
        axes[2] = -axes[2]
    along = (points - middle) @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    center = middle + 0.5 * (low + high) @ axes
    size = np.maximum(high - low, 0.01)
    return UrdfShape(
        kind="box",
        size=tuple(size.tolist()),
        T_link_shape=SE3.from_parts(axes.T, center),
    )


def back_out(context: Context, arm: str) -> FaultFound | None:
    """Draw a hand straight back, the way it came, as far as the arm can."""
    limb = context.limbs[arm]
    q = context.posture(limb)
    T = limb.pose(q)
    motion = context.cycle.motion
    shift = -_BACK * T.R[:, 2]
    if motion is not None and motion.arm == arm:
        # Straight out: aside it would draw its fingers along what they touch.
        far = float((motion.grasp.T_base_pregrasp.p - T.p) @ -T.R[:, 2])
        if context.cycle.is_removed:
            # By now it is elsewhere, and what it put down as long as it was.
            grasp = motion.grasp
            way_in = grasp.T_base_hand.p - grasp.T_base_pregrasp.p
            far = max(float(np.linalg.norm(way_in)), _BACK)
        if 0.0 < far < 0.3:
            shift = -far * T.R[:, 2]
    if np.linalg.norm(shift) < 5e-3:
        return None
    share = free_share(limb, q, shift)
    if share < 0.1:
        return None
    way = share * shift
    speed = context.settings.lift_speed
    end = Drive(context, arm).leg(way, speed=speed, tare=TarePolicy.SESSION)
    return end if isinstance(end, FaultFound) else None


def free_share(limb: LimbState, q: FloatArray, way: FloatArray) -> float:
    """Tell how much of a straight way (3,) of the hand an arm can go.

    Folded onto itself it would find no way on from there; but if it is so already, it
    must get out.
    """
    limits = limb.limits.controller
    start = np.clip(q, limits.lower, limits.upper)

    def is_free(row: FloatArray) -> bool:
        return not is_folded(limb, row)

    legs = LegPlanner(
        limb.reach.chain, limits, is_free=is_free if is_free(start) else None
    )
    return legs.plan(start, CartesianLeg.along(limb.pose(start), way).goal).share


def is_folded(limb: LimbState, q: FloatArray) -> bool:
    """Whether an arm is nearer to itself, or to the robot, than plans may be."""
    alone = MotionSpace(measured=None, unknown=None, ground_plane=_BARE)
    return not limb.planner.exact_test(alone, with_hand=False).is_free(q[None])[0]


def to_rest(context: Context, arm: str) -> FaultFound | None:
    """Bring an arm back to its posture of rest."""
    limb, drive = context.limbs[arm], Drive(context, arm)
    rest = context.settings.rest or limb.rest_of
    q_rest = limb.reach.chain.vector(context.model.posture(arm, rest))
    q = context.posture(limb)
    if np.abs(q - q_rest).max() < 0.01:
        limb.trail.clear()
        return None
    limb.went(q[None])
    motion = context.cycle.motion
    if motion is not None and motion.arm == arm:
        reach = motion.reach.trajectory
        assert reach is not None
        is_there = np.abs(q - reach.q[-1]).max() < 0.01
        is_from_rest = np.abs(reach.q[0] - q_rest).max() < 0.01
        if is_there and is_from_rest:
            return _back(context, drive, reversed_motion(reach))
    found = _way_to(context, limb, q_rest)
    for _ in range(_RISES):
        if not isinstance(found, FaultFound) or found.fault != "plan_collision":
            break
        q, up = context.posture(limb), np.array([0.0, 0.0, _UP])
        way, speed = free_share(limb, q, up) * up, context.settings.lift_speed
        if np.linalg.norm(way) < 5e-3:
            break
        end = drive.leg(way, speed=speed, tare=TarePolicy.SESSION)
        found = end if isinstance(end, FaultFound) else _way_to(context, limb, q_rest)
    if isinstance(found, FaultFound):
        return found
    assert found.trajectory is not None
    return _back(context, drive, found.trajectory)


def _back(context: Context, drive: Drive, trajectory: Trajectory) -> FaultFound | None:
    """Follow a motion to rest, slowly near all that the empty hand may touch."""
    preshape = next(iter(drive.limb.hand.preshapes))
    widest = drive.limb.hand.preshape(preshape).widths[1]
    corners = hand_corners(drive.limb, preshape, widest)
    fault = drive.follow(
        trajectory, pace=careful(context, drive.limb, corners, trajectory, 1.0)
    )
    if fault is None:
        drive.limb.trail.clear()
    return fault


def _way_to(
    context: Context, limb: LimbState, goal: FloatArray
) -> MotionPlan | FaultFound:
    """Plan to a posture; through what was not seen if there is no other way.

    The way that the arm came leads back, if nothing shorter does. At last only what was
    seen is in the way: all else is a guess, near which the arm goes slowly.
    """
    known = np.array(limb.trail) if limb.trail else None
    stands = limb.planner, context.posture(limb)
    for unknown, leaves, with_guesses in (
        (UnknownSpace.HIDDEN, None, True),
        (UnknownSpace.IGNORED, None, True),
        (UnknownSpace.IGNORED, stands, True),
        (UnknownSpace.IGNORED, stands, False),
    ):
        if not (with_guesses or context.dropped or context.fallen):
            break
        space = space_of(
            context, unknown=unknown, stands=leaves, with_guesses=with_guesses
        )
        found = planned(context, limb, goal, space, known=known)
        if not isinstance(found, FaultFound):
            break
    return found


def put_down(context: Context, most: float) -> FaultFound | None:
    """Lower what a hand holds until it lies on something, and let go."""
    held = context.held
    if held is None:
        return None
    limb, drive = context.limbs[held.arm], Drive(context, held.arm)
    if held.is_lifted:
        share = free_share(limb, context.posture(limb), np.array([0.0, 0.0, -most]))
        depth = most if share > 1.0 - 1e-6 else share * most - _SPARE
        if depth > 2e-3:
            end = _lowered(drive, depth)
            # Loaded to its limit already, the hand can't go down: it lets go here.
            if isinstance(end, FaultFound) and end.fault != "ratchet":
                return end
    return let_go(context)


def _lowered(drive: Drive, depth: float) -> LegEnd | FaultFound:
    """Lower until something else bears a good part of the weight."""
    least: list[float] = []

    def lies(load: Wrench) -> bool:
        least.append(drive.carried(load))
        if len(least) < _FIRST:
            return False
        weight = sum(least[:_FIRST]) / _FIRST
        return sum(least[-5:]) < 5.0 * (weight - max(4.0, 0.3 * weight))

    way, speed = [0.0, 0.0, -depth], drive.context.settings.lift_speed
    return drive.leg(way, speed=speed, tare=TarePolicy.SESSION, until=lies)


def let_go(context: Context, opening: float | None = None) -> FaultFound | None:
    """Open the hand that holds something, and hold nothing.

    Parameters
    ----------
    opening
        To open to [m]; None: just far enough to be free, for there may be no more
        room.
    """
    held = context.held
    if held is None:
        return None
    context.held = None
    most = held.grip.config.opening if opening is None else opening
    fault = loosen(Drive(context, held.arm), most)
    if fault is not None:
        context.held = held
    return fault
