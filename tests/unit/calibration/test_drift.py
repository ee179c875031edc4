"""The monitor alarms when something moved, keeps still otherwise, and names causes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.calibration import (
    Calibration,
    DriftConfig,
    DriftMonitor,
    DriftReport,
    DriftStatus,
    Head,
    Known,
    calibrate,
)
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3

from .looks import PLACES, head, head_looks

NOISE = 0.0025
REST = np.array([0.0, 0.75])


@pytest.fixture
def calibrated(rng) -> Calibration:
    return calibrate(
        head_looks(head(), PLACES, REST, noise=NOISE, rng=rng), Known(head=head())
    )


def watched(
    calibration: Calibration, heads: list[Head], rng: np.random.Generator
) -> list[DriftReport]:
    """Look once with each head, at random places."""
    monitor, reports = DriftMonitor(calibration=calibration), []
    for carrier in heads:
        place = PLACES[rng.integers(len(PLACES))][None]
        look = head_looks(carrier, place, REST, noise=NOISE, rng=rng)
        monitor, report = monitor.seen(look)
        reports.append(report)
    return reports


def shifted(x: float) -> Head:
    carrier = head()
    moved = SE3.from_parts(p=[0.0, x, 0.0]) @ carrier.T_base_camera_at_zero
    return carrier.mounted(moved)


def test_nothing_moved_nothing_said(calibrated, rng):
    reports = watched(calibrated, [head()] * 30, rng)
    assert not any(r.blocks_grasps for r in reports)
    assert np.mean([r.status is DriftStatus.STEADY for r in reports]) > 0.85


def test_a_large_shift_alarms_at_once(calibrated, rng):
    (report,) = watched(calibrated, [shifted(0.03)], rng)
    assert report.status is DriftStatus.ALARM
    assert "alarm" in str(report)


def test_a_small_shift_alarms_within_five_looks_and_is_measured(calibrated, rng):
    reports = watched(calibrated, [shifted(0.012)] * 5, rng)
    assert reports[-1].blocks_grasps
    assert np.linalg.norm(reports[-1].shift) == pytest.approx(0.012, abs=0.005)
    assert 0.0 < reports[-1].shift_sigma < 0.003


@pytest.mark.parametrize(("joint", "slip"), [("pan", [2.0, 0.0]), ("tilt", [0.0, 1.5])])
def test_the_joint_that_slipped_is_named(calibrated, rng, joint, slip):
    reports = watched(calibrated, [head().slipped(np.deg2rad(slip))] * 5, rng)
    assert reports[-1].blocks_grasps
    assert reports[-1].suspect.startswith(f"{joint} slipped by")
    measured = float(reports[-1].suspect.split()[3])
    assert measured == pytest.approx(max(slip), abs=0.5)


def test_growth_is_foretold(calibrated, rng):
    reports = watched(calibrated, [shifted(0.001 * i) for i in range(20)], rng)
    trend = reports[-1].trend
    assert trend is not None
    assert trend.per_look == pytest.approx(0.001, abs=4 * trend.sigma)
    assert trend.looks_left is not None
    assert watched(calibrated, [head()] * 3, rng)[-1].trend is None


def test_an_alarm_passes_once_the_camera_is_back(calibrated, rng):
    reports = watched(calibrated, [shifted(0.03)] * 3 + [head()] * 12, rng)
    assert reports[2].blocks_grasps
    assert not reports[-1].blocks_grasps


@pytest.mark.parametrize("k", [0, 1, 4])
def test_a_wrong_pick_is_named_and_forgotten(calibrated, rng, k):
    monitor, reports = DriftMonitor(calibration=calibrated), []
    for i in range(8):
        place = PLACES[rng.integers(len(PLACES))][None]
        look = head_looks(head(), place, REST, noise=NOISE, rng=rng)
        seen = look.points_camera + (0.05 if i == k else 0.0)
        look = replace(look, points_camera=seen, names=(f"look_{i}",))
        monitor, report = monitor.seen(look)
        reports.append(report)
    assert [r.blocks_grasps for r in reports] == [i == k for i in range(8)]
    assert not any("slipped" in r.suspect for r in reports)
    assert [name for r in reports for name in r.wrong_picks] == [f"look_{k}"]
    assert len(monitor.looks) == 7
    trend = reports[-1].trend
    assert trend is not None
    assert trend.looks_left is None


def test_a_drift_is_no_wrong_pick(calibrated, rng):
    for slip in ([2.0, 0.0], [0.0, 1.5]):
        slipped = head().slipped(np.deg2rad(slip))
        reports = watched(calibrated, [head()] * 4 + [slipped] * 6, rng)
        assert not any(r.wrong_picks for r in reports)
        assert all(r.blocks_grasps for r in reports[4:])
        assert reports[4].suspect == ""  # one look alone names no cause
        assert "slipped by" in reports[-1].suspect


def test_a_monitor_is_not_changed_by_a_look(calibrated):
    monitor = DriftMonitor(calibration=calibrated)
    monitor.seen(head_looks(head(), PLACES[:2], REST))
    assert monitor.looks == ()
    with pytest.raises(ConfigError, match="looks"):
        monitor.report()


def test_settings_out_of_range_are_refused():
    with pytest.raises(ConfigError):
        DriftConfig(window=60)
    with pytest.raises(ConfigError):
        DriftConfig(false_alarms=0.0)
