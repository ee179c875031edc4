"""Looks at one object on its way: lifted, its true size; put down, how it lies.

Before the lift an object is known by what stood out of the pile. Hanging in the hand it
is seen as a whole, and so is what it covered. Whatever moved since the last look, and
hangs together with what is held, belongs to it. Put down it may lie otherwise than it
was held, and the way back leads around it.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray
from debrisgrasp.geometry import DepthSight, LineOfSight, voxel_downsample
from debrisgrasp.io import Capture
from debrisgrasp.pipeline.self_filter import are_near, body_at

from .context import Context, Held
from .dropoff import with_underside
from .gaze import look_towards
from .perceive import image, is_close, sight_of
from .result import FaultFound

__all__ = ["looked_after", "looked_again", "looked_around", "looked_at"]

_MOVED = 0.025
"""Depth that changed by less is noise [m]."""
_CELL = 0.01
"""Spacing of the points of what hangs in a hand [m]."""
_TOGETHER = 0.03
"""Points nearer than this hang together [m]."""
_BRIDGED = 0.12
"""Parts no farther apart may belong together behind an arm [m]."""
_SKIN = 0.015
"""What is so near to an object is taken for the object itself [m]."""
_HAND = 0.02
"""What is so near to the hand is the hand [m]."""
_FEW = 20
"""Fewer points than this are noise."""
_PLACE, _BESIDE = 0.3, 0.8
"""Around where something was put down the ground must be seen so far, and what lies
there is looked for [m]."""
_HIGHEST = 0.25
"""A look at what was put down aims no higher [m]."""
_STANDS = 0.2
"""What is no higher can't fall far [m]."""
_HIGHER = ("", "_above", "_top")
"""Names of the looks at something that stands higher than one picture shows."""
_EDGE, _FRAME = 3, 0.1
"""Rows next to the upper end of what is measured [pixels], and how much of a picture a
camera may not measure there."""
_DEEP, _GRAIN = 0.3, 0.025
"""What came into sight goes on so far behind what is seen of it; spacing of the points
that stand for that [m]."""
_LOW = 0.03
"""What is no higher lies on the ground [m]."""


def looked_at(context: Context, held: Held) -> int:
    """See how large what is held is, and what lies around it.

    Returns
    -------
    int
        Points seen of it [count]; 0: it is not in the picture, or hidden by the hand,
        or the image is none to go by, and it remains what it was taken for.
    """
    before, is_own = context.cycle.seen, context.cycle.is_own
    motion = context.cycle.motion
    if before is None or is_own is None or motion is None or not len(held.points_hand):
        return 0
    limb = context.limbs[held.arm]
    T_base_hand = limb.pose(context.posture(limb))
    known = T_base_hand.apply(held.points_hand)
    assert before.capture.T_base_camera is not None
    T_base_before = before.capture.T_base_camera
    look = look_towards(context, known.mean(axis=0), T_base_before)
    taken = image(context, f"hanging_{context.cycle.number:03d}", look)
    if isinstance(taken, FaultFound):
        return 0
    context.record.keep(taken, taken.name)
    old = before.cloud.points

    points, sight = _cloud(taken)
    gap = _clearance(before.sight, points)
    is_near = _near(old[is_own], points, _TOGETHER)
    is_new = ~(np.abs(gap) <= _MOVED) | is_near  # without depth before: new
    grasp, is_robot = motion.grasp, np.zeros(len(points), dtype=bool)
    is_robot[is_new] = _are_own(
        context, held.arm, grasp.preshape, grasp.width, points[is_new]
    )
    points, gap, is_new = points[~is_robot], gap[~is_robot], is_new[~is_robot]
    of_held, is_noise = _divided(points, gap, is_new, known)
    seen = points[of_held]
    seen = seen[voxel_downsample(seen, _CELL)] if len(seen) >= _FEW else seen[:0]
    if len(seen):
        kept = known[: len(known) // 2]  # the rest is the underside, as it was guessed
        whole = np.concatenate([kept[~(_clearance(sight, kept) > _MOVED)], seen])
        body = with_underside(whole, grasp.width, 0.0)
        held.points_hand = T_base_hand.inverse().apply(body)
    pile = context.cycle.around
    if pile is None:
        pile = old[~_near(old[is_own], old, _SKIN)]
    others = points[~(of_held | is_noise)]
    others = others[~_near(np.concatenate([known, seen]), others, _SKIN)]
    context.cycle.around = np.concatenate([_out_of_sight(sight, pile), others])
    return len(seen)


def looked_around(context: Context, arm: str) -> None:
    """See anew what is around an empty hand, for it may have moved something there.

    What came there has a back that nobody sees: behind it everything is a guess.
    """
    before, limb = context.cycle.seen, context.limbs[arm]
    if before is None:
        return
    assert before.capture.T_base_camera is not None
    place = limb.pose(context.posture(limb)).p
    look = look_towards(context, place, before.capture.T_base_camera)
    name = f"touched_{context.cycle.number:03d}_{round(context.now()):05d}"
    taken = image(context, name, look, is_wanted=is_close)
    if isinstance(taken, FaultFound):
        return
    context.record.keep(taken, taken.name)
    points, sight = _cloud(taken)
    points = points[voxel_downsample(points, _CELL)]
    opening = limb.opening
    points = points[~_are_own(context, arm, limb.preshape, opening, points)]
    points = _without_noise(points)
    came = _without_noise(points[_clearance(before.sight, points) > _MOVED])
    hidden = _behind(came, sight.T_base_camera.p)
    hidden = hidden[~_are_own(context, arm, limb.preshape, opening, hidden)]
    context.memory.fallen.append(hidden)
    around = context.cycle.around
    pile = before.cloud.points if around is None else around
    context.cycle.around = np.concatenate([_out_of_sight(sight, pile), points])


def looked_after(
    context: Context, arm: str, place: FloatArray, name: str = "released"
) -> FloatArray | None:
    """See what lies where a hand put something down, and where nothing does.

    Until then it was taken for a box where the hand let it go, larger than it and
    perhaps elsewhere, or smaller than what was never seen of it.

    Parameters
    ----------
    place
        Where it was let go, base frame [m], shape (3,).
    name
        Of the captures in the record.

    Returns
    -------
    FloatArray or None
        Points seen there, base frame [m], shape (n, 3); None: there is no image to go
        by.
    """
    if context.cycle.motion is None:
        return None
    opening = context.limbs[arm].opening
    # What may have fallen lies low.
    place = np.array([*place[:2], min(place[2], _HIGHEST)])
    seen: list[FloatArray] = []
    aim: FloatArray | None = place
    looked: Mapping[str, float] = {}
    # What stands on end goes on above a picture: no way may lead through there.
    for higher in _HIGHER:
        if aim is None:
            break
        look = look_towards(context, aim)
        if seen and look == looked:
            break  # no head turns higher
        looked = look
        is_wanted = is_close if seen else partial(_is_beside, place)
        called = f"{name}_{context.cycle.number:03d}{higher}"
        taken = image(context, called, look, is_wanted=is_wanted)
        if isinstance(taken, FaultFound):
            break
        context.record.keep(taken, taken.name)
        seen.append(_lying(context, arm, opening, taken, place))
        aim = _above_picture(taken, seen[-1])
    return np.concatenate(seen) if seen else None


def looked_again(
    context: Context, arm: str, place: FloatArray, before: FloatArray
) -> None:
    """See once more, from rest, what lay where a hand put something down (n, 3).

    What stood there may have leaned on the hand, and have fallen when that went. The
    arm may hide it now: it stands only if some of it is seen to.
    """
    stood = before[before[:, 2] > _STANDS]
    seen = looked_after(context, arm, place, "rested") if len(stood) else None
    if seen is None:
        return
    stands = seen[seen[:, 2] > _STANDS]
    part, _ = _parts(np.concatenate([stood, stands]))
    own, still = part[: len(stood)], part[len(stood) :]
    leaned = own[_away(stood, place) < _PLACE]
    gone = stood[np.isin(own, leaned) & ~np.isin(own, still)]

    def is_gone(body: FloatArray) -> BoolArray:
        is_near = _near(gone, body, _TOGETHER)
        return np.asarray(is_near & ~_near(stands, body, _TOGETHER))

    context.memory.topple(is_gone, _STANDS)


def _is_beside(place: FloatArray, ground: FloatArray) -> BoolArray:
    """Whether points of the ground (n, 3) lie where something was put down."""
    return np.asarray(_away(ground, place) < _PLACE)


def _above_picture(taken: Capture, points: FloatArray) -> FloatArray | None:
    """Where points (n, 3) go on above the picture [m], shape (3,); None: nowhere."""
    assert taken.depth is not None
    assert taken.intrinsics is not None
    assert taken.T_base_camera is not None
    uv, _ = taken.intrinsics.project(taken.T_base_camera.inverse().apply(points))
    column, row = np.rint(uv).astype(np.intp).T
    first = np.isfinite(taken.depth).argmax(axis=0)
    is_cut = (row - first[column] < _EDGE) & (row < _FRAME * len(taken.depth))
    at_edge = points[is_cut]
    return at_edge.mean(axis=0) if len(at_edge) >= _FEW else None


def _lying(
    context: Context, arm: str, opening: float, taken: Capture, place: FloatArray
) -> FloatArray:
    """Take in what a look shows around a place (3,): its points [m], shape (n, 3)."""
    assert context.cycle.motion is not None
    preshape = context.cycle.motion.grasp.preshape
    points, sight = _cloud(taken)
    is_near = (_away(points, place) < _BESIDE) & (points[:, 2] > _LOW)
    points = points[is_near & ~context.is_in_way(points)]
    points = points[~_are_own(context, arm, preshape, opening, points)]
    points = _without_noise(points)

    def still(body: FloatArray) -> FloatArray:
        body = body[~(_clearance(sight, body) > _MOVED)]
        # Nor does anything lie where the robot stands.
        return body[~_are_own(context, arm, preshape, opening, body)]

    context.memory.settle(points, still)
    return points


def _behind(points: FloatArray, viewpoint: FloatArray) -> FloatArray:
    """Where what was seen (n, 3) may go on, out of sight, over the ground, (k, 3)."""
    ways = points - viewpoint
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    steps = np.arange(_GRAIN, _DEEP, _GRAIN)[:, None, None]
    hidden = (points + steps * ways).reshape(-1, 3)
    hidden = hidden[hidden[:, 2] > _LOW]
    return hidden[voxel_downsample(hidden, _GRAIN)]


def _away(points: FloatArray, place: FloatArray) -> FloatArray:
    """How far points (n, 3) are from a place across the ground [m], shape (n,)."""
    return np.asarray(np.hypot(*(points - place)[:, :2].T))


def _divided(
    points: FloatArray, gap: FloatArray, is_new: BoolArray, known: FloatArray
) -> tuple[BoolArray, BoolArray]:
    """Which points (n, 3) are those of what is held, and which are noise, (n,) each.

    Parameters
    ----------
    gap
        How far they lie in front of what was seen before [m], shape (n,).
    is_new
        Which were not seen before, or only as the object, shape (n,).
    known
        What is known of it already [m], shape (k, 3).
    """
    of_held, is_noise = np.zeros((2, len(points)), dtype=bool)
    rows = np.flatnonzero(is_new & (points[:, 2] > _LOW))
    if not len(rows):
        return of_held, is_noise
    part, cells = _parts(points[rows])
    away = np.asarray(cKDTree(known).query(points[rows])[0])
    nearest = np.full(len(cells), np.inf)
    np.minimum.at(nearest, part, away)
    # What came into space that was free, and hangs there, hangs on the hand: the arm
    # may hide what is between.
    moved = np.bincount(part, weights=gap[rows] > _MOVED) / np.bincount(part)
    is_held = nearest < _TOGETHER
    is_held |= (cells >= _FEW) & (moved > 0.5) & (nearest < _BRIDGED)
    of_held[rows] = is_held[part]
    is_noise[rows] = (cells < _FEW)[part]  # flying pixels
    return of_held, is_noise


def _cloud(taken: Capture) -> tuple[FloatArray, DepthSight]:
    """Measured points in base (n, 3), and the lines of sight to them."""
    assert taken.depth is not None
    sight = sight_of(taken)
    points = sight.intrinsics.deproject(taken.depth)[np.isfinite(taken.depth)]
    return sight.T_base_camera.apply(points), sight


def _clearance(sight: LineOfSight, points: FloatArray) -> FloatArray:
    """How far points (n, 3) lie in front of what was measured, NaN for nothing [m]."""
    x, y, z = points.T.astype(np.float32)
    return np.asarray(sight.clearance(x, y, z), dtype=np.float64)


def _out_of_sight(sight: LineOfSight, points: FloatArray) -> FloatArray:
    """Those of points seen before (n, 3) that something hides now."""
    return points[~(_clearance(sight, points) > -_MOVED)]


def _near(points: FloatArray, others: FloatArray, within: float) -> BoolArray:
    """Which of others (n, 3) are so near to some points [m], shape (n,)."""
    if not len(points):
        return np.zeros(len(others), dtype=bool)
    away = cKDTree(points).query(others, distance_upper_bound=within)[0]
    is_near: BoolArray = np.isfinite(away)
    return is_near


def _parts(points: FloatArray) -> tuple[IntArray, IntArray]:
    """Divide points (n, 3) into what hangs together: parts (n,), and their cells."""
    kept = voxel_downsample(points, _CELL)
    if not len(kept):
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
    tree = cKDTree(points[kept])
    a, b = tree.query_pairs(_TOGETHER, output_type="ndarray").T
    links = coo_array((np.ones(len(a)), (a, b)), shape=(len(kept),) * 2)
    part = connected_components(links, directed=False)[1]
    return part[tree.query(points)[1]], np.bincount(part)


def _without_noise(points: FloatArray) -> FloatArray:
    """Those of points (n, 3) that hang together with some others."""
    part, cells = _parts(points)
    return points[cells[part] >= _FEW]


def _are_own(
    context: Context, arm: str, preshape: str, opening: float, points: FloatArray
) -> BoolArray:
    """Which points (n, 3) are of the robot as it stands, a hand open so far, (n,)."""
    limb = context.limbs[arm]
    T_base_hand = limb.pose(context.posture(limb))
    # Fingers may read a bit beyond their range.
    opening = min(opening, limb.hand.preshape(preshape).widest)
    hand = limb.hand.solids(preshape, opening)
    body = body_at(context.model, context.joint_values(), without=arm)
    body += [(solid.moved(T_base_hand), _HAND) for solid in hand]
    return are_near(points, body)
