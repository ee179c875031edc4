"""What no camera can be fitted to is refused: what, with numbers, and the mend."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.calibration import (
    CalibrationConfig,
    Head,
    Known,
    Observations,
    calibrate,
)
from debrisgrasp.errors import ConfigError, InputError, ShapeError
from debrisgrasp.geometry import SE3, sampling, so3

from .looks import CAMERA, PLACES, REST, head, head_looks, looks

LEVEL = so3.from_rpy(np.array([-np.pi / 2, 0.0, -np.pi / 2]))
"""Orientation of a camera that looks straight ahead."""


def refused(*words: str, **fields: object) -> str:
    given = looks()
    arguments = {
        "points_base": given.points_base,
        "points_camera": given.points_camera,
        **fields,
    }
    known = arguments.pop("known", None)
    with pytest.raises(InputError) as caught:
        calibrate(Observations(**arguments), known)  # type: ignore[arg-type]
    message = str(caught.value)
    assert all(word in message for word in words), message
    return message


def test_collinear():
    line = PLACES[0] + np.linspace(0, 1, 6)[:, None] * [0.3, 0.4, 0.1]
    seen = CAMERA.inverse().apply(line)
    refused("one line", "mm", points_base=line, points_camera=seen)


def test_nearly_collinear(rng):
    line = PLACES[0] + np.linspace(0, 1, 6)[:, None] * [-0.3, 0.4, 0.1]
    near = line + rng.normal(0, 0.02, line.shape)
    found = calibrate(looks(near))
    assert not found.decision.accepted
    assert "of a line" in str(found.decision)


def test_all_in_one_place():
    spot = PLACES[0] + 0.002 * np.eye(3)
    seen = CAMERA.inverse().apply(spot)
    refused("one place", points_base=spot, points_camera=seen)


def test_clustered(rng):
    near = PLACES[1] + rng.uniform(-0.05, 0.05, (8, 3))
    found = calibrate(looks(near, noise=0.0025, rng=rng))
    assert not found.decision.accepted
    assert found.error.rms > 0.008
    assert any("clustered" in f.problem for f in found.decision.findings)


def test_duplicate():
    given = looks()
    rows = [0, 1, 2, 3, 3]
    refused(
        "4 and 5",
        points_base=given.points_base[rows],
        points_camera=given.points_camera[rows],
    )


def test_nan():
    seen = looks().points_camera.copy()
    seen[2, 2] = np.nan
    refused("NaN", "observation 3", points_camera=seen)


@pytest.mark.parametrize("wrong", [np.nan, 2.0])
def test_attitudes_that_are_no_rotations(wrong):
    attitudes = np.tile(np.eye(3), (len(PLACES), 1, 1))
    attitudes[2, 0, 0] = wrong
    with pytest.raises(InputError, match="attitudes of the wrist"):
        Observations(PLACES, looks().points_camera, R_base_wrist=attitudes)


def test_a_number_whose_square_overflows():
    seen = looks().points_camera.copy()
    seen[2, 0] = 1e200
    refused("1e+200", "observation 3", "1e+06", points_camera=seen)


def test_a_file_is_for_the_facade():
    with pytest.raises(
        InputError, match=r"Observations.*debrisgrasp\.calibrate\(path\)"
    ):
        calibrate("looks.yaml")


def test_too_few():
    refused(
        "at least 3",
        points_base=PLACES[:2],
        points_camera=looks().points_camera[:2],
    )


def test_swapped_frames():
    given = looks()
    refused(
        "swapped",
        points_base=given.points_camera,
        points_camera=given.points_base,
    )


def test_swapped_frames_against_the_model():
    given = looks()
    refused(
        "swapped",
        points_base=given.points_camera,
        points_camera=given.points_base,
        known=Known(head=Head.fixed(CAMERA)),
    )


def test_swapped_frames_are_named_as_files_have_them():
    given = looks()
    swapped = {"points_base": given.points_camera, "points_camera": given.points_base}
    said = refused("`point`", "camera_x", "`position`", "base_x", **swapped)
    # Without an expected pose there is none to be the wrong way round.
    assert "T_base_camera" not in said


def test_an_expected_pose_that_is_the_wrong_way_round():
    wrong = Known(head=Head.fixed(CAMERA.inverse()))
    refused("expected pose", "T_base_camera", "inverse", known=wrong)


@pytest.mark.parametrize(
    ("factor", "unit"),
    [(1000.0, "millimetres"), (100.0, "centimetres"), (39.37, "inches")],
)
@pytest.mark.parametrize("side", ["points_base", "points_camera"])
def test_wrong_unit(factor, unit, side):
    points = getattr(looks(), side) * factor
    refused(unit, f"divide by {factor:g}", **{side: points})


@pytest.mark.parametrize(
    ("factor", "unit"),
    [(1000.0, "millimetres"), (100.0, "centimetres"), (39.37, "inches")],
)
def test_wrong_unit_in_both(factor, unit):
    given = looks()
    refused(
        unit,
        points_base=given.points_base * factor,
        points_camera=given.points_camera * factor,
    )


@pytest.mark.parametrize(("height", "word"), [(0.3, "below"), (0.7, "upside down")])
def test_a_plane_with_a_mirrored_axis(rng, height, word):
    plane = PLACES * [1, 1, 0] + [0, 0, height]
    seen = looks(plane, noise=0.002, rng=rng).points_camera
    right = calibrate(Observations(plane, seen))
    assert right.decision.accepted
    assert any("one plane" in note for note in right.decision.notes)
    wrong = calibrate(Observations(plane * [1, -1, 1], seen))
    (finding,) = wrong.decision.findings
    assert word in finding.problem
    assert "mirrored" in finding.problem
    assert "out of that plane" in finding.remedy


def test_a_camera_below_the_ground():
    down = SE3.from_parts(p=[0.0, 0.0, -1.5])
    given = looks()
    found = calibrate(Observations(down.apply(given.points_base), given.points_camera))
    assert "0.57 m below the ground" in str(found.decision)
    assert "mirrored" not in str(found.decision)


def test_axes_of_a_body_instead_of_the_optical_frame():
    low = SE3.from_parts(LEVEL, [0.0, 0.0, 0.1])
    assert calibrate(looks(T_base_camera=low)).decision.accepted
    body = SE3.from_parts(p=low.p)  # x forward, as a link of the robot
    found = calibrate(looks(T_base_camera=body))
    assert not found.decision.accepted
    assert "looking up by 90 degrees" in str(found.decision)
    assert "optical frame" in found.decision.findings[0].remedy
    # What the model of a robot says of the camera decides otherwise.
    known = Known(head=Head.fixed(body))
    assert "looking up" not in str(calibrate(looks(T_base_camera=body), known).decision)


def test_unrelated_points(rng):
    for n in (4, 6, 8, 12):
        R = sampling.random_rotations(n, rng=rng)
        seen = rng.uniform([-0.5, -0.5, 0.7], [0.5, 0.5, 1.7], (n, 3))
        places = rng.uniform([0.6, -0.5, 0.1], [1.2, 0.5, 0.7], (n, 3))
        found = calibrate(Observations(places, seen, R_base_wrist=R))
        assert not found.decision.accepted
        assert all(a.degrees_of_freedom > 0 for a in found.attempts)


def test_mirrored_axis():
    seen = looks().points_camera * [-1.0, 1.0, 1.0]
    refused("left-handed", points_camera=seen)


def test_y_up():
    seen = looks().points_camera * [1.0, -1.0, 1.0]
    refused("left-handed", points_camera=seen)


def test_behind_the_camera():
    # x forward, y left, z up, as in a robot's link frame
    seen = looks().points_camera[:, [2, 0, 1]] * [1, -1, -1]
    refused("optical", points_camera=seen)


def test_another_count():
    with pytest.raises(ShapeError):
        Observations(PLACES, PLACES[:4])


@pytest.mark.parametrize("sigma", [0.0, -1.0, np.nan, 2.0])
def test_sigma_out_of_range(sigma):
    sigmas = np.full(8, 0.002)
    sigmas[2] = sigma
    message = refused("sigma", "observation 3,", sigmas=sigmas)
    assert "[" not in message
    refused("observation 1 and in 7 more", sigmas=sigma)


@pytest.mark.parametrize("sigma", [np.nan, np.inf, -0.001, 1.0, "0.001", [0.001] * 8])
def test_an_arm_of_unknown_accuracy(sigma):
    with pytest.raises(ConfigError, match=r"kinematic_sigma \[m\].*0 to 0.1"):
        looks(kinematic_sigma=sigma)


def test_accuracy_of_an_arm_in_millimetres():
    refused("kinematic_sigma", "divide by 1000", kinematic_sigma=1.0)


def test_far_from_where_the_model_has_it():
    elsewhere = SE3.exp([0.5, 0, 0, 0, 0, 0]) @ CAMERA
    found = calibrate(looks(), Known(head=Head.fixed(elsewhere)))
    assert not found.decision.accepted
    assert "500 mm" in str(found.decision)


def test_readings_without_a_head():
    with pytest.raises(InputError, match="no head"):
        calibrate(head_looks(head(), PLACES, REST))


@pytest.mark.parametrize(
    ("reference", "error", "words"),
    [
        ([0.0, np.nan], InputError, "1 of 2 values NaN"),
        ([0.0], ShapeError, r"pan, tilt"),
        (np.zeros((3, 2)), ShapeError, r"reference: got \(3, 2\)"),
        ("rest", ShapeError, "reference"),
    ],
)
def test_a_pose_for_readings_that_are_none(reference, error, words):
    given = head_looks(head(), PLACES, REST)
    with pytest.raises(error, match=words):
        calibrate(given, Known(head=head()), reference=reference)


@pytest.mark.parametrize("readings", [[0.0, np.inf], ["a", "b"]])
def test_a_head_whose_joints_are_nowhere(readings):
    for ask in (head().T_base_camera, head().screws):
        with pytest.raises(InputError, match="joint readings of the head"):
            ask(readings)


@pytest.mark.parametrize("length", [0.0, 0.5, 2.0])
def test_an_axis_of_another_length(length):
    with pytest.raises(InputError, match=f"'pan' of the head: got length {length:g}"):
        replace(head(), axes=head().axes * [[length], [1.0]])


def test_settings_out_of_range():
    with pytest.raises(ConfigError):
        CalibrationConfig(min_places=3)
    with pytest.raises(ConfigError):
        CalibrationConfig(max_rms=-1.0)
    for name in ("distinct", "max_shift", "max_turn", "min_places_known"):
        for value in (-1, np.nan, "much"):
            with pytest.raises(ConfigError, match=name):
                CalibrationConfig(**{name: value})


@pytest.mark.parametrize(
    ("covariance", "words"),
    [
        (1e-6 * np.eye(3), r"mount: got \(3, 3\), expected \(6, 6\)"),
        (np.full((6, 6), np.nan), "mount: got 36 of 36 values NaN"),
        (1e-6 * np.eye(6) + np.eye(6, k=1), "an asymmetry of 1"),
        (-1e-6 * np.eye(6), "an eigenvalue of -1e-06"),
        (np.zeros((6, 6)), "an eigenvalue of 0"),
        ("well", "covariance of the mount"),
    ],
)
def test_a_mount_known_by_no_covariance(covariance, words):
    """By one below zero the fit is pulled away from where the mount is known to be."""
    with pytest.raises(InputError, match=words):
        Known(head=head(), mount_covariance=covariance)
