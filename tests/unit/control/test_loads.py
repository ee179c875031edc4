"""Identification of tool and sensor, baselines, references."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.control import (
    BaselineConfig,
    BaselineLook,
    Body,
    LoadModel,
    RefusalCause,
    identify_payload,
    identify_tool,
    judge_baseline,
    reference_wrench,
    require_sensor_range,
)
from debrisgrasp.errors import ConfigError, InputError, ShapeError
from debrisgrasp.geometry import SE3, random_rotations

from .rigs import LIMITS, T_EE_FT, rpy

BIAS = np.array([6.0, -3.0, 12.0, 0.2, -0.1, 0.05])
TOOL = Body(2.1, np.array([0.004, -0.006, 0.085]))
LOADS = LoadModel(T_ee_ft=T_EE_FT, tool=TOOL, bias=BIAS)
PUSH = np.array([2.5, 0, 0, 0, 0, 0])
SCALE = np.repeat([1.0, 0.03], 3)
"""Of a noisy sensor [N, N m]."""
TILTS = np.stack([np.eye(3), rpy(0.9, 0, 0.3), rpy(-0.4, 1, 0), rpy(0.2, -0.8, 2)])


def readings(R: np.ndarray, sign: float = 1.0) -> np.ndarray:
    return -sign * LOADS.load_ft(np.zeros((len(R), 6)), R)


def test_random_tools_are_found_through_noise(rng):
    R = random_rotations(12, rng=rng)
    noisy = readings(R) + rng.normal(0, 0.02, (12, 6)) * np.repeat([1, 0.02], 3)
    fit = identify_tool(noisy, R)
    assert fit.tool.mass == pytest.approx(2.1, abs=0.01)
    np.testing.assert_allclose(fit.tool.com, TOOL.com, atol=1e-3)
    assert 0.005 < fit.rms[0] < 0.06


def test_an_inverted_sensor_is_found_and_refused():
    with pytest.raises(InputError, match="wrench_sign to -1"):
        identify_tool(readings(TILTS, sign=-1.0), TILTS)
    fit = identify_tool(readings(TILTS, sign=-1.0), TILTS, wrench_sign=-1.0)
    assert fit.tool.mass == pytest.approx(2.1)


def test_too_few_and_too_similar_orientations_are_refused():
    with pytest.raises(InputError, match="at least 4"):
        identify_tool(readings(TILTS[:3]), TILTS[:3])
    near = np.stack([rpy(0.2 * k, 0.1 * k, 0) for k in range(4)])
    with pytest.raises(InputError, match="60 degrees"):
        identify_tool(readings(near), near)
    about_one_axis = np.stack([rpy(1.2, 0, 0), np.eye(3)] * 2)
    with pytest.raises(InputError, match="rank 9"):
        identify_tool(readings(about_one_axis), about_one_axis)


def test_a_tool_of_the_wrong_mass_is_refused():
    with pytest.raises(InputError, match="within 10 %"):
        identify_tool(readings(TILTS), TILTS, expected_mass=1.5)


def test_readings_are_checked():
    with pytest.raises(ShapeError):
        identify_tool(np.zeros((4, 5)), TILTS)
    with pytest.raises(InputError, match="NaN"):
        identify_tool(np.full((4, 6), np.nan), TILTS)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"wrench_sign": 2.0}, "wrench_sign: got 2.0, expected 1 or -1"),
        ({"wrench_sign": 0.0}, "wrench_sign"),
        ({"expected_mass": np.nan}, "expected mass of the tool"),
        ({"gravity": np.zeros(3)}, "size of gravity"),
        ({"gravity": [0.0, 0.0, np.nan]}, "gravity: got 1 of 3 values NaN"),
        ({"gravity": np.zeros(4)}, r"gravity: got \(4,\)"),
        ({"R_base_ft": 2.0 * TILTS}, "orientations of the sensor"),
        ({"R_base_ft": TILTS[:, :, 0]}, r"orientations of the sensor: got \(4, 3\)"),
        ({"R_base_ft": np.ones((4, 4))}, r"orientations of the sensor: got \(4, 4\)"),
        ({"R_base_ft": TILTS[:0], "raw": np.zeros((0, 6))}, r"readings: got \(0, 6\)"),
        ({"raw": "readings"}, "readings: got str"),
    ],
)
def test_a_tool_is_not_found_by_what_no_sensor_gives(given, words):
    """A sign of 2 doubled the mass; an expected mass that is no number fits all."""
    with pytest.raises(InputError, match=words):
        identify_tool(**{"raw": readings(TILTS), "R_base_ft": TILTS, **given})


def test_nothing_is_held_without_readings():
    with pytest.raises(ShapeError, match="readings"):
        identify_payload(LOADS, np.zeros((0, 6)), np.zeros((0, 3, 3)))


def test_a_centre_of_mass_is_one_place():
    with pytest.raises(ShapeError, match=r"centre of mass: got \(2, 3\)"):
        Body(2.1, np.zeros((2, 3)))


def test_a_moment_of_contact_beside_hardly_any_weight_is_told_as_it_was_measured():
    light = [[0.0, 0.0, -0.03, 0.7, 0.0, 0.0]]
    payload, _ = identify_payload(LoadModel(T_ee_ft=T_EE_FT), light, [np.eye(3)])
    assert payload.mass == pytest.approx(0.003, abs=1e-4)
    assert payload.com[1] == pytest.approx(-0.7 / 0.03)


def test_gravity_is_one_vector():
    with pytest.raises(ShapeError, match=r"gravity: got \(2, 3\)"):
        LoadModel(T_ee_ft=T_EE_FT, gravity=np.ones((2, 3)))


def test_a_reference_needs_many_samples_at_rest(rng):
    calm = rng.normal(0, 0.3, (200, 6)) * np.repeat([1, 0.02], 3) + np.arange(6)
    np.testing.assert_allclose(reference_wrench(calm), np.arange(6), atol=0.1)
    with pytest.raises(InputError, match="at least 50"):
        reference_wrench(calm[:49])
    moving = calm + np.linspace(0, 5, 200)[:, None]
    with pytest.raises(InputError, match="stand still"):
        reference_wrench(moving)


def look(R, *, contact=(0.0, 0, 0), shift=0.0, rng=None, **changed) -> BaselineLook:
    """Readings in one posture; a contact force is fixed in base."""
    rng = rng or np.random.default_rng(5)
    raw = readings(R[None])[0] + np.repeat([shift, 0.0], 3)
    raw[:3] += R.T @ np.asarray(contact, dtype=float)
    noise = rng.normal(0, 1, (250, 6)) * np.repeat([0.3, 0.01], 3)
    fields = {
        "raw": raw + noise,
        "R_base_ft": R,
        "duration": 1.0,
        "clearance": 0.1,
        "is_open_and_empty": True,
        "is_standing": True,
    }
    return BaselineLook(**fields | changed)


def judged(*looks, age=600.0, commissioned=BIAS):
    return judge_baseline(looks, LOADS, commissioned, age=age)


TILTED = rpy(np.deg2rad(50.0), 0.1, 0.4)


def test_a_baseline_in_free_space_is_taken():
    verdict = judged(look(np.eye(3), shift=1.0), look(TILTED, shift=1.0))
    assert verdict.is_accepted, verdict.refusals
    np.testing.assert_allclose(verdict.bias, BIAS + np.repeat([1.0, 0.0], 3), atol=0.1)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"is_open_and_empty": False}, "open and empty"),
        ({"is_standing": False}, "stand still"),
        ({"clearance": 0.03}, "30 mm of clearance"),
        ({"clearance": float("nan")}, "clearance"),
        ({"duration": 0.5}, "0.5 s of readings"),
    ],
)
def test_a_look_that_proves_nothing_is_refused(changed, words):
    verdict = judged(look(np.eye(3), **changed), look(TILTED))
    assert not verdict.is_accepted
    assert any(words in refusal.words for refusal in verdict.refusals)


def test_contact_that_one_pose_cannot_see_is_found_by_two():
    force = (0.0, 15.0, 0.0)
    pair = look(np.eye(3), contact=force), look(TILTED, contact=force)
    verdict = judged(*pair, age=1e5)
    assert RefusalCause.TOUCHED in {refusal.cause for refusal in verdict.refusals}
    alike = judged(pair[0], pair[0], age=1e5)
    assert any("degrees apart" in refusal.words for refusal in alike.refusals)


def test_a_bias_that_moved_too_fast_or_too_far_is_refused():
    shifted = look(np.eye(3), shift=4.0), look(TILTED, shift=4.0)
    (refusal,) = judged(*shifted, age=60.0).refusals
    assert (refusal.cause, refusal.words[:4]) == (RefusalCause.SHIFTED, "jump")
    assert judged(*shifted, age=3600.0).is_accepted
    crept = judged(*shifted, age=3600.0, commissioned=BIAS - 63.0)
    assert any("since commissioning" in refusal.words for refusal in crept.refusals)


def test_a_bias_may_use_up_a_tenth_of_the_sensors_own_range():
    looks = look(np.eye(3)), look(TILTED)
    small = replace(LOADS, sensor_range=(100.0, 60.0))
    before = BIAS - np.repeat([13.0, 0.0], 3)
    verdict = judge_baseline(looks, small, before, age=600.0)
    assert "since commissioning of 13" in verdict.refusals[0].words
    assert "at most 10" in verdict.refusals[0].words
    assert judge_baseline(looks, LOADS, before, age=600.0).is_accepted


def test_noise_beyond_twice_the_usual_is_refused(rng):
    noisy = look(np.eye(3))
    noisy = look(np.eye(3), raw=noisy.raw + rng.normal(0, 1.0, noisy.raw.shape))
    verdict = judged(noisy, look(TILTED))
    assert any("noise of" in refusal.words for refusal in verdict.refusals)


def test_a_noisy_sensor_is_allowed_its_noise_but_no_contact(rng):
    scattered = [
        look(R, raw=look(R).raw + rng.normal(0, 1.0, look(R).raw.shape) * SCALE)
        for R in (np.eye(3), TILTED)
    ]
    (refusal, *_) = judged(*scattered).refusals
    assert "LoadModel(sensor_noise=...), up to 1 N and 0.1 N m" in refusal.words
    noisy = replace(LOADS, sensor_noise=(1.0, 0.03))
    assert judge_baseline(scattered, noisy, BIAS, age=600.0).is_accepted
    pushed = replace(scattered[1], raw=scattered[1].raw + PUSH)
    verdict = judge_baseline([scattered[0], pushed], noisy, BIAS, age=600.0)
    assert RefusalCause.TOUCHED in {refusal.cause for refusal in verdict.refusals}


@pytest.mark.parametrize("noise", [(1.1, 0.01), (0.3, 0.2), (0.0, 0.01), (np.nan, 0.1)])
def test_more_noise_than_a_touch_is_told_from_is_refused(noise):
    with pytest.raises(ConfigError, match="sensor_noise"):
        replace(LOADS, sensor_noise=noise)


def test_a_baseline_needs_looks():
    with pytest.raises(InputError, match="looks"):
        judged()
    assert BaselineConfig().clearance == 0.05


@pytest.mark.parametrize(
    ("given", "error"),
    [
        ((100.0, 0.0), "sensor_range"),
        ((-1.0, 60.0), "sensor_range"),
        ((np.nan, 60.0), "sensor_range"),
        ((100.0,), "expected 2"),
        (100.0, "sensor_range"),
    ],
)
def test_a_range_that_no_sensor_has_is_refused(given, error):
    with pytest.raises(InputError, match=error):
        LoadModel(T_ee_ft=T_EE_FT, sensor_range=given)


@pytest.mark.parametrize(
    ("sensor_range", "words"),
    [
        ((660.0, 60.0), ""),
        ((100.0, 60.0), "force limit.*got 150, expected below 98.*limits.force"),
        ((153.0, 60.0), "force limit"),
        ((154.0, 60.0), ""),
        ((660.0, 40.0), "torque limit.*got 40, expected below 39.2.*sensor_range"),
    ],
)
def test_a_sensor_must_reach_beyond_the_limits(sensor_range, words):
    loads = LoadModel(T_ee_ft=T_EE_FT, sensor_range=sensor_range)
    if not words:
        require_sensor_range(loads, LIMITS)
        return
    with pytest.raises(ConfigError, match=words):
        require_sensor_range(loads, LIMITS)


def test_a_sensor_is_placed_by_a_pose_only():
    with pytest.raises(InputError, match=r"ndarray.*SE3\.from_matrix"):
        LoadModel(T_ee_ft=np.eye(4))
    with pytest.raises(InputError, match="finite"):
        LoadModel(T_ee_ft=SE3.from_parts(p=[0.0, 0.0, np.nan]))


def test_a_baseline_of_unknown_age_or_orientation_is_no_baseline():
    R = np.eye(3)
    turned = rpy(np.pi / 2, 0.0, 0.0)
    assert not judged(look(R), look(turned), age=np.nan).is_accepted
    broken = np.full(6, np.nan)
    assert not judged(look(R), look(turned), commissioned=broken).is_accepted
    with pytest.raises(InputError, match="orientation"):
        BaselineLook(
            raw=np.zeros((5, 6)),
            R_base_ft=np.full((3, 3), np.nan),
            duration=1.0,
            clearance=0.1,
            is_open_and_empty=True,
            is_standing=True,
        )
