"""Links of an arm as spheres, to know afterwards what they went through."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import KinematicChain, RobotModel
from debrisgrasp.kinematics.solids import solids_of_shape

from .shapes import BodyShape

__all__ = ["LinkSpheres"]

_RADIUS = 0.06
"""Largest of the spheres [m]."""
_SLACK = 0.01
"""By which spheres stick out of the links they contain, about [m]."""


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
        self._q_last: Sequence[float] = ()

    def has_moved(self, q: Sequence[float]) -> bool:
        """Whether the arm is elsewhere than when this was asked last."""
        has_moved, self._q_last = q != self._q_last, q
        return has_moved

    def overlaps(
        self, q: Sequence[float], T_odom_base: SE3, bodies: Sequence[BodyShape]
    ) -> Iterator[tuple[int, float]]:
        """Numbers of bodies that the links are in, and how deep [m]."""
        if not len(self._radii):
            return
        T = (T_odom_base @ self._chain.joint_frames(np.asarray(q))).matrix
        T = T[self._joints]
        centers: FloatArray = np.einsum("nij,nj->ni", T[:, :3, :3], self._centers)
        centers += T[:, :3, 3]
        for i, body in enumerate(bodies):
            gaps = np.linalg.norm(centers - body.middle, axis=1) - self._radii
            near = gaps < body.radius
            if near.any():
                depths = body.depths(centers[near]).min(axis=1) - self._radii[near]
                deepest = -float(depths.min()) - _SLACK
                if deepest > 0.0:
                    yield i, deepest
