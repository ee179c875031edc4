"""Bring the hand behind a post: on a straight line, and by a planned motion.

A Cartesian leg is right for the last few centimetres; it knows one way only. A planned
motion finds another one, and every posture on it is checked by the links' solids.

Run: python examples/13_reach_a_grasp.py [PICTURE.png]
"""

import sys

import numpy as np

from debrisgrasp import SE3, PointCloud
from debrisgrasp.control import CartesianLeg, LegPlanner
from debrisgrasp.kinematics import ArmReach, RobotModel
from debrisgrasp.motion import MotionPlanner, MotionSpace
from debrisgrasp.viz import MotionTrack, motion_png


def post(x: float, y: float, height: float) -> PointCloud:
    """Put up a round post of 10 cm, as cameras all around would see it."""
    angle = np.linspace(0.0, 2.0 * np.pi, 36, endpoint=False)
    z = np.arange(0.0, height, 0.01)
    ring = np.column_stack([x + 0.05 * np.cos(angle), y + 0.05 * np.sin(angle)])
    points = np.column_stack([np.tile(ring, (len(z), 1)), np.repeat(z, len(ring))])
    return PointCloud(points, np.full(points.shape, np.nan), np.zeros(3))


def main() -> None:
    picture = sys.argv[1] if len(sys.argv) > 1 else "reach.png"
    robot = RobotModel.load("roman")
    arm = ArmReach(robot, "right")
    q, limits = arm.q_present, robot.limits("right").planner
    T = arm.chain.fk(q)
    goal = SE3.from_parts(p=[0.0, 0.4, -0.05]) @ T
    middle = 0.5 * (T.p + goal.p)
    cloud = post(middle[0], middle[1], middle[2] + 0.1)
    ground = np.array([0.0, 0.0, 1.0, 0.0])
    space = MotionSpace.from_points(cloud.points, ground_plane=ground)
    planner = MotionPlanner.of_arm(arm)

    test = planner.exact_test(space)
    legs = LegPlanner(arm.chain, limits, is_free=lambda row: test.is_free(row[None])[0])
    leg = legs.plan(q, goal)
    print(f"straight: {leg.reason or 'done'}")
    blind = LegPlanner(arm.chain, limits).plan(q, goal)
    blocked = blind.q[~test.is_free(blind.q)]
    for contact in test.contacts(blocked[0]):
        print(f"  {contact}")

    found = planner.plan(q, goal, space, rng=np.random.default_rng(0))
    motion = found.trajectory
    if motion is None:
        raise SystemExit(f"planned: {found.reason}")
    print(
        f"planned: {motion.duration:.1f} s over {len(found.path)} corners, "
        f"{found.counts.postures} postures tested"
    )
    motion_png(
        picture,
        "Bringing the hand behind a post",
        robot,
        "right",
        [
            MotionTrack(
                label=f"Straight leg: blocked after {100 * leg.share:.0f} % of the way",
                trajectories=[blind.trajectory],
                limits=limits,
                touches=blocked[[len(blocked) // 2]],
            ),
            MotionTrack(
                label=f"Planned: {motion.duration:.1f} s, touching nothing",
                trajectories=[motion],
                limits=limits,
            ),
        ],
        cloud=cloud,
        note=f"{CartesianLeg(T, goal).length:.2f} m sideways; postures from light to "
        "dark, path of the palm in purple, contact in red",
    )
    print(f"wrote {picture}")


if __name__ == "__main__":
    main()
