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
from .places import Key, Places, Push, Sides, is_behind
from .shapes import BodyShape, HandShape
from .springs import (
    GROUND,
    HELD,
    PALM,
    REACH,
    Guard,
    Near,
    Spring,
    Stand,
    Watch,
    yielded,
)

__all__ = ["Touch"]

_MARGIN = 0.03
"""What is nearer than this is watched [m]."""
_UPWARDS = Sides(np.array([[0.0, 0.0, 1.0]]), np.array([False]))
"""The one side of the ground."""
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
        self._config = config
        self.shape = HandShape(gripper.model)
        self.held: BodyShape | None = None
        """What it holds."""
        self._held_index: int | None = None
        self._at_rest: dict[Key, float] = {}
        """How deep owners are in bodies that came to rest against them [m]."""
        self._net: dict[Key, float] = {}
        """How deep they were pressed in from there, at the last look [m]."""
        self._settled: set[int] = set()
        self._is_new = False
        self._pushed: dict[Key, Push] = {}
        """What pushed at the last look, frame odom."""
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
            # The fingers go on pushing, and being pushed, where they were.
            pushed = self._pushed.items()
            self._pushed = {key: push for key, push in pushed if key[0] > HELD}
        self.held, self._held_index = body, index
        if body is not None:
            normals, offsets, self._held_points = body.seen(R, p)
            self._held_planes = normals, offsets
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
        places = Places(self._pushed)
        for watch in self._watches:
            if watch.part is None:
                where = watch.points @ R.T + p
                heights = self.ground.height(where[:, :2])
                places.add_all(watch, where, where[:, 2:] - heights[:, None], _UPWARDS)
                continue
            shape = bodies[watch.body]
            if self._gone < watch.free_until and shape.p is watch.place:
                continue
            where = watch.points @ R.T + p
            sides = Sides(shape.normals[watch.part], shape.is_covered[watch.part])
            beyond = where @ sides.normals.T - shape.offsets[watch.part]
            nearest = places.add_all(watch, where, beyond, sides)
            watch.free_until = self._gone + nearest - REACH - _ROUNDING
            watch.place = shape.p
        for guard in self._guards:
            where = bodies[guard.body].points[guard.rows]
            beyond = (where - p) @ R @ guard.normals.T - guard.offsets
            sides = Sides(guard.normals @ R.T, guard.is_covered)
            places.add((guard.owner, guard.body), where, beyond, sides, -1.0)
        near = places.shifted()
        springs = yielded(self._eased(near), p, self._config)
        pressed = {spring.point.tobytes() for spring in springs}
        self._pushed = {
            key: (place.normal, place.depth, place.point)
            for key, place in near.items()
            if place.depth > 0.0 or place.point.tobytes() in pressed
        }
        return springs

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

    def _eased(self, near: dict[Key, Near]) -> list[Near]:
        """Take from the contacts what was there when the bodies lay at rest."""
        rest, net = self._at_rest, self._net
        for key, place in near.items():
            owner, body = place.owner, place.body
            if owner == HELD and self._is_new:
                rest[key] = place.depth
            elif body in self._settled or (owner == HELD and self._settled):
                rest[key] = place.depth - min(place.depth, net.get(key, 0.0))
            elif key in self._pushed and is_behind(place.normal, self._pushed[key][0]):
                # Jammed in a body, it was there before, hardly less deep.
                rest[key] = place.depth
        self._settled, self._is_new, self._net = set(), False, {}
        self._at_rest = {}
        for key, place in near.items():
            first = min(rest.get(key, 0.0), place.depth)
            self._net[key] = place.depth - max(first, 0.0)
            if first > 0.0:
                self._at_rest[key] = first
        return [at._replace(depth=self._net[key]) for key, at in near.items()]

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
            own = watch.owners > HELD
            watch.points[own] = self._points[watch.rows[own]]
        if self.held is not None:
            self._look_at_held()

    def _look_at_held(self) -> None:
        """Find the contacts of the hand with what it holds."""
        places = Places(self._pushed)
        if self.held is not None and self._held_index is not None:
            all_normals, all_offsets = self._held_planes
            for part in self.held.parts:
                sides = Sides(all_normals[part], self.held.is_covered[part])
                beyond = self._points @ sides.normals.T - all_offsets[part]
                rows = np.flatnonzero(beyond.max(axis=1) < 0.0)
                if len(rows):
                    where, owners = self._points[rows], self._owner_of[rows]
                    watch = Watch(self._held_index, part, rows, owners, where)
                    places.add_all(watch, where, beyond[rows], sides)
        stiffness = self._config.contact_stiffness
        self.grip = [place.spring(stiffness) for place in places.found.values()]

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
            owners.append(np.asarray(HELD - self.held.part_of_points))
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
                (HELD - i, normals[s], offsets[s], covered[s])
                for i, s in enumerate(self.held.parts)
            ]
        for owner, normals, offsets, is_covered in solids:
            gaps = (points @ normals.T - offsets).max(axis=1)
            near = np.flatnonzero(gaps < _MARGIN)
            if len(near):
                self._guards.append(Guard(owner, i, near, normals, offsets, is_covered))
