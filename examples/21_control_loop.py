"""Run a leg in a loop of 250 Hz, against the protocols that a real arm fulfils.

The arm is a stand-in that goes where it is sent. Replace it by drivers that fulfil
`debrisgrasp.robot.Arm` and `ForceSensor`, and nothing else changes.

Run: python examples/21_control_loop.py
"""

import time

import numpy as np

from debrisgrasp import control
from debrisgrasp.kinematics import LimitSet, RobotModel
from debrisgrasp.robot import JointReading, WrenchReading

PERIOD = 0.004


class StandIn:
    """An arm and a wrist sensor that do as they should."""

    def __init__(self, q: np.ndarray, limits: LimitSet) -> None:
        self.q, self.limits, self.rng = q, limits, np.random.default_rng(0)

    def read(self) -> JointReading:
        return JointReading(time.monotonic(), self.q)

    def wrench(self) -> WrenchReading:
        return WrenchReading(time.monotonic(), self.rng.normal(0.0, 0.05, 6))

    def command(self, q) -> None:
        self.q = np.asarray(q)

    def stop(self) -> None: ...


def run(controller: control.LegController, arm: StandIn) -> tuple[str, np.ndarray]:
    """Step the leg until it ends; how it ended, and the time of each tick [s]."""

    def reading() -> control.Reading:
        (time_, q), (measured, wrench) = arm.read(), arm.wrench()
        return control.Reading(time_, q, wrench, measured)

    state = controller.engage(reading()).require()
    due, spent = time.monotonic(), []
    while True:
        start = time.perf_counter()
        state, command = controller.step(state, reading())
        if command.is_stop:
            arm.stop()
            return str(command.stop), np.array(spent)
        arm.command(command.q)
        spent.append(time.perf_counter() - start)
        if command.outcome is not control.LegOutcome.RUNNING:
            return command.outcome.value, np.array(spent)
        due += PERIOD
        time.sleep(max(0.0, due - time.monotonic()))


def main() -> None:
    robot = RobotModel.load("roman")
    chain = robot.chain("right", {"torso_joint": 0.0})
    limits = robot.limits("right", chain).controller
    q = chain.vector(robot.posture("right", "ready"))
    T_hand, T_sensor = (robot.link_poses()[n] for n in ("right_hand", "right_ft_frame"))
    controller = control.LegController(
        chain,
        limits,
        control.LoadModel(T_ee_ft=T_hand.inverse() @ T_sensor),
        control.CartesianLeg.along(chain.fk(q), [0.0, 0.0, 0.05]),
        control.ControllerConfig(period=PERIOD, speed=0.05),
        baseline_time=time.monotonic(),
    )
    ending, spent = run(controller, StandIn(q, limits))
    median, high = 1e6 * np.percentile(spent, [50, 99])
    print(f"{ending} after {len(spent)} ticks of {median:.0f} us, 99 % {high:.0f} us")


if __name__ == "__main__":
    main()
