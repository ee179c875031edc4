from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from debrisgrasp.geometry import so3
from debrisgrasp.kinematics import KinematicChain
from debrisgrasp.kinematics.formulas import AxisGoals, ChainFormulas
from debrisgrasp.kinematics.ik_types import Freedom
from debrisgrasp.kinematics.program import LaneKernel, Program


def on_lanes(program: Program, *inputs: float, n: int = 3) -> np.ndarray:
    """Every lane has the same inputs; return one lane after checking the others."""
    kernel = LaneKernel(program.for_lanes(), np.float64)
    rows = np.array(kernel(*(np.full(n, value) for value in inputs)))
    np.testing.assert_array_equal(rows, np.repeat(rows[:, :1], n, axis=1))
    return rows[:, 0]


numbers = st.floats(-3.0, 3.0).filter(lambda x: abs(x) > 1e-3)


@given(a=numbers, b=numbers, k=st.sampled_from([-2.5, -1.0, 0.0, 1.0, 2.5]))
def test_recorded_formulas_equal_plain_arithmetic(a: float, b: float, k: float) -> None:
    def formula(x, y, call):
        s, c = call("sin", x * y), call("cos", -(x - k))
        length = call("sqrt", s * s + c * c + 1.0)
        top = call("maximum", k * x - y, -(s * k) + 0.25)
        low = call("minimum", top, c - 1.0 * s)
        return [
            call("divide", low + k, length),
            k - x * 0.0 - (-y),
            -x,
            (x + y) * (x + y),
            top,
        ]

    names = {
        "sin": math.sin,
        "cos": math.cos,
        "sqrt": math.sqrt,
        "maximum": max,
        "minimum": min,
        "divide": lambda p, q: p / q,
    }
    plain = formula(a, b, lambda name, *args: names[name](*args))
    program = Program(2)
    program.outputs = formula(*program.inputs(), program.call)
    np.testing.assert_allclose(program.for_floats()(a, b), plain, atol=1e-14)
    np.testing.assert_allclose(on_lanes(program, a, b), plain, atol=1e-14)


def test_inputs_constants_and_repeated_results_may_be_outputs() -> None:
    program = Program(1)
    (x,) = program.inputs()
    doubled = x * 2.0
    program.outputs = [x, 3.0, doubled, doubled, 0.0]
    assert program.for_floats()(5.0) == (5.0, 3.0, 10.0, 10.0, 0.0)
    np.testing.assert_array_equal(on_lanes(program, 5.0), [5, 3, 10, 10, 0])


@pytest.mark.parametrize(
    ("q", "pull", "is_free"),
    [(0.0, -1.0, 1.0), (-1.0, -1.0, 0.0), (-1.0, 1.0, 1.0), (1.0, 1.0, 0.0)],
)
def test_a_joint_is_held_where_it_is_pulled_out_of_its_limits(
    q: float, pull: float, is_free: float
) -> None:
    program = Program(2)
    value, force = program.inputs()
    program.outputs = [program.call("is_free", value, -1.0, 1.0, force)]
    assert program.for_floats()(q, pull) == (is_free,)
    assert on_lanes(program, q, pull) == [is_free]


def test_kernels_serve_one_width_after_another() -> None:
    program = Program(1)
    (x,) = program.inputs()
    program.outputs = [x * x + 1.0]
    kernel = LaneKernel(program.for_lanes(), np.float32)
    for n in (4, 9, 2, 0):
        x_lanes = np.arange(n, dtype=np.float32)
        np.testing.assert_array_equal(kernel(x_lanes)[0], x_lanes**2 + 1.0)


def goal_of(chain: KinematicChain, q: np.ndarray) -> list[float]:
    frames = chain.form.frames(q[:, None])
    columns = np.stack([frames.x, frames.y, frames.z, frames.p])
    return columns.ravel().tolist()


def test_a_step_is_that_of_levenberg_and_marquardt(
    arm: KinematicChain, rng: np.random.Generator
) -> None:
    formulas = arm.formulas(Freedom())
    weight, damping = 0.3, 0.1
    for q, near in zip(
        arm.sampled(20, rng=rng), rng.normal(0, 0.2, (20, 8)), strict=True
    ):
        q = 0.8 * q
        goal = goal_of(arm, q + near)
        size, *after = formulas.step_of_one(*q, *goal, weight, damping)
        frames = arm.form.frames(q[:, None])
        J = arm.form.jacobian(frames)[..., 0]
        want = np.reshape(goal, (4, 3)).T
        have = np.stack([frames.x, frames.y, frames.z], axis=1)[..., 0]
        turn = want[:, :3] @ have.T
        vector = so3.log(turn)
        angle = np.linalg.norm(vector)
        rotation = 2.0 * math.tan(angle / 2.0) * vector / angle
        error = np.concatenate([want[:, 3] - frames.p[:, 0], weight * rotation])
        J[3:] *= weight
        lam = damping * error @ error + 1e-6
        expected = q + J.T @ np.linalg.solve(J @ J.T + lam * np.eye(6), error)
        assert size == pytest.approx(error @ error)
        # Joints that go round have no end in a descent.
        clipped = expected.clip(arm.lower, arm.upper)
        expected = np.where(arm.is_cyclic, expected, clipped)
        np.testing.assert_allclose(after, expected, atol=1e-9)


def test_a_step_of_the_middle_joints_squares_a_small_error(
    arm: KinematicChain, rng: np.random.Generator
) -> None:
    formulas = arm.formulas(Freedom())
    ratios = []
    for q in arm.sampled(30, rng=rng):
        aim, _, _ = AxisGoals.of_one(goal_of(arm, q))
        start = q[1:-1] + rng.normal(0, 1e-3, 6)
        before, *after = formulas.middle_step_of_one(*start, *aim, 0.3, 0.1)
        left, *_ = formulas.middle_step_of_one(*after, *aim, 0.3, 0.1)
        ratios.append(math.sqrt(left) / before)
    # Newton's method: what is left is a moderate multiple of the squared error.
    assert np.median(ratios) < 20.0


def test_the_ends_complete_the_middle_joints(
    arm: KinematicChain, rng: np.random.Generator
) -> None:
    formulas = arm.formulas(Freedom())
    for q in arm.sampled(20, rng=rng):
        goal = goal_of(arm, q)
        ends = formulas.ends_of_one(*q[1:-1], *goal)
        angles = math.atan2(*ends[:2]), math.atan2(*ends[2:]) - arm.form.offsets[-1]
        gap = arm.difference(np.array([angles[0], *q[1:-1], angles[1]]), q)
        # The torso can't go round, so its angle is compared as an angle.
        assert abs(math.sin(gap[0])) < 1e-9
        assert abs(gap[1:]).max() < 1e-9


def test_the_proof_is_forward_kinematics(
    arm: KinematicChain, rng: np.random.Generator
) -> None:
    formulas = arm.formulas(Freedom())
    for q, other in zip(
        arm.sampled(10, rng=rng), arm.sampled(10, rng=rng), strict=True
    ):
        square, sine_square, cosine = formulas.proof_of_one(*other, *goal_of(arm, q))
        gap = arm.fk(q).inverse() @ arm.fk(other)
        assert math.sqrt(square) == pytest.approx(np.linalg.norm(gap.p))
        angle = math.atan2(math.sqrt(sine_square), cosine)
        assert angle == pytest.approx(np.linalg.norm(gap.log()[3:]), abs=1e-7)


@pytest.mark.parametrize("name", ["step", "middle_step", "ends", "proof"])
def test_lanes_equal_floats(
    arm: KinematicChain, rng: np.random.Generator, name: str
) -> None:
    formulas = arm.formulas(Freedom())
    one, code = (
        getattr(formulas, f"{name}_of_one"),
        getattr(formulas, f"{name}_of_lanes"),
    )
    kernel = LaneKernel(code, np.float64)
    n_inputs = {"step": 22, "middle_step": 13, "ends": 18, "proof": 20}[name]
    inputs = rng.uniform(0.1, 0.9, (n_inputs, 40))
    rows = kernel(*inputs)
    for i in range(40):
        np.testing.assert_allclose(rows[:, i], one(*inputs[:, i]), rtol=1e-4, atol=1e-6)


def test_a_chain_travels_to_another_process_after_use(arm: KinematicChain) -> None:
    formulas = arm.formulas(Freedom())
    inputs = np.full(22, 0.3)
    expected = formulas.step_of_one(*inputs)
    twin = pickle.loads(pickle.dumps(arm))
    assert twin.hash == arm.hash
    again: ChainFormulas = twin.formulas(Freedom())
    assert again.step_of_one(*inputs) == expected
