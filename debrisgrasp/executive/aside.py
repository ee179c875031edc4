"""Push out of the way what no hand can hold.

A closed hand goes down beside the object, on its inner side, and moves straight to the
nearer border of the way. It gives up where the object resists.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import LegOutcome, TarePolicy
from debrisgrasp.control._rigid import Wrench
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import Trajectory
from debrisgrasp.motion import MotionSpace, UnknownSpace
from debrisgrasp.segmentation import Segment

from .context import Context
from .drive import Drive
from .dropoff import postures_at
from .fingers import open_hand
from .folding import free_share, straight
from .limb_state import LimbState
from .marks import Mark
from .moves import CAUGHT, planned
from .obstacles import room_for
from .pacing import hand_corners
from .relief import relieve
from .resting import put_away
from .result import Done, FaultFound, StepResult
from .states import State

__all__ = ["push_aside", "to_push"]

_STRAY = 0.05
"""Share of an object's points that may be no part of it; all others are to go out."""
_GAP = 0.04
"""Between hand and object where a push begins [m]."""
_OVER, _HIGH = 0.03, 0.4
"""Of the fingers over the lowest that was seen of the object: at least so much [m], and
at this share of its height, or as high as what the tracks drive over; ..."""
_TIPS = 0.03
"""... it is pushed by so much of their ends [m]."""
_LEAST, _LONGEST = 0.08, 1.0
"""A shorter push is not worth the way there; nor one so long to the other side [m]."""
_MOST_FORCE = 60.0
"""Under which things slide; 8 kg on concrete take 50 N [N]."""
_FELT = 4.0
"""By so much more than before a hand is pushed back as it begins to push [N]."""
_CAME = 0.03
"""An object that was pushed no farther stays [m]."""
_BACK = 0.06
"""How far a hand leaves what it has pushed, before it goes to rest [m]."""
_TRIES = 2
"""An object that so often did not come is left."""
_TILTS = (0.0, 0.4, 0.8)
"""Of the hand, forwards from straight down [rad]."""
_ALONG = (0.0, -0.06, 0.06)
"""Where it pushes, off the middle of the object [m]."""
_GOALS = 8
"""The farthest pushes of those possible to which a motion is sought ..."""
_WORTH, _WHOLE = 0.7, 0.95
"""... that go nearly as far as the farthest; one that goes so far is whole."""
_EASED = 0.2
"""Share of a limit above which a hand gives way before it leaves."""
_WITHIN = 0.15
"""Of where it should be by then its middle may seem to be, seen from elsewhere [m]."""
_UP, _SHORT = 0.15, 5e-3
"""So far the hand rises on its way to rest; a shorter leg is none [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Push:
    """How an object is to be pushed."""

    limb: LimbState
    reach: Trajectory
    """To where it begins."""
    way: FloatArray
    """Of the hand from there, base frame [m], shape (3,)."""


class _Touch:
    """Notes where a hand on its way (3,) begins to push, and ends what is too much."""

    def __init__(self, drive: Drive, way: FloatArray) -> None:
        self._drive, self._ahead = drive, way / np.linalg.norm(way)
        self._is_too_much = drive.against(way, _MOST_FORCE)
        self._free: float | None = None
        self._place: FloatArray | None = None

    def _here(self) -> FloatArray:
        limb = self._drive.limb
        return limb.pose(self._drive.context.posture(limb)).p

    def __call__(self, load: Wrench) -> bool:
        push = float(self._drive.push(load) @ self._ahead)
        if self._free is None:
            self._free = push
        if self._place is None and self._free - push > _FELT:
            self._place = self._here()
        return self._is_too_much(load)

    @property
    def came(self) -> float:
        """How far what it pushes came along [m]."""
        if self._place is None:
            return 0.0
        return max(float((self._here() - self._place) @ self._ahead), 0.0)


def to_push(context: Context, segments: Sequence[Segment]) -> Segment | None:
    """Of objects that no hand took, the one with the shortest way out, if any."""
    if context.n_pushes >= context.settings.pushes:
        return None

    def may_come(segment: Segment) -> bool:
        mark = context.marks.of(segment.centroid)
        return mark is None or mark.n_stayed < _TRIES

    return min(
        filter(may_come, segments),
        key=lambda segment: next(_ways_out(context, segment.centroid[None]))[1],
        default=None,
    )


def push_aside(context: Context) -> StepResult:
    """Push the chosen object out of the way, as far as an arm can."""
    cycle = context.cycle
    assert cycle.seen is not None
    assert cycle.is_own is not None
    assert cycle.centroid is not None
    own = cycle.seen.cloud.points[cycle.is_own]
    mark = context.marks.of(cycle.centroid)
    assert mark is not None
    mark.n_stayed += 1  # until it has come
    mark.why_stays = "the push did not end well"
    push = _sought(context, own)
    if isinstance(push, str):
        return _stays(mark, push)
    context.n_pushes += 1
    drive = Drive(context, push.limb.name)
    fault = _taken_there(context, drive, push)
    if fault is not None:
        return fault
    ahead = push.way / np.linalg.norm(push.way)
    touch = _Touch(drive, push.way)
    end = drive.leg(
        push.way,
        speed=context.settings.lift_speed,
        tare=TarePolicy.SESSION,
        until=touch,
    )
    if isinstance(end, FaultFound):
        return end
    came, force = touch.came, float(np.linalg.norm(drive.push()))
    _remember(context, mark, own, came * ahead)
    if came >= _CAME:
        cycle.pushed, context.n_pushed = came, context.n_pushed + 1
        # Others may come now, itself it is pushed on.
        mark.n_changes, mark.n_stayed = context.n_changes, mark.n_stayed - 1
    fault = _left(context, drive, -_BACK * ahead)
    if fault is not None:
        return fault
    if came < _CAME:
        words = f"it came by {100 * came:.0f} cm, then {force:.0f} N resisted"
        if end.outcome is not LegOutcome.CONTACT:
            far = 100.0 * end.share * end.length
            words = f"it came by {100 * came:.0f} cm as the hand went {far:.0f} cm"
        return _stays(mark, words, _facts(push))
    facts = {"pushed": round(came, 3), "end": end.outcome.value}
    return Done({**facts, **_facts(push)}, State.RETREAT)


def _stays(mark: Mark, why: str, facts: Mapping[str, object] | None = None) -> Done:
    """Note why an object was not pushed."""
    mark.why_stays = why
    return Done({"pushed": 0.0, "why": why, **(facts or {})}, State.RETREAT)


def _facts(push: _Push) -> dict[str, object]:
    """Say how it was pushed, for the record."""
    limb, (preshape, opening) = push.limb, _closed(push.limb)
    return {
        "arm": limb.name,
        "gripper": limb.hand.name,
        "preshape": preshape,
        "opening": round(opening, 4),
        "pose": np.round(limb.pose(push.reach.q[-1]).matrix, 5).tolist(),
        "way": np.round(push.way, 4).tolist(),
    }


def _ways_out(
    context: Context, points: FloatArray
) -> Iterator[tuple[FloatArray, float]]:
    """Directions across the way (3,), and how far points (n, 3) must go there [m].

    The shorter one first.
    """
    across = context.T_base_way.inverse().apply(points)[:, 1]
    low, high = np.quantile(across, [_STRAY, 1.0 - _STRAY])
    (_, right, _), (_, left, _) = context.settings.workspace
    least = _LEAST + _GAP
    ways = [(1.0, max(left - low, least)), (-1.0, max(high - right, least))]
    shorter, longer = sorted(ways, key=lambda way: way[1])
    for sign, far in (shorter, longer) if longer[1] < _LONGEST else (shorter,):
        yield sign * context.T_base_way.R[:, 1], float(far)


def _sought(context: Context, own: FloatArray) -> _Push | str:
    """Find an arm that gets beside an object (n, 3) and pushes it, or say why not."""
    space = room_for(context, context.limbs.values(), unknown=UnknownSpace.HIDDEN)
    why = "no hand fits beside it"
    forward, over = context.T_base_way.R[:, 0], context.settings.drive_over
    for ahead, far in _ways_out(context, own):
        # The arm on the side to which it goes reaches farther there.
        side = float(np.sign(ahead[1]))
        for limb in sorted(
            context.limbs.values(),
            key=lambda limb: -side * context.settings.drop_off[limb.name][1],
        ):
            goals = _beside(limb, own, ahead, forward, over)
            rows, ways = _begins(context, limb, goals, (far + _GAP) * ahead, space)
            if not len(rows):
                continue
            found = planned(context, limb, rows, space)
            if isinstance(found, FaultFound):
                why = found.message
                continue
            assert found.trajectory is not None
            at = np.abs(rows - found.trajectory.q[-1]).max(axis=1).argmin()
            return _Push(limb, found.trajectory, ways[at])
    return why


def _beside(
    limb: LimbState,
    own: FloatArray,
    ahead: FloatArray,
    forward: FloatArray,
    over: float,
) -> SE3:
    """Poses of a closed hand behind an object (n, 3) that is to go ahead, (k,).

    Its fingers are no higher than ``over`` [m] above the lowest of the object.
    """
    preshape, closed = _closed(limb)
    corners = hand_corners(limb, preshape, closed)
    middle = 0.5 * ((own @ forward).min() + (own @ forward).max())
    back = float((own @ ahead).min()) - _GAP
    low, high = max(float(own[:, 2].min()), 0.0), float(own[:, 2].max())
    bottom = low + float(np.clip(_HIGH * (high - low), _OVER, max(over, _OVER)))
    up = np.array([0.0, 0.0, 1.0])
    poses = []
    for tilt in _TILTS:
        z = np.sin(tilt) * forward - np.cos(tilt) * up
        side = np.cross(z, ahead)
        for x in (ahead, -ahead, side, -side):
            R = np.stack([x, np.cross(z, x), z], axis=1)
            at = corners @ R.T
            for shift in _ALONG:
                # The fingers are what pushes, wherever the palm is then.
                tips = at[at[:, 2] < at[:, 2].min() + _TIPS]
                p = (middle + shift - (tips @ forward).mean()) * forward
                p = p + (back - (at @ ahead).max()) * ahead
                poses.append(SE3.from_parts(R, p + (bottom - at[:, 2].min()) * up))
    return SE3(np.array([pose.matrix for pose in poses]))


def _begins(
    context: Context, limb: LimbState, goals: SE3, way: FloatArray, space: MotionSpace
) -> tuple[FloatArray, FloatArray]:
    """Postures (k, d) in which a push may begin, and how far it goes there (k, 3)."""
    q, limits = context.posture(limb), limb.limits.planner
    solved = postures_at(context, limb, goals, q)
    rows = np.array([row for row, _ in solved if not limits.violation(row)])
    rows = rows.reshape(-1, len(q))
    rows = rows[limb.planner.exact_test(space).is_free(rows)] if len(rows) else rows
    shares: list[float] = []
    for row in rows:
        shares.append(free_share(limb, row, way))
        if sum(share > _WHOLE for share in shares) == _GOALS:
            break
    least = max(
        _WORTH * max(shares, default=0.0), (_LEAST + _GAP) / np.linalg.norm(way)
    )
    best = [i for i in np.argsort(shares)[::-1] if shares[i] >= least][:_GOALS]
    return rows[best], np.array(shares)[best, None] * way


def _closed(limb: LimbState) -> tuple[str, float]:
    """Preshape and opening of a hand that pushes [m]."""
    name = limb.first_preshape
    return name, limb.hand.preshape(name).narrowest


def _taken_there(context: Context, drive: Drive, push: _Push) -> FaultFound | None:
    """Close the hand, and go to where the push begins."""
    fault = open_hand(drive, *_closed(push.limb))
    if fault is not None:
        return fault
    fault = drive.follow(push.reach, pace=context.cycle.speed)
    context.is_in_pile = push.limb.name
    return fault


def _remember(context: Context, mark: Mark, own: FloatArray, shift: FloatArray) -> None:
    """Take note of where an object (n, 3) is that came by a shift (3,)."""
    cycle = context.cycle
    assert cycle.seen is not None
    assert cycle.is_own is not None
    others = cycle.seen.cloud.points[~cycle.is_own]
    cycle.around = np.concatenate([others, own + shift])
    mark.centroid, mark.within = mark.centroid + shift, _WITHIN
    if not context.is_in_way((own + shift).mean(axis=0)):
        context.memory.dropped.append(own + shift)


def _left(context: Context, drive: Drive, way: FloatArray) -> FaultFound | None:
    """Draw the hand off what it has pushed, by an offset (3,) [m], and go to rest."""
    limb = drive.limb
    fault = relieve(context, limb.name, _EASED, way)
    if fault is not None:
        return fault
    for part in (way, np.array([0.0, 0.0, _UP])):
        speed = context.settings.lift_speed
        end = straight(drive, part, CAUGHT, speed=speed, least=_SHORT)
        if isinstance(end, FaultFound):
            return end
    fault = put_away(context, limb.name)
    if fault is None:
        context.is_in_pile = None
    return fault
