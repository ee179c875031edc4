"""Our own robot, and robots of which each breaks one promise."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from debrisgrasp.errors import DriverError
from debrisgrasp.robot import FakeConfig, fake_robot
from debrisgrasp.worlds import World
from tests.unit.robot.rigs import FAR, GRIPPERS, ROMAN, beam


def made_fake(config=None):
    return fake_robot(
        ROMAN,
        World((FAR, beam("near", 2.0, (1.2, 0.0, 0.0445)))),
        rng=np.random.default_rng(0),
        config=config or FakeConfig(),
        grippers=GRIPPERS,
    )


def made():
    return made_fake().robot


class Changed:
    """A device some of whose members are others."""

    def __init__(self, device, **members) -> None:
        self._device, self._members = device, members

    def __getattr__(self, name):
        if name in self._members:
            return self._members[name]
        return getattr(self._device, name)


def with_limb(robot, device, **members):
    """The same robot, one device of whose right arm is changed."""
    limb = robot.limbs["right"]
    limb = replace(limb, **{device: Changed(getattr(limb, device), **members)})
    return replace(robot, limbs={**robot.limbs, "right": limb})


def nothing(*_args):
    """Do nothing, whatever was asked for."""


def raising(*_args):
    raise DriverError("arm", "no answer")


def no_reset(robot):
    return with_limb(robot, "arm", reset=nothing)


def no_latch(robot):
    arm = robot.limbs["right"].arm
    return with_limb(robot, "arm", stop=arm.disengage)


def lying_limits(robot):
    limits = robot.limbs["right"].arm.limits
    wider = replace(limits, upper=limits.upper + 1.0)
    return with_limb(robot, "arm", limits=wider)


def limits_in_degrees(robot):
    limits = robot.limbs["right"].arm.limits
    return with_limb(
        robot, "arm", limits=replace(limits, velocity=np.rad2deg(limits.velocity))
    )


def degrees(robot):
    arm = robot.limbs["right"].arm
    return with_limb(
        robot, "arm", read=lambda: arm.read()._replace(q=np.rad2deg(arm.read().q))
    )


def short_reading(robot):
    arm = robot.limbs["right"].arm
    return with_limb(robot, "arm", read=lambda: arm.read()._replace(q=arm.read().q[1:]))


def nan_joint(robot):
    arm = robot.limbs["right"].arm
    return with_limb(robot, "arm", read=lambda: arm.read()._replace(q=[np.nan] * 8))


def no_time(robot):
    arm = robot.limbs["right"].arm
    return with_limb(robot, "arm", read=lambda: arm.read()._replace(time=np.nan))


def worded_joints(robot):
    arm = robot.limbs["right"].arm
    return with_limb(
        robot, "arm", read=lambda: arm.read()._replace(q=list(map(str, arm.read().q)))
    )


def worded_wrench(robot):
    read = robot.limbs["right"].sensor.read
    return with_limb(
        robot, "sensor", read=lambda: read()._replace(wrench_ft=["0.1"] * 6)
    )


def worded_fingers(robot):
    read = robot.limbs["right"].gripper.read
    return with_limb(
        robot, "gripper", read=lambda: read()._replace(forces=("a", "b", "c"))
    )


def silent_joints(robot):
    return with_limb(robot, "arm", read=lambda: None)


def silent_fingers(robot):
    return with_limb(robot, "gripper", read=lambda: None)


def shares_of_fingers(robot):
    """A hand that tells, and is told, shares of its opening."""
    hand = robot.limbs["right"].gripper
    widest = 0.16

    def read():
        reading = hand.read()
        return reading._replace(openings=[x / widest for x in reading.openings])

    def command(wanted):
        openings = tuple(min(x, 1.0) * widest for x in wanted.openings)
        hand.command(wanted._replace(openings=openings))

    return with_limb(robot, "gripper", read=read, command=command)


def turned_wrench(robot):
    """A wrist whose sensor is mounted a quarter turn off."""
    read = robot.limbs["right"].sensor.read

    def turned():
        a, b, c, d, e, f = read().wrench_ft
        return read()._replace(wrench_ft=(-b, a, c, -e, d, f))

    return with_limb(robot, "sensor", read=turned)


def fewer_fingers(robot):
    read = robot.limbs["right"].gripper.read
    return with_limb(
        robot, "gripper", read=lambda: read()._replace(openings=read().openings[:1])
    )


def numberless_fingers(robot):
    read = robot.limbs["right"].gripper.read
    return with_limb(
        robot,
        "gripper",
        read=lambda: read()._replace(openings=[np.nan] * len(read().openings)),
    )


def worded_answer(robot):
    return with_limb(robot, "arm", is_engaged="no")


def no_limits(robot):
    return with_limb(robot, "arm", limits=None)


def exiting(robot):
    def exits():
        raise SystemExit(0)

    return with_limb(robot, "arm", read=exits)


def other_order(robot):
    names = robot.limbs["right"].arm.joint_names
    return with_limb(robot, "arm", joint_names=names[::-1])


def frozen_time(robot):
    arm = robot.limbs["right"].arm
    return with_limb(robot, "arm", read=lambda: arm.read()._replace(time=1.0))


def late_wrench(robot):
    sensor = robot.limbs["right"].sensor

    def read():
        reading = sensor.read()
        return reading._replace(time=reading.time - 0.024)

    return with_limb(robot, "sensor", read=read)


def timeless(robot):
    arm = robot.limbs["right"].arm
    return with_limb(robot, "arm", read=lambda: arm.read()._replace(time=None))


def nameless(robot):
    return with_limb(robot, "arm", joint_names=None)


def silent(robot):
    return with_limb(robot, "arm", read=raising)


def unnamed_reading(robot):
    arm = robot.limbs["right"].arm
    return with_limb(robot, "arm", read=lambda: {"time": 0.0, "q": arm.read().q})


def no_image(robot):
    return replace(robot, camera=Changed(robot.camera, capture=nothing))


def reset_is_no_method(robot):
    return with_limb(robot, "arm", reset=None)


def incomplete(robot):
    arm = robot.limbs["right"].arm
    part = SimpleNamespace(
        joint_names=arm.joint_names, limits=arm.limits, read=arm.read
    )
    limb = replace(robot.limbs["right"], arm=part)
    return replace(robot, limbs={**robot.limbs, "right": limb})


def inverted_wrench(robot):
    sensor = robot.limbs["right"].sensor

    def read():
        reading = sensor.read()
        return reading._replace(wrench_ft=-np.asarray(reading.wrench_ft))

    return with_limb(robot, "sensor", read=read)


def frozen_wrench(robot):
    sensor = robot.limbs["right"].sensor
    first = sensor.read()
    return with_limb(
        robot, "sensor", read=lambda: first._replace(time=robot.clock.now())
    )


def forces_only(robot):
    read = robot.limbs["right"].sensor.read

    def wrench():
        reading = read()
        return reading._replace(wrench_ft=(*reading.wrench_ft[:3], 0.0, 0.0, 0.0))

    return with_limb(robot, "sensor", read=wrench)


def millimetre_fingers(robot):
    hand = robot.limbs["right"].gripper

    def read():
        reading = hand.read()
        return reading._replace(openings=tuple(1e3 * x for x in reading.openings))

    return with_limb(robot, "gripper", read=read)


def other_hand(robot):
    return with_limb(robot, "gripper", name="camhand")


def seen(robot, **changes):
    camera = robot.camera

    def capture():
        frame = camera.capture()
        made = {key: change(frame) for key, change in changes.items()}
        return replace(frame, **made)

    return replace(robot, camera=Changed(camera, capture=capture))


def millimetre_depth(robot):
    return seen(robot, depth=lambda frame: 1e3 * frame.depth)


def integer_depth(robot):
    return seen(robot, depth=lambda frame: frame.depth.astype(np.uint16))


def integer_millimetres(robot):
    return seen(robot, depth=lambda frame: (1e3 * frame.depth).astype(np.uint16))


def blind(robot):
    return seen(robot, depth=lambda frame: 0.0 * frame.depth)


def other_frame(robot):
    return seen(robot, frame=lambda _: "world")


def other_resolution(robot):
    return seen(
        robot, intrinsics=lambda frame: replace(frame.intrinsics, fx=3000.0, fy=3000.0)
    )


def lensless(robot):
    return seen(robot, intrinsics=nothing)


def stopped_clock(robot):
    return replace(robot, clock=Changed(robot.clock, now=nothing))


def backward_clock(robot):
    times = iter(np.arange(1e3, 0.0, -1.0))
    return replace(
        robot,
        clock=Changed(robot.clock, now=lambda: float(next(times)), wait_until=nothing),
    )


def impatient_clock(robot):
    return replace(robot, clock=Changed(robot.clock, wait_until=nothing))


def base_of_numbers(robot):
    return replace(robot, base=Changed(robot.base, read=lambda: (0.0, 0.0, 0.0)))


def head_in_degrees(robot):
    head = robot.head
    return replace(
        robot,
        head=Changed(
            head, read=lambda: head.read()._replace(q=np.rad2deg(head.read().q))
        ),
    )


def stuck_joint(robot):
    arm = robot.limbs["right"].arm

    def command(q):
        arm.command([*q[:5], arm.read().q[5], *q[6:]])

    return with_limb(robot, "arm", command=command)
