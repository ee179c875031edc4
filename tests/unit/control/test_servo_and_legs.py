"""Joint steps within limits, and straight legs planned ahead."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.control import (
    CartesianLeg,
    CartesianServo,
    ContactGuard,
    ControllerConfig,
    LegPlanner,
    LegStatus,
    PostureKinematics,
    ServoConfig,
)
from debrisgrasp.control._rigid import parts
from debrisgrasp.control.servo import stoppable
from debrisgrasp.errors import ConfigError, InputError, ShapeError
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.kinematics import KinematicChain, LimitSet
from tests.unit.kinematics.robots import JointText, written

from .rigs import CHAIN, LIMITS, PERIOD, READY, ROMAN, SOFT, Rig, rpy

T = CHAIN.fk(READY)


def test_mixed_and_parallel_joints_equal_the_batched_kinematics(tmp_path, rng):
    joints = (
        JointText("continuous", axis=(0, 0, 1)),
        JointText("revolute", rpy=(0.3, -0.2, 0.9), axis=(0, 1, 0.2)),
        JointText("prismatic", xyz=(0.1, 0, 0), axis=(1, 1, 0), lower=-0.1, upper=0.4),
        JointText("fixed", xyz=(0, 0.3, 0.1), rpy=(1, 2, 3)),
        JointText("revolute", axis=(0, 0, 1)),
        JointText("revolute", xyz=(0.3, 0, 0), axis=(0, 0, 1)),
        JointText("prismatic", axis=(0, 0, 1), lower=-0.1, upper=0.4),
        JointText("revolute", xyz=(0.2, 0, 0), rpy=(1e-6, 0, 0), axis=(0, 0, 1)),
    )
    chain = KinematicChain.from_urdf(written(tmp_path, joints), "link0", "link8")
    kinematics = PostureKinematics(chain)
    for q in chain.sampled(20, rng=rng):
        R, p, J = kinematics.pose_and_jacobian(q.tolist())
        pose = chain.fk(q)
        np.testing.assert_allclose(np.reshape(R, (3, 3)), pose.R, atol=1e-12)
        np.testing.assert_allclose(p, pose.p, atol=1e-12)
        body = np.kron(np.eye(2), pose.R.T) @ J
        np.testing.assert_allclose(body, chain.jacobian(q), atol=1e-12)


def test_a_goal_is_reached_and_kept_without_swinging():
    servo = CartesianServo(CHAIN, LIMITS, PERIOD)
    goal = parts(SE3.from_parts(rpy(0.05, -0.1, 0.1) @ T.R, T.p + 0.04))
    state, gaps = servo.start(READY), []
    for _ in range(700):
        state = servo.step(state, *goal)
        gaps.append(state.gap)
    assert gaps[-1] < 1e-9
    assert np.diff(gaps).max() < 1e-4
    assert not state.is_moving


def test_a_singular_posture_is_damped():
    servo = CartesianServo(CHAIN, LIMITS, PERIOD)
    stretched = CHAIN.vector(ROMAN.posture("right", "zero"))
    _, _, J = servo.kinematics.pose_and_jacobian(stretched.tolist())
    assert np.linalg.svd(J, compute_uv=False)[-1] < 0.01
    step, sigma = servo.solved(J, (0.002, 0.002, 0.002, 0.0, 0.0, 0.0))
    assert sigma < 0.01
    assert np.abs(step).max() < 0.1
    regular = servo.kinematics.pose_and_jacobian(READY.tolist())[2]
    error = np.array([1e-3, 0, 2e-3, 0, 1e-3, 0])
    step, sigma = servo.solved(regular, error)
    assert sigma == np.inf
    np.testing.assert_allclose(step, np.linalg.pinv(regular) @ error, atol=1e-12)


def test_joints_that_turn_other_arms_move_least(rng):
    chain = ROMAN.chain("right")
    assert chain.shared == {"torso_joint"}
    assert not CHAIN.shared
    limits = ROMAN.limits("right", chain).controller
    servo = CartesianServo(chain, limits, PERIOD)
    cost = np.where(np.arange(8) == 0, servo.config.shared_cost, 1.0)
    n_regular = 0
    for q in chain.sampled(20, rng=rng):
        J = servo.kinematics.pose_and_jacobian(q.tolist())[2]
        error = 1e-3 * rng.normal(size=6)
        step, sigma = servo.solved(J, error.tolist())
        if sigma < np.inf:
            continue
        n_regular += 1
        np.testing.assert_allclose(J @ step, error, atol=1e-12)
        # Of all steps that do it, the cheapest: its slope has no part that J allows.
        null = np.linalg.svd(J)[2][6:]
        assert np.abs(null @ (cost * step)).max() < 1e-9
    assert n_regular > 10


def test_where_all_joints_are_shared_none_is_dearer(rng):
    """Two hands on one wrist: what turns one turns the other."""
    ours = replace(CHAIN, shared=frozenset(CHAIN.joint_names))
    J = CHAIN.jacobian(CHAIN.sampled(1, rng=rng)[0])
    error = (1e-3 * rng.normal(size=6)).tolist()
    found, expected = (
        CartesianServo(chain, LIMITS, PERIOD).solved(J, error)
        for chain in (ours, CHAIN)
    )
    assert found == expected


def test_where_a_joint_is_stopped_shared_ones_do_its_part(rng):
    chain = ROMAN.chain("right")
    limits = ROMAN.limits("right", chain).controller
    servo, n_stopped, n_damped = CartesianServo(chain, limits, PERIOD), 0, 0
    for q in chain.sampled(400, rng=rng):
        q = np.clip(q, limits.lower + 0.2, limits.upper - 0.2)
        stopped = rng.integers(1, 8)
        q[stopped] = limits.upper[stopped]
        J = servo.kinematics.pose_and_jacobian(q.tolist())[2]
        free = np.delete(J, stopped, axis=1)
        error = 1e-6 * J @ rng.normal(size=8)
        asked = servo.solved(J, error.tolist())[0]
        is_regular = np.linalg.svd(free, compute_uv=False)[-1] > servo.config.sigma_min
        if asked[stopped] <= 0.0 or not is_regular:
            continue
        n_stopped += 1
        n_damped += servo.solved(np.insert(free, stopped, 0.0, axis=1), error)[1] < 1.0
        goal = SE3.from_parts(
            so3.exp(error[3:]) @ chain.fk(q).R, chain.fk(q).p + error[:3]
        )
        step = np.array(servo.step(servo.start(q), *parts(goal)).step)
        assert step[stopped] == 0.0
        assert np.linalg.norm(J @ step - error) < 1e-3 * np.linalg.norm(error)
    assert n_stopped > 20
    assert n_damped > 3


def test_shared_joints_keep_no_leg_from_being_done():
    chain = ROMAN.chain("right")
    limits = ROMAN.limits("right", chain).controller
    postures = np.clip(
        chain.sampled(60, rng=np.random.default_rng(5)),
        limits.lower + 0.02,
        limits.upper - 0.02,
    )
    ways = np.random.default_rng(6).normal(size=(60, 3))
    ways *= 0.12 / np.linalg.norm(ways, axis=1, keepdims=True)
    n_done = {}
    for name, one in (
        ("dear", chain),
        ("like others", replace(chain, shared=frozenset())),
    ):
        planner = LegPlanner(one, limits)
        legs = [
            planner.plan(q, SE3.from_parts(T.R, T.p + way))
            for q, T, way in zip(postures, map(chain.fk, postures), ways, strict=True)
        ]
        n_done[name] = sum(leg.is_done for leg in legs)
    assert n_done["dear"] >= n_done["like others"] > 0


@pytest.mark.parametrize("seed", range(8))
def test_a_joint_at_its_limit_stops_no_hand_that_the_others_can_move(seed):
    """Legs that a plan says can be done, from postures with a joint near its limit."""
    rng = np.random.default_rng(seed)
    servo, planner = (
        CartesianServo(CHAIN, LIMITS, PERIOD),
        LegPlanner(CHAIN, LIMITS, speed=0.03),
    )
    n_done = 0
    while n_done < 3:
        q = CHAIN.sampled(1, rng=rng)[0]
        joint = rng.integers(CHAIN.n_joints)
        q[joint] = (LIMITS.lower, LIMITS.upper)[rng.integers(2)][joint]
        start = CHAIN.fk(q)
        way = rng.normal(size=3)
        goal = SE3.from_parts(start.R, start.p + 0.1 * way / np.linalg.norm(way))
        plan = planner.plan(q, goal)
        least = min(
            np.linalg.svd(CHAIN.jacobian(row), compute_uv=False)[-1] for row in plan.q
        )
        if not plan.is_done or least < 0.1:
            continue
        n_done += 1
        state, leg, n = servo.start(q), CartesianLeg(start, goal), 850
        passed = [q]
        for i in range(n + 150):
            state = servo.step(state, *leg.at(min((i + 1) / n, 1.0)))
            passed.append(np.array(state.q))
        assert state.gap < 1e-4
        assert LIMITS.violation(np.array(passed)) == ""
        assert np.abs(np.diff(passed, 2, axis=0) / PERIOD**2).max() < (
            1.001 * LIMITS.acceleration.max()
        )


@pytest.mark.parametrize("aside", [0.0, 2e-5, 2e-4])
def test_a_hand_that_one_joint_can_hardly_follow_goes_on_smoothly(tmp_path, aside):
    """The waist of six joints stands at its limit; aside of it the hand can't go."""
    joints = [
        JointText("revolute", xyz=(reach, 0, 0), axis=axis)
        for reach, axis in (
            (0.0, (0, 0, 1)),
            (0.0, (0, 1, 0)),
            (0.5, (0, 1, 0)),
            (0.5, (0, 1, 0)),
            (0.1, (0, 0, 1)),
            (0.1, (1, 0, 0)),
        )
    ]
    chain = KinematicChain.from_urdf(written(tmp_path, joints), "link0", "link6")
    limits = LimitSet.of_chain(chain, velocity=1.0, acceleration=10.0)
    servo = CartesianServo(chain, limits, PERIOD)
    q = np.array([2.0, -0.9, 1.5, -0.6, 0.0, 0.1])
    start, n = chain.fk(q), 1000
    outwards, left = so3.exp([0.0, 0.0, 2.0])[:, :2].T
    state, passed = servo.start(q), [q]
    for i in range(n):
        goal = start.p + aside * left + 0.06 * i / n * outwards
        state = servo.step(state, *parts(SE3.from_parts(start.R, goal)))
        passed.append(np.array(state.q))
    assert limits.violation(np.array(passed)) == ""
    assert state.gap < aside / 0.015 + 1e-3
    is_moving = np.abs(np.diff(passed, axis=0)).max(axis=1) > 1e-9
    assert np.count_nonzero(np.diff(is_moving)) <= 1


def test_what_can_be_stopped_in_time_is():
    """Braking by one gain a step from the largest displacement never overruns."""
    gain = 1.0
    for distance in np.linspace(0.0, 30.0, 301):
        step, left = stoppable(float(distance), gain), float(distance)
        while step > 0.0:
            left -= step
            assert left >= -1e-12
            step = max(step - gain, 0.0)
        assert left <= max(1.0, 0.2 * distance)


def test_braking_comes_to_rest_within_the_acceleration():
    servo = CartesianServo(CHAIN, LIMITS, PERIOD)
    state = servo.start(READY)
    goal = parts(SE3.from_parts(T.R, T.p + 0.2))
    for _ in range(60):
        state = servo.step(state, *goal)
    assert state.is_moving
    for _ in range(60):
        state = servo.braked(state)
    assert not state.is_moving


def test_braking_leaves_the_hand_on_its_way():
    """Near a singularity joints are fast that cancel out: they slow down together."""
    stretched = READY.copy()
    stretched[3] *= 0.05
    servo, T_start = CartesianServo(CHAIN, LIMITS, PERIOD), CHAIN.fk(stretched)
    state = servo.start(stretched)
    for i in range(80):
        way = np.array([0.0, 0.0, -2e-4 * (i + 1)])
        state = servo.step(state, *parts(SE3.from_parts(T_start.R, T_start.p + way)))
    before, gain = CHAIN.fk(np.array(state.q)), LIMITS.acceleration * PERIOD**2
    while state.is_moving:
        last, state = np.array(state.step), servo.braked(state)
        assert (np.abs(last - state.step) <= gain + 1e-12).all()
    after = CHAIN.fk(np.array(state.q))
    assert after.p[2] < before.p[2] - 1e-4
    assert np.linalg.norm((after.p - before.p)[:2]) < 5e-5
    assert np.linalg.norm(so3.log(before.R.T @ after.R)) < 1e-4


def test_servo_refuses_foreign_limits_and_impossible_starts():
    torso = ROMAN.limits("right").controller
    with pytest.raises(ConfigError, match="joints of the limits"):
        CartesianServo(CHAIN, torso, PERIOD)
    servo = CartesianServo(CHAIN, LIMITS, PERIOD)
    with pytest.raises(InputError, match="right_arm_joint2"):
        servo.start(READY + np.array([0, -9.0, 0, 0, 0, 0, 0]))
    with pytest.raises(InputError, match="start posture"):
        servo.start(np.full(7, np.nan))
    with pytest.raises(ShapeError):
        servo.start(READY[:6])


@pytest.mark.parametrize(
    "offset", [(0, 0, 0.2), (0.2, 0, 0), (-0.2, 0, 0), (0, 0.2, 0)]
)
def test_a_leg_is_straight_within_limits_and_carries_their_hash(offset):
    planner = LegPlanner(CHAIN, LIMITS, speed=0.1)
    turn = rpy(0.0, 0.2, 0.1)
    plan = planner.plan(READY, SE3.from_parts(T.R @ turn, T.p + np.array(offset)))
    assert plan.is_done, plan.reason
    assert re.fullmatch(
        r"<LegPlan done: <Trajectory of 7 joints: \d+ knots, .* s>>", repr(plan)
    )
    assert plan.share == 1.0
    poses = CHAIN.fk(plan.q)
    leg = CartesianLeg(T, plan.reached)
    for s, pose in zip(np.linspace(0, 1, len(plan.q)), poses.matrix, strict=True):
        np.testing.assert_allclose(pose, leg.pose(s).matrix, atol=1e-5)
    trajectory = plan.trajectory
    trajectory.require_executable(LIMITS)
    np.testing.assert_allclose(trajectory.q[-1], plan.q[-1], atol=1e-9)
    np.testing.assert_allclose(trajectory.dq[[0, -1]], 0.0, atol=1e-9)
    q = trajectory.at(np.linspace(0, trajectory.duration, 200))[0]
    p = CHAIN.fk(q).p - T.p
    way = np.array(offset) / np.linalg.norm(offset)
    assert np.abs(p - np.outer(p @ way, way)).max() < 1e-4
    with pytest.raises(ConfigError, match="hash"):
        trajectory.require_executable(LIMITS.scaled(velocity=0.5))


def test_a_leg_that_ends_where_a_slide_ends_says_so_in_metres(tmp_path):
    axes = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
    joints = [JointText("prismatic", axis=axis) for axis in axes]
    joints += [JointText(xyz=(0.0, 0.0, 0.0), axis=axis) for axis in axes]
    chain = KinematicChain.from_urdf(written(tmp_path, joints), "link0", "link6")
    limits = LimitSet.of_chain(chain, velocity=1.0, acceleration=10.0)
    q = np.array([1.9, 0.0, 0.0, 0.3, 0.2, 0.1])
    goal = SE3.from_parts(p=[0.3, 0.0, 0.0]) @ chain.fk(q)
    plan = LegPlanner(chain, limits).plan(q, goal)
    assert plan.status is LegStatus.JOINT_LIMIT
    assert "joint1 stands at 2.000 m" in plan.reason


def test_a_leg_that_ends_at_a_joint_limit_says_which_and_how_far():
    plan = LegPlanner(CHAIN, LIMITS).plan(READY, SE3.from_parts(p=[0.6, 0, 0]) @ T)
    assert plan.status is LegStatus.JOINT_LIMIT
    assert "right_arm_joint1 stands at" in plan.reason
    assert " rad" in plan.reason
    assert 0.5 < plan.share < 1.0
    np.testing.assert_allclose(CHAIN.fk(plan.q[-1]).p, plan.reached.p, atol=1e-4)
    assert LIMITS.violation(plan.q) == ""
    assert plan.trajectory.violation(LIMITS) == ""


def test_a_leg_beyond_the_arms_length_ends_stretched():
    q = READY.copy()
    far = SE3.from_parts(p=[0.0, -0.9, 0.0]) @ T
    plan = LegPlanner(CHAIN, LIMITS).plan(q, far)
    assert not plan.is_done
    assert plan.reason


def test_a_leg_stops_before_an_obstacle():
    def is_free(q):
        return CHAIN.fk(q).p[2] < T.p[2] + 0.05

    plan = LegPlanner(CHAIN, LIMITS, is_free=is_free).plan(
        READY, SE3.from_parts(p=[0, 0, 0.1]) @ T
    )
    assert plan.status is LegStatus.BLOCKED
    assert plan.share == pytest.approx(0.5, abs=0.05)
    assert "50 of 100 mm" in plan.reason or "48 of 100 mm" in plan.reason


def test_a_leg_of_no_length_is_done_at_once():
    plan = LegPlanner(CHAIN, LIMITS).plan(READY, T)
    assert plan.is_done
    assert plan.trajectory.duration == 0.0
    q, dq, ddq = plan.trajectory.at(0.5)
    np.testing.assert_allclose(q, READY)
    assert not dq.any()
    assert not ddq.any()


def test_a_leg_is_only_accepted_with_room_for_the_deflection():
    planner = LegPlanner(CHAIN, LIMITS)
    short = planner.plan(READY, SE3.from_parts(p=[0, 0, 0.02]) @ T)
    assert planner.margin_fault(short) == ""
    long = planner.plan(READY, SE3.from_parts(p=[0.4, 0, 0]) @ T)
    assert long.is_done
    assert "joint" in planner.margin_fault(long)
    assert planner.margin_fault(planner.plan(READY, SE3.from_parts(p=[0.6, 0, 0]) @ T))


@pytest.mark.parametrize(
    ("offset", "words"),
    [
        ((0, 0, np.nan), "offset of a leg"),
        ((np.inf, 0, 0), "offset of a leg"),
        ((0, 0, 100.0), "at most 3.*millimetres"),
        ((0, 0), "offset of a leg"),
    ],
)
def test_an_offset_that_makes_no_leg_is_refused(offset, words):
    with pytest.raises(InputError, match=words):
        CartesianLeg.along(T, offset)


def test_a_leg_takes_finite_poses_only():
    broken = SE3.from_parts(np.full((3, 3), np.nan), T.p)
    for start, goal in ((T, broken), (broken, T)):
        with pytest.raises(InputError, match="finite"):
            CartesianLeg(start, goal)
    with pytest.raises(InputError, match=r"SE3\.from_matrix"):
        CartesianLeg(T, np.eye(4))
    with pytest.raises(InputError, match="finite"):
        LegPlanner(CHAIN, LIMITS).plan(READY, SE3.from_parts(p=[0, 0, np.nan]))


@pytest.mark.parametrize("period", [0.001, 0.004, 0.02])
def test_a_far_goal_is_approached_as_fast_by_slow_loops_as_by_fast_ones(period):
    limits = replace(
        LIMITS, velocity=10 * LIMITS.velocity, acceleration=np.full(7, 1e9)
    )
    servo = CartesianServo(CHAIN, limits, period)
    goal = T.R, T.p + np.array([0.0, 0.0, 0.2])
    state = servo.start(READY)
    for _ in range(round(0.2 / period)):
        state = servo.step(state, *parts(SE3.from_parts(*goal)))
    moved = CHAIN.fk(np.array(state.q)).p - T.p
    assert moved[2] == pytest.approx(0.2 * servo.config.max_speed, rel=0.02)


def test_a_leg_that_is_faster_than_its_servo_is_refused():
    servo = ServoConfig(max_speed=0.2, max_turn_rate=1.0)
    with pytest.raises(ConfigError, match=r"speed.*got 0\.3, expected 1e-06 to 0\.2"):
        ControllerConfig(speed=0.3, servo=servo)
    with pytest.raises(ConfigError, match=r"turn_rate.*to 1\.$"):
        ControllerConfig(turn_rate=1.5, servo=servo)


def test_a_leg_and_its_controller_are_told_in_a_line_each():
    leg = "<CartesianLeg of 100 mm and 0 deg>"
    for given, how in (
        ({}, "rigid"),
        ({"guard": ContactGuard()}, "guarded"),
        ({"guard": ContactGuard(), "compliance": SOFT}, "giving way, guarded"),
    ):
        controller = Rig(**given, config=ControllerConfig(speed=0.01)).controller
        assert repr(controller.leg) == leg
        assert repr(controller) == f"<LegController of {CHAIN} on {leg}, {how}>"
