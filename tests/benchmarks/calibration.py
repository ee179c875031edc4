"""Calibration: error in the workspace, honesty of the prediction, gate, drift, LED.

``python -m tests.benchmarks.calibration [--json FILE]`` on RoMan with the LED on its
right hand. Monte Carlo: 2.5 mm of noise on each coordinate that the camera measures,
1 mm on each that kinematics gives. The error of one trial is the root mean square
(``err``) over a grid of the workspace, or the mean (``mean_err``). Times are of the
processor, the median over trials. OpenCV's solvers run beside where it is installed
(``cv_``).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from debrisgrasp._calibrating import CalibrationRig, choose_postures
from debrisgrasp.calibration import (
    WORKSPACE,
    Calibration,
    DriftMonitor,
    Head,
    Known,
    MarkerFound,
    Observations,
    calibrate,
    find_marker,
)
from debrisgrasp.calibration.uncertainty import grid
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, sampling
from debrisgrasp.kinematics import RobotModel
from tests.benchmarks.led_views import led_view
from tests.benchmarks.report import arguments, publish

SIGMA, KINEMATIC = 0.0025, 0.001
TRIALS = 1000
GRID = grid(WORKSPACE)
TARGETS = {
    "err_mm_5": "<= 2.6",
    "err95_mm_5": "<= 4.6",
    "err_mm_8": "<= 2.0",
    "err95_mm_8": "<= 3.6",
    "err_mm_8_outlier": "<= 3",
    "predicted_over_true_5": "0.9 to 1.1",
    "predicted_over_true_8": "0.9 to 1.1",
    "gate_pass_chosen_5": ">= 0.99",
    "gate_pass_chosen_8": ">= 0.99",
    "gate_pass_clustered": "0",
    "gate_pass_collinear": "0",
    "drift_20mm_one_look": ">= 0.95",
    "drift_10mm_five_looks": "found",
    "drift_false_alarms_per_look": "1e-4",
    "led_within_0.3px": "1 of 500",
    "led_false_off": "0 of 500",
    "led_false_hidden": "0 of 500",
    "solve_ms": "< 5",
    "choose_8_s": "< 2",
}


class Lab:
    """RoMan with a camera that is not quite where its model says."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        robot = RobotModel.load("roman")
        self.rig = CalibrationRig(robot=robot, fiducial="right_robotiq_led_frame")
        off = SE3.exp(self.rng.normal(0.0, [0.015] * 3 + [0.02] * 3))
        nominal = self.rig.head
        self.head = nominal.mounted(nominal.T_base_camera_at_zero @ off)
        self.reference = self.rig.reference
        _ = self.rig.collision  # cached by a session too

    def places(self, n: int, *, apart: float = 0.1) -> np.ndarray:
        plan = choose_postures(self.rig, n, rng=self.rng, apart=apart)
        return np.array([p.place for p in plan.postures])

    def looks(self, places: np.ndarray, head: Head | None = None) -> Observations:
        """Measure places with noise on both sides."""
        head = head or self.head
        readings = np.tile(self.reference, (len(places), 1))
        seen = head.T_base_camera(readings).inverse().apply(places)
        return Observations(
            places + self.rng.normal(0.0, KINEMATIC, places.shape),
            seen + self.rng.normal(0.0, SIGMA, places.shape),
            SIGMA,
            readings,
        )

    def errors(self, T_base_camera: SE3, head: Head | None = None) -> np.ndarray:
        """Distance of every point of the grid from where it is put."""
        truth = (head or self.head).T_base_camera(self.reference)
        put = T_base_camera.apply(truth.inverse().apply(GRID))
        return np.linalg.norm(put - GRID, axis=1)

    def calibrated(self, places: np.ndarray) -> Calibration:
        return calibrate(self.looks(places), Known(head=self.rig.head))


def chosen_sets(lab: Lab) -> dict[str, float]:
    """Error, prediction and gate for chosen sets of five and eight."""
    figures: dict[str, float] = {}
    for n in (5, 8):
        places = lab.places(n)
        rms, mean, predicted, passed, seconds = [], [], [], [], []
        for _ in range(TRIALS):
            looks = lab.looks(places)
            start = time.process_time()
            result = calibrate(looks, Known(head=lab.rig.head))
            seconds.append(time.process_time() - start)
            error = lab.errors(result.T_base_camera)
            rms.append(float(np.sqrt(np.mean(error**2))))
            mean.append(float(error.mean()))
            predicted.append(result.error.rms)
            passed.append(result.decision.accepted)
        figures |= {
            f"err_mm_{n}": 1e3 * float(np.median(rms)),
            f"err95_mm_{n}": 1e3 * float(np.quantile(rms, 0.95)),
            f"mean_err_mm_{n}": 1e3 * float(np.median(mean)),
            f"mean_err95_mm_{n}": 1e3 * float(np.quantile(mean, 0.95)),
            f"predicted_over_true_{n}": _ratio(predicted, rms),
            f"gate_pass_chosen_{n}": float(np.mean(passed)),
            "solve_ms": 1e3 * float(np.median(seconds)),
        }
    figures["err_mm_8_outlier"], figures["outlier_named"] = _with_outlier(lab, 8)
    return figures


def _ratio(predicted: list[float], true: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(predicted)) / np.mean(np.square(true))))


def _with_outlier(lab: Lab, n: int) -> tuple[float, float]:
    """Error with one pick of n wrong by 5 cm, and how often exactly it is named."""
    places, rms, named = lab.places(n), [], []
    for _ in range(TRIALS):
        looks = lab.looks(places)
        wrong = int(lab.rng.integers(n))
        picks = looks.points_camera.copy()
        way = lab.rng.normal(size=3)
        picks[wrong] += 0.05 * way / np.linalg.norm(way)
        result = calibrate(
            Observations(looks.points_base, picks, SIGMA, looks.head),
            Known(head=lab.rig.head),
        )
        rms.append(float(np.sqrt(np.mean(lab.errors(result.T_base_camera) ** 2))))
        named.append(np.flatnonzero(result.is_outlier).tolist() == [wrong])
    return 1e3 * float(np.median(rms)), float(np.mean(named))


def poor_sets(lab: Lab) -> dict[str, float]:
    """How often the gate lets clustered, collinear and random sets through."""
    pool = lab.places(60, apart=0.03)

    def clustered() -> np.ndarray:
        middle = pool[lab.rng.integers(len(pool))]
        return middle + lab.rng.uniform(-0.05, 0.05, (5, 3))

    def collinear() -> np.ndarray:
        a, b = pool[lab.rng.choice(len(pool), 2, replace=False)]
        along = np.linspace(0.0, 1.0, 6)[:, None]
        return a + along * (b - a) + lab.rng.normal(0.0, 0.01, (6, 3))

    def at_random() -> np.ndarray:
        return pool[lab.rng.choice(len(pool), 5, replace=False)]

    return {
        "gate_pass_clustered": _passed(lab, clustered),
        "gate_pass_collinear": _passed(lab, collinear),
        "gate_pass_random_5": _passed(lab, at_random),
    }


def _passed(lab: Lab, places: Callable[[], np.ndarray]) -> float:
    accepted = 0
    for _ in range(TRIALS // 3):
        try:
            accepted += lab.calibrated(places()).decision.accepted
        except InputError:
            continue  # refused at once
    return accepted / (TRIALS // 3)


def slipped(lab: Lab) -> dict[str, float]:
    """Error after a slip of pan and tilt and three looks, by two models."""
    places = lab.places(8)
    head = lab.head.slipped(np.deg2rad([1.5, -1.0]))
    by_slip, by_mount = [], []
    for _ in range(TRIALS // 5):
        before = lab.calibrated(places)
        looks = lab.looks(places[:3], head)
        for known, errors in (
            (before.known, by_slip),
            (Known(head=lab.rig.head), by_mount),
        ):
            found = calibrate(looks, known, reference=lab.reference)
            error = lab.errors(found.T_base_camera, head)
            errors.append(float(np.sqrt(np.mean(error**2))))
    return {
        "slip_3_looks_err_mm": 1e3 * float(np.median(by_slip)),
        "slip_3_looks_err95_mm": 1e3 * float(np.quantile(by_slip, 0.95)),
        "slip_by_mount_err_mm": 1e3 * float(np.median(by_mount)),
    }


def drift(lab: Lab) -> dict[str, float]:
    """How soon drifts of several sizes alarm, and how often noise does."""
    chosen, pool = lab.places(8), lab.places(60, apart=0.03)

    def alarms(shift: float, n_looks: int, trials: int) -> np.ndarray:
        """Which looks alarm, shape (trials, n_looks)."""
        out = np.zeros((trials, n_looks), dtype=bool)
        for trial in range(trials):
            way = lab.rng.normal(size=3)
            way *= shift / np.linalg.norm(way)
            monitor = DriftMonitor(calibration=lab.calibrated(chosen))
            # The head stands still, so that a shift in base is one of the mount.
            carrier = lab.head.carriers(lab.reference)
            shifted = carrier.inverse() @ SE3.from_parts(p=way) @ carrier
            head = lab.head.mounted(shifted @ lab.head.T_base_camera_at_zero)
            for look in range(n_looks):
                place = pool[lab.rng.integers(len(pool))][None]
                monitor, report = monitor.seen(lab.looks(place, head))
                out[trial, look] = report.blocks_grasps
        return out

    large, small = alarms(0.020, 1, 600), alarms(0.010, 5, 400)
    quiet = alarms(0.0, 10, 500)
    return {
        "drift_20mm_one_look": float(large.mean()),
        "drift_10mm_one_look": float(small[:, 0].mean()),
        "drift_10mm_five_looks": float(small.any(axis=1).mean()),
        "drift_false_alarms_per_look": float(quiet.mean()),
    }


def led(rng: np.random.Generator, n: int = 500) -> dict[str, float]:
    """Finding the LED in random views; with both frames, and by colour alone."""
    figures: dict[str, float] = {}
    for name, has_off in (("led", True), ("led_by_color", False)):
        gaps, depths, seconds, false = [], [], [], {"off": 0, "hidden": 0}
        for _ in range(n):
            view = led_view(rng)
            off = view.off if has_off else None
            start = time.process_time()
            found = find_marker(
                view.on, view.depth, view.intrinsics, view.expected, rgb_off=off
            )
            seconds.append(time.process_time() - start)
            if isinstance(found, MarkerFound):
                gaps.append(float(np.linalg.norm(found.pixel - view.pixel)))
                depths.append(abs(found.point_camera[2] - view.point[2]))
            for key, settings in (
                ("off", {"is_lit": False}),
                ("hidden", {"is_hidden": True}),
            ):
                view = led_view(rng, **settings)
                off = view.off if has_off else None
                found = find_marker(
                    view.on, view.depth, view.intrinsics, view.expected, rgb_off=off
                )
                false[key] += isinstance(found, MarkerFound)
        figures |= {
            f"{name}_found": len(gaps) / n,
            f"{name}_within_0.3px": float(np.sum(np.array(gaps) <= 0.3)) / n,
            f"{name}_px_95": float(np.quantile(gaps, 0.95)),
            f"{name}_depth_mm_95": 1e3 * float(np.quantile(depths, 0.95)),
            f"{name}_false_off": float(false["off"]),
            f"{name}_false_hidden": float(false["hidden"]),
            f"{name}_ms": 1e3 * float(np.median(seconds)),
        }
    return figures


def choosing(lab: Lab) -> dict[str, float]:
    """Time to choose eight postures of the robot."""
    seconds = []
    for seed in range(3):
        start = time.process_time()
        choose_postures(lab.rig, 8, rng=np.random.default_rng(seed))
        seconds.append(time.process_time() - start)
    return {"choose_8_s": float(np.median(seconds))}


def opencv(lab: Lab) -> dict[str, float]:
    """OpenCV on the same noise; nothing if it is not installed.

    Its solvers for eye and hand want the orientation of a board too, which a single LED
    does not have: they are given an exact one, turned by 0.5 degrees of noise. Its
    affine estimator for points fits twelve numbers; its rotation is orthonormalised.
    """
    if find_spec("cv2") is None:
        return {}
    cv: Any = import_module("cv2")
    places = lab.places(8)
    names = ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")
    errors: dict[str, list[float]] = {
        name: [] for name in (*names, "affine", "umeyama")
    }
    own = []
    for _ in range(200):
        looks = lab.looks(places)
        result = calibrate(looks, Known(head=lab.rig.head))
        own.append(float(np.sqrt(np.mean(lab.errors(result.T_base_camera) ** 2))))
        R = sampling.random_rotations(len(places), rng=lab.rng)
        board = SE3.from_parts(R, looks.points_base)
        T_camera_base = lab.head.T_base_camera(lab.reference).inverse()
        noisy = sampling.perturbed(
            T_camera_base @ SE3.from_parts(R, places), 0.0, 0.0087, rng=lab.rng
        )
        seen = SE3.from_parts(noisy.R, looks.points_camera)
        inverse = board.inverse()
        for name in names:
            R_found, p_found = cv.calibrateHandEye(
                list(inverse.R),
                list(inverse.p),
                list(seen.R),
                list(seen.p),
                method=getattr(cv, f"CALIB_HAND_EYE_{name}"),
            )
            if np.isfinite(R_found).all() and np.isfinite(p_found).all():
                found = SE3.from_parts(R_found, p_found.reshape(3))
                errors[name].append(float(np.sqrt(np.mean(lab.errors(found) ** 2))))
        ok, affine, _ = cv.estimateAffine3D(
            looks.points_camera, looks.points_base, ransacThreshold=0.01
        )
        if ok:
            u, _, vt = np.linalg.svd(affine[:, :3])
            found = SE3.from_parts(u @ vt, affine[:, 3])
            errors["affine"].append(float(np.sqrt(np.mean(lab.errors(found) ** 2))))
        # Umeyama's fit has a scale of its own, which a depth camera should not have.
        rigid, scale = cv.estimateAffine3D(
            looks.points_camera, looks.points_base, force_rotation=True
        )
        found = SE3.from_parts(rigid[:, :3] / scale, rigid[:, 3])
        errors["umeyama"].append(float(np.sqrt(np.mean(lab.errors(found) ** 2))))
    figures = {"cv_ours_err_mm": 1e3 * float(np.median(own))}
    for name, values in errors.items():
        figures[f"cv_{name.lower()}_err_mm"] = 1e3 * float(np.median(values))
    return figures


def main() -> None:
    options = arguments(__doc__ or "")
    lab = Lab(7)
    figures = chosen_sets(lab) | poor_sets(lab) | slipped(lab) | drift(lab)
    figures |= choosing(lab) | led(np.random.default_rng(5)) | opencv(lab)
    publish(figures, options.json)
    print("\ntargets:")
    for name, target in TARGETS.items():
        print(f"  {name:30} {target:12} measured {figures[name]:.4g}")


if __name__ == "__main__":
    main()
