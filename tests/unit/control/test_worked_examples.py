"""Known answers, computed apart from this code to twelve digits."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.control import (
    ArmResponse,
    Body,
    CartesianLeg,
    Compliance,
    DeflectionMode,
    LoadModel,
    StabilityBound,
    WrenchFilter,
    contact_gain,
    identify_payload,
    identify_tool,
)
from debrisgrasp.control._rigid import parts
from debrisgrasp.control.compliance import in_base_axes
from debrisgrasp.control.filters import ZERO_WRENCH
from debrisgrasp.geometry import SE3

from .rigs import rpy

EXACT = {"rtol": 0.0, "atol": 1e-9}
T_BASE_EE = SE3.from_parts(rpy(0.4, -0.7, 1.1), [0.55, -0.2, 0.45])
T_EE_FT = SE3.from_parts(rpy(0.1, 0.2, -0.6), [0.0, 0.02, -0.14])
TENSOR = np.diag([1e-3, 2e-3, 5e-4, 0.01, 0.02, 0.005])
WRENCH_FT = (
    *(12.9578269901, 11.4815627395, 27.7356888639),
    *(-2.74010503509, 0.744132882041, 0.972104884075),
)
WRENCH_EE = (
    *(20.08151908, -3.2515553516, 25.5960930463),
    *(-1.62567063121, -0.880916794776, 1.16352077742),
)


def test_twist_wrench_and_power_in_two_frames():
    T_ab = SE3.from_parts(rpy(0.3, -0.2, 0.9), [0.4, -0.1, 0.25])
    twist_b = np.array([0.1, -0.2, 0.05, 0.3, 0.4, -0.5])
    wrench_a = np.array([10, -4, 25, 1.5, -0.7, 0.2])
    twist_a, wrench_b = T_ab.map_twist(twist_b), T_ab.inverse().map_wrench(wrench_a)
    expected_twist = (
        *(0.0989235485946, 0.0206780795926, 0.236220095946),
        *(-0.187923556784, 0.615641864727, -0.292694091503),
    )
    expected_wrench = (
        *(7.98807471883, -2.79905078732, 25.8719148301),
        *(7.20703808852, 1.60262273444, -1.17055643252),
    )
    np.testing.assert_allclose(twist_a, expected_twist, **EXACT)
    np.testing.assert_allclose(wrench_b, expected_wrench, **EXACT)
    assert wrench_a @ twist_a == pytest.approx(6.04065210744, abs=1e-9)
    assert wrench_b @ twist_b == pytest.approx(6.04065210744, abs=1e-9)


def test_sensor_to_hand_to_base_axes():
    loads = LoadModel(T_ee_ft=T_EE_FT)
    R, _ = parts(T_BASE_EE)
    wrench_ee = loads.load_ee(WRENCH_FT, R)
    np.testing.assert_allclose(wrench_ee, WRENCH_EE, **EXACT)
    np.testing.assert_allclose(
        in_base_axes(R, wrench_ee), (12, -5, 30, 0.35, -2.1, -0.49), **EXACT
    )


@pytest.mark.parametrize(
    ("mode", "p"),
    [
        (DeflectionMode.SE3, (0.561669482454, -0.210040950247, 0.465229836311)),
        (DeflectionMode.DECOUPLED, (0.562, -0.21, 0.465)),
    ],
)
def test_deflection_twist_and_pose(mode, p):
    compliance = Compliance(TENSOR, mode=mode)
    twist = compliance.twist(WRENCH_EE, T_BASE_EE)
    np.testing.assert_allclose(
        twist, (0.012, -0.01, 0.015, 0.0035, -0.042, -0.00245), **EXACT
    )
    twist_ee = np.kron(np.eye(2), T_BASE_EE.R.T) @ twist
    expected = (
        *(0.00701008883849, -0.00869027070315, 0.0185563425702),
        *(-0.0289926656969, -0.0121579103292, 0.0281755754549),
    )
    np.testing.assert_allclose(twist_ee, expected, **EXACT)
    printed = np.array(
        [
            *(-0.00163557781342, -0.0211665532012, 0.0259812436961),
            *(0.0259005185872, 0.0124187121514, -0.0196065169415),
        ]
    )
    assert np.abs(twist_ee - printed).max() > 1e-2
    T = compliance.deflected_pose(WRENCH_EE, T_BASE_EE)
    np.testing.assert_allclose(T.p, p, **EXACT)
    R = (
        (0.32119000633, -0.945868620772, 0.0465782360407),
        (0.678530594413, 0.195541646063, -0.708067579473),
        (0.660630919863, 0.25902898852, 0.704606820026),
    )
    np.testing.assert_allclose(T.R, R, **EXACT)
    if mode is DeflectionMode.SE3:
        exact = T_BASE_EE @ SE3.exp(twist_ee)
        np.testing.assert_allclose(T.matrix, exact.matrix, atol=1e-12)


def test_filter_of_three_samples_and_of_a_step():
    smoothing = WrenchFilter(tau=float(-0.004 / np.log(0.99)))
    assert smoothing.alpha == pytest.approx(0.01, abs=1e-12)
    reference = np.array([9, 0, -5, 0, 0, 0.5])
    samples = np.array(
        [[10, 0, -5, 0, 0, 0.5], [12, 1, -6, 0.1, 0, 0.5], [14, 2, -7, 0.2, 0, 0.5]]
    )
    expected = [
        (0.01, 0, 0, 0, 0, 0),
        (0.0399, 0.01, -0.01, 0.001, 0, 0),
        (0.089501, 0.0299, -0.0299, 0.00299, 0, 0),
    ]
    state = ZERO_WRENCH
    for sample, row in zip(samples, expected, strict=True):
        state = smoothing.step(state, tuple((sample - reference).tolist()))
        np.testing.assert_allclose(state, row, **EXACT)
    state, seen = ZERO_WRENCH, {}
    for n in range(1, 251):
        state = smoothing.step(state, (1.0,) * 6)
        seen[n] = state[3]
    assert seen[100] == pytest.approx(0.633967658727, abs=1e-9)
    assert seen[250] == pytest.approx(0.918941483838, abs=1e-9)


@pytest.mark.parametrize(
    ("period", "alpha"), [(0.002, 0.00501256289338), (0.010, 0.0248128128918)]
)
def test_equal_time_constant_at_other_rates(period, alpha):
    tau = float(-0.004 / np.log(0.99))
    assert WrenchFilter(tau=tau, period=period).alpha == pytest.approx(alpha, abs=1e-9)


def test_identification_returns_tool_and_bias():
    R = np.stack([np.eye(3), rpy(0.9, 0, 0.3), rpy(-0.4, 1, 0), rpy(0.2, -0.8, 2)])
    readings = np.array(
        [
            (6, -3, -8.601, 0.323606, -0.017596, 0.05),
            (
                *(6, -19.1373176652, -0.805786956344),
                *(1.64850672328, -0.0487768521746, -0.0145492706609),
            ),
            (
                *(23.335143758, 1.33452514654, 1.74788394318),
                *(-0.106921941115, 1.41449568366, 0.171348963134),
            ),
            (
                *(-8.77825282862, -5.85147208181, -2.06675340297),
                *(0.526775647372, -1.29988447682, -0.050075405299),
            ),
        ]
    )
    fit = identify_tool(readings, R, expected_mass=2.0)
    assert fit.tool.mass == pytest.approx(2.1, abs=1e-9)
    np.testing.assert_allclose(fit.tool.com, (0.004, -0.006, 0.085), **EXACT)
    np.testing.assert_allclose(fit.bias, (6, -3, 12, 0.2, -0.1, 0.05), **EXACT)
    loads = LoadModel(
        T_ee_ft=T_EE_FT, tool=Body(2.1, np.array([0.004, -0.006, 0.085])), bias=fit.bias
    )
    np.testing.assert_allclose(loads.load_ft(readings, R), 0.0, **EXACT)


def test_contact_gain_of_a_lever():
    C = np.diag([1e-4] * 3 + [0.01] * 3)
    assert contact_gain(C, (0, 0, 0.3)) == pytest.approx(1e-3, abs=1e-12)
    assert contact_gain(C) == pytest.approx(1e-4, abs=1e-12)


@pytest.mark.parametrize(
    ("a", "frequency", "damping", "delay", "figures"),
    [
        (0.01, 8, 0.7, 2, (19.785, 6.594, 8.309, 0.0357)),
        (0.01, 4, 0.5, 2, (9.241, 3.827, 4.117, 0.129)),
        (0.01, 4, 0.5, 5, (7.679, 3.408, 3.573, 0.0568)),
        (0.05, 8, 0.7, 2, (4.932, 7.427, 2.133, 0.00713)),
        (0.2, 8, 0.7, 2, (2.564, 9.613, 1.132, 0.00178)),
    ],
)
def test_stability_bounds(a, frequency, damping, delay, figures):
    arm = ArmResponse(frequency=frequency, damping=damping, delay=delay)
    bound = StabilityBound(arm, WrenchFilter(tau=float(-0.004 / np.log(1 - a))))
    found = (bound.gain_max, bound.crossover, bound.gain_safe, bound.mass_gain_max)
    np.testing.assert_allclose(found, figures, rtol=2.5e-3)
    np.testing.assert_allclose(found[:3], figures[:3], rtol=1e-3)


def test_a_leg_is_a_line_and_not_a_screw():
    start = SE3.from_parts(rpy(np.pi, 0, 0), [0.5, 0, 0.4])
    goal = SE3.from_parts(
        start.R @ rpy(0, 0.8, 0.4), start.p + np.array([0.2, 0.1, -0.1])
    )
    middle = CartesianLeg(start, goal).pose(0.5)
    np.testing.assert_allclose(middle.p, (0.6, 0.05, 0.35), **EXACT)
    screw = start @ SE3.exp(0.5 * (start.inverse() @ goal).log())
    np.testing.assert_allclose(
        screw.p, (0.585162081567, 0.0616502435645, 0.331974406699), **EXACT
    )
    assert np.linalg.norm(screw.p - middle.p) == pytest.approx(0.0260924, abs=1e-6)
    np.testing.assert_allclose(middle.R, screw.R, atol=1e-12)


def test_payload_needs_two_orientations_for_its_whole_centre():
    loads = LoadModel(T_ee_ft=T_EE_FT, tool=Body(2.1, np.array([0.0, 0.0, 0.08])))
    R = np.stack([rpy(0.3, 0.1, 0.0), rpy(-0.5, 0.4, 1.0)])
    both = LoadModel(T_ee_ft=T_EE_FT, tool=Body(8.0, np.array([0.1, -0.05, 0.3])))
    raw = -loads.load_ft(np.zeros((2, 6)), R) - both.load_ft(np.zeros((2, 6)), R)
    payload, is_complete = identify_payload(loads, raw, R)
    assert is_complete
    assert payload.mass == pytest.approx(8.0, abs=1e-9)
    np.testing.assert_allclose(payload.com, (0.1, -0.05, 0.3), atol=1e-9)
    one, is_complete = identify_payload(loads, raw[:1], R[:1])
    assert not is_complete
    assert one.mass == pytest.approx(8.0, abs=1e-9)
    # Along gravity it is where it should be, across it where the torque says.
    seen, _ = identify_payload(
        loads, raw[:1], R[:1], expected_com=payload.com + 0.05 * R[0].T[:, 2]
    )
    np.testing.assert_allclose(seen.com, payload.com + 0.05 * R[0].T[:, 2], atol=1e-9)
    across = R[0].T[:, 0]
    seen, _ = identify_payload(
        loads, raw[:1], R[:1], expected_com=payload.com + 0.05 * across
    )
    np.testing.assert_allclose(seen.com, payload.com, atol=1e-9)
