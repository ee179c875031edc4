"""Laws of control: yielding does work, rates and limits hold, stops stay."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from debrisgrasp.control import (
    CartesianServo,
    Compliance,
    DeflectionMode,
    LoadModel,
    PostureKinematics,
    TaskFrame,
)
from debrisgrasp.control._rigid import (
    exp3,
    left_jacobian_times,
    parts,
    rotation_error,
    times,
)
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.kinematics import LimitSet
from tests.strategies import poses, rotvecs, twists, vectors
from tests.unit.control.rigs import (
    CHAIN,
    LIMITS,
    PERIOD,
    READY,
    Rig,
    broken_stream,
    fault_of_stream,
)

MODES = st.sampled_from(list(DeflectionMode))
SEEDS = st.integers(0, 2**32 - 1)


@st.composite
def tensors(draw: st.DrawFn) -> np.ndarray:
    """Symmetric and positive semidefinite, with coupling, some of lower rank."""
    rng = np.random.default_rng(draw(SEEDS))
    root = rng.normal(0.0, 0.03, (6, draw(st.integers(1, 6))))
    return root @ root.T


@st.composite
def frames(draw: st.DrawFn) -> TaskFrame:
    make = draw(st.sampled_from([TaskFrame.fixed_in_base, TaskFrame.on_hand, None]))
    return TaskFrame.ecra() if make is None else make(draw(poses))


def power_frames(T: SE3) -> np.ndarray:
    return np.kron(np.eye(2), T.R.T)


@given(tensors(), frames(), poses, twists)
def test_the_hand_always_yields(tensor, frame, T, wrench):
    """P1: the work of a reaction is never negative, at any pose."""
    twist_ee = power_frames(T) @ Compliance(tensor, frame).twist(wrench, T)
    scale = np.linalg.norm(wrench) * np.linalg.norm(twist_ee)
    assert wrench @ twist_ee >= -1e-12 * (1.0 + scale)


@given(st.floats(0.0, 0.01), st.floats(0.0, 0.1), poses, twists)
def test_equal_compliance_is_equal_at_every_orientation(c, k, T, wrench):
    """P2: C = diag(c I, k I) gives (c f, k tau), whatever the orientation."""
    twist = Compliance.diagonal(c, k).twist(wrench, T)
    expected = np.concatenate([c * wrench[:3], k * wrench[3:]])
    np.testing.assert_allclose(power_frames(T) @ twist, expected, atol=1e-12)


@given(poses, poses, twists, twists)
def test_power_is_the_same_at_sensor_and_hand(T_ee_ft, T_base_ee, wrench, twist_ee):
    """P3."""
    wrench_ee = LoadModel(T_ee_ft=T_ee_ft).load_ee(wrench.tolist(), parts(T_base_ee)[0])
    twist_ft = T_ee_ft.inverse().map_twist(twist_ee)
    power = wrench @ twist_ft
    assert np.dot(wrench_ee, twist_ee) == pytest.approx(power, abs=1e-9)


@given(tensors(), frames(), poses, MODES)
def test_no_wrench_leaves_exactly_the_nominal_goal(tensor, frame, T, mode):
    """P4."""
    moved = Compliance(tensor, frame, mode).deflected_pose(np.zeros(6), T)
    np.testing.assert_array_equal(moved.p, T.p)
    np.testing.assert_allclose(moved.R, T.R, atol=1e-15)


@given(tensors(), frames(), poses, twists)
def test_deflection_in_base_equals_deflection_in_the_hand(tensor, frame, T, wrench):
    """P5: exp6(Ad(T_BH) V_H) T_BE = T_BE exp6(V_E)."""
    wrench = 5.0 * wrench
    compliance = Compliance(tensor, frame, DeflectionMode.SE3)
    twist = compliance.twist(wrench, T)
    assume(np.linalg.norm(twist) < 3.0)
    moved = compliance.deflected_pose(wrench, T)
    in_hand = T @ SE3.exp(power_frames(T) @ twist)
    at_hand = SE3.from_parts(p=T.p)
    in_base = SE3.exp(at_hand.map_twist(twist)) @ T
    np.testing.assert_allclose(moved.matrix, in_hand.matrix, atol=1e-9)
    np.testing.assert_allclose(moved.matrix, in_base.matrix, atol=1e-9)


@given(tensors(), poses, poses, twists)
def test_any_task_frame_equals_its_tensor_moved_to_the_hand(tensor, T_task, T, wrench):
    """V_E = A C A^T W_E with A = Ad(T_ET), the full adjoint."""
    frame = TaskFrame.fixed_in_base(T_task)
    A = (T.inverse() @ T_task).adjoint()
    expected = A @ tensor @ A.T @ wrench
    twist_ee = power_frames(T) @ Compliance(tensor, frame).twist(wrench, T)
    np.testing.assert_allclose(twist_ee, expected, atol=1e-9, rtol=1e-9)


@given(st.floats(0.0, 0.1), poses, vectors(), twists)
def test_a_hinge_stays_where_it_is(c, T, point, wrench):
    """Compliance about a line moves no point of that line."""
    frame = TaskFrame.about_line(point, [0.3, -0.8, 0.5])
    twist = Compliance.diagonal(0.0, [c, 0.0, 0.0], frame=frame).twist(wrench, T)
    v, w = twist[:3], twist[3:]
    np.testing.assert_allclose(v + np.cross(w, point - T.p), 0.0, atol=1e-9)


@given(rotvecs, rotvecs, vectors())
def test_plain_rotations_equal_the_batched_ones(a, b, v):
    assume(np.linalg.norm(a) < 3.0)
    A, B = exp3(tuple(a)), exp3(tuple(b))
    np.testing.assert_allclose(np.reshape(A, (3, 3)), so3.exp(a), atol=1e-12)
    product = so3.exp(a) @ so3.exp(b)
    np.testing.assert_allclose(np.reshape(times(A, B), (3, 3)), product, atol=1e-12)
    moved = left_jacobian_times(tuple(b), tuple(v))
    np.testing.assert_allclose(moved, so3.left_jacobian(b) @ v, atol=1e-9)
    left = rotation_error(B, times(A, B))
    np.testing.assert_allclose(left, a, atol=1e-6)


@given(SEEDS)
@settings(max_examples=20)
def test_one_posture_equals_the_batched_kinematics(seed):
    kinematics = PostureKinematics(CHAIN)
    for q in CHAIN.sampled(3, rng=np.random.default_rng(seed)):
        R, p, J = kinematics.pose_and_jacobian(q.tolist())
        T = CHAIN.fk(q)
        np.testing.assert_allclose(np.reshape(R, (3, 3)), T.R, atol=1e-12)
        np.testing.assert_allclose(p, T.p, atol=1e-12)
        np.testing.assert_allclose(power_frames(T) @ J, CHAIN.jacobian(q), atol=1e-12)
        assert kinematics.pose(q.tolist()) == (R, p)


@given(SEEDS, st.floats(0.3, 3.0))
@settings(max_examples=25)
def test_joint_commands_never_leave_their_limits(seed, tightness):
    """Goals that jump about, near position limits, with little acceleration."""
    rng = np.random.default_rng(seed)
    limits = LimitSet(
        joint_names=LIMITS.joint_names,
        lower=READY - rng.uniform(0.001, 0.2, 7),
        upper=READY + rng.uniform(0.001, 0.2, 7),
        velocity=rng.uniform(0.1, 1.0, 7),
        acceleration=tightness * rng.uniform(0.3, 5.0, 7),
    )
    servo = CartesianServo(CHAIN, limits, PERIOD)
    state, T = servo.start(READY), CHAIN.fk(READY)
    steps, postures = [np.zeros(7)], [READY]
    goal = parts(T)
    for k in range(250):
        if k % 25 == 0:
            shift = SE3.from_parts(
                so3.exp(rng.normal(0, 0.4, 3)) @ T.R, T.p + rng.normal(0, 0.2, 3)
            )
            goal = parts(shift)
        state = servo.step(state, *goal) if k % 50 < 45 else servo.braked(state)
        steps.append(np.array(state.step))
        postures.append(np.array(state.q))
    speed = np.diff(postures, axis=0) / PERIOD
    change = np.diff(speed, axis=0, prepend=0.0) / PERIOD
    assert limits.violation(np.array(postures), tolerance=1e-12) == ""
    assert limits.violation(READY, speed, change, tolerance=1e-6) == ""


@given(SEEDS)
@settings(max_examples=60)
def test_broken_sensors_never_move_the_arm_outside_a_limit(seed):
    rig = BROKEN
    stream = broken_stream(rig, 120, rng=np.random.default_rng(seed))
    fault, _, _ = fault_of_stream(rig, stream)
    assert fault == ""


BROKEN = Rig(compliance=Compliance.diagonal(1e-4, 1e-3), offset=(0.03, 0.0, 0.1))
