"""An arm with something in its hand, for the planner."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from debrisgrasp.geometry import SE3, Solid
from debrisgrasp.kinematics import ArmCollision, RobotModel
from debrisgrasp.kinematics.body import BodyPart, RobotBody
from debrisgrasp.kinematics.pairs import without_idle_pairs
from debrisgrasp.kinematics.solids import solids_of_shape
from debrisgrasp.motion import MotionPlanner

from .context import Context
from .limb_state import LimbState
from .obstacles import box_around

__all__ = ["carrying"]


def carrying(context: Context, limb: LimbState) -> MotionPlanner:
    """Make a planner for the arm with a box around what its hand holds."""
    held, model = context.held, context.model
    if held is None or len(held.points_hand) < 10:
        return limb.planner
    reach = limb.reach
    shape, tip = box_around(held.points_hand), model.arm(limb.name).tip
    (box,) = solids_of_shape(shape, tip, model.tree.path.parent)
    body = _loaded(model, reach.collision, tip, box)
    collision = replace(reach.collision, body=body)
    return MotionPlanner(collision, limb.limits.planner, reach_map=reach.reach_map)


def _loaded(
    model: RobotModel, collision: ArmCollision, tip: str, solid: Solid
) -> RobotBody:
    """Body of a robot with a solid, in the frame of the tip, in its hand."""
    body, tree = collision.body, model.tree
    last, own = body.chain.n_joints, tree.body_of(tip)
    q = np.zeros((1, last))
    T_segment_tip = SE3(body.segment_poses(q)[0, -1]).inverse() @ body.chain.fk(q[0])
    part = BodyPart(tip, solid.moved(T_segment_tip), last, is_hand=True)
    ends = [
        {tree.body_of(joint.parent), tree.body_of(joint.child)}
        for joint in tree.joints.values()
    ]
    joined = {own}.union(*(pair for pair in ends if own in pair))
    ignored = set(map(frozenset, model.ignored_collisions))
    met = [
        (len(body.parts), row)
        for row, other in enumerate(body.parts)
        if other.segment != last
        and tree.body_of(other.link) not in joined
        and frozenset((tip, other.link)) not in ignored
    ]
    alone = without_idle_pairs(
        replace(body, parts=(*body.parts, part), pairs=np.array(met, dtype=np.intp)),
        collision.self_margin,
    )
    return replace(
        alone,
        pairs=np.concatenate([body.pairs, alone.pairs]),
        always_touching=(*body.always_touching, *alone.always_touching),
    )
