"""Hands of files of their own, mounted on arms whose URDF ends at the flange."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from debrisgrasp._words import arm_called
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3, Box, Capsule, Cylinder, Solid, Sphere

from .robot import RobotModel
from .solids import solids_of_shape
from .urdf import UrdfJoint, UrdfShape, UrdfTree

__all__ = ["with_hand"]

_OUT = 0.005
"""Fingers stand out in front of the palm by more than this [m]."""
_BEFORE = 0.03
"""The link at which a hand begins may have its origin so far ahead of the palm [m]."""


def with_hand(robot: RobotModel, arm: str, solids: Sequence[Solid]) -> RobotModel:
    """Return the robot with a hand on an arm, if its URDF has none there.

    It has one if a solid of the hand's links stands out in front of the palm. A hand
    that was mounted so before is replaced, for its fingers may stand otherwise.

    Parameters
    ----------
    robot, arm
        The robot, and which of its arms carries the hand.
    solids
        Palm and fingers, in the frame of the palm.

    Raises
    ------
    ConfigError
        If the arm's palm lies behind the link at which its hand begins.
    """
    spec, tree = robot.arm(arm), robot.tree
    T_hand_palm = tree.link_pose(spec.hand, {}).inverse() @ tree.link_pose(spec.tip, {})
    ahead = float(T_hand_palm.inverse().p[2])
    if ahead > _BEFORE:
        raise ConfigError(
            f"tip of {arm_called(arm)} of {robot.name}",
            got=f"{spec.tip}, {ahead:.3f} m behind {spec.hand}, where the hand begins",
            expected="one in front of it: z points out of the palm",
            mend="Look at the sign of its position, and at rpy, in the robot's file.",
        )
    link = f"{spec.gripper} of {arm}"
    if link not in tree.shapes and _has_hand(tree, spec.hand, spec.tip):
        return robot
    joint = UrdfJoint.fixed(spec.hand, link, T_hand_palm)
    mounted = replace(
        tree,
        shapes={**tree.shapes, link: tuple(map(_shape, solids))},
        joints={**tree.joints, joint.name: joint},
    )
    return replace(robot, tree=mounted)


def _has_hand(tree: UrdfTree, hand: str, tip: str) -> bool:
    """Whether anything of a hand stands out in front of the palm, as fingers do."""
    poses = tree.link_poses({})
    to_palm = poses[tip].inverse()
    return any(
        solid.moved(to_palm @ poses[link]).bounds.upper[2] > _OUT
        for link in tree.links_below(hand)
        for shape in tree.shapes[link]
        for solid in solids_of_shape(shape, link, tree.path.parent)
    )


def _shape(solid: Solid) -> UrdfShape:
    """Collision geometry of a link that is a solid."""
    if isinstance(solid, Box):
        size = tuple((2.0 * np.asarray(solid.half_extents)).tolist())
        return UrdfShape(kind="box", size=size, T_link_shape=solid.T_frame_solid)
    if isinstance(solid, Sphere):
        T = SE3.from_parts(p=solid.center)
        return UrdfShape(kind="sphere", size=(solid.radius,), T_link_shape=T)
    if isinstance(solid, Cylinder | Capsule):
        return UrdfShape(
            kind=type(solid).__name__.lower(),
            size=(solid.radius, solid.length),
            T_link_shape=solid.T_frame_solid,
        )
    raise AssertionError(f"hands have no {type(solid).__name__}")
