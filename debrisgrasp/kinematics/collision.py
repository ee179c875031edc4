"""Tests whether the links of an arm touch the scene, or the robot itself.

Links are covered by spheres, so the batched tests never miss a collision but may report
it some millimetres early. Contact of the robot with itself is then confirmed on the
exact solids.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, require_trailing
from debrisgrasp.errors import ShapeError
from debrisgrasp.geometry import SE3, Box, Capsule, Cylinder, Solid, Sphere

from .body import BodyPart, RobotBody
from .chain import KinematicChain
from .robot import RobotModel

__all__ = ["ArmCollision", "Distance"]

Distance = Callable[[FloatArray], FloatArray]
"""Maps points (..., 3) [m] in the base frame to their distance from the nearest
obstacle [m], shape (...). They may be truncated above the radius of the spheres."""

_SPHERE_RADIUS = 0.05
"""Default radius of the covering spheres [m]: below the truncation of usual fields."""
_CHUNK = 256
"""Postures treated at once; bounds memory."""


@dataclass(frozen=True, slots=True, eq=False)
class _Spheres:
    """Sphere covers of some parts, padded to the same number of spheres."""

    centers: FloatArray
    """In the frames of the segments [m], shape (parts, s, 3)."""
    radii: FloatArray
    """Radii [m], minus infinity where padded; shape (parts, s)."""

    @classmethod
    def cover(cls, parts: Sequence[BodyPart], max_radius: float) -> _Spheres:
        covers = [part.solid.sphere_cover(max_radius) for part in parts]
        most = max((len(radii) for _, radii in covers), default=0)
        centers = np.zeros((len(covers), most, 3))
        sizes = np.full((len(covers), most), -np.inf)
        for i, (points, radii) in enumerate(covers):
            centers[i, : len(radii)], sizes[i, : len(radii)] = points, radii
        return cls(centers, sizes)

    def grown(self, margin: float) -> _Spheres:
        """Return the same spheres with larger radii."""
        return _Spheres(self.centers, self.radii + margin)

    def touching(self, rows: IntArray, T: FloatArray, solid: Solid) -> IntArray:
        """Which of the covers ``rows``, moved by T (n, 4, 4), reach into a solid."""
        centers = self.centers[rows] @ np.swapaxes(T[:, :3, :3], -1, -2)
        centers += T[:, None, :3, 3]
        gap = solid.signed_distance(centers) - self.radii[rows]
        return np.flatnonzero(gap.min(axis=-1) <= 0.0)

    @classmethod
    def around(cls, parts: Sequence[BodyPart]) -> _Spheres:
        """One sphere around each part, of the size of its bounding box."""
        bounds = [part.solid.bounds for part in parts]
        middles = [0.5 * (b.lower + b.upper) for b in bounds]
        extents = [0.5 * np.linalg.norm(b.size) for b in bounds]
        return cls(
            np.array(middles).reshape(-1, 1, 3), np.array(extents).reshape(-1, 1)
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class ArmCollision:
    """Collision tests for the postures of one arm, all other joints held."""

    body: RobotBody
    sphere_radius: float = _SPHERE_RADIUS
    """Largest radius of the covering spheres [m]; smaller ones fit the links more
    closely and cost more."""
    self_margin: float = 0.0
    """Distance that the parts of the robot keep from one another [m]."""

    @classmethod
    def fit(
        cls,
        robot: RobotModel,
        arm: str,
        chain: KinematicChain | None = None,
        *,
        held: Mapping[str, float] | None = None,
        sphere_radius: float = _SPHERE_RADIUS,
        self_margin: float = 0.0,
    ) -> ArmCollision:
        """Cover the links of a robot.

        Parameters
        ----------
        robot, arm
            The robot, and which of its arms moves.
        chain
            The arm's chain, if not the default ``robot.chain(arm)``.
        held
            Values of joints off the chain, if not idle and at rest.
        sphere_radius
            Largest radius of a sphere [m].
        self_margin
            Distance that the parts of the robot keep from one another [m].
        """
        chain = robot.chain(arm) if chain is None else chain
        body = RobotBody.fit(robot, arm, chain, held)
        return cls(body=body, sphere_radius=sphere_radius, self_margin=self_margin)

    @cached_property
    def _scene_spheres(self) -> list[tuple[int, FloatArray, FloatArray]]:
        """Segment, centres and radii of the spheres that may touch the scene."""
        found = []
        for segment in range(1, self.body.chain.n_joints + 1):
            mine = [
                part
                for part in self.body.parts
                if part.segment == segment and not part.is_hand
            ]
            spheres = _Spheres.cover(mine, self.sphere_radius)
            is_real = np.isfinite(spheres.radii)
            if is_real.any():
                found.append(
                    (segment, spheres.centers[is_real], spheres.radii[is_real])
                )
        return found

    @cached_property
    def _bounding(self) -> _Spheres:
        return _Spheres.around(self.body.parts).grown(self.self_margin)

    @cached_property
    def _moving_cover(self) -> tuple[IntArray, _Spheres]:
        """Covers of the parts that come first in a pair, and where each part's is."""
        first = np.unique(self.body.pairs[:, 0])
        row = np.full(len(self.body.parts), -1)
        row[first] = np.arange(len(first))
        parts = [self.body.parts[i] for i in first]
        cover = _Spheres.cover(parts, self.sphere_radius)
        return row, cover.grown(self.self_margin)

    def scene_clearance(self, q: ArrayLike, distance: Distance) -> FloatArray:
        """Least distance of the moving links from the scene, hand left out.

        Parameters
        ----------
        q
            Postures [rad or m], shape (..., d).
        distance
            Distance to the nearest obstacle; see `Distance`.

        Returns
        -------
        FloatArray
            Clearance [m], shape (...): positive means clear for certain; negative
            means that a covering sphere reaches into an obstacle by so much.
        """
        rows, batch = self._rows(q)
        clearance = np.full(len(rows), np.inf)
        for part in _chunks(len(rows)):
            poses = self.body.segment_poses(rows[part])
            for segment, centers, radii in self._scene_spheres:
                R, p = poses[:, segment, :3, :3], poses[:, segment, None, :3, 3]
                points = centers @ np.swapaxes(R, -1, -2) + p
                least = (distance(points) - radii).min(axis=-1)
                np.minimum(clearance[part], least, out=clearance[part])
        return clearance.reshape(batch)

    def may_hit_itself(self, q: ArrayLike) -> BoolArray:
        """Whether the robot may touch itself; where False it certainly does not.

        Takes postures (..., d) and returns (...). The hand counts as a part of the
        robot, in the posture that joints off the chain are held in.
        """
        rows, batch = self._rows(q)
        is_doubtful = np.zeros(len(rows), dtype=bool)
        for part in _chunks(len(rows)):
            posture, _ = self._doubtful(self.body.segment_poses(rows[part]))
            is_doubtful[part.start + posture] = True
        return is_doubtful.reshape(batch)

    def hits_itself(self, q: ArrayLike) -> BoolArray:
        """Whether the robot comes nearer to itself than its margin.

        Takes postures (..., d) and returns (...); decided on the exact solids.
        """
        rows, batch = self._rows(q)
        is_hit = np.zeros(len(rows), dtype=bool)
        for part in _chunks(len(rows)):
            for posture, _ in self._contacts(rows[part], first_only=True):
                is_hit[part.start + posture] = True
        return is_hit.reshape(batch)

    def self_contacts(self, q: ArrayLike) -> tuple[tuple[str, str], ...]:
        """Pairs of links that touch in one posture (d,), by their exact solids."""
        rows, batch = self._rows(q)
        if batch:
            raise ShapeError(
                "shape of posture", got=np.shape(q), expected=f"({rows.shape[1]},)"
            )
        parts = self.body.parts
        names = [
            (parts[i].link, parts[j].link)
            for _, pair in self._contacts(rows, first_only=False)
            for i, j in (self.body.pairs[pair],)
        ]
        return tuple(dict.fromkeys(names))

    def _contacts(self, q: FloatArray, *, first_only: bool) -> list[tuple[int, int]]:
        """Posture and pair of every contact, or of the first of each posture."""
        import coal  # slow to load

        poses = self.body.segment_poses(q)
        request, found, hit = coal.CollisionRequest(), [], set()
        request.security_margin = self.self_margin
        for posture, pair in zip(*self._doubtful(poses), strict=True):
            if first_only and posture in hit:
                continue
            shapes, placed = [], []
            for index in self.body.pairs[pair]:
                shape, T_segment_shape = self._exact[index]
                T = poses[posture, self.body.parts[index].segment] @ T_segment_shape
                shapes.append(shape)
                placed.append(coal.Transform3s(T[:3, :3], T[:3, 3]))
            result = coal.CollisionResult()
            if coal.collide(
                shapes[0], placed[0], shapes[1], placed[1], request, result
            ):
                hit.add(posture)
                found.append((int(posture), int(pair)))
        return found

    @cached_property
    def _exact(self) -> list[tuple[Any, FloatArray]]:
        return [_exact_shape(part.solid) for part in self.body.parts]

    def _doubtful(self, poses: FloatArray) -> tuple[IntArray, IntArray]:
        """Postures and pairs that the spheres can't tell apart, by posture."""
        posture, pair = self._near_pairs(poses)
        row, cover = self._moving_cover
        parts, is_kept = self.body.parts, np.zeros(len(pair), dtype=bool)
        segments = np.array([part.segment for part in parts])
        moved, still = self.body.pairs[pair].T
        for j in np.unique(still):
            mine = np.flatnonzero(still == j)
            where, others = posture[mine], moved[mine]
            T_other_base = SE3(poses[:, parts[j].segment]).inverse().matrix
            T = T_other_base[where] @ poses[where, segments[others]]
            near = self._bounding.touching(others, T, parts[j].solid)
            close = cover.touching(row[others[near]], T[near], parts[j].solid)
            is_kept[mine[near[close]]] = True
        return posture[is_kept], pair[is_kept]

    def _near_pairs(self, poses: FloatArray) -> tuple[IntArray, IntArray]:
        """Postures and pairs whose bounding spheres overlap, by posture."""
        T = poses[:, [part.segment for part in self.body.parts]]
        middles = (T[..., :3, :3] @ self._bounding.centers[:, 0, :, None])[..., 0]
        middles = np.moveaxis(middles + T[..., :3, 3], -1, 0).astype(np.float32)
        a, b = self.body.pairs.T
        reach = self._bounding.radii[a, 0] + self._bounding.radii[b, 0]
        # Rounding to single precision must not lose a contact.
        limit = ((reach + 1e-5) ** 2).astype(np.float32)
        gap = middles[:, :, a]
        gap -= middles[:, :, b]
        gap *= gap
        posture, pair = np.nonzero(gap.sum(axis=0) < limit)
        return posture, pair

    def _rows(self, q: ArrayLike) -> tuple[FloatArray, tuple[int, ...]]:
        q = np.asarray(q, dtype=np.float64)
        d = self.body.chain.n_joints
        require_trailing(q, "joint values", (d,))
        return q.reshape(-1, d), q.shape[:-1]


def _chunks(n: int) -> Iterator[slice]:
    for start in range(0, n, _CHUNK):
        yield slice(start, min(start + _CHUNK, n))


def _exact_shape(solid: Solid) -> tuple[Any, FloatArray]:
    """Shape for the exact checker, and its pose in the solid's frame (4, 4)."""
    import coal  # slow to load

    if isinstance(solid, Sphere):
        return coal.Sphere(solid.radius), SE3.from_parts(p=solid.center).matrix
    if isinstance(solid, Box):
        return coal.Box(*(2.0 * solid.half_extents)), solid.T_frame_solid.matrix
    if isinstance(solid, Cylinder):
        return coal.Cylinder(solid.radius, solid.length), solid.T_frame_solid.matrix
    if isinstance(solid, Capsule):
        return coal.Capsule(solid.radius, solid.length), solid.T_frame_solid.matrix
    raise TypeError(f"no exact shape for {type(solid).__name__}")
