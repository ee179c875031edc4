"""Lift one end of a beam whose other end rests on an edge: rigid, and giving way.

The operator only asks for "straight up". A rigid hand bends the beam's weight into its
own wrist until the limit stops it. A hand that may turn lets the beam lie on its edge.

Run: python examples/10_lift_a_beam.py [PICTURE.png]
"""

import sys

import numpy as np

from debrisgrasp import control
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.viz import LegTrace, Outline, leg_png

MASS, LENGTH, RISE = 8.0, 1.2, 0.2  # beam [kg], [m]; way up [m]
GRIP, EDGE = 500.0, 2e4  # stiffness of the grip [N m/rad], of what lies below [N/m]
WEIGHT = 9.81 * MASS


def beam(raised: float, pitch: float) -> tuple[np.ndarray, float]:
    """Wrench on a hand raised and pitched so far, and the tilt of the beam."""
    sunk = 0.5 * WEIGHT / EDGE
    near = max(EDGE * (sunk - raised), 0.0)  # what still lies on the ground
    tilt = EDGE * LENGTH * (sunk - raised) - 0.5 * WEIGHT * LENGTH + GRIP * pitch
    tilt /= EDGE * LENGTH**2 + GRIP
    far = EDGE * (sunk - raised - LENGTH * tilt)
    if far < 0.0:  # the beam has left the edge
        far, tilt = 0.0, pitch - 0.5 * WEIGHT * LENGTH / GRIP
    return np.array([0, 0, near + far - WEIGHT, 0, GRIP * (pitch - tilt), 0]), tilt


def drawn(p: np.ndarray, tilt: float, trace: int | None) -> Outline:
    along, up = np.array([LENGTH, 0, LENGTH * tilt]), np.array([0, 0, 0.09])
    return Outline(points=np.array([p, p + along, p + along - up, p - up]), trace=trace)


def main() -> None:
    picture = sys.argv[1] if len(sys.argv) > 1 else "lift.png"
    robot = RobotModel.load("roman")
    chain = robot.chain("right", {"torso_joint": 0.0})
    limits = robot.limits("right", chain).controller
    q = chain.vector(robot.posture("right", "ready"))
    T, links = chain.fk(q), robot.link_poses()
    loads = control.LoadModel(
        T_ee_ft=links["right_hand"].inverse() @ links["right_ft_frame"]
    )
    contact = control.Contact(
        stiffness=EDGE,
        structure=GRIP / LENGTH**2,
        lever=(LENGTH, 0.0, 0.0),
        mass=MASS,
        mass_lever=(0.5 * LENGTH, 0.0, 0.0),
    )
    arm = control.ArmResponse(frequency=8.0, damping=0.7, delay=2)
    config = control.ControllerConfig(
        speed=0.04, arm=arm, contact=contact, tare=control.TarePolicy.MOTION
    )
    leg = control.CartesianLeg.along(T, [0.0, 0.0, RISE])
    turning = control.Compliance.diagonal(2e-4, [0.0, 0.005, 0.0])

    foot = np.array([[0, 0, 0], [0.05, 0, -0.14], [-0.05, 0, -0.14]])
    edge = T.p + foot + np.array([LENGTH, 0, -0.09])
    outlines = [Outline(points=edge, label="edge", is_filled=True), drawn(T.p, 0, None)]
    traces = []
    for number, (label, compliance) in enumerate(
        [("rigid hand", None), ("hand that turns", turning)]
    ):
        controller = control.LegController(
            chain, limits, loads, leg, config, compliance=compliance
        )

        def world(T_now):
            pitch = (T_now.R @ T.R.T)[2, 0]
            return beam(T_now.p[2] - T.p[2], pitch)[0]

        run = control.rehearse(
            controller, q, world, arm=arm, rng=np.random.default_rng(0)
        )
        force, torque = (
            np.linalg.norm(x, axis=1).max() for x in np.split(run.load, 2, 1)
        )
        print(f"{label}: {run.ending}; at most {force:.0f} N and {torque:.0f} N m")
        end = run.position[-1]
        tilt = beam(end[2] - T.p[2], -run.deflection[-1, 4])[1]
        outlines.append(drawn(end, tilt, number))
        traces.append(LegTrace(label=label, run=run))
    leg_png(
        picture,
        "Lifting one end of an 8 kg beam off the ground, the other rests on an edge",
        traces,
        limits,
        nominal=np.array([leg.start.p, leg.goal.p]),
        outlines=outlines,
        note="Asked for: straight up. From the side: the beam before (grey), and where "
        "each hand left it.",
    )
    print(f"wrote {picture}")


if __name__ == "__main__":
    main()
