"""Connect a robot of your own: one small class for each device, and checks for them.

The devices only pretend: put the calls of your drivers in their place. Three mistakes
are built in, so that the checks have something to find; comments name them.

Run: python examples/14_your_own_robot.py
"""

from types import SimpleNamespace

import numpy as np

from debrisgrasp import SE3, Intrinsics, robot
from debrisgrasp.control import Body, LoadModel
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.prototypes import GripperModel

clock = SimpleNamespace(time=0.0, now=lambda: clock.time)
clock.wait_until = lambda until: setattr(clock, "time", max(clock.time, until))


class Arm:
    """Joints that are at once where they are sent."""

    is_engaged = is_stopped = False

    def __init__(self, limits, q) -> None:
        self.limits, self.joint_names, self.q = limits, limits.joint_names, tuple(q)

    def read(self) -> robot.JointReading:
        return robot.JointReading(clock.now(), self.q)

    def engage(self) -> None:
        self.is_engaged = not self.is_stopped

    def disengage(self) -> None:
        self.is_engaged = False

    def command(self, q) -> None:
        if self.is_engaged and not self.limits.violation(q):
            self.q = tuple(q)

    def stop(self) -> None:
        self.is_stopped, self.is_engaged = True, False

    def reset(self) -> None:
        self.is_stopped = False


class Gripper:
    """Fingers that are at once where they are sent."""

    is_initialised = False

    def __init__(self, hand) -> None:
        self.name, self.openings = hand.name, (0.1,) * len(hand.fingers)
        self.sides = [finger.side for finger in hand.fingers]

    def initialise(self) -> None:
        self.is_initialised = True

    def preshape(self, _name, opening) -> None:
        self.openings = (opening,) * len(self.openings)

    def command(self, command) -> None:
        # The force is that of a side: two fingers on it press with half of it each.
        self.forces = [command.force / self.sides.count(side) for side in self.sides]
        self.openings = command.openings

    def read(self) -> robot.HandReading:
        # A mistake: four forces, however many fingers the hand has.
        return robot.HandReading(clock.now(), self.openings, (0.0,) * 4)


def main() -> None:
    mine, rng = RobotModel.load("roman"), np.random.default_rng(0)
    K = Intrinsics(fx=160, fy=160, cx=79.5, cy=59.5, width=160, height=120)
    depth = np.full((120, 160), 1500.0)  # another mistake
    image = {"depth": depth, "intrinsics": K, "frame": mine.camera}
    camera = SimpleNamespace(
        capture=lambda: robot.DepthFrame(time=clock.now(), **image)
    )
    # A third one: the weight of the tool is not in it. Only motion shows that, and
    # nothing is moved before the other two are mended.
    wrench = SimpleNamespace(
        read=lambda: robot.WrenchReading(clock.now(), rng.normal(0, 0.1, 6))
    )
    limbs = {}
    for name in mine.arms:
        start = mine.chain(name).vector(mine.posture(name, "ready"))
        limbs[name] = robot.Limb(
            arm=Arm(mine.limits(name).hardware, start.tolist()),
            sensor=wrench,
            gripper=Gripper(GripperModel.load(mine.arm(name).gripper)),
            loads=LoadModel(T_ee_ft=SE3.identity(), tool=Body(mass=1.5)),
        )
    devices = robot.Robot(model=mine, clock=clock, limbs=limbs, camera=camera)
    print(robot.check_robot(devices, motion=True))


if __name__ == "__main__":
    main()
