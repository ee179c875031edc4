"""Bodies where they are: they can be moved, and sink to rest when asked."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from math import cos, sin

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3
from debrisgrasp.worlds import Body, World, come_to_rest

from .config import FakeConfig
from .shapes import BodyShape
from .springs import GROUND

__all__ = ["Rubble"]

_TOUCH = 0.003
"""Gap below which bodies count as touching [m]."""
_BESIDE = 0.01
"""Boxes around bodies that are nearer than this make them neighbours [m]."""
_COLUMN = 0.2
"""How far beside a falling body others may still be met [m]."""
_ROUNDS = 4
_OVERLAP = 2e-4
"""Bodies may be so deep in each other and still fall freely [m]."""
_THRICE = 3.0 * np.eye(3)
_PUSHES_OUT, _FREED = 8, 2.0
"""So often, and so many times as far as it overlaps, a body is moved out of others."""


class Rubble:
    """The bodies of a world, by number."""

    def __init__(self, world: World, config: FakeConfig) -> None:
        self._world, self._config = world, config
        self.names = world.names
        self.shapes = [BodyShape(body) for body in world.bodies]
        self.version = 0
        """Changes whenever bodies moved by themselves."""
        self._is_current = True

    @property
    def world(self) -> World:
        """Bodies where they are now."""
        if not self._is_current:
            poses = [SE3.from_parts(shape.R, shape.p) for shape in self.shapes]
            bodies = [
                body
                if np.array_equal(body.T_base_body.matrix, T.matrix)
                else body.at(T)
                for body, T in zip(self._world.bodies, poses, strict=True)
            ]
            self._world = World(tuple(bodies), self._world.ground, self._world.name)
            self._is_current = True
        return self._world

    def place(self, body: int, R: FloatArray, p: FloatArray) -> None:
        """Put a body somewhere.

        What rounding adds to rotations that follow from each other grows where bodies
        ride on each other: a step of Newton and Schulz takes it out.
        """
        self.shapes[body].place(0.5 * R @ (_THRICE - R.T @ R), p)
        self._is_current = False

    def shift(self, body: int, way: FloatArray) -> None:
        """Move a body without turning it."""
        self.shapes[body].shift(way)
        self._is_current = False

    def turn(self, body: int, angle: float, about: FloatArray) -> None:
        """Turn a body [rad] about the vertical through a point, shape (3,) [m]."""
        shape, c, s = self.shapes[body], cos(angle), sin(angle)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        self.place(body, R @ shape.R, about + R @ (shape.p - about))

    def box(self, body: int) -> tuple[FloatArray, FloatArray]:
        """Corners of the box around a body [m]."""
        return self.shapes[body].box

    def neighbours(
        self, body: int, box: tuple[FloatArray, FloatArray] | None = None
    ) -> set[int]:
        """Bodies that may touch a body, or what is in a box."""
        low, high = box or self.box(body)
        found = set()
        for other in range(len(self.shapes)):
            if other != body:
                lower, upper = self.box(other)
                if (lower < high + _BESIDE).all() and (upper > low - _BESIDE).all():
                    found.add(other)
        return found

    def touching(self, body: int) -> set[int]:
        """Bodies that touch a body."""
        shape = self.shapes[body]
        return {
            other
            for other in self.neighbours(body)
            if _depth(shape, self.shapes[other])[0] > -_TOUCH
        }

    def is_on(self, upper: int, lower: int) -> bool:
        """Whether one body bears the other from below."""
        above, below = self.shapes[upper], self.shapes[lower]
        return _bears(below, above.points, 1.0) or _bears(above, below.points, -1.0)

    def is_on_ground(self, body: int) -> bool:
        """Whether a body touches the ground."""
        points = self.shapes[body].points
        heights = self._world.ground.height(points[:, :2])
        return bool((points[:, 2] - heights).min() < _TOUCH)

    def riders(self, body: int) -> dict[int, float]:
        """Bodies that lie on a body, or on those, and the share of their weight.

        What lies on something else as well bears down on it with half.
        """
        found = dict[int, float]()
        waiting: list[tuple[tuple[int, ...], float]] = [((body,), 1.0)]
        while waiting:
            chain, part = waiting.pop()
            lower = chain[-1]
            for other in self.neighbours(lower).difference(chain):
                if self.is_on(other, lower):
                    beside = self.neighbours(other) - {lower}
                    is_shared = self.is_on_ground(other) or any(
                        self.is_on(other, third) for third in beside
                    )
                    share = part * (0.5 if is_shared else 1.0)
                    found[other] = min(found.get(other, 0.0) + share, 1.0)
                    waiting.append(((*chain, other), share))
        return found

    def depths(self, body: int) -> dict[int, float]:
        """How deep a body is in each neighbour, and in the ground (`GROUND`) [m]."""
        shape = self.shapes[body]
        heights = self._world.ground.height(shape.points[:, :2])
        return {
            GROUND: float((heights - shape.points[:, 2]).max()),
            **{
                other: _depth(shape, self.shapes[other])[0]
                for other in self.neighbours(body)
            },
        }

    def settle(
        self,
        loose: Iterable[int],
        held: Iterable[int],
        obstacles: Sequence[Body] = (),
    ) -> set[int]:
        """Let bodies sink to rest, and those that stood on what moved.

        Parameters
        ----------
        loose
            Bodies that may have lost their support.
        held
            Bodies that do not move.
        obstacles
            Hands, which do not move either.

        Returns
        -------
        set
            Bodies that moved.
        """
        fixed, waiting, moved = set(held), set(loose) - set(held), set[int]()
        for _ in range(_ROUNDS):
            if not waiting:
                break
            borne = {body: self.touching(body) for body in waiting}
            fallen = self._sunk(waiting, obstacles)
            moved |= fallen
            beside = set[int]().union(*(borne[body] for body in fallen))
            waiting = beside - fixed - waiting
        if moved:
            self.version += 1
        return moved

    def push_out(
        self, body: int, without: Collection[int], obstacles: Sequence[Body]
    ) -> None:
        """Move a body out of others that it was pressed into by a hand.

        What overlaps from two sides could not fall. Where there is no short way out of
        all of them it stays as little pressed in as it comes.
        """
        others = [
            *(self.shapes[i] for i in self.neighbours(body) - set(without)),
            *(BodyShape(obstacle) for obstacle in obstacles),
        ]
        shape, start = self.shapes[body], self.shapes[body].p
        least, best, farthest = np.inf, start, 0.0
        for _ in range(_PUSHES_OUT):
            depth, way = _way_out(shape, others)
            if depth < least:
                least, best = depth, shape.p
            if depth <= _OVERLAP:
                break
            farthest = farthest or _FREED * depth
            if float(np.linalg.norm(shape.p + depth * way - start)) > farthest:
                break
            self.shift(body, depth * way)
        if best is not shape.p:
            self.shift(body, best - shape.p)

    def _sunk(self, loose: set[int], obstacles: Sequence[Body]) -> set[int]:
        """Let some bodies sink, the lowest first, onto those that already lie."""
        waiting = sorted(loose, key=lambda body: self.box(body)[0][2])
        fallen = set()
        while waiting:
            # What lies on a body does not keep it from falling: it follows.
            body = waiting.pop(0)
            if self._sink(body, waiting, obstacles):
                fallen.add(body)
        return fallen

    def _sink(
        self, body: int, without: Collection[int], obstacles: Sequence[Body]
    ) -> bool:
        """Let one body sink; return whether it moved."""
        start = self.shapes[body].com
        self.push_out(body, without, obstacles)
        low, high = self.box(body)
        near = [
            i
            for i in range(len(self.shapes))
            if i not in without
            and (self.box(i)[0][:2] < high[:2] + _COLUMN).all()
            and (self.box(i)[1][:2] > low[:2] - _COLUMN).all()
        ]
        world = self.world
        bodies = (*(world.bodies[i] for i in near), *obstacles)
        scene = World(bodies, world.ground)
        fixed = [other.name for other in bodies if other.name != self.names[body]]
        rested = come_to_rest(scene, self._config.rest, fixed=fixed)
        if rested.moved:
            pose = rested.world.bodies[near.index(body)].T_base_body
            self.place(body, pose.R, pose.p)
        return float(np.linalg.norm(self.shapes[body].com - start)) > _TOUCH


def _way_out(shape: BodyShape, others: Sequence[BodyShape]) -> tuple[float, FloatArray]:
    """How deep a body is in one of some others [m], and its way out of it (3,)."""
    found = [(0.0, np.zeros(3)), *(_depth(shape, other) for other in others)]
    return max(found, key=lambda depth_and_way: depth_and_way[0])


def _depth(one: BodyShape, other: BodyShape) -> tuple[float, FloatArray]:
    """How deep two bodies are in each other [m], and the way out of the first (3,).

    Edges of one fit between the points of the other: it is asked both ways.
    """
    into, around = other.deepest(one.points), one.deepest(other.points)
    return into if into[0] >= around[0] else (around[0], -around[1])


def _bears(shape: BodyShape, points: FloatArray, sign: float) -> bool:
    """Whether points (n, 3) touch sides of a body that face up (1) or down (-1)."""
    low, high = shape.points.min(axis=0) - _TOUCH, shape.points.max(axis=0) + _TOUCH
    points = points[((points > low) & (points < high)).all(axis=1)]
    for part in shape.parts:
        normals = shape.normals[part]
        beyond = points @ normals.T - shape.offsets[part]
        near = np.flatnonzero(beyond.max(axis=1, initial=-np.inf) < _TOUCH)
        if len(near) and (sign * normals[beyond[near].argmax(axis=1), 2] > 0.3).any():
            return True
    return False
