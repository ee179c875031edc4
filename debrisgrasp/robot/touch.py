"""Springs between one hand, what it holds, and everything else.

What is near is looked up once and then watched until the hand has gone as far as the
watch reaches, so that a tick in free space costs next to nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from math import dist

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.worlds import Ground

from .config import FakeConfig
from .fake_hand import FakeGripper
from .shapes import BodyShape, HandShape, ways_out
from .springs import (
    GROUND,
    HELD,
    PALM,
    Guard,
    Spring,
    Stand,
    Watch,
    blended,
    shifting,
    yielded,
)

__all__ = ["Touch"]

_MARGIN = 0.03
"""What is nearer than this is watched [m]."""
_UP = np.array([[0.0, 0.0, 1.0]])
_DEEPENS = 5e-4
"""So much at most does a contact deepen from one look to the next [m]."""
_SHARPNESS = 4
"""How much more the deeper points count for the direction of a push."""
_NO_WAY = 0.01
"""Squares of shorter means say nothing of a direction."""
_BEHIND = -0.3
"""Cosine to the last push beyond which a side lies behind what is pushed."""
_ROUNDING = 1e-9
"""[m]."""

Rotation = tuple[float, ...]
"""Nine numbers: a matrix row by row."""
Vector = tuple[float, ...]


class Touch:
    """What one hand touches."""

    def __init__(
        self, gripper: FakeGripper, ground: Ground, config: FakeConfig
    ) -> None:
        self.gripper, self.ground = gripper, ground
        self.stiffness = config.contact_stiffness
        self.arm_stiffness = config.arm_stiffness
        self.shape = HandShape(gripper.model)
        self.held: BodyShape | None = None
        """What it holds."""
        self._held_index: int | None = None
        self._at_rest: dict[tuple[int, int], float] = {}
        """How deep owners are in bodies that came to rest against them [m]."""
        self._net: dict[tuple[int, int], float] = {}
        """How deep they were pressed in from there, at the last look [m]."""
        self._settled: set[int] = set()
        self._is_new = False
        self._pushed: dict[tuple[int, int], tuple[FloatArray, float, FloatArray]] = {}
        """Direction (3,) in which each contact pushed at the last look, odom, how deep
        it was [m], and where (3,)."""
        self.grip: list[Spring] = []
        """Contacts of the hand with what it holds, in the frame of the hand."""
        counts = [rows.stop - rows.start for rows in self.shape.owned]
        self._owner_of = np.repeat(np.arange(len(counts)), counts)
        self._held_points = np.zeros((0, 3))
        self._held_planes: tuple[FloatArray, FloatArray] = (np.zeros((0, 3)),) * 2
        self._watches: list[Watch] = []
        self._guards: list[Guard] = []
        self._since: Stand | None = None
        self._clear: tuple[Rotation, Vector, float, float] | None = None
        self._room = self._reach = self._gone = 0.0
        """How far a point of the hand has gone so far, at most [m]."""
        self._last: Stand | None = None
        self._key: tuple[str, tuple[float, ...]] | None = None
        self._points = self.shape.palm

    def hold(
        self, index: int | None, body: BodyShape | None, R: FloatArray, p: FloatArray
    ) -> None:
        """Take a body whose pose in the frame of the hand is (R, p); None: let go."""
        if index != self._held_index:
            self._is_new = True
        self.held, self._held_index = body, index
        if body is not None:
            normals, offsets, self._held_points = body.seen(R, p)
            self._held_planes = normals, offsets
        self._pushed = {}
        self._look_at_held()
        self.forget()

    def forget(self) -> None:
        """Look again for what is near: a body has moved."""
        self._since = self._clear = None

    def settled(self, bodies: Collection[int]) -> None:
        """Take note that bodies have come to rest, against hand or held body perhaps.

        They lie there; that they were set down a little inside presses nothing.
        """
        self._settled |= set(bodies)
        self.forget()

    def shifted(self, distance: float) -> None:
        """Take note that a body has moved a little [m]."""
        self._room -= distance
        self._clear = None

    def is_near(self, body: int) -> bool:
        """Whether a body is so near that it is watched."""
        watched = {watch.body for watch in self._watches}
        return body in watched or any(guard.body == body for guard in self._guards)

    def is_clear(self, R: Rotation, p: Vector) -> bool:
        """Whether a hand at this pose, in plain numbers, can't touch anything yet.

        Quick, and only ever true for a hand whose fingers have not moved.
        """
        if self._clear is None:
            return False
        R0, p0, room, reach = self._clear
        return dist(p, p0) + reach * dist(R, R0) < room

    def springs(
        self,
        R: FloatArray,
        p: FloatArray,
        bodies: Sequence[BodyShape],
        left_out: Collection[int],
    ) -> list[Spring]:
        """All contacts of the hand at pose (R, p) in odom, but for bodies left out."""
        self._refresh()
        now = Stand(R.copy(), p.copy(), tuple(self.gripper.openings))
        if self._since is None or (
            self._since.way_to(now, self._reach, self.shape.gain) > self._room
        ):
            self._look(now, bodies, left_out)
        if self._last is not None:
            # Fingers may have opened since the reach was measured.
            reach = self._reach + _MARGIN
            self._gone += self._last.way_to(now, reach, self.shape.gain)
        self._last = now
        found: dict[tuple[int, int], Spring] = {}
        for watch in self._watches:
            if watch.part is None:
                where = watch.points @ R.T + p
                heights = self.ground.height(where[:, :2])
                beyond = where[:, 2:] - heights[:, None]
                self._add_all(found, watch, where, beyond, _UP)
                continue
            shape = bodies[watch.body]
            if self._gone < watch.free_until and shape.p is watch.place:
                continue
            where = watch.points @ R.T + p
            normals = shape.normals[watch.part]
            beyond = where @ normals.T - shape.offsets[watch.part]
            beyond = ways_out(beyond, shape.is_covered[watch.part])
            nearest = self._add_all(found, watch, where, beyond, normals)
            watch.free_until, watch.place = self._gone + nearest - _ROUNDING, shape.p
        for guard in self._guards:
            where = bodies[guard.body].points[guard.rows]
            beyond = (where - p) @ R @ guard.normals.T - guard.offsets
            if beyond.max(axis=1).min() < 0.0:
                beyond = ways_out(beyond, guard.is_covered)
                normals = guard.normals @ R.T
                key = guard.owner, guard.body
                self._add(found, key, where, beyond, normals, -1.0)
        for key in found.keys() & self._pushed.keys():
            found[key] = shifting(found[key], self._pushed[key][2])
        self._pushed = {
            key: (s.force / float(np.linalg.norm(s.force)), s.depth, s.point)
            for key, s in found.items()
        }
        return yielded(self._eased(found), self.arm_stiffness)

    def felt(self, owner: int, point: FloatArray, force: FloatArray) -> float:
        """How much a force on a finger is against its closing [N].

        Point [m] and force [N], shape (3,), in the frame of the hand. It is felt along
        the axis in which pads close, and along the way on which the link that is hit
        sweeps; the one that feels more decides when the finger stands.
        """
        gripper = self.gripper
        way = self.shape.way_of(gripper.shape, gripper.openings, owner - 1, point)
        across = gripper.model.fingers[owner - 1].side * float(force[0])
        return max(across, float(way @ force), key=abs)

    def _eased(self, found: dict[tuple[int, int], Spring]) -> list[Spring]:
        """Take from the contacts what was there when the bodies lay at rest."""
        rest, net = self._at_rest, self._net
        for key, spring in found.items():
            owner, body = key
            if owner == HELD and self._is_new:
                rest[key] = spring.depth
            elif body in self._settled or (owner == HELD and self._settled):
                rest[key] = spring.depth - min(spring.depth, net.get(key, 0.0))
        self._settled, self._is_new, self._net = set(), False, {}
        self._at_rest = {}
        for key, spring in found.items():
            first = min(rest.get(key, 0.0), spring.depth)
            self._net[key] = spring.depth - first
            if first > 0.0:
                self._at_rest[key] = first
                share = 1.0 - first / spring.depth
                found[key] = spring._replace(
                    force=share * spring.force, depth=spring.depth - first
                )
        return [s for s in found.values() if s.depth > 0.0]

    def _add_all(
        self,
        found: dict[tuple[int, int], Spring],
        watch: Watch,
        where: FloatArray,
        beyond: FloatArray,
        normals: FloatArray,
    ) -> float:
        """Add the contacts of each owner of watched points; return the least gap."""
        gaps = beyond.max(axis=1)
        nearest = float(gaps.min())
        if nearest >= 0.0:
            return nearest
        for owner in np.unique(watch.owners[gaps < 0.0]).tolist():
            mine = watch.owners == owner
            key = owner, watch.body
            self._add(found, key, where[mine], beyond[mine], normals, 1.0)
        return nearest

    def _add(
        self,
        found: dict[tuple[int, int], Spring],
        key: tuple[int, int],
        where: FloatArray,
        beyond: FloatArray,
        normals: FloatArray,
        sign: float,
    ) -> None:
        """Keep the deepest contact of each owner with each body."""
        inside = beyond.max(axis=1) < 0.0
        where, beyond = where[inside], beyond[inside]
        beyond = self._same_side(key, beyond, sign * normals)
        depths = -beyond.max(axis=1)
        depth = float(depths.max())
        if key in found and found[key].depth >= depth:
            return
        # Where points are pushed by several sides none takes over all at once.
        shares = (depths / depth) ** _SHARPNESS
        ways = blended(normals, beyond)
        normal = shares @ ways / shares.sum()
        if float(normal @ normal) < _NO_WAY:
            normal = ways[int(depths.argmax())]
        owner, body = key
        force = (sign * self.stiffness * depth) * normal
        found[key] = Spring(owner, body, depths @ where / depths.sum(), force, depth)

    def _same_side(
        self, key: tuple[int, int], beyond: FloatArray, pushes: FloatArray
    ) -> FloatArray:
        """Leave out sides of a body opposite to the one that pushed a tick ago.

        A finger that is pressed into a thin wall does not come out at its back.

        Parameters
        ----------
        beyond
            Of points inside, from each side [m], shape (n, s).
        """
        before = self._pushed.get(key)
        if before is None:
            return beyond
        direction, depth, _ = before
        kept = np.where(pushes @ direction < _BEHIND, -np.inf, beyond)
        # Else it is another place that is touched now.
        now = -float(kept.max(axis=1).min())
        return kept if abs(now - depth) < _DEEPENS else beyond

    def _refresh(self) -> None:
        """Take over where the fingers are now."""
        key = (self.gripper.shape, tuple(self.gripper.openings))
        if key == self._key:
            return
        if self._key is None or self._key[0] != key[0]:
            self.forget()
        self._key = key
        self._points = self.shape.points(*key)
        self._clear = None
        for watch in self._watches:
            own = watch.owners != HELD
            watch.points[own] = self._points[watch.rows[own]]
        if self.held is not None:
            self._look_at_held()

    def _look_at_held(self) -> None:
        """Find the contacts of the hand with what it holds."""
        found: dict[tuple[int, int], Spring] = {}
        if self.held is not None and self._held_index is not None:
            all_normals, all_offsets = self._held_planes
            for part in self.held.parts:
                normals, offsets = all_normals[part], all_offsets[part]
                beyond = self._points @ normals.T - offsets
                rows = np.flatnonzero(beyond.max(axis=1) < 0.0)
                if len(rows):
                    where, owners = self._points[rows], self._owner_of[rows]
                    watch = Watch(self._held_index, part, rows, owners, where)
                    inside = ways_out(beyond[rows], self.held.is_covered[part])
                    self._add_all(found, watch, where, inside, normals)
        self.grip = list(found.values())

    def _look(
        self,
        now: Stand,
        bodies: Sequence[BodyShape],
        left_out: Collection[int],
    ) -> None:
        """Find what is near."""
        R, p, _ = now
        groups, owners = [self._points], [self._owner_of]
        if self.held is not None:
            groups.append(self._held_points)
            owners.append(np.full(len(self._held_points), HELD))
        own, owner_of = np.concatenate(groups), np.concatenate(owners)
        self._reach = float(np.linalg.norm(own, axis=1).max())
        where = own @ R.T + p
        self._watches, self._guards = [], []
        heights = where[:, 2] - self.ground.height(where[:, :2])
        clear = self._watch(GROUND, None, heights, own, owner_of)
        for i, body in enumerate(bodies):
            gap = float(np.linalg.norm(body.middle - p)) - body.radius - self._reach
            if gap >= _MARGIN or i in left_out or i == self._held_index:
                clear = min(clear, max(gap, _MARGIN))
                continue
            depths = body.depths(where)
            for k, part in enumerate(body.parts):
                nearest = self._watch(i, part, depths[:, k], own, owner_of)
                clear = min(clear, nearest)
            self._guard(i, (body.points - p) @ R)
        self._since = now
        self._room = max(clear, _MARGIN) - 1e-3
        self._clear = None
        if not self._watches and not self._guards:
            flat = tuple(R.ravel().tolist()), tuple(p.tolist())
            self._clear = (*flat, self._room, self._reach)

    def _watch(
        self,
        body: int,
        part: slice | None,
        gaps: FloatArray,
        own: FloatArray,
        owner_of: IntArray,
    ) -> float:
        """Watch the points that are near something; return the smallest gap [m]."""
        near = np.flatnonzero(gaps < _MARGIN)
        if len(near):
            watch = Watch(body, part, near, owner_of[near], own[near])
            self._watches.append(watch)
        return float(gaps.min())

    def _guard(self, i: int, points: FloatArray) -> None:
        """Watch points (n, 3) of a body, frame of the hand, that are near its solids.

        A thin edge fits between the points of a palm; the other way round it is seen.
        """
        solids = [
            (PALM, normals, offsets, np.zeros(len(offsets), dtype=bool))
            for normals, offsets in self.shape.palm_planes
        ]
        if self.held is not None:
            normals, offsets = self._held_planes
            covered = self.held.is_covered
            solids += [
                (HELD, normals[s], offsets[s], covered[s]) for s in self.held.parts
            ]
        for owner, normals, offsets, is_covered in solids:
            gaps = (points @ normals.T - offsets).max(axis=1)
            near = np.flatnonzero(gaps < _MARGIN)
            if len(near):
                self._guards.append(Guard(owner, i, near, normals, offsets, is_covered))
