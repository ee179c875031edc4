"""Contacts of the links' own solids: slow, and right to the last digit.

Solids of the robot are tested against one another by the exact checker. Against space,
every measured point and every unknown cell's centre near a solid is measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, finite
from debrisgrasp.geometry import Box, Capsule, Cylinder, Solid, Sphere
from debrisgrasp.kinematics.body import RobotBody
from debrisgrasp.kinematics.exact import ExactSolids
from debrisgrasp.kinematics.hull import Hull

from .space import MotionSpace

__all__ = ["Contact", "ExactArm", "ExactTest"]

GROUND, MEASURED, UNKNOWN = "the ground", "a measured surface", "unknown space"


@dataclass(frozen=True, slots=True)
class Contact:
    """A link that comes too near to something."""

    link: str
    what: str
    """Name of another link, or of what the space holds there."""

    def __str__(self) -> str:
        return f"{self.link} touches {self.what}"


@dataclass(frozen=True, eq=False)
class ExactArm:
    """The solids of a robot body, ready for exact tests."""

    body: RobotBody

    @cached_property
    def solids(self) -> ExactSolids:
        """As the exact checker holds them."""
        return ExactSolids([part.solid for part in self.body.parts])

    @cached_property
    def segments(self) -> IntArray:
        """Segment of each part, shape (p,)."""
        return np.array([part.segment for part in self.body.parts], dtype=np.intp)

    @cached_property
    def balls(self) -> tuple[FloatArray, FloatArray]:
        """Centre (p, 3) in its segment and radius (p,) of a ball around each part."""
        bounds = [part.solid.bounds for part in self.body.parts]
        centers = np.array([0.5 * (b.lower + b.upper) for b in bounds])
        return centers, np.array([0.5 * np.linalg.norm(b.size) for b in bounds])


@dataclass(frozen=True, eq=False, kw_only=True)
class ExactTest:
    """Tests postures of one arm in one space, by the solids themselves."""

    arm: ExactArm
    space: MotionSpace
    margin: float
    """Distance that solids keep from the space's obstacles [m]."""
    self_margin: float
    """Distance that the parts of the robot keep from one another [m]."""
    with_hand: bool = True
    """Whether the hand, too, is tested against the space."""

    def is_free(self, q: FloatArray) -> BoolArray:
        """Whether postures (n, d) are free of contact, shape (n,)."""
        # One of NaN lies near nothing.
        q = finite(q, "postures", (None, self.arm.body.chain.n_joints))
        found = np.ones(len(q), dtype=bool)
        if not len(q):
            return found
        poses = self.arm.body.segment_poses(q)
        centers = self._ball_centers(poses)
        for rows, _, _ in self._space_contacts(poses, centers):
            found[rows] = False
        for row in np.flatnonzero(found):
            found[row] = not self._self_contacts(poses[row], centers[row], limit=1)
        return found

    def contacts(self, q: ArrayLike) -> tuple[Contact, ...]:
        """All contacts in one posture (d,)."""
        q = finite(q, "posture", (self.arm.body.chain.n_joints,))
        poses = self.arm.body.segment_poses(q[None])
        centers = self._ball_centers(poses)
        parts = self.arm.body.parts
        found = [
            Contact(parts[part].link, what)
            for rows, part, what in self._space_contacts(poses, centers)
            if len(rows)
        ]
        found += [
            Contact(parts[i].link, parts[j].link)
            for i, j in self._self_contacts(poses[0], centers[0], limit=len(parts))
        ]
        return tuple(dict.fromkeys(found))

    def _ball_centers(self, poses: FloatArray) -> FloatArray:
        """Centres of the balls around all parts in base, (n, p, 3)."""
        T = poses[:, self.arm.segments]
        centers = self.arm.balls[0]
        placed: FloatArray = (T[..., :3, :3] @ centers[:, :, None])[..., 0]
        return placed + T[..., :3, 3]

    def _self_contacts(
        self, poses: FloatArray, centers: FloatArray, limit: int
    ) -> list[tuple[int, int]]:
        """Pairs of parts that touch with segments posed so, (d + 1, 4, 4)."""
        arm, (_, radii) = self.arm, self.arm.balls
        pairs, found = arm.body.pairs, []
        one, other = pairs[:, 0], pairs[:, 1]
        gap = np.linalg.norm(centers[one] - centers[other], axis=1)
        gap -= radii[one] + radii[other]
        near = np.flatnonzero(gap <= self.self_margin)
        for i, j in pairs[near[np.argsort(gap[near], kind="stable")]].tolist():
            T_i, T_j = poses[arm.segments[i]], poses[arm.segments[j]]
            if arm.solids.touch(i, T_i, j, T_j, self.self_margin):
                found.append((i, j))
                if len(found) == limit:
                    break
        return found

    def _space_contacts(
        self, poses: FloatArray, centers: FloatArray
    ) -> list[tuple[IntArray, int, str]]:
        """Rows in which a part touches something, the part, and what it touches."""
        arm, space, found = self.arm, self.space, []
        _, radii = arm.balls
        near = self._near(centers)
        plane = space.ground_plane
        is_low = np.zeros(near.shape, dtype=bool)
        if plane is not None:
            is_low = centers @ plane[:3] + plane[3] - radii < self.margin
        for part in np.flatnonzero((near | is_low).any(axis=0)).tolist():
            mine = arm.body.parts[part]
            if not mine.segment or (mine.is_hand and not self.with_hand):
                continue
            solid, T = mine.solid, poses[:, arm.segments[part]]
            low = np.flatnonzero(is_low[:, part])
            if plane is not None and len(low):
                normals = T[low, :3, :3].swapaxes(1, 2) @ plane[:3]
                offset = T[low, :3, 3] @ plane[:3] + plane[3]
                lowest = offset + np.array([_least(solid, n) for n in normals])
                low = low[lowest < self.margin]
                if len(low):
                    found.append((low, part, GROUND))
            rows = np.flatnonzero(near[:, part])
            if not len(rows):
                continue
            reach = radii[part] + self.margin
            for is_unknown, what in ((False, MEASURED), (True, UNKNOWN)):
                tree = space.unknown_tree if is_unknown else space.measured_tree
                if not tree.n:
                    continue
                lists = tree.query_ball_point(centers[rows, part], reach)
                counts = np.array([len(each) for each in lists])
                if not counts.any():
                    continue
                index = np.concatenate([np.array(e, dtype=np.intp) for e in lists])
                points, owner = tree.data[index], np.repeat(rows, counts)
                if is_unknown and space.opened is not None:
                    closed = ~space.is_open(points)
                    points, owner = points[closed], owner[closed]
                offset = points - T[owner, :3, 3]
                own = (offset[:, None] @ T[owner, :3, :3])[:, 0]
                hits = solid.signed_distance(own) < self.margin
                if hits.any():
                    found.append((np.unique(owner[hits]), part, what))
        return found

    def _near(self, centers: FloatArray) -> BoolArray:
        """Whether balls (n, p) may reach a point of the space."""
        _, radii = self.arm.balls
        if self.space.coarse is None:
            return np.zeros(centers.shape[:2], dtype=bool)
        grid, gap = self.space.coarse
        x, y, z = np.moveaxis(centers.astype(np.float32), -1, 0)
        reach = radii + self.margin + 0.87 * grid.spacing
        # What lies outside the grid, or beyond its reach, may be nearer than that.
        is_large = reach >= grid.truncation
        near: BoolArray = (gap[grid.cell(x, y, z)] < reach) | is_large
        return near


def _least(solid: Solid, normal: FloatArray) -> float:
    """Least value of ``normal . x`` over a solid; the normal has unit length."""
    if isinstance(solid, Sphere):
        return float(normal @ solid.center - solid.radius)
    if isinstance(solid, Hull):
        placed = solid.T_frame_solid.apply(solid.points)
        return float((placed @ normal).min())
    if not isinstance(solid, Box | Cylinder | Capsule):
        raise TypeError(f"no extent for {type(solid).__name__}")
    own = solid.T_frame_solid.R.T @ normal
    middle = float(normal @ solid.T_frame_solid.p)
    if isinstance(solid, Box):
        return middle - float(np.abs(own) @ solid.half_extents)
    half = 0.5 * solid.length * abs(float(own[2]))
    if isinstance(solid, Capsule):
        return middle - half - solid.radius
    return middle - half - solid.radius * float(np.hypot(own[0], own[1]))
