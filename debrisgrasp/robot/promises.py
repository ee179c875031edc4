"""What a robot promises at rest: each function yields what is wrong, in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._words import arm_called
from debrisgrasp.control import SafetyConfig
from debrisgrasp.geometry import SE3, Intrinsics
from debrisgrasp.kinematics import KinematicChain, LimitSet

from .gaps import absent, unanswered
from .interface import DepthFrame, Robot
from .kinds import (
    dead_half,
    odd_answers,
    odd_base,
    odd_image,
    odd_openings,
    odd_time,
    unlike_numbers,
)

__all__ = [
    "answers_whole",
    "arms_are_named",
    "base_stands",
    "camera_sees",
    "clock_runs",
    "head_is_known",
    "joints_are_read",
    "limits_are_true",
    "protocols_are_kept",
    "stop_latches",
    "times_rise",
    "wrist_is_read",
]

_OLD = 0.2
"""A reading older than this is not of now [s]; a wrench must be younger."""
_OFTEN = 10.0 * np.pi
"""An endless joint that reads more is rather in degrees [rad]."""
_UNITS = {True: "radians, not degrees?", False: "metres, not millimetres?"}
"""What to ask of a joint that turns, and of one that slides."""
_FREE_LOAD = (20.0, 5.0)
"""Load of an idle hand, at most [N, N m]."""


def protocols_are_kept(robot: Robot) -> Iterator[str]:
    """Check that every device has what its protocol asks for, and answers so."""
    gaps = [*absent(robot), *unanswered(robot)]
    for gap in gaps:
        yield gap.problem
    if not gaps:
        for name, limb in robot.limbs.items():
            for odd in odd_answers(limb):
                yield f"{arm_called(name)}: {odd}"


def arms_are_named(robot: Robot) -> Iterator[str]:
    """Check that limbs, joints and hands bear the names of the model."""
    model = robot.model
    if set(robot.limbs) != set(model.arms):
        yield f"limbs {sorted(robot.limbs)}, but the model has {sorted(model.arms)}"
    for name in set(robot.limbs) & set(model.arms):
        limb, spec = robot.limbs[name], model.arm(name)
        expected = model.chain(name).joint_names
        if tuple(limb.arm.joint_names) != expected:
            yield (
                f"joints of arm {name} are {', '.join(limb.arm.joint_names)}; "
                f"the model has {', '.join(expected)}, in this order"
            )
        if limb.gripper.name != spec.gripper:
            yield (
                f"arm {name} carries gripper {limb.gripper.name!r}; the model says "
                f"{spec.gripper!r}"
            )


def clock_runs(robot: Robot) -> Iterator[str]:
    """Check that time rises, and waiting ends at the time asked for."""
    clock = robot.clock
    start = clock.now()
    if odd := odd_time(start):
        yield odd
        return
    if not np.isfinite(start):
        yield f"now is {start}"
        return
    for wait in (0.004, 0.02, 0.1):
        before = clock.now()
        clock.wait_until(before + wait)
        after = clock.now()
        if after < before:
            yield f"time fell from {before:g} to {after:g} s"
        if after < before + wait - 1e-6:
            yield f"waiting for {wait:g} s ended after {after - before:g} s"
        if after > before + wait + 0.5:
            yield f"waiting for {wait:g} s took {after - before:g} s"
    before = clock.now()
    clock.wait_until(before - 1.0)
    if clock.now() > before + 0.5:
        yield "waiting for a time that has passed does not return at once"


def times_rise(robot: Robot) -> Iterator[str]:
    """Check that readings are of now, and later ones are later."""
    clock = robot.clock
    readers: list[tuple[str, Callable[[], Any], float]] = []
    for name, limb in robot.limbs.items():
        readers += [
            (f"arm {name}", limb.arm.read, _OLD),
            (f"sensor {name}", limb.sensor.read, SafetyConfig().hold_after),
            (f"gripper {name}", limb.gripper.read, _OLD),
        ]
    if robot.head is not None:
        readers.append(("head", robot.head.read, _OLD))
    for device, read, oldest in readers:
        first = read().time
        if odd := odd_time(first):
            yield f"{device}: {odd}"
            continue
        clock.wait_until(clock.now() + 0.1)
        second, now = float(read().time), clock.now()
        if not (np.isfinite(first) and np.isfinite(second)):
            yield f"{device}: the time is {first}, then {second}"
        elif second <= first:
            yield f"{device}: a reading 0.1 s later bears no later time"
        elif not now - oldest <= second <= now + 1e-3:
            yield (
                f"{device}: a reading is of {second:.3f} s when the clock says "
                f"{now:.3f}; it may be {1e3 * oldest:g} ms old"
            )


def joints_are_read(robot: Robot) -> Iterator[str]:
    """Check that joints are finite, in radians or metres, within their limits."""
    for name, limb in robot.limbs.items():
        limits, said = limb.arm.limits, limb.arm.read().q
        if odd := _odd_joints(robot.model.chain(name), said):
            yield f"arm {name}: {odd}"
            continue
        q = np.asarray(said, dtype=np.float64)
        if limits.lower.shape == q.shape and limits.violation(q, tolerance=0.02):
            yield f"arm {name}: {limits.violation(q, tolerance=0.02)}"


def _odd_joints(chain: KinematicChain, said: Sequence[float] | FloatArray) -> str:
    """Say why values can't be where the joints are; "" if they can."""
    if odd := unlike_numbers(said):
        return odd
    q = np.asarray(said, dtype=np.float64)
    if q.shape != (chain.n_joints,):
        return f"{q.shape} values for {chain.n_joints} joints"
    if not np.isfinite(q).all():
        return f"reads {q.tolist()}"
    farthest = 2.0 * np.maximum(np.abs(chain.lower), np.abs(chain.upper))
    share = np.abs(q) / np.where(np.isfinite(farthest), farthest, _OFTEN)
    worst = int(np.argmax(share))
    if share[worst] <= 1.0:
        return ""
    doubt = _UNITS[bool(chain.is_revolute[worst])]
    return f"{chain.joint_names[worst]} reads {q[worst]:.1f}; {doubt}"


def limits_are_true(robot: Robot) -> Iterator[str]:
    """Check that the limits of the arms are those of the model."""
    for name, limb in robot.limbs.items():
        said, known = limb.arm.limits, robot.model.limits(name).hardware
        turns = robot.model.chain(name).is_revolute
        if not isinstance(said, LimitSet):
            yield f"arm {name}: limits are {said!r}; a LimitSet is needed"
            continue
        if said.joint_names != known.joint_names:
            yield f"arm {name}: limits are of {', '.join(said.joint_names)}"
            continue
        for what in ("lower", "upper", "velocity", "acceleration"):
            a, b = getattr(said, what), getattr(known, what)
            rows = zip(said.joint_names, a, b, turns, strict=True)
            for joint, own, model, does_turn in rows:
                # A joint without limits has infinite ones, whose difference is NaN.
                if own != model and abs(own - model) > 1e-3 * max(1.0, abs(model)):
                    factor = np.rad2deg(1.0) if does_turn else 1e3
                    is_scaled = np.isclose(own, factor * model, rtol=0.01)
                    hint = f"; {_UNITS[bool(does_turn)]}" if is_scaled else ""
                    yield (
                        f"arm {name}: {what} of {joint} is {own:g}; the model says "
                        f"{model:g}{hint}"
                    )
        for what in ("force", "torque"):
            if getattr(said, what) > getattr(known, what) * (1.0 + 1e-6):
                yield (
                    f"arm {name}: {what} limit {getattr(said, what):g}; the model "
                    f"says {getattr(known, what):g}"
                )


def wrist_is_read(robot: Robot) -> Iterator[str]:
    """Check that an idle wrist reads no more than tool and bias."""
    clock = robot.clock
    for name, limb in robot.limbs.items():
        rows = []
        for _ in range(25):
            rows.append(limb.sensor.read().wrench_ft)
            clock.wait_until(clock.now() + 0.008)
        if odd := next(filter(None, (unlike_numbers(row, 6) for row in rows)), ""):
            yield f"sensor {name}: {odd}"
            continue
        raw = np.array(rows, dtype=np.float64)
        if not np.isfinite(raw).all():
            yield f"sensor {name}: reads {raw[0].tolist()}"
            continue
        if (raw == raw[0]).all():
            yield f"sensor {name}: equal to the last digit for 0.2 s; is it alive?"
        elif odd := dead_half(raw):
            yield f"sensor {name}: {odd}"
        q = limb.arm.read().q
        if _odd_joints(robot.model.chain(name), q):
            continue  # `joints_are_read` tells; nobody knows where down is
        T = robot.model.chain(name).fk(np.asarray(q))
        mean = raw.mean(axis=0)
        load = _load(robot, name, T, mean)
        if not _is_free(load):
            text = f"sensor {name}: an idle hand bears {np.linalg.norm(load[:3]):.1f} N"
            text += f" and {np.linalg.norm(load[3:]):.2f} N m"
            if _is_free(_load(robot, name, T, -mean)):
                text += "; its sign is inverted"
            elif _is_free(_load(robot, name, T, 1e3 * mean)):
                text += "; does it read kilonewtons?"
            yield text + ". Identify tool and bias, or empty the hand."


def _load(robot: Robot, name: str, T: SE3, raw: FloatArray) -> FloatArray:
    R = tuple(T.R.ravel().tolist())
    return np.array(robot.limbs[name].loads.load_ee(raw.tolist(), R))


def _is_free(load: FloatArray) -> bool:
    force, torque = np.linalg.norm(load[:3]), np.linalg.norm(load[3:])
    return bool(force < _FREE_LOAD[0] and torque < _FREE_LOAD[1])


def answers_whole(robot: Robot) -> Iterator[str]:
    """Check that a hand tells opening and force of every finger, in SI."""
    for name, limb in robot.limbs.items():
        reading = limb.gripper.read()
        n, m = len(reading.openings), len(reading.forces)
        if n != m or n < 2:
            yield f"gripper {name}: {n} openings and {m} forces; one of each a finger"
            continue
        if odd := unlike_numbers([*reading.openings, *reading.forces]):
            yield f"gripper {name}: {odd}"
            continue
        numbers = np.array([*reading.openings, *reading.forces], dtype=np.float64)
        if not np.isfinite(numbers).all():
            yield f"gripper {name}: reads {numbers.tolist()}"
        elif odd := odd_openings(reading.openings):
            yield f"gripper {name}: {odd}"


def camera_sees(robot: Robot) -> Iterator[str]:
    """Check that depth is in metres, in the size and frame that it says."""
    before = robot.clock.now()
    frame: DepthFrame = robot.camera.capture()
    if odd := odd_image(frame):
        yield odd
        return
    depth = np.asarray(frame.depth)
    if not np.issubdtype(depth.dtype, np.floating):
        yield f"depth of type {depth.dtype}; metres as floats are needed"
    expected = robot.model.camera
    if expected is not None and frame.frame != expected:
        yield f"frame {frame.frame!r}; the model's camera is {expected!r}"
    if not before - 1e-6 <= frame.time <= robot.clock.now() + 1e-3:
        yield f"image of {frame.time:g} s, taken after {before:g} s: an old one?"
    seen = depth[np.isfinite(depth) & (depth != 0.0)]
    if seen.size < 0.1 * depth.size:
        yield f"only {100.0 * seen.size / depth.size:.0f} % of the pixels have depth"
    elif seen.min() < 0.0:
        yield f"depth {seen.min():g} m, below zero"
    yield from _implausible(frame.intrinsics)
    if frame.rgb is not None:
        rgb = np.asarray(frame.rgb)
        if rgb.shape != (*depth.shape, 3) or rgb.dtype != np.uint8:
            yield f"rgb of {rgb.shape} {rgb.dtype}; {(*depth.shape, 3)} uint8 is needed"


def _implausible(K: Intrinsics) -> Iterator[str]:
    try:
        Intrinsics.from_matrix(K.matrix, (K.height, K.width))
    except ValueError as error:
        yield str(error)


def head_is_known(robot: Robot) -> Iterator[str]:
    """Check that the head's joints are the model's, and it stands."""
    head = robot.head
    if head is None:
        return
    unknown = [name for name in head.joint_names if name not in robot.model.tree.joints]
    if unknown:
        yield f"joints {', '.join(unknown)} are not in the model"
        return
    q = np.asarray(head.read().q, dtype=np.float64)
    if q.shape != (len(head.joint_names),) or not np.isfinite(q).all():
        yield f"reads {q.tolist()} for joints {', '.join(head.joint_names)}"
        return
    for name, value in zip(head.joint_names, q, strict=True):
        joint = robot.model.tree.joints[name]
        if not joint.lower - 0.02 <= value <= joint.upper + 0.02:
            doubt = _UNITS[joint.kind != "prismatic"]
            hint = f"; {doubt}" if abs(value) > 2.0 * np.pi else ""
            ends = f"{joint.lower:g} to {joint.upper:g}"
            yield f"{name} at {value:g}, beyond {ends}{hint}"
    if not head.is_still:
        yield "moves, though nothing was asked of it"


def base_stands(robot: Robot) -> Iterator[str]:
    """Check that the base tells a pose, and stands when stopped."""
    base = robot.base
    if base is None:
        return
    base.stop()
    if odd := next(odd_base(base), ""):
        yield odd
        return
    robot.clock.wait_until(robot.clock.now() + 2.0)
    first = SE3.from_matrix(base.read().matrix, "T_odom_base")
    robot.clock.wait_until(robot.clock.now() + 0.2)
    moved = first.inverse() @ base.read()
    if float(np.linalg.norm(moved.p)) > 1e-3:
        yield f"moved by {1e3 * np.linalg.norm(moved.p):.1f} mm in 0.2 s after a stop"


def stop_latches(robot: Robot) -> Iterator[str]:
    """Check that a stop stays until it is reset."""
    clock = robot.clock
    for name, limb in robot.limbs.items():
        arm = limb.arm
        arm.stop()
        clock.wait_until(clock.now() + 0.2)
        if not arm.is_stopped:
            yield f"arm {name}: says that it is not stopped after a stop"
        arm.engage()
        clock.wait_until(clock.now() + 0.2)
        if not arm.is_stopped:
            yield f"arm {name}: the stop ends by itself when the arm is engaged"
        arm.disengage()
        arm.reset()
        clock.wait_until(clock.now() + 0.2)
        if arm.is_stopped:
            yield f"arm {name}: still stopped after a reset"
        if arm.is_engaged:
            yield f"arm {name}: engaged by a reset"
