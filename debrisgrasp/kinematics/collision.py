"""Tests whether the links of an arm touch the scene, or the robot itself.

Links are covered by spheres, so the batched tests never miss a collision but may report
it a centimetre early. Contact of the robot with itself is then confirmed on the
exact solids.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import (
    BoolArray,
    FloatArray,
    as_floats,
    require_finite,
)
from debrisgrasp._checked import checked
from debrisgrasp.errors import ShapeError
from debrisgrasp.geometry import SE3, Solid

from .body import RobotBody
from .chain import KinematicChain
from .exact import ExactSolids
from .pairs import without_idle_pairs
from .robot import RobotModel
from .scene_cover import Distance, SceneCover, scene_clearance
from .segments import SegmentLanes, joint_frames_of_segments
from .self_gaps import SelfGaps, SelfModel

__all__ = ["ArmCollision", "Distance"]

_SPHERE_RADIUS = 0.08
"""Default radius of the spheres for the scene [m]: less than the distance at which the
planner's map of obstacles is truncated."""
_SELF_EXCESS = 0.02
"""How far spheres for the robot itself stand out over the solids [m]: finer ones cost
more time than the exact tests that they spare."""
_HORIZON = 0.1
"""Clearances saturate here [m]."""
_CLOSE = 0.01
"""Gaps between spheres below this are replaced by exact distances [m]."""
_CHUNK = 1024
"""Postures tested against the scene at once; bounds memory."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ArmCollision:
    """Collision tests for the postures of one arm, all other joints held.

    `is_free` and `clearance` answer for thousands of postures; the others say more.
    """

    body: RobotBody
    sphere_radius: float = _SPHERE_RADIUS
    """Largest radius of the spheres for the scene [m]; smaller ones fit the links more
    closely and cost more."""
    self_margin: float = 0.0
    """Distance that the parts of the robot keep from one another [m]."""

    @classmethod
    @checked
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
            Largest radius of a sphere for the scene [m].
        self_margin
            Distance that the parts of the robot keep from one another [m].
        """
        chain = robot.chain(arm) if chain is None else chain
        body = without_idle_pairs(RobotBody.fit(robot, arm, chain, held), self_margin)
        return cls(body=body, sphere_radius=sphere_radius, self_margin=self_margin)

    def clearance(
        self,
        q: ArrayLike,
        distance: Distance | None = None,
        *,
        with_hand: bool = True,
        horizon: float = _HORIZON,
    ) -> FloatArray:
        """Distance that the robot keeps from itself and from a scene, for certain.

        Parameters
        ----------
        q
            Postures [rad or m], shape (..., d).
        distance
            Distance to the nearest obstacle; see `Distance`. None: nothing around.
        with_hand
            Whether the hand, too, is tested against the scene.
        horizon
            Clearances saturate here [m].

        Returns
        -------
        FloatArray
            Clearance [m], shape (...): never more than the true one, and not above zero
            where there is a contact; how far below says little. As to the robot itself
            it is above zero wherever nothing touches; as to the scene, a covering
            sphere that touches makes it zero.
        """
        rows, batch = self._rows(q)
        gap = self._self_clearance(rows, horizon)
        if distance is not None:
            scene = self.scene_clearance(rows, distance, with_hand=with_hand)
            gap = np.minimum(gap, scene)
        return gap.reshape(batch)

    def is_free(
        self,
        q: ArrayLike,
        distance: Distance | None = None,
        *,
        with_hand: bool = True,
        margin: float = 0.0,
    ) -> BoolArray:
        """Whether the robot keeps its margins from itself and from a scene.

        Parameters
        ----------
        q, distance, with_hand
            As for `clearance`.
        margin
            Clearance that the links keep from the scene [m].

        Returns
        -------
        BoolArray
            Shape (...). True is certain. False is certain as to the robot itself; as
            to the scene, a covering sphere comes nearer than the margin.
        """
        rows, batch = self._rows(q)
        is_free = np.ones(len(rows), dtype=bool)
        if distance is not None:
            scene = self.scene_clearance(rows, distance, with_hand=with_hand)
            is_free &= scene >= margin
        is_free[is_free] = ~self.hits_itself(rows[is_free])
        return is_free.reshape(batch)

    def scene_clearance(
        self, q: ArrayLike, distance: Distance, *, with_hand: bool = False
    ) -> FloatArray:
        """Least distance of the moving links from the scene.

        Parameters
        ----------
        q
            Postures [rad or m], shape (..., d).
        distance
            Distance to the nearest obstacle; see `Distance`.
        with_hand
            Whether the hand counts. A grasp planner tests it more closely by itself.

        Returns
        -------
        FloatArray
            Clearance [m], shape (...): positive means clear for certain; negative
            means that a covering sphere reaches into an obstacle by so much.
        """
        rows, batch = self._rows(q)
        covers = [c for c in self._scene_covers if with_hand or not c.is_hand]
        clearance = np.full(len(rows), np.inf)
        for start in range(0, len(rows) if covers else 0, _CHUNK):
            part = slice(start, start + _CHUNK)
            lanes = SegmentLanes(self.body.chain, rows[part])
            poses = [self._placed(lanes, cover.segment) for cover in covers]
            clearance[part] = scene_clearance(covers, poses, distance)
        return clearance.reshape(batch)

    def may_hit_itself(self, q: ArrayLike) -> BoolArray:
        """Whether the robot may touch itself; where False it certainly does not.

        Takes postures (..., d) and returns (...). The hand counts as a part of the
        robot, in the posture that joints off the chain are held in.
        """
        rows, batch = self._rows(q)
        is_doubtful = np.zeros(len(rows), dtype=bool)
        is_doubtful[self._gaps(rows).posture] = True
        return is_doubtful.reshape(batch)

    def hits_itself(self, q: ArrayLike) -> BoolArray:
        """Whether the robot comes nearer to itself than its margin.

        Takes postures (..., d) and returns (...); decided on the exact solids.
        """
        rows, batch = self._rows(q)
        gaps = self._gaps(rows)
        is_hit = gaps.is_hit.copy()
        unsure = np.flatnonzero(~is_hit[gaps.posture])
        # The deepest pair is the likeliest contact, and one contact is enough.
        unsure = unsure[np.argsort(gaps.pair_gap[unsure], kind="stable")]
        postures, place = np.unique(gaps.posture[unsure], return_inverse=True)
        poses = self.body.segment_poses(rows[postures])
        for posture, row, pair in zip(
            gaps.posture[unsure].tolist(), place, gaps.pair[unsure], strict=True
        ):
            if not is_hit[posture]:
                is_hit[posture] = self._touch(poses[row], pair)
        return is_hit.reshape(batch)

    def self_contacts(self, q: ArrayLike) -> tuple[tuple[str, str], ...]:
        """Pairs of links that touch in one posture (d,), by their exact solids.

        Raises
        ------
        ShapeError
            If it is not one posture.
        """
        parts, rows = self.body.parts, self._one_row(q)
        poses = self.body.segment_poses(rows)[0]
        names = [
            (parts[i].link, parts[j].link)
            for pair in sorted(self._gaps(rows).pair)
            for i, j in (self.body.pairs[pair],)
            if self._touch(poses, pair)
        ]
        return tuple(dict.fromkeys(names))

    def self_distance(self, q: ArrayLike) -> float:
        """Least distance of two parts in one posture (d,) [m], by exact solids.

        Slow: every pair is measured. Negative where parts overlap.

        Raises
        ------
        ShapeError
            If it is not one posture.
        """
        poses = self.body.segment_poses(self._one_row(q))[0]
        return min(
            (self._distance(poses, pair) for pair in range(len(self.body.pairs))),
            default=np.inf,
        )

    def _self_clearance(self, q: FloatArray, horizon: float) -> FloatArray:
        gaps = self._self_model.gaps(q, _CLOSE, horizon)
        clearance = gaps.gap
        is_close = np.zeros(len(q), dtype=bool)
        is_close[gaps.posture] = True
        # All other pairs of these are farther apart than _CLOSE.
        clearance[is_close] = min(_CLOSE, horizon)
        clearance[gaps.is_hit] = -np.inf
        postures, place = np.unique(gaps.posture, return_inverse=True)
        poses = self.body.segment_poses(q[postures])
        for i in np.argsort(gaps.pair_gap, kind="stable"):
            posture = gaps.posture[i]
            if gaps.pair_gap[i] < clearance[posture]:
                distance = self._distance(poses[place[i]], gaps.pair[i])
                clearance[posture] = min(clearance[posture], distance)
        clearance[gaps.is_hit] = gaps.gap[gaps.is_hit]
        return clearance

    def _distance(self, poses: FloatArray, pair: int) -> float:
        """Distance of a pair with the segments posed so, (d + 1, 4, 4) [m]."""
        i, j = self.body.pairs[pair]
        one, other = (self.body.parts[k].segment for k in (i, j))
        return self._exact.distance(i, poses[one], j, poses[other])

    def _touch(self, poses: FloatArray, pair: int) -> bool:
        """Whether a pair touches with the segments posed so, (d + 1, 4, 4)."""
        i, j = self.body.pairs[pair]
        one, other = (self.body.parts[k].segment for k in (i, j))
        return self._exact.touch(i, poses[one], j, poses[other], self.self_margin)

    def _gaps(self, rows: FloatArray) -> SelfGaps:
        return self._self_model.gaps(rows, self.self_margin, self.self_margin)

    @cached_property
    def _exact(self) -> ExactSolids:
        return ExactSolids([part.solid for part in self.body.parts])

    @cached_property
    def _self_model(self) -> SelfModel:
        return SelfModel.fit(self.body, _SELF_EXCESS)

    @cached_property
    def _scene_covers(self) -> list[SceneCover]:
        parts: dict[tuple[int, bool], list[Solid]] = {}
        for part in self.body.parts:
            if part.segment:
                parts.setdefault((part.segment, part.is_hand), []).append(part.solid)
        return [
            SceneCover(*key, solids, self.sphere_radius)
            for key, solids in sorted(parts.items())
        ]

    @cached_property
    def _joint_frames(self) -> list[SE3]:
        return joint_frames_of_segments(self.body.chain)

    def _placed(
        self, lanes: SegmentLanes, segment: int
    ) -> tuple[FloatArray, FloatArray]:
        """Rotations (k, 3, 3) and origins (k, 3) of a segment in base."""
        T, own = self.body.chain.form.T_base_first, self._joint_frames[segment]
        R, p = (pose.astype(np.float64) for pose in lanes.pose(segment))
        turn = T[:3, :3] @ np.moveaxis(R, -1, 0)
        origin = p.T @ T[:3, :3].T + T[:3, 3]
        return turn @ own.R, turn @ own.p + origin

    def _one_row(self, q: ArrayLike) -> FloatArray:
        """Return one posture (d,) as a row, shape (1, d), or raise if it is not one."""
        rows, batch = self._rows(q)
        if batch:
            raise ShapeError(
                "shape of posture", got=np.shape(q), expected=f"({rows.shape[1]},)"
            )
        return rows

    def _rows(self, q: ArrayLike) -> tuple[FloatArray, tuple[int, ...]]:
        d = self.body.chain.n_joints
        q = as_floats(q, "joint values", (d,))
        require_finite(q, "joint values")
        return q.reshape(-1, d), q.shape[:-1]
