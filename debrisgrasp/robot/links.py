"""Links of an arm as spheres, to know afterwards what they went through."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import KinematicChain, RobotModel
from debrisgrasp.kinematics.solids import solids_of_shape

from .shapes import BodyShape

__all__ = ["LinkSpheres"]

_RADIUS = 0.06
"""Largest of the spheres [m]."""
_SLACK = 0.01
"""By which spheres stick out of the links they contain, about [m]."""
_NEAR = 0.1
"""Of spheres that are nearer than this to the ball around a body it is worth knowing
how far they are from its sides [m]."""
_ROUNDING = 1e-6
"""[m]."""


class LinkSpheres:
    """Spheres around the links of one arm, without its hand."""

    def __init__(self, model: RobotModel, arm: str, chain: KinematicChain) -> None:
        tree, hand = model.tree, model.tree.links_below(model.arm(arm).hand)
        poses = model.link_poses(dict.fromkeys(chain.joint_names, 0.0))
        frames = chain.joint_frames(np.zeros(chain.n_joints))
        self._chain = chain
        centers, radii, joints = [np.zeros((0, 3))], [np.zeros(0)], []
        shared = {
            joint
            for other in model.arms
            if other != arm
            for joint in model.chain(other).joint_names
        }
        for i, name in enumerate(chain.joint_names):
            if name in shared:
                continue
            for link, shapes in tree.shapes.items():
                if link in hand or tree.body_of(link) != tree.joints[name].child:
                    continue
                T_joint_link = frames[i].inverse() @ poses[link]
                for shape in shapes:
                    for solid in solids_of_shape(shape, link, tree.path.parent):
                        found = solid.moved(T_joint_link).sphere_cover(_RADIUS)
                        centers.append(found[0])
                        radii.append(found[1])
                        joints += [i] * len(found[1])
        self._centers, self._radii = np.concatenate(centers), np.concatenate(radii)
        self._joints = np.array(joints, dtype=int)
        self._levers = _levers(chain, self._centers, self._joints)
        self._q_last: Sequence[float] = ()
        self._gone = 0.0
        """What no sphere has gone more than, in base, since the start [m]."""
        self._clear: dict[int, tuple[FloatArray, float]] = {}
        """By body: where it was, and how far the spheres may have gone before one can
        be in it."""
        self._T_last: SE3 | None = None

    def has_moved(self, q: Sequence[float]) -> bool:
        """Whether the arm is elsewhere than when this was asked last."""
        last, self._q_last = self._q_last, q
        if q == last:
            return False
        for a, b, lever in zip(q, last, self._levers, strict=False):
            self._gone += abs(a - b) * lever
        return True

    def overlaps(
        self, q: Sequence[float], T_odom_base: SE3, bodies: Sequence[BodyShape]
    ) -> Iterator[tuple[int, float]]:
        """Numbers of bodies that the links are in, and how deep [m].

        ``q`` is that of which `has_moved` was told last. Bodies to which the links
        can't have come since they were looked at last are passed over.
        """
        if T_odom_base is not self._T_last:
            self._T_last = T_odom_base
            self._clear.clear()
        due = [
            (i, body) for i, body in enumerate(bodies) if not self._is_clear(i, body)
        ]
        if not due or not len(self._radii):
            return
        T = (T_odom_base @ self._chain.joint_frames(np.asarray(q))).matrix
        T = T[self._joints]
        centers: FloatArray = np.einsum("nij,nj->ni", T[:, :3, :3], self._centers)
        centers += T[:, :3, 3]
        for i, body in due:
            gaps = np.linalg.norm(centers - body.middle, axis=1) - self._radii
            gaps -= body.radius
            near = np.flatnonzero(gaps < _NEAR)
            if len(near):
                depths = body.depths(centers[near]).min(axis=1) - self._radii[near]
                depths += _SLACK
                # Lower bounds: beyond the ball around the body its gap may say more.
                beyond = gaps[near] >= 0.0
                gaps[near] = np.where(beyond, np.maximum(gaps[near], depths), depths)
            room = float(gaps.min())
            self._clear[i] = body.p, self._gone + room - _ROUNDING
            if room < 0.0:
                yield i, -room

    def _is_clear(self, i: int, body: BodyShape) -> bool:
        """Whether no sphere can have come to a body since it was looked at last."""
        place, until = self._clear.get(i, (None, 0.0))
        return place is body.p and self._gone < until


def _levers(
    chain: KinematicChain, centers: FloatArray, joints: IntArray
) -> list[float]:
    """How far a sphere moves per change of each joint at most [m or 1], d values.

    Centres (n, 3) are in the frames of their joints (n,).
    """
    ways = np.maximum(np.abs(chain.lower), np.abs(chain.upper))
    steps = np.linalg.norm(np.diff(chain.points, axis=0), axis=1)
    steps = steps + np.where(chain.is_revolute[1:], 0.0, ways[1:])
    last = int(joints.max(initial=0))
    farthest = float(np.linalg.norm(centers, axis=1).max(initial=0.0))
    turning = zip(chain.is_revolute, range(chain.n_joints), strict=True)
    return [farthest + float(steps[i:last].sum()) if t else 1.0 for t, i in turning]
