"""Whether a robot touches itself, for thousands of postures at once.

Parts that move are covered by spheres, and every sphere is tested against the solids
that it may meet. A gap found this way is never more than the true one, so no contact is
missed. Parts of one segment are tested together, and first of all by balls around them
and around what they may meet: most are far apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray

from .body import BodyPart, RobotBody
from .gaps import SolidGap
from .segments import SegmentLanes, carried, joint_frames_of_segments
from .serial import Lanes
from .spheres import covering_spheres

__all__ = ["SelfGaps", "SelfModel"]

_SLACK = np.float32(2e-5)
"""More than the rounding of single precision [m]."""
_GROUP_RADIUS = 0.2
"""Groups of parts larger than this are divided [m]."""
_CHUNK = 2048
"""Postures treated at once; keeps the work in the cache."""
_SOME = 128
"""Of these, so many at once where all pairs are compared."""


@dataclass(frozen=True, slots=True, eq=False)
class SelfGaps:
    """What the spheres tell about n postures."""

    gap: FloatArray
    """No more than the least distance between two parts [m], shape (n,); at most the
    horizon asked for."""
    is_hit: BoolArray
    """Parts certainly overlap, shape (n,)."""
    posture: IntArray
    """Of each doubtful pair, shape (m,)."""
    pair: IntArray
    """Of each doubtful pair, its row in `RobotBody.pairs`; shape (m,)."""
    pair_gap: FloatArray
    """Of each doubtful pair [m], shape (m,)."""


@dataclass(frozen=True, slots=True, eq=False)
class _Still:
    """One solid that a group may meet."""

    segment: int
    gap: SolidGap
    middle: Lanes
    """Centre of a ball around the solid, shape (3, 1) [m]."""
    radius: np.float32
    spheres: IntArray
    """Those of the group that may meet it."""
    starts: IntArray
    """Where in ``spheres`` those of another part begin."""
    pairs: IntArray
    """Row in `RobotBody.pairs` of each of those parts."""


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """Parts of one segment that lie together."""

    segment: int
    middle: Lanes
    """Centre of a sphere around all of them, shape (3, 1) [m]."""
    radius: np.float32
    centers: Lanes
    """Of the covering spheres [m], shape (3, s)."""
    radii: Lanes
    """Shape (s, 1) [m]."""
    is_inner: BoolArray
    """Whether the sphere's centre lies inside its part, shape (s, 1)."""
    others: tuple[_Still, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Balls:
    """Balls around groups and around what they may meet."""

    middles: tuple[Lanes, ...]
    """Centres of the balls of each segment, in its frame, shape (3, b) [m]."""
    one: IntArray
    """Ball of the group of each pair of balls, shape (m,)."""
    other: IntArray
    """Ball of what it may meet, shape (m,)."""
    radii: Lanes
    """Sum of the radii of both, shape (m, 1) [m]."""

    @classmethod
    def around(cls, groups: Sequence[_Group]) -> _Balls:
        """Collect them, the pairs in the order of the groups and of their others."""
        pairs = [(group, other) for group in groups for other in group.others]
        balls = [[ball.segment, *ball.middle[:, 0]] for pair in pairs for ball in pair]
        known, place = np.unique(
            np.reshape(balls, (-1, 4)), axis=0, return_inverse=True
        )
        one, other = place.reshape(-1, 2).T
        ends = np.cumsum(np.bincount(known[:, 0].astype(np.intp)))[:-1]
        middles = np.split(known[:, 1:].T.astype(np.float32), ends, axis=1)
        radii = [[group.radius + other.radius] for group, other in pairs]
        return cls(
            tuple(middles), one, other, np.reshape(radii, (-1, 1)).astype(np.float32)
        )

    def may_meet(self, poses: SegmentLanes, limit: float) -> list[bool]:
        """Whether the balls of each pair come nearer than ``limit`` in any posture."""
        still, *moved = self.middles
        placed = [np.repeat(still[..., None], poses.n_postures, axis=2)]
        for segment, middles in enumerate(moved, 1):
            placed.append(carried(*poses.pose(segment), middles))
        places = np.concatenate(placed, axis=1)
        far = np.square(self.radii + np.float32(limit))
        found = np.zeros(len(far), dtype=bool)
        for first in range(0, poses.n_postures, _SOME):
            x, y, z = places[:, :, first : first + _SOME]
            square = np.square(x[self.one] - x[self.other])
            square += np.square(y[self.one] - y[self.other])
            square += np.square(z[self.one] - z[self.other])
            found |= (square <= far).any(axis=1)
        return found.tolist()


@dataclass(frozen=True, eq=False, kw_only=True)
class SelfModel:
    """Spheres and solids of one robot body."""

    body: RobotBody
    groups: tuple[_Group, ...]

    @classmethod
    def fit(cls, body: RobotBody, excess: float) -> SelfModel:
        """Cover the parts that move; ``excess`` as in `covering_spheres` [m]."""
        frames = joint_frames_of_segments(body.chain)
        placed = [
            BodyPart(p.link, p.solid.moved(frames[p.segment]), p.segment, p.is_hand)
            for p in body.parts
        ]
        gaps = [SolidGap.of(part.solid) for part in placed]
        groups = [
            _group(body, placed, gaps, members, excess)
            for members in _divided(body, placed)
        ]
        return cls(body=body, groups=tuple(groups))

    def gaps(self, q: FloatArray, limit: float, horizon: float) -> SelfGaps:
        """Test postures (n, d); pairs nearer than ``limit`` [m] are doubtful."""
        found = [
            self._chunk(q[start : start + _CHUNK], limit, horizon, start)
            for start in range(0, max(len(q), 1), _CHUNK)
        ]
        return SelfGaps(
            gap=np.concatenate([part.gap for part in found]),
            is_hit=np.concatenate([part.is_hit for part in found]),
            posture=np.concatenate([part.posture for part in found]),
            pair=np.concatenate([part.pair for part in found]),
            pair_gap=np.concatenate([part.pair_gap for part in found]),
        )

    @cached_property
    def _balls(self) -> _Balls:
        return _Balls.around(self.groups)

    def _chunk(
        self, q: FloatArray, limit: float, horizon: float, first: int
    ) -> SelfGaps:
        poses = SegmentLanes(self.body.chain, q)
        least = np.full(len(q), max(horizon, limit), dtype=np.float32)
        may_meet = iter(self._balls.may_meet(poses, float(least.max(initial=0.0))))
        is_hit = np.zeros(len(q), dtype=bool)
        nothing = np.zeros(0, dtype=np.intp)
        doubtful: list[tuple[IntArray, IntArray, Lanes]] = [
            (nothing, nothing, np.zeros(0, dtype=np.float32))
        ]
        for group in self.groups:
            segment = -1
            for other in group.others:
                if not next(may_meet):
                    continue
                if other.segment != segment:
                    segment = other.segment
                    R, p = poses.relative(group.segment, segment)
                    middle = carried(R, p, group.middle)[:, 0]
                reach = np.maximum(least, np.float32(limit)) + group.radius
                near = np.flatnonzero(other.gap(middle) < reach)
                if not len(near):
                    continue
                spheres = other.spheres
                centers = carried(R[:, :, near], p[:, near], group.centers[:, spheres])
                distance = other.gap(centers)
                gap = distance - group.radii[spheres]
                by_part = np.minimum.reduceat(gap, other.starts, axis=0) - _SLACK
                least[near] = np.minimum(least[near], by_part.min(axis=0))
                part, lane = np.nonzero(by_part <= limit)
                found = by_part[part, lane]
                doubtful.append((near[lane] + first, other.pairs[part], found))
                if other.gap.is_exact:
                    inside = (distance < -_SLACK) & group.is_inner[spheres]
                    is_hit[near] |= inside.any(axis=0)
        return SelfGaps(
            gap=least.astype(np.float64),
            is_hit=is_hit,
            posture=np.concatenate([posture for posture, _, _ in doubtful]),
            pair=np.concatenate([pair for _, pair, _ in doubtful]),
            pair_gap=np.concatenate([gap for _, _, gap in doubtful]).astype(np.float64),
        )


def _divided(body: RobotBody, parts: Sequence[BodyPart]) -> list[IntArray]:
    """Parts that come first in a pair, in groups that lie together."""
    middles = np.array(
        [0.5 * (part.solid.bounds.lower + part.solid.bounds.upper) for part in parts]
    )
    segments = np.array([part.segment for part in parts])
    moved = np.unique(body.pairs[:, 0])
    waiting = [moved[segments[moved] == s] for s in np.unique(segments[moved])]
    groups = []
    while waiting:
        members = waiting.pop()
        spread = np.ptp(middles[members], axis=0)
        if len(members) > 1 and spread.max() > 2 * _GROUP_RADIUS:
            axis = int(spread.argmax())
            order = members[np.argsort(middles[members, axis], kind="stable")]
            waiting += [order[: len(order) // 2], order[len(order) // 2 :]]
        else:
            groups.append(np.sort(members))
    return groups


def _group(
    body: RobotBody,
    parts: Sequence[BodyPart],
    gaps: Sequence[SolidGap],
    members: IntArray,
    excess: float,
) -> _Group:
    covers = [covering_spheres(parts[i].solid, excess) for i in members]
    centers = np.concatenate([c for c, _ in covers])
    radii = np.concatenate([r for _, r in covers])
    owner = np.repeat(members, [len(r) for _, r in covers])
    is_inner = np.concatenate(
        [
            parts[i].solid.signed_distance(c) < -1e-4
            if gaps[i].is_exact
            else np.zeros(len(c), dtype=bool)
            for i, (c, _) in zip(members, covers, strict=True)
        ]
    )
    low = (centers - radii[:, None]).min(axis=0)
    high = (centers + radii[:, None]).max(axis=0)
    middle = 0.5 * (low + high)
    radius = (np.linalg.norm(centers - middle, axis=1) + radii).max()
    mine = np.flatnonzero(np.isin(body.pairs[:, 0], members))
    others = []
    for j in np.unique(body.pairs[mine, 1]):
        pairs = mine[body.pairs[mine, 1] == j]
        pairs = pairs[np.argsort(body.pairs[pairs, 0], kind="stable")]
        spheres = np.flatnonzero(np.isin(owner, body.pairs[pairs, 0]))
        starts = np.flatnonzero(np.diff(owner[spheres], prepend=-1))
        bounds = parts[j].solid.bounds
        others.append(
            _Still(
                segment=parts[j].segment,
                gap=gaps[j],
                middle=0.5 * (bounds.lower + bounds.upper)[:, None].astype(np.float32),
                radius=np.float32(np.linalg.norm(bounds.size) / 2 + _SLACK),
                spheres=spheres,
                starts=starts,
                pairs=pairs,
            )
        )
    return _Group(
        segment=parts[members[0]].segment,
        middle=middle[:, None].astype(np.float32),
        radius=np.float32(radius + _SLACK),
        centers=np.ascontiguousarray(centers.T, dtype=np.float32),
        radii=radii[:, None].astype(np.float32),
        is_inner=is_inner[:, None],
        others=tuple(sorted(others, key=lambda other: other.segment)),
    )
