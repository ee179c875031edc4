"""An arm as spheres: thousands of postures tested against space and robot at once.

What the first joint carries, the trunk with an idle arm, depends on that joint alone:
whether it is clear is a table. Spheres over what later joints carry are looked up in a
grid around the trunk, and in the grids of the space.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from debrisgrasp._arrays import BoolArray, Float32Array, FloatArray, IntArray
from debrisgrasp.geometry import Solid
from debrisgrasp.kinematics.body import RobotBody
from debrisgrasp.kinematics.segments import (
    SegmentLanes,
    carried,
    joint_frames_of_segments,
)
from debrisgrasp.kinematics.self_gaps import SelfModel
from debrisgrasp.kinematics.spheres import covering_spheres

from .solid_field import GRID_SPACING, SolidField
from .space import MotionSpace

__all__ = ["ArmSpheres", "SphereTest", "discernible"]

_EXCESSES = (0.01, 0.015, 0.02, 0.03)
"""How far spheres may stand out [m]: a solid gets the least that takes few of them."""
_FEW = 6
_MAX_RADIUS = 0.08
_CHUNK = 1024
"""Postures treated at once; keeps the work in the cache."""
_SEED, _N_SAMPLES, _MOSTLY = 2_718_281_828, 64, 0.5
"""Of the random postures that tell which parts spheres keep apart, and the share of
them in which they must."""
_STEP = 0.01
"""Steps of the first joint at which the trunk is tested [rad or m]."""


def discernible(body: RobotBody, margin: float) -> RobotBody:
    """Leave out the pairs of parts that spheres seldom tell apart by a margin [m].

    Links that pass each other closely are near in every posture: to a search by spheres
    the arm would always touch itself. What it finds is tested by the solids.
    """
    q = body.chain.sampled(_N_SAMPLES, rng=np.random.default_rng(_SEED))
    most = _EXCESSES[-1]
    gaps = SelfModel.fit(body, most).gaps(q, most + margin, 0.0)
    n_near = np.bincount(gaps.pair, minlength=len(body.pairs))
    return replace(body, pairs=body.pairs[n_near < _MOSTLY * _N_SAMPLES])


@dataclass(frozen=True, slots=True, eq=False)
class _Cover:
    """Spheres over the parts of one segment, in the frame of its joint."""

    parts: IntArray
    """Part that each sphere belongs to, shape (s,)."""
    centers: Float32Array
    """Shape (3, s) [m]."""
    radii: Float32Array
    """Shape (s, 1) [m]."""

    @classmethod
    def fit(cls, body: RobotBody, segment: int) -> _Cover:
        to_joint = joint_frames_of_segments(body.chain)[segment]
        found = [
            (i, *_few_spheres(part.solid.moved(to_joint)))
            for i, part in enumerate(body.parts)
            if part.segment == segment
        ]
        centers = np.concatenate([np.zeros((0, 3)), *(c for _, c, _ in found)])
        radii = np.concatenate([np.zeros(0), *(r for _, _, r in found)])
        parts = np.repeat([i for i, _, _ in found], [len(r) for _, _, r in found])
        return cls(
            parts.astype(np.intp),
            np.ascontiguousarray(centers.T, dtype=np.float32),
            radii[:, None].astype(np.float32),
        )


@dataclass(frozen=True, slots=True, eq=False)
class _StillParts:
    """Parts of segment 0 or 1 as a grid, and the spheres that may meet them."""

    segment: int
    field: SolidField
    spheres: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class _MovingPair:
    """Two segments that may meet: a ball around each, and pairs of their spheres."""

    balls: tuple[int, int]
    """Spheres that stand for the ball centres, nearest to the middle."""
    reach: np.float32
    """Centres of the balls farther apart than this: no contact [m]."""
    one: IntArray
    other: IntArray
    """Spheres of each pair, shape (p,)."""
    touch: Float32Array
    """Sum of their radii, shape (p, 1) [m]."""


@dataclass(frozen=True, eq=False)
class ArmSpheres:
    """Spheres over all parts that a chain moves."""

    body: RobotBody

    @cached_property
    def n_segments(self) -> int:
        """Segments that move, the trunk included."""
        return self.body.chain.n_joints

    @cached_property
    def covers(self) -> tuple[_Cover, ...]:
        """Of segments 2 to d."""
        return tuple(
            _Cover.fit(self.body, segment) for segment in range(2, self.n_segments + 1)
        )

    @cached_property
    def trunk(self) -> _Cover:
        """Of segment 1."""
        return _Cover.fit(self.body, 1)

    @cached_property
    def radii(self) -> Float32Array:
        """Of all spheres of segments 2 to d [m], shape (s, 1)."""
        return np.concatenate(
            [np.zeros((0, 1), np.float32)] + [c.radii for c in self.covers]
        )

    @cached_property
    def parts(self) -> IntArray:
        """Part of the body that each of these spheres belongs to, shape (s,)."""
        return np.concatenate([np.zeros(0, np.intp)] + [c.parts for c in self.covers])

    @cached_property
    def still(self) -> tuple[_StillParts, ...]:
        """What stands still, or turns with the trunk, and may be met."""
        return (*self._met(0, self.parts), *self._met(1, self.parts))

    @cached_property
    def trunk_still(self) -> tuple[_StillParts, ...]:
        """What stands still and may be met by the trunk."""
        return self._met(0, self.trunk.parts)

    def _met(self, segment: int, owners: IntArray) -> tuple[_StillParts, ...]:
        """Parts of a segment that may be met by spheres on the given parts (s,)."""
        parts, mine = self.body.parts, set(owners.tolist())
        sets: dict[int, list[int]] = {}
        for i, j in self.body.pairs.tolist():
            if parts[j].segment == segment and i in mine:
                sets.setdefault(i, []).append(j)
        groups: dict[tuple[int, ...], list[int]] = {}
        for i, others in sets.items():
            groups.setdefault(tuple(sorted(others)), []).append(i)
        T = joint_frames_of_segments(self.body.chain)[1]
        found = []
        for still, movers in groups.items():
            solids = [parts[j].solid for j in still]
            if segment == 1:
                solids = [solid.moved(T) for solid in solids]
            rows = np.flatnonzero(np.isin(owners, movers))
            found.append(_StillParts(segment, SolidField.build(solids), rows))
        return tuple(found)

    @cached_property
    def moving(self) -> tuple[_MovingPair, ...]:
        """Pairs of segments 2 to d that may meet."""
        parts = self.body.parts
        meets = np.zeros((len(parts), len(parts)), dtype=bool)
        for i, j in self.body.pairs:
            meets[i, j] = meets[j, i] = parts[i].segment > 1 and parts[j].segment > 1
        starts = np.cumsum([0] + [len(c.parts) for c in self.covers])
        found = []
        for a in range(len(self.covers)):
            for b in range(a):
                one, other = self.covers[a], self.covers[b]
                rows = np.argwhere(meets[one.parts][:, other.parts])
                if len(rows):
                    found.append(_moving_pair(one, other, rows, starts[a], starts[b]))
        return tuple(found)

    def poses(self, q: FloatArray) -> tuple[Float32Array, Float32Array]:
        """Rotations (d, 3, 3, n) and origins (d, 3, n) of segments 1 to d in base."""
        lanes = SegmentLanes(self.body.chain, q)
        T = self.body.chain.form.T_base_first.astype(np.float32)
        d = self.n_segments
        R = np.empty((d, 3, 3, len(q)), dtype=np.float32)
        p = np.empty((d, 3, len(q)), dtype=np.float32)
        for segment in range(1, d + 1):
            own_R, own_p = lanes.pose(segment)
            R[segment - 1] = (T[:3, :3] @ own_R.reshape(3, -1)).reshape(own_R.shape)
            p[segment - 1] = T[:3, :3] @ own_p + T[:3, 3:]
        return R, p

    def centers(self, R: Float32Array, p: Float32Array) -> Float32Array:
        """Centres of the spheres of segments 2 to d in base, (3, s, n) [m]."""
        found = np.empty((3, len(self.radii), p.shape[-1]), dtype=np.float32)
        start = 0
        for k, cover in enumerate(self.covers, 1):
            stop = start + len(cover.radii)
            if stop > start:
                found[:, start:stop] = carried(R[k], p[k], cover.centers)
            start = stop
        return found

    def trunk_centers(self, R: Float32Array, p: Float32Array) -> Float32Array:
        """Centres of the spheres of segment 1 in base, (3, t, n) [m]."""
        return carried(R[0], p[0], self.trunk.centers)

    def hits_still(
        self, centers: Float32Array, R: Float32Array, p: Float32Array, margin: float
    ) -> BoolArray:
        """Whether spheres (3, s, n) touch base or trunk, posed by R and p; (n,)."""
        is_hit = np.zeros(centers.shape[-1], dtype=bool)
        for still in self.still:
            points = centers[:, still.spheres]
            if still.segment:
                points = points - p[:, None]
                points = np.einsum("jin,jsn->isn", R, points)
            gap = still.field(*points)
            is_hit |= (gap < self.radii[still.spheres] + np.float32(margin)).any(axis=0)
        return is_hit

    def hits_arm(self, centers: Float32Array, margin: float) -> BoolArray:
        """Whether spheres (3, s, n) of different segments touch, shape (n,)."""
        is_hit = np.zeros(centers.shape[-1], dtype=bool)
        if not self.moving:
            return is_hit
        i, j = np.array([pair.balls for pair in self.moving]).T
        reach = np.array([pair.reach for pair in self.moving], np.float32)[:, None]
        gap = centers[:, i] - centers[:, j]
        is_near = (gap * gap).sum(axis=0) < (reach + np.float32(margin)) ** 2
        for row in np.flatnonzero(is_near.any(axis=1)):
            pair, near = self.moving[row], np.flatnonzero(is_near[row])
            close = centers
            if len(near) < len(is_hit):
                close = np.take(centers, near, axis=2)
            gap = close[:, pair.one] - close[:, pair.other]
            touch = pair.touch + np.float32(margin)
            is_hit[near] |= ((gap * gap).sum(axis=0) < touch * touch).any(axis=0)
        return is_hit


@dataclass(frozen=True, eq=False, kw_only=True)
class SphereTest:
    """Tests postures of one arm in one space."""

    arm: ArmSpheres
    space: MotionSpace
    margin: float
    """Distance that spheres keep from the space's obstacles [m]."""
    self_margin: float
    """Distance that spheres keep from other parts of the robot [m]."""
    is_strict: bool = False
    """Whether True is certain; else to half the diagonal of a cell of the grid around
    base and trunk."""

    def __call__(self, q: FloatArray) -> BoolArray:
        """Whether postures (n, d) are free, shape (n,); False is never certain."""
        found = np.zeros(len(q), dtype=bool)
        for start in range(0, len(q), _CHUNK):
            part = slice(start, start + _CHUNK)
            found[part] = self._chunk(q[part])
        return found

    def _chunk(self, q: FloatArray) -> BoolArray:
        arm = self.arm
        found = self._trunk_is_free(q[:, 0])
        alive = np.flatnonzero(found)
        if not len(alive):
            return found
        R, p = arm.poses(q[alive])
        centers = arm.centers(R, p)
        clear = ~self.space.hits(
            centers, arm.radii, self.margin, is_strict=self.is_strict
        )
        centers, trunk_R, trunk_p = _taken(clear, centers, R[0], p[0])
        alive = alive[clear]
        if len(alive):
            grid = 0.87 * GRID_SPACING if self.is_strict else 0.0
            clear = ~arm.hits_still(centers, trunk_R, trunk_p, self.self_margin + grid)
            (centers,) = _taken(clear, centers)
            alive = alive[clear]
        if len(alive):
            alive = alive[~arm.hits_arm(centers, self.self_margin)]
        found[:] = False
        found[alive] = True
        return found

    def _trunk_is_free(self, q: FloatArray) -> BoolArray:
        first, table = self._trunk_table
        if not np.isfinite(self.arm.body.chain.lower[0]):
            q = q - 2.0 * np.pi * np.round(q / (2.0 * np.pi))
        place = np.round((q - first) / _STEP).astype(np.intp)
        return table[np.clip(place, 0, len(table) - 1)]

    @cached_property
    def _trunk_table(self) -> tuple[float, BoolArray]:
        """Whether the trunk is clear, by the value of the first joint.

        Of one that turns without end, by those of one turn.
        """
        chain, cover = self.arm.body.chain, self.arm.trunk
        lower = chain.lower[0] if np.isfinite(chain.lower[0]) else -np.pi
        upper = chain.upper[0] if np.isfinite(chain.upper[0]) else np.pi
        values = np.arange(lower, upper + _STEP, _STEP)
        if not len(cover.radii):
            return float(lower), np.ones(len(values), dtype=bool)
        q = np.zeros((len(values), chain.n_joints))
        q[:, 0] = values
        R, p = self.arm.poses(q)
        centers = self.arm.trunk_centers(R, p)
        # Between two values of the table the trunk moves by half a step.
        lever = np.hypot(*cover.centers[:2]).max() if chain.is_revolute[0] else 1.0
        sweep = 0.5 * _STEP * float(lever) if self.is_strict else 0.0
        is_hit = self.space.hits(
            centers, cover.radii, self.margin + sweep, is_strict=self.is_strict
        )
        room = self.self_margin + sweep + 0.87 * GRID_SPACING * self.is_strict
        for still in self.arm.trunk_still:
            gap = still.field(*centers[:, still.spheres])
            need = cover.radii[still.spheres] + np.float32(room)
            is_hit |= (gap < need).any(axis=0)
        return float(lower), ~is_hit


def _taken(keep: BoolArray, *arrays: Float32Array) -> list[Float32Array]:
    """Keep some lanes (the last axis), contiguous in memory as before."""
    if keep.all():
        return list(arrays)
    lanes = np.flatnonzero(keep)
    return [np.take(array, lanes, axis=-1) for array in arrays]


def _few_spheres(solid: Solid) -> tuple[FloatArray, FloatArray]:
    """Cover a solid as closely as a few spheres can."""
    for excess in _EXCESSES:
        centers, radii = covering_spheres(solid, excess, _MAX_RADIUS)
        if len(radii) <= _FEW:
            break
    return centers, radii


def _moving_pair(
    one: _Cover, other: _Cover, rows: IntArray, start: int, start_other: int
) -> _MovingPair:
    balls, reach = [], 0.0
    for cover, first, used in (
        (one, start, rows[:, 0]),
        (other, start_other, rows[:, 1]),
    ):
        used = np.unique(used)
        centers, radii = cover.centers[:, used], cover.radii[used, 0]
        middle = 0.5 * (centers.min(axis=1) + centers.max(axis=1))
        away = np.linalg.norm(centers - middle[:, None], axis=0)
        ball = int(away.argmin())
        spread = np.linalg.norm(centers - centers[:, ball : ball + 1], axis=0)
        reach += float((spread + radii).max())
        balls.append(int(first + used[ball]))
    return _MovingPair(
        balls=(balls[0], balls[1]),
        reach=np.float32(reach),
        one=rows[:, 0] + start,
        other=rows[:, 1] + start_other,
        touch=one.radii[rows[:, 0]] + other.radii[rows[:, 1]],
    )
