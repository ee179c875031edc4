"""What a robot promises in motion: each function yields what is wrong, in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import GripCommand, felt_weight
from debrisgrasp.kinematics import KinematicChain
from debrisgrasp.prototypes import GripperModel

from .interface import Arm, Robot

__all__ = [
    "arm_follows",
    "base_stands_by_itself",
    "disengaged_arm_stands",
    "hand_moves",
    "head_moves",
    "nonsense_is_refused",
    "stopped_arm_stands",
    "wrist_feels_weight",
]

_SWING = np.deg2rad(2.0)
"""By which joints are moved [rad]; prismatic joints by a tenth of it [m]."""
_REST = 0.1
"""So long an arm is sent to where a motion ends [s]."""
_STOOD = np.deg2rad(0.1)
"""A joint that moved less than this stood [rad]."""
_BASE_STOOD = 1e-3
"""A base that moved less than this stood [m]."""
_CREEP, _ON_ITS_OWN = 0.03, 1.0
"""A base is told once to go so fast [m/s], and stands so long after that [s]."""
_READINGS, _READ_EVERY = 100, 0.008
"""Of the wrist at each end of a turn, and between two of them [s]."""
_CLOSING = 3.0
"""So long a hand is sent to an opening [s]."""
_CERTAIN, _LEAST = 8.0, 0.2
"""A change of the weight counts beyond so many standard errors, and beyond [N]."""
_STRAYS, _UNUSUAL = 3.0, 12.0
"""Readings of a wrist that stands lie within so much [N], or within so many times the
median difference of two that follow each other: noise reaches half of that."""


def disengaged_arm_stands(robot: Robot, *, period: float) -> Iterator[str]:
    """Check that a disengaged arm follows nothing."""
    for name, limb in robot.limbs.items():
        limb.arm.disengage()
        _wait(robot, 0.2)
        if limb.arm.is_engaged:
            yield f"arm {name}: engaged after it was disengaged"
        yield from _stands(robot, name, "disengaged", period)


def stopped_arm_stands(robot: Robot, *, period: float) -> Iterator[str]:
    """Check that a stopped arm follows nothing."""
    for name, limb in robot.limbs.items():
        if odd := _unready(robot, limb.arm):
            yield f"arm {name}: {odd}"
            continue
        limb.arm.stop()
        yield from _stands(robot, name, "stopped", period)
        limb.arm.reset()
        limb.arm.disengage()


def arm_follows(robot: Robot, *, period: float) -> Iterator[str]:
    """Check that an engaged arm goes where it is sent."""
    for name, limb in robot.limbs.items():
        arm = limb.arm
        if odd := _unready(robot, arm):
            yield f"arm {name}: {odd}"
            continue
        start = _q(arm)
        goal = start + _swing(robot, name, start)
        _send(robot, name, start, goal, period)
        missed = np.abs(_q(arm) - goal)
        for joint, gap, way in zip(arm.joint_names, missed, goal - start, strict=True):
            if gap > 0.25 * abs(way):
                yield (
                    f"arm {name}: {joint} was sent {way:+.4f} and misses it by "
                    f"{gap:.4f} rad or m"
                )
        _send(robot, name, goal, start, period)
        arm.disengage()
        _wait(robot, 0.2)
        if (np.abs(_q(arm) - start) > 0.25 * np.abs(goal - start)).any():
            yield f"arm {name}: did not come back to where it was"


def wrist_feels_weight(robot: Robot, *, period: float) -> Iterator[str]:
    """Check that a wrist that is turned feels the tool's weight, the right way round.

    Nothing is said where 2 degrees at each joint change it too little for the noise.
    """
    for name, limb in robot.limbs.items():
        arm, loads, chain = limb.arm, limb.loads, robot.model.chain(name)
        if odd := _unready(robot, arm):
            yield f"arm {name}: {odd}"
            continue
        start = _q(arm)
        goal = start + _tilt(arm, chain, start, _swing(robot, name, start))
        ends = []
        for q_from, q_to in ((start, start), (start, goal)):
            _send(robot, name, q_from, q_to, period)
            ends.append((chain.fk(_q(arm)).R @ loads.T_ee_ft.R, _forces(robot, name)))
        _send(robot, name, goal, start, period)
        arm.disengage()
        Rs, forces = (np.array(each) for each in zip(*ends, strict=True))
        if not np.isfinite(forces).all():
            yield f"sensor {name}: reads NaN or infinite values when the arm moves"
            continue
        strays = np.ptp(forces, axis=1)
        usual = np.median(np.abs(np.diff(forces, axis=1)), axis=1)
        if (strays > np.maximum(_STRAYS, _UNUSUAL * usual)).any():
            yield f"sensor {name}: jumps by {strays.max():.1f} N while the arm stands"
            continue
        error = np.sqrt((forces.var(axis=1) / _READINGS).sum())
        felt, due = felt_weight(loads, Rs, forces.mean(axis=1))
        if due < max(_CERTAIN * error, _LEAST):
            continue
        said = f"sensor {name}: a turn that changes the tool's weight by {due:.2f} N"
        if felt < -0.5 * due:
            yield f"{said} changes the force by {felt:.2f} N; its sign is inverted"
        elif felt < 0.5 * due:
            yield f"{said} changes the force by {felt:.2f} N; does it measure at all?"
        elif felt > 2.0 * due:
            yield f"{said} changes the force by {felt:.2f} N; does it jump?"


def _tilt(
    arm: Arm, chain: KinematicChain, q: FloatArray, swing: FloatArray
) -> FloatArray:
    """Of small motions of the joints those that turn the hand most against gravity."""
    down, size = chain.fk(q).R[2], np.abs(swing)
    steps = np.concatenate([np.diag(size), -np.diag(size)])
    # Each joint for itself: others may read a little outside their limits.
    allowed = (q + size <= arm.limits.upper, q - size >= arm.limits.lower)
    steps = steps[np.concatenate(allowed)]
    turns = chain.fk(q + steps).R[:, 2] - down
    most = turns[np.argmax(np.linalg.norm(turns, axis=1))]
    along = turns @ most
    found = np.zeros(len(q))
    for row in np.argsort(along):
        if along[row] > 0.0:
            joint = int(np.argmax(np.abs(steps[row])))
            found[joint] = steps[row, joint]
    return found


def _forces(robot: Robot, name: str) -> FloatArray:
    """Read the wrist while the arm stands [N], shape (n, 3)."""
    rows = []
    for _ in range(_READINGS):
        rows.append(np.asarray(robot.limbs[name].sensor.read().wrench_ft)[:3])
        _wait(robot, _READ_EVERY)
    return np.array(rows, dtype=np.float64)


def nonsense_is_refused(robot: Robot, *, period: float) -> Iterator[str]:
    """Check that an arm follows no NaN."""
    for name, limb in robot.limbs.items():
        arm = limb.arm
        if odd := _unready(robot, arm):
            yield f"arm {name}: {odd}"
            continue
        before = _q(arm)
        for _ in range(10):
            with suppress(Exception):  # to refuse by raising is fine
                arm.command([float("nan")] * len(before))
            _wait(robot, period)
        try:
            after = _q(arm)
        except Exception as error:  # noqa: BLE001 - a driver may raise any
            said = f"{type(error).__name__}: {error}"
            yield f"arm {name}: can't be read after it was sent NaN ({said})"
            continue
        # NaN compares as false.
        if not np.abs(after - before).max() <= _STOOD:
            yield f"arm {name}: obeys NaN, went to {after.tolist()} when sent NaN"
        if arm.is_stopped:
            arm.reset()
        arm.disengage()


def hand_moves(
    robot: Robot, *, period: float, grippers: Mapping[str, GripperModel]
) -> Iterator[str]:
    """Check that fingers initialise, open and close."""
    for name, limb in robot.limbs.items():
        model = grippers[limb.gripper.name]
        yield from _closes(robot, name, model, period)


def _closes(
    robot: Robot, name: str, model: GripperModel, period: float
) -> Iterator[str]:
    hand = robot.limbs[name].gripper
    hand.initialise()
    if not _becomes(robot, lambda: hand.is_initialised, 15.0):
        yield f"gripper {name}: not initialised within 15 s"
        return
    shape, wide = next(iter(model.preshapes)), 0.9 * model.opening_range[1]
    hand.preshape(shape, wide)

    def gap(goal: float) -> float:
        return max(abs(opening - goal) for opening in hand.read().openings)

    if not _becomes(robot, lambda: gap(wide) < 0.005, 5.0):
        yield (
            f"gripper {name}: preshape {shape!r} at {wide:.3f} m missed by "
            f"{gap(wide):.3f} m after 5 s"
        )
        return
    narrow = wide - 0.02
    command = GripCommand((narrow,) * len(model.fingers), 0.3 * model.max_force)
    for _ in range(int(np.ceil(_CLOSING / period))):
        hand.command(command)
        _wait(robot, period)
    if gap(narrow) > 0.005:
        missed = gap(narrow)
        yield f"gripper {name}: sent to {narrow:.3f} m, misses it by {missed:.3f} m"
    if len(hand.read().openings) != len(model.fingers):
        yield (
            f"gripper {name}: {len(hand.read().openings)} openings; the model has "
            f"{len(model.fingers)} fingers"
        )


def head_moves(robot: Robot) -> Iterator[str]:
    """Check that the head turns and tells when it has arrived."""
    head = robot.head
    if head is None:
        return
    start = np.asarray(head.read().q, dtype=np.float64)
    joints = [robot.model.tree.joints[name] for name in head.joint_names]
    middle = np.array([0.5 * (joint.lower + joint.upper) for joint in joints])
    goal = start + np.where(start < middle, _SWING, -_SWING)
    for target in (goal, start):
        head.move_to(target.tolist())
        if head.is_still:
            yield "says at once that it has arrived"
        if not _becomes(robot, lambda: head.is_still, 5.0):
            yield "does not arrive within 5 s"
        gap = np.abs(np.asarray(head.read().q, dtype=np.float64) - target).max()
        if gap > 0.25 * _SWING:
            yield f"says that it has arrived, {np.rad2deg(gap):.2f} degrees off"


def base_stands_by_itself(robot: Robot) -> Iterator[str]:
    """Check that a base that is told once to go does so, and stands by itself."""
    base = robot.base
    if base is None or not robot.model.drives:
        return
    places = [base.read()]
    try:
        base.drive(_CREEP, 0.0)
        for seconds in (0.4, _ON_ITS_OWN - 0.4, 0.2):
            _wait(robot, seconds)
            places.append(base.read())
    finally:
        base.stop()
    begun, going, standing, after = places
    gone = float((begun.inverse() @ going).p[0])
    if not gone > 0.1 * 0.4 * _CREEP:
        yield f"went {1e3 * gone:.1f} mm in 0.4 s when sent ahead at {_CREEP:g} m/s"
    on = float(np.linalg.norm((standing.inverse() @ after).p))
    if not on <= _BASE_STOOD:
        yield (
            f"goes on {_ON_ITS_OWN:g} s after its last command, by {1e3 * on:.1f} mm "
            "in 0.2 s; it must stand by itself"
        )


def _stands(robot: Robot, name: str, state: str, period: float) -> Iterator[str]:
    """Send an arm away that must not go."""
    arm = robot.limbs[name].arm
    before = _q(arm)
    _send(robot, name, before, before + _swing(robot, name, before), period)
    moved = float(np.abs(_q(arm) - before).max())
    if moved > _STOOD:
        yield f"arm {name}: followed by {moved:.4f} rad or m though it was {state}"


def _swing(robot: Robot, name: str, q: FloatArray) -> FloatArray:
    """Small motion of an arm away from the nearer limits, shape (d,)."""
    limits, turns = robot.limbs[name].arm.limits, robot.model.chain(name).is_revolute
    room = limits.upper - q > q - limits.lower
    most = np.where(turns, _SWING, 0.1 * _SWING)
    sizes: FloatArray = np.minimum(most, 0.1 * (limits.upper - limits.lower))
    return np.where(room, sizes, -sizes)


def _send(
    robot: Robot, name: str, q_from: FloatArray, q_to: FloatArray, period: float
) -> None:
    """Stream a smooth motion well within speeds and accelerations, then wait.

    Limits that the arm tells may be wrong: what the model allows counts, too.
    """
    arm, model = robot.limbs[name].arm, robot.model.limits(name).hardware
    way = np.abs(q_to - q_from)
    velocity = np.minimum(arm.limits.velocity, model.velocity)
    acceleration = np.minimum(arm.limits.acceleration, model.acceleration)
    # Speed and acceleration of 3 u^2 - 2 u^3 are at most 1.5 and 6.
    duration = max(
        float((1.5 * way / (0.2 * velocity)).max()),
        float(np.sqrt(6.0 * way / (0.2 * acceleration)).max()),
    )
    n = max(int(np.ceil(duration / period)), 1)
    for k in range(1, n + 1 + int(np.ceil(_REST / period))):
        u = min(k / n, 1.0)
        goal: Sequence[float] = (
            q_from + (3.0 - 2.0 * u) * u * u * (q_to - q_from)
        ).tolist()
        arm.command(goal)
        _wait(robot, period)


def _unready(robot: Robot, arm: Arm) -> str:
    """Engage an arm; say why it can't be sent anywhere, "" if it can."""
    if arm.is_stopped:
        arm.reset()
    arm.engage()
    if not _becomes(robot, lambda: arm.is_engaged, 0.5):
        return "not engaged within 0.5 s"
    q = _q(arm)
    if not np.isfinite(q).all():
        return f"reads {q.tolist()}; did it obey NaN?"
    return ""


def _becomes(robot: Robot, condition: Callable[[], bool], limit: float) -> bool:
    until = robot.clock.now() + limit
    while not condition():
        if robot.clock.now() >= until:
            return False
        _wait(robot, 0.02)
    return True


def _q(arm: Arm) -> FloatArray:
    return np.asarray(arm.read().q, dtype=np.float64)


def _wait(robot: Robot, seconds: float) -> None:
    robot.clock.wait_until(robot.clock.now() + seconds)
