"""Which solids of a robot move with which joint of a chain.

With one chain moving and every other joint held, the robot falls into d + 1 rigid
segments: segment 0 stands still, segment i moves with the chain's i-th joint. An idle
arm on a moving torso is part of the torso's segment.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.geometry import SE3, Solid

from .chain import KinematicChain
from .robot import RobotModel
from .solids import solids_of_shape

__all__ = ["BodyPart", "RobotBody"]


@dataclass(frozen=True, slots=True, eq=False)
class BodyPart:
    """One solid of one link."""

    link: str
    solid: Solid
    """In the frame of its segment."""
    segment: int
    is_hand: bool
    """Belongs to the hand at the end of the chain."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RobotBody:
    """All solids of a robot, sorted into the segments of one chain."""

    chain: KinematicChain
    parts: tuple[BodyPart, ...]
    pairs: IntArray
    """Pairs of parts that could touch: the part on the later segment first; (m, 2)."""
    always_touching: tuple[tuple[str, str], ...] = ()
    """Links that overlap in every posture, and are not tested for that reason."""

    def __repr__(self) -> str:
        return f"<RobotBody of {len(self.parts)} parts on {self.chain!r}>"

    @classmethod
    def fit(
        cls,
        robot: RobotModel,
        arm: str,
        chain: KinematicChain,
        held: Mapping[str, float] | None = None,
    ) -> RobotBody:
        """Collect the solids; ``held`` gives joints off the chain other values."""
        tree, spec = robot.tree, robot.arm(arm)
        order = {name: i + 1 for i, name in enumerate(chain.joint_names)}
        at_zero = dict.fromkeys(chain.joint_names, 0.0)
        poses = robot.link_poses({**(held or {}), **at_zero})
        hand = tree.links_below(spec.hand)
        parts = []
        for link, shapes in tree.shapes.items():
            above = (order.get(j.name, 0) for j in tree.joints_above(link))
            segment = max(above, default=0)
            to_segment = SE3.from_parts(
                p=-chain.points[segment - 1] if segment else np.zeros(3)
            )
            for shape in shapes:
                for solid in solids_of_shape(shape, link, tree.path.parent):
                    placed = solid.moved(to_segment @ poses[link])
                    parts.append(BodyPart(link, placed, segment, link in hand))
        pairs = _pairs(robot, parts)
        return cls(chain=chain, parts=tuple(parts), pairs=pairs)

    def segment_poses(self, q: FloatArray) -> FloatArray:
        """Pose of every segment in base for postures (n, d), shape (n, d + 1, 4, 4)."""
        moving = self.chain.joint_frames(q).matrix
        poses = np.empty((len(q), moving.shape[1] + 1, 4, 4))
        poses[:, 0], poses[:, 1:] = np.eye(4), moving
        return poses


def _pairs(robot: RobotModel, parts: list[BodyPart]) -> IntArray:
    """Pairs on different segments whose links are neither joined nor ignored."""
    tree = robot.tree
    body = {part.link: tree.body_of(part.link) for part in parts}
    joined = set(map(frozenset, robot.ignored_collisions))
    for joint in tree.joints.values():
        ends = (tree.body_of(joint.parent), tree.body_of(joint.child))
        joined.add(frozenset(ends))
    found = []
    for i, a in enumerate(parts):
        for j, b in enumerate(parts[:i]):
            if a.segment == b.segment:
                continue
            links = frozenset((a.link, b.link))
            bodies = frozenset((body[a.link], body[b.link]))
            if len(bodies) == 1 or links in joined or bodies in joined:
                continue
            found.append((i, j) if a.segment > b.segment else (j, i))
    return np.array(found, dtype=np.intp).reshape(-1, 2)
