"""Come down onto something that was not expected: guarded and slow, and neither.

While a touch is felt and the arm is stopped, the force grows by stiffness times speed.
No controller helps against that afterwards, so the guard refuses to come faster.

Run: python examples/11_guarded_approach.py [PICTURE.png]
"""

import sys

import numpy as np

from debrisgrasp import control
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.viz import LegTrace, Outline, leg_png

STIFFNESS, DEPTH = 1e5, 0.04  # of a concrete block [N/m]; how far below the hand [m]


def main() -> None:
    picture = sys.argv[1] if len(sys.argv) > 1 else "approach.png"
    robot = RobotModel.load("roman")
    chain = robot.chain("right", {"torso_joint": 0.0})
    limits = robot.limits("right", chain).controller
    q = chain.vector(robot.posture("right", "ready"))
    T, links = chain.fk(q), robot.link_poses()
    loads = control.LoadModel(
        T_ee_ft=links["right_hand"].inverse() @ links["right_ft_frame"]
    )
    leg = control.CartesianLeg.along(T, [0.0, 0.0, -0.1])
    arm = control.ArmResponse(frequency=8.0, damping=0.7, delay=2)
    guard = control.ContactGuard(force=60.0, stiffness=STIFFNESS)
    slow = guard.largest_speed(limits)
    print(f"the guard allows {1000 * slow:.0f} mm/s against {STIFFNESS:.0e} N/m")

    top = T.p[2] - DEPTH

    def block(T_now):
        push = max(STIFFNESS * (top - T_now.p[2]), 0.0)
        return np.array([0, 0, push, 0, 0, 0])

    traces = []
    for label, speed, used in (
        ("50 mm/s, no guard", 0.05, None),
        (f"{1000 * slow:.0f} mm/s, guarded", slow, guard),
    ):
        controller = control.LegController(
            chain,
            limits,
            loads,
            leg,
            control.ControllerConfig(speed=speed, arm=arm),
            guard=used,
        )
        run = control.rehearse(
            controller, q, block, arm=arm, rng=np.random.default_rng(0), settle=0.3
        )
        peak = np.linalg.norm(run.load[:, :3], axis=1).max()
        verdict = "below" if peak < limits.force else "ABOVE"
        print(f"{label}: {run.ending}; peak {peak:.0f} N, {verdict} the limit")
        traces.append(LegTrace(label=f"{label} (peak {peak:.0f} N)", run=run))
    x, y, _ = T.p
    sides = np.array([[x - 0.06, y, top], [x + 0.06, y, top]])
    corners = np.vstack([sides, sides[::-1] - [0, 0, 0.05]])
    leg_png(
        picture,
        "Coming down onto a concrete block that was not expected",
        traces,
        limits,
        nominal=np.array([leg.start.p, leg.goal.p]),
        outlines=[Outline(points=corners, label="block", is_filled=True)],
        note="Asked for: 100 mm straight down. The block begins after 40 mm.",
    )
    print(f"wrote {picture}")


if __name__ == "__main__":
    main()
