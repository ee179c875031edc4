"""A camera that an arm carries before a fiducial that stands still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.calibration import (
    BEFORE_CAMERA,
    CalibrationConfig,
    DriftMonitor,
    DriftStatus,
    Head,
    Known,
    Observations,
    calibrate,
)
from debrisgrasp.calibration.uncertainty import grid
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.geometry import SE3, so3

DRAWN = SE3.from_parts(so3.from_rpy(np.array([0.0, 0.1, 1.2])), [0.05, 0.0, 0.04])
"""Camera on its link, as the robot's file has it."""
KNOWN = Known(head=Head.fixed(DRAWN))
CAMERA = DRAWN @ SE3.exp([0.012, -0.008, 0.01, 0.05, -0.03, 0.04])
"""Where it is."""
PLACE = np.array([0.6, 0.1, 0.02])
"""Of the fiducial in base."""


def wrist_looks(
    n: int = 12,
    *,
    rng: np.random.Generator,
    said: np.ndarray = PLACE,
    tilt: float = 0.6,
    noise: float = 0.0025,
    T_link_camera: SE3 = CAMERA,
) -> Observations:
    """Look down at the fiducial from all sides, wherever it is in the picture."""
    point = rng.uniform([-0.25, -0.18, 0.4], [0.25, 0.18, 0.9], (n, 3))
    down = so3.from_rpy(np.array([np.pi, 0.0, 0.0]))
    turns = rng.uniform(-1.0, 1.0, (n, 3)) * [tilt, tilt, 3.0]
    R = down @ so3.exp(turns)
    T_base_camera = SE3.from_parts(R, PLACE - (R @ point[..., None])[..., 0])
    T_link_base = T_link_camera @ T_base_camera.inverse()
    return Observations(
        T_link_base.apply(said) + rng.normal(0.0, 0.4 * noise, (n, 3)),
        point + rng.normal(0.0, noise, (n, 3)),
        R_base_wrist=T_link_base.R,
        link="tool0",
    )


def test_without_noise_camera_and_place_are_found(rng):
    said = PLACE + np.array([0.02, -0.03, 0.01])
    config = CalibrationConfig(fiducial_sigma=0.3)
    given = wrist_looks(rng=rng, said=said, noise=1e-9)
    found = calibrate(given, KNOWN, config=config)
    assert found.model == "mount, fiducial"
    assert found.link == "tool0"
    # What is known of its place beforehand pulls by a few micrometres.
    assert found.T_link_camera.matrix == pytest.approx(CAMERA.matrix, abs=1e-4)
    assert said + found.fiducial == pytest.approx(PLACE, abs=1e-4)


def test_what_an_arm_carries_has_no_pose_in_base(rng):
    found = calibrate(wrist_looks(rng=rng), KNOWN)
    with pytest.raises(ConfigError, match=r"'tool0' carries.*T_base_link @"):
        _ = found.T_base_camera
    with pytest.raises(ConfigError, match="'tool0' carries"):
        found.T_base_camera_at([])


def test_the_error_is_as_predicted():
    squared, true, predicted = [], [], []
    for seed in range(15):
        rng = np.random.default_rng(seed)
        said = PLACE + rng.normal(0.0, 0.015, 3)
        found = calibrate(wrist_looks(10, rng=rng, said=said), KNOWN)
        away = np.append(
            (found.T_link_camera.inverse() @ CAMERA).log(),
            PLACE - said - found.fiducial,
        )
        squared.append(away @ np.linalg.solve(found.fit_covariance, away))
        points = grid(BEFORE_CAMERA)
        gaps = found.T_link_camera.apply(points) - CAMERA.apply(points)
        true.append(np.mean((gaps**2).sum(axis=1)))
        predicted.append(found.error.rms)
        assert not found.is_outlier.any()
    # 135 degrees of freedom: within four standard deviations of their mean.
    assert np.mean(squared) == pytest.approx(9.0, abs=4.0 * np.sqrt(18.0 / 15.0))
    ratio = np.sqrt(np.mean(true)) / np.sqrt(np.mean(np.square(predicted)))
    assert 0.75 < ratio < 1.25


def test_twelve_looks_from_all_sides_are_accepted_and_wrong_picks_named(rng):
    given = wrist_looks(rng=rng)
    points = given.points_camera.copy()
    points[3] += [0.05, 0.02, 0.0]
    points[7] -= [0.02, 0.03, 0.02]
    found = calibrate(replace(given, points_camera=points), KNOWN)
    assert found.decision.accepted
    assert "left out as a wrong pick: 4, 8" in found.decision.notes
    assert np.linalg.norm(found.T_link_camera.p - CAMERA.p) < 0.008


def test_a_fiducial_that_stands_elsewhere_is_told(rng):
    given = wrist_looks(rng=rng, said=PLACE + np.array([0.25, -0.1, 0.05]))
    found = calibrate(given, KNOWN)
    (finding,) = found.decision.findings
    assert "stands 27" in finding.problem
    assert "right within 20 mm" in finding.problem
    assert "`fiducial_sigma`" in finding.remedy
    config = CalibrationConfig(fiducial_sigma=0.3)
    assert calibrate(given, KNOWN, config=config).decision.accepted


def test_a_wrist_that_hardly_turns_is_told(rng):
    found = calibrate(wrist_looks(rng=rng, tilt=0.03), KNOWN)
    (turns,) = [f for f in found.decision.findings if "tool0 is turned" in f.problem]
    assert "two axes" in turns.remedy
    assert found.error.rms > 0.004
    assert "of the camera frame" in str(found.decision)


def test_no_height_is_read_from_the_frame_of_a_link(rng):
    # By 10 mm below the origin of the link, drawn as much above.
    camera = SE3.from_parts(DRAWN.R, [0.05, 0.0, -0.01])
    drawn = Known(head=Head.fixed(SE3.from_parts(DRAWN.R, [0.05, 0.0, 0.01])))
    found = calibrate(wrist_looks(rng=rng, T_link_camera=camera), drawn)
    assert found.decision.accepted


@pytest.mark.parametrize(
    ("spoil", "word"),
    [
        (lambda g: {"points_camera": 1e3 * g.points_camera}, "millimetres"),
        (lambda g: {"points_camera": 39.37 * g.points_camera}, "inches"),
        (lambda g: {"points_camera": g.points_camera * [-1, 1, 1]}, "left-handed"),
        (lambda g: {"points_camera": g.points_camera * [1, -1, 1]}, "left-handed"),
        (lambda g: {"points_camera": -g.points_camera}, "z <= 0"),
        (lambda g: {"points_camera": g.points_camera * [1, 1, np.nan]}, "NaN"),
        (lambda g: {"points_base": 1e3 * g.points_base}, "millimetres"),
    ],
)
def test_what_can_not_be_is_refused_by_name(rng, spoil, word):
    given = wrist_looks(rng=rng)
    with pytest.raises(InputError, match=word):
        calibrate(replace(given, **spoil(given)), KNOWN)


def test_looks_of_a_link_need_its_attitude(rng):
    with pytest.raises(ConfigError, match="attitude of base in 'tool0'"):
        replace(wrist_looks(rng=rng), R_base_wrist=None)


def test_the_pose_as_drawn_is_needed(rng):
    with pytest.raises(InputError, match="as it is drawn"):
        calibrate(wrist_looks(rng=rng))


def test_a_copied_look_is_refused(rng):
    with pytest.raises(InputError, match="1 that repeat another number for number"):
        wrist_looks(rng=rng).selected([0, 1, 2, 3, 4, 0])


def test_a_model_with_the_inverse_pose_is_told(rng):
    inverse = Known(head=Head.fixed(DRAWN.inverse()))
    with pytest.raises(InputError, match="the inverse of what the looks give"):
        calibrate(wrist_looks(rng=rng), inverse)


def test_three_looks_tell_no_camera_but_whether_it_is_as_before(rng):
    few = wrist_looks(3, rng=rng)
    with pytest.raises(InputError, match="at least 4 that agree"):
        calibrate(few, KNOWN)
    before = calibrate(wrist_looks(rng=rng), KNOWN)
    again = calibrate(few, before.known)
    assert again.model == "as before"
    assert again.decision.accepted
    assert again.error.rms <= before.error.rms


def test_noise_is_no_drift_and_a_knock_is():
    quiet, looks_to_alarm = 0, []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        said = PLACE + np.array([0.01, 0.01, -0.01])
        found = calibrate(wrist_looks(rng=rng, said=said), KNOWN)
        for camera in (CAMERA, CAMERA @ SE3.exp([0.02, 0.0, 0.0, 0.0, 0.02, 0.0])):
            later = wrist_looks(10, rng=rng, said=said, T_link_camera=camera)
            monitor, reports = DriftMonitor(calibration=found), []
            for i in range(len(later)):
                monitor, report = monitor.seen(later.selected([i]))
                reports.append(report.status)
            alarms = [i for i, s in enumerate(reports) if s is DriftStatus.ALARM]
            if camera is CAMERA:
                quiet += not alarms
            else:
                looks_to_alarm.append(alarms[0] + 1)
    assert quiet == 3
    assert max(looks_to_alarm) <= 5


def test_looks_of_another_carrier_are_no_drift(rng):
    """They are in the frame of that link: any would alarm, or hide a knock."""
    given = wrist_looks(rng=rng)
    monitor = DriftMonitor(calibration=calibrate(given, KNOWN))
    for link, said in (("tool1", "link 'tool1' carries"), (None, "no arm carries")):
        with pytest.raises(InputError, match=f"{said}, expected link 'tool0'"):
            monitor.seen(replace(given, link=link))


def test_looks_by_a_camera_on_an_arm_are_told_in_a_line(rng):
    assert repr(wrist_looks(rng=rng)) == "<Observations of 12 looks from link tool0>"
