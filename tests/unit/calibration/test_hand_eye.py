"""The fit finds the camera, the right model, wrong picks, and says how sure it is."""

from __future__ import annotations

import re

import numpy as np
import pytest

from debrisgrasp.calibration import (
    Head,
    Known,
    Observations,
    WorkspaceError,
    calibrate,
    predicted_error,
)
from debrisgrasp.calibration.rigid import consensus, fit_rigid, triples
from debrisgrasp.calibration.uncertainty import grid, lever_arm
from debrisgrasp.errors import ShapeError
from debrisgrasp.geometry import SE3, sampling, so3

from .looks import CAMERA, PLACES, REST, head, head_looks, looks


def test_finds_the_camera_exactly_without_noise():
    found = calibrate(looks())
    assert found.T_base_camera.matrix == pytest.approx(CAMERA.matrix, abs=1e-9)
    assert found.decision.accepted
    assert found.rmse < 1e-9


def test_three_places_fit_but_are_too_few():
    found = calibrate(looks(PLACES[:3]))
    assert found.T_base_camera.matrix == pytest.approx(CAMERA.matrix, abs=1e-9)
    assert not found.decision.accepted
    assert "3 different places agree, 5 are needed" in str(found.decision)


def test_looks_from_one_place_count_once():
    near = PLACES[0] + 0.005 * np.eye(3)
    found = calibrate(looks(np.concatenate([near, PLACES[1:4]])))
    assert "4 different places agree" in str(found.decision)


def test_a_wrong_pick_is_named_and_does_no_harm(rng):
    given = looks(noise=0.0025, rng=rng, names=tuple("abcdefgh"))
    picks = given.points_camera.copy()
    picks[4] += (0.03, -0.02, 0.035)
    wrong = Observations(given.points_base, picks, names=given.names)
    found, clean = calibrate(wrong), calibrate(given.selected(np.arange(8) != 4))
    assert np.flatnonzero(found.is_outlier).tolist() == [4]
    assert found.decision.accepted
    assert any("wrong pick: e" in note for note in found.decision.notes)
    assert found.T_base_camera.matrix == pytest.approx(
        clean.T_base_camera.matrix, abs=1e-9
    )


def test_many_wrong_picks_are_refused(rng):
    given = looks(noise=0.0025, rng=rng)
    picks = given.points_camera.copy()
    picks[:3] += rng.normal(0.0, 0.05, (3, 3))
    found = calibrate(Observations(given.points_base, picks))
    assert not found.decision.accepted
    assert any("don't agree" in f.problem for f in found.decision.findings)


def test_held_out_error_is_that_of_a_fit_without_the_observation(rng):
    given = looks(noise=0.003, rng=rng)
    found = calibrate(given)
    assert not found.is_outlier.any()
    for i in range(len(given)):
        others = np.arange(len(given)) != i
        without = fit_rigid(given.points_base[others], given.points_camera[others])
        gap = without.apply(given.points_camera[i]) - given.points_base[i]
        # To first order in the noise.
        assert found.held_out[i] == pytest.approx(np.linalg.norm(gap), rel=0.03)


def test_covariance_is_the_spread_of_repeated_calibrations(rng):
    sigma = 0.003
    twists = [
        (
            CAMERA
            @ calibrate(
                looks(noise=sigma, rng=rng, sigmas=sigma, kinematic_sigma=1e-9)
            ).T_base_camera.inverse()
        ).log()
        for _ in range(250)
    ]
    predicted = calibrate(looks(sigmas=sigma, kinematic_sigma=1e-9)).covariance
    measured = np.cov(np.array(twists).T)
    ratio = np.linalg.solve(predicted, measured)
    assert np.trace(ratio) / 6.0 == pytest.approx(1.0, abs=0.12)


def test_predicted_error_equals_its_definition(rng):
    root = rng.normal(size=(6, 6))
    covariance, points = root @ root.T, rng.normal(size=(5, 3))
    for point, error in zip(points, predicted_error(covariance, points), strict=True):
        J = np.concatenate([np.eye(3), -so3.hat(point)], axis=1)
        assert error == pytest.approx(np.sqrt(np.trace(J @ covariance @ J.T)))
    summary = WorkspaceError.of(covariance)
    at_grid = predicted_error(covariance, grid(summary.bounds))
    assert summary.rms == pytest.approx(np.sqrt(np.mean(at_grid**2)))
    assert summary.worst == pytest.approx(at_grid.max())


def test_less_certain_coordinates_count_less(rng):
    given = looks()
    seen = given.points_camera + [0.0, 0.0, 1.0] * rng.normal(0, 0.02, (8, 1))
    equal = calibrate(Observations(PLACES, seen, 0.02))
    knowing = calibrate(Observations(PLACES, seen, np.tile([1e-4, 1e-4, 0.02], (8, 1))))
    gap = np.linalg.norm(equal.T_base_camera.p - CAMERA.p)
    assert np.linalg.norm(knowing.T_base_camera.p - CAMERA.p) < 0.3 * gap


@pytest.mark.parametrize("n", [3, 6, 14, 40])
def test_triples_are_distinct_sets(n):
    found = triples(n)
    assert len({frozenset(t) for t in found.tolist()}) == len(found)
    assert found.max() < n
    assert all(len(set(t)) == 3 for t in found.tolist())


def test_consensus_outvotes_nearly_half(rng):
    seen = CAMERA.inverse().apply(np.concatenate([PLACES, PLACES + 0.05]))
    wrong = rng.permutation(16)[:7]
    seen[wrong] += rng.normal(0.0, 0.1, (7, 3))
    places = np.concatenate([PLACES, PLACES + 0.05])
    agrees, _ = consensus(places, seen, np.full(16, 0.0027**2))
    assert set(np.flatnonzero(~agrees)) == set(wrong)


def test_lever_arm_of_a_ring_is_its_spread_about_the_worst_axis():
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    assert lever_arm(ring) == pytest.approx(np.sqrt(0.5))
    assert lever_arm(ring * [1, 0, 0]) == pytest.approx(0.0, abs=1e-7)


class TestHead:
    def test_pose_is_that_of_the_joints_turned_one_after_the_other(self):
        carrier = head()
        pan, tilt = 0.3, -0.2
        turned = (
            _about(carrier.points[0], pan * carrier.axes[0])
            @ _about(carrier.points[1], tilt * carrier.axes[1])
            @ carrier.T_base_camera_at_zero
        )
        found = carrier.T_base_camera([pan, tilt])
        assert found.matrix == pytest.approx(turned.matrix)

    def test_screws_are_the_derivative_of_the_pose(self):
        carrier, q, h = head(), np.array([0.3, -0.2]), 1e-6
        for j in range(2):
            step = h * np.eye(2)[j]
            change = (
                carrier.T_base_camera(q + step)
                @ carrier.T_base_camera(q - step).inverse()
            ).log() / (2 * h)
            assert carrier.screws(q)[j] == pytest.approx(change, abs=1e-8)

    def test_offsets_add_to_the_readings(self):
        slipped = head().slipped([0.1, 0.2])
        assert slipped.T_base_camera([0.0, 0.3]).matrix == pytest.approx(
            head().T_base_camera([0.1, 0.5]).matrix
        )

    def test_readings_of_another_head_are_refused(self):
        with pytest.raises(ShapeError, match="pan, tilt"):
            head().T_base_camera([0.1])

    def test_mount_is_found_from_looks_with_a_moving_head(self, rng):
        true = head().mounted(
            head().T_base_camera_at_zero @ SE3.exp([0.02, 0, 0.01, 0.02, 0.01, -0.03])
        )
        readings = REST + rng.uniform(-0.2, 0.2, (8, 2))
        found = calibrate(head_looks(true, PLACES, readings), Known(head=head()))
        assert found.model == "mount"
        assert found.T_base_camera_at([0.1, 0.5]).matrix == pytest.approx(
            true.T_base_camera([0.1, 0.5]).matrix, abs=1e-9
        )

    def test_covariance_elsewhere_follows_the_camera(self):
        found = calibrate(head_looks(head(), PLACES, REST), Known(head=head()))
        q = np.array([0.2, 0.6])
        moved = found.head.T_base_camera(q) @ found.T_base_camera.inverse()
        expected = moved.adjoint() @ found.covariance @ moved.adjoint().T
        assert found.covariance_at(q) == pytest.approx(expected, rel=1e-9)
        assert found.covariance_at(REST) == pytest.approx(found.covariance)


class TestWrist:
    """The camera rides on the wrist, which stands in for the base."""

    BEHIND = SE3.from_parts(p=[0.05, 0.01, -0.03])
    IN_WRIST = PLACES * [0.5, 0.5, 1.0] - [0.5, 0.0, -0.2]

    def test_a_camera_behind_the_flange_is_not_below_ground(self):
        nominal = SE3.from_parts(p=[0.06, 0.0, -0.02])
        found = calibrate(
            looks(self.IN_WRIST, T_base_camera=self.BEHIND),
            Known(head=Head.fixed(nominal)),
        )
        assert "ground" not in str(found.decision)
        assert found.T_base_camera.matrix == pytest.approx(self.BEHIND.matrix)

    def test_a_camera_below_a_nominal_one_above_ground_is_refused(self):
        nominal = SE3.from_parts(p=[0.06, 0.0, 0.02])
        found = calibrate(
            looks(self.IN_WRIST, T_base_camera=self.BEHIND),
            Known(head=Head.fixed(nominal)),
        )
        assert "0.03 m below the ground" in str(found.decision)


class TestModels:
    def test_a_slipped_head_is_told_from_a_moved_mount(self, rng):
        noise = 0.002
        before = calibrate(
            head_looks(head(), PLACES, REST, noise=noise, rng=rng), Known(head=head())
        )
        slipped = head().slipped(np.deg2rad([1.5, -1.0]))
        found = calibrate(
            head_looks(slipped, PLACES[:3], REST, noise=noise, rng=rng), before.known
        )
        assert found.model == "slipped head"
        assert "smaller models do not" in found.why_model
        assert found.decision.accepted
        slip = np.asarray(found.head.offsets)
        assert np.rad2deg(slip) == pytest.approx([1.5, -1.0], abs=0.4)

    def test_an_unchanged_camera_keeps_its_calibration_and_gains(self, rng):
        first = calibrate(looks(noise=0.002, rng=rng))
        again = calibrate(looks(noise=0.002, rng=rng), first.known)
        assert again.model == "as before"
        assert again.error.rms < first.error.rms

    def test_a_moved_mount_needs_the_full_model(self, rng):
        first = calibrate(looks(noise=0.002, rng=rng))
        moved = CAMERA @ SE3.exp([0.02, 0, 0, 0, 0.03, 0])
        found = calibrate(looks(T_base_camera=moved, noise=0.002, rng=rng), first.known)
        assert found.model == "mount"

    def test_a_fiducial_that_sits_elsewhere_is_found(self, rng):
        places = np.concatenate([PLACES, PLACES * [1, -0.9, 1]])
        R = sampling.random_rotations(16, rng=rng)
        offset = np.array([0.012, -0.02, 0.008])
        seen = CAMERA.inverse().apply(places + R @ offset)
        found = calibrate(
            Observations(
                places,
                seen + rng.normal(0, 0.001, seen.shape),
                0.001,
                R_base_wrist=R,
            )
        )
        assert found.model == "mount, fiducial"
        assert found.fiducial == pytest.approx(offset, abs=0.002)

    @pytest.mark.parametrize(("times", "is_doubted"), [(1.0, False), (2.0, True)])
    def test_how_far_a_fiducial_sits_from_the_model_is_said(
        self, rng, times, is_doubted
    ):
        places = np.concatenate([PLACES, PLACES * [1, -0.9, 1]])
        R = sampling.random_rotations(16, rng=rng)
        offset = times * np.array([0.012, -0.02, 0.008])
        seen = CAMERA.inverse().apply(places + R @ offset)
        found = calibrate(Observations(places, seen, 0.0005, R_base_wrist=R))
        (said,) = [note for note in found.decision.notes if "fiducial" in note]
        assert f"{1e3 * np.linalg.norm(offset):.0f} mm from where" in said
        assert ("is it on the link" in said) is is_doubted

    def test_a_misplaced_fiducial_is_not_taken_for_wrong_picks(self, rng):
        places = np.concatenate([PLACES, PLACES[:4] * [1, -0.9, 1]])
        R = so3.exp(rng.normal(0.0, 0.7, places.shape))
        for offset in rng.normal(0.0, 0.007, (40, 3)):
            seen = CAMERA.inverse().apply(places + R @ offset)
            seen = seen + rng.normal(0.0, 0.0025, seen.shape)
            found = calibrate(Observations(places, seen, R_base_wrist=R))
            assert not found.is_outlier.any()

    def test_a_larger_model_does_not_take_in_a_wrong_pick(self, rng):
        R = sampling.random_rotations(8, rng=rng)
        given = looks(noise=0.0025, rng=rng, R_base_wrist=R)
        picks = given.points_camera.copy()
        picks[4] += (0.03, -0.02, 0.035)
        wrong = Observations(given.points_base, picks, R_base_wrist=R)
        found = calibrate(wrong)
        assert [a.model for a in found.attempts] == ["mount", "mount, fiducial"]
        assert (found.model, found.kept.n_used) == ("mount", 7)
        assert "is the smallest model" in found.why_model

    def test_the_smallest_model_is_kept_when_it_fits(self, rng):
        R = sampling.random_rotations(8, rng=rng)
        found = calibrate(looks(noise=0.002, rng=rng, R_base_wrist=R))
        assert [a.model for a in found.attempts] == ["mount"]
        assert found.kept.p_value > 1e-3

    def test_noise_beyond_what_is_stated_is_refused(self, rng):
        for sigma in (0.0005, 0.0015):
            found = calibrate(looks(noise=0.005, rng=rng, sigmas=sigma))
            assert not found.decision.accepted

    def test_noise_far_below_what_is_stated_is_noted(self, rng):
        found = calibrate(looks(noise=1e-5, rng=rng))
        assert found.decision.accepted
        assert any("too large" in note for note in found.decision.notes)


def _about(point: np.ndarray, rotvec: np.ndarray) -> SE3:
    R = so3.exp(rotvec)
    return SE3.from_parts(R, point - R @ point)


def test_what_a_calibration_is_made_of_is_told_in_a_line_each(rng):
    given = head_looks(head(), PLACES, REST, noise=0.002, rng=rng)
    found = calibrate(given, Known(head=head()))
    assert repr(given) == "<Observations of 8 looks, head of 2 joints>"
    assert repr(found.head) == "<Head of 2 joints: pan, tilt>"
    assert repr(Head.fixed(CAMERA)) == "<Head of 0 joints>"
    assert repr(Known(head=head())) == f"<Known nominal mount of {head()}>"
    assert repr(found.known) == f"<Known calibrated mount of {head()}>"
    told = r"<Calibration of mount from 8 of 8 looks, error \d\.\d mm, accepted>"
    assert re.fullmatch(told, repr(found))
