"""Watches a calibration at work, and tells when the camera has moved."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.special import chdtrc

from debrisgrasp._arrays import FloatArray, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import ConfigError, InputError

from .fit import Terms, predicted
from .head import Head
from .observations import Observations

__all__ = ["DriftConfig", "DriftMonitor", "DriftReport", "DriftStatus", "Trend"]

_SURER = 0.01
"""How much rarer than an alarm a look must be by noise to be called a wrong pick."""


class DriftStatus(Enum):
    """What to do after a look."""

    STEADY = "steady"
    WATCH = "watch"
    """More than noise usually does; look again before the next grasp."""
    ALARM = "alarm"
    """The camera, the head or the fiducial has moved; calibrate before grasping."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class DriftConfig:
    """Settings of the monitor."""

    false_alarms: float = 1e-4
    """Share of looks that alarm although nothing moved."""
    warnings: float = 1e-2
    """Share of looks that call for attention although nothing moved."""
    window: int = 5
    """Looks that are tested together; more find smaller drifts, later."""
    memory: int = 50
    """Looks that the trend is drawn through."""
    tolerance: float = 0.008
    """Shift at which grasps begin to miss [m]; the trend says when it is reached."""

    def __post_init__(self) -> None:
        require_range("false_alarms", self.false_alarms, 1e-9, 0.1)
        require_range("warnings", self.warnings, self.false_alarms, 0.5)
        require_range("tolerance", self.tolerance, 1e-4, 0.5)
        if not 1 <= self.window <= self.memory:
            raise ConfigError(
                "window, memory",
                got=(self.window, self.memory),
                expected="1 <= window <= memory",
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Trend:
    """How the shift has grown from look to look."""

    per_look: float
    """Growth along the present direction of the shift [m]."""
    sigma: float
    """Its standard deviation [m]."""
    looks_left: int | None
    """Looks until the tolerance is reached at this pace; None if it is not growing."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DriftReport:
    """What the last look, and those before it, say."""

    status: DriftStatus
    gap: float
    """Distance of the last look from where it should be [m]."""
    shift: FloatArray
    """Mean shift of what the camera sees, over the window, base frame [m], (3,)."""
    shift_sigma: float
    """Standard deviation of a coordinate of it [m]."""
    p_value: float
    """How often noise does as much as the strongest of the tests saw."""
    suspect: str
    """Joint of the head that most likely slipped, and by how much; empty if no single
    cause stands out."""
    trend: Trend | None
    """None before the fifth look."""
    wrong_picks: tuple[str, ...] = ()
    """Earlier looks that this one shows to be wrong picks; they count no more."""

    @property
    def blocks_grasps(self) -> bool:
        """Whether to calibrate before the next grasp."""
        return self.status is DriftStatus.ALARM

    def __str__(self) -> str:
        size = 1e3 * float(np.linalg.norm(self.shift))
        words = f"{self.status.value}: points shifted by {size:.1f} mm"
        words += f" (p = {self.p_value:.1g})"
        return f"{words}; {self.suspect}" if self.suspect else words


class Calibrated(Protocol):
    """What the monitor needs of a calibration, fresh or from a file."""

    @property
    def link(self) -> str | None:
        """Link of the arm that carries the camera; None if none does."""
        ...

    @property
    def head(self) -> Head:
        """What carries the camera."""
        ...

    @property
    def fit_covariance(self) -> FloatArray:
        """Of mount, offsets and shift of the fiducial, shape (9 + k, 9 + k)."""
        ...

    @property
    def fiducial(self) -> FloatArray:
        """Shift of the fiducial in the frame of its link [m], shape (3,)."""
        ...


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DriftMonitor:
    """Looks at the fiducial since the calibration; each new one gives a new monitor."""

    calibration: Calibrated
    config: DriftConfig = DriftConfig()
    looks: tuple[Observations, ...] = ()
    """Single observations, oldest first."""

    def seen(self, look: Observations) -> tuple[DriftMonitor, DriftReport]:
        """Take in the looks of one task cycle, and judge.

        Parameters
        ----------
        look
            One observation or more: where the arm and where the camera has the
            fiducial, or any point of the hand.

        Raises
        ------
        InputError
            If another link, or none, carried the camera when it was calibrated: looks
            are given in the frame of that link.
        """
        link = self.calibration.link
        if look.link != link:
            raise InputError(
                "looks",
                got=f"those of a camera that {_carrier(look.link)} carries",
                expected=f"{_carrier(link)}, as when it was calibrated",
                mend="Watch each camera by its own calibration; Observations(link=...) "
                "says which carries it.",
            )
        looks = self.looks
        wrong: list[str] = []
        for i in range(len(look)):
            looks = (*looks, look.selected([i]))
            for k in range(max(len(looks) - 3, 0), len(looks) - 1):
                if self._is_wrong_pick(looks, k):
                    wrong += looks[k].names
                    looks = looks[:k] + looks[k + 1 :]
                    break
        monitor = replace(self, looks=looks[-self.config.memory :])
        return monitor, replace(monitor.report(), wrong_picks=tuple(wrong))

    def _is_wrong_pick(self, looks: tuple[Observations, ...], k: int) -> bool:
        """Whether look k contradicts what those before and after it agree on.

        Whatever drift the others may share, slips of the head included, they must be
        explained by it and look k must not. The first look has the calibration before
        it.
        """
        around = (*looks[max(k - 2, 0) : k], *looks[k + 1 : k + 3])
        others, everything = (
            _Stack(self.calibration, around),
            _Stack(self.calibration, (*around, looks[k])),
        )
        contradictions = []
        for cause in ("none", "shifts", "slips") if k else ("none",):
            columns = others.columns(cause)
            left = others.remainder(columns)
            freedom = others.gaps.size - columns.shape[1]
            if chdtrc(freedom, left) < self.config.warnings:
                continue
            added = everything.remainder(everything.columns(cause)) - left
            contradictions.append(added)
        least = min(contradictions, default=0.0)
        return bool(chdtrc(3, max(least, 0.0)) < _SURER * self.config.false_alarms)

    def report(self) -> DriftReport:
        """Judge the looks so far.

        Three tests share the false alarms: the last look alone; a common shift of the
        last few; a slip of the head's joints common to the last few. All count the
        noise of the looks and the uncertainty of the calibration itself.

        Raises
        ------
        ConfigError
            If nothing was seen yet.
        """
        if not self.looks:
            raise ConfigError(
                "looks", got="none", expected="at least one", mend="Call seen() first."
            )
        config = self.config
        last = _Stack(self.calibration, self.looks[-1:])
        recent = _Stack(self.calibration, self.looks[-config.window :])
        tests = [last.test(last.shifts)]
        if len(self.looks) > 1:
            tests.append(recent.test(recent.shifts))
        k = self.calibration.head.n_joints
        if k and len(self.looks) > 1:
            tests.append(recent.test(recent.slips))
        p_value = min(1.0, len(tests) * min(tests))
        status = DriftStatus.STEADY
        if p_value < config.false_alarms:
            status = DriftStatus.ALARM
        elif p_value < config.warnings:
            status = DriftStatus.WATCH
        shift, covariance = recent.solved(recent.shifts)
        is_calm = status is DriftStatus.STEADY
        return DriftReport(
            status=status,
            gap=float(np.linalg.norm(last.gaps)),
            shift=shift,
            shift_sigma=float(np.sqrt(np.trace(covariance) / 3.0)),
            p_value=p_value,
            suspect="" if is_calm else self._suspect(),
            trend=self._trend(shift),
        )

    def _suspect(self) -> str:
        """Name the cause that the newest looks, two or more, agree on."""
        for n in range(min(self.config.window, len(self.looks)), 1, -1):
            recent = _Stack(self.calibration, self.looks[-n:])
            words, p_value = self._cause(recent)
            if p_value >= self.config.false_alarms:
                return words
        return ""

    def _cause(self, recent: _Stack) -> tuple[str, float]:
        """Name the cause that explains most, and how often noise leaves as much."""
        causes = {"the mount of the camera, or the fiducial, moved": recent.shifts}
        for j, joint in enumerate(self.calibration.head.joint_names):
            causes[joint] = recent.slips[:, j : j + 1]
        # Each unknown of a cause is paid for, as in the information criterion.
        costs = {
            name: recent.remainder(columns) + 2.0 * columns.shape[1]
            for name, columns in causes.items()
        }
        best = min(costs, key=lambda name: costs[name])
        runner_up = (
            min(v for name, v in costs.items() if name != best)
            if (len(costs) > 1)
            else np.inf
        )
        freedom = recent.gaps.size - causes[best].shape[1]
        p_value = float(chdtrc(freedom, max(recent.remainder(causes[best]), 0.0)))
        if runner_up - costs[best] < 2.0:
            return "", p_value
        if best not in self.calibration.head.joint_names:
            return best, p_value
        slip, variance = recent.solved(causes[best])
        sigma = float(np.sqrt(variance[0, 0]))
        return (
            f"{best} slipped by {np.rad2deg(slip[0]):.2f} deg "
            f"(+-{np.rad2deg(sigma):.2f})"
        ), p_value

    def _trend(self, shift: FloatArray) -> Trend | None:
        n = len(self.looks)
        if n < 5:
            return None
        stack = _Stack(self.calibration, self.looks)
        towards = shift / max(float(np.linalg.norm(shift)), 1e-12)
        along = stack.shifted @ towards
        age = np.arange(n) - 0.5 * (n - 1)
        slope = float(age @ along / (age @ age))
        noise = float(np.sqrt(np.mean(stack.variances)))
        sigma = noise / float(np.sqrt(age @ age))
        left = None
        if slope > 3.0 * sigma:
            now = float(np.mean(along)) + slope * age[-1]
            left = max(0, int(np.ceil((self.config.tolerance - now) / slope)))
        return Trend(per_look=slope, sigma=sigma, looks_left=left)


def _carrier(link: str | None) -> str:
    return "no arm" if link is None else f"link {link!r}"


class _Stack:
    """Looks written below one another, with the covariance of their gaps."""

    def __init__(
        self, calibration: Calibrated, looks: tuple[Observations, ...]
    ) -> None:
        k = calibration.head.n_joints
        terms = Terms(n_offsets=k, has_fiducial=True)
        rows, jacobians, noise, turned = [], [], [], []
        for look in looks:
            seen, jacobian = predicted(
                look, calibration.head, calibration.fiducial, terms
            )
            rows.append((look.points_camera - seen)[0])
            jacobians.append(jacobian[0])
            noise.append(look.total_sigmas[0] ** 2)
            turned.append(calibration.head.T_base_camera(look.readings).R[0])
        self.gaps: FloatArray = np.concatenate(rows)
        self.variances: FloatArray = np.array(noise)
        R_base_camera = np.array(turned)
        self.shifted: FloatArray = (R_base_camera @ np.array(rows)[..., None])[..., 0]
        """Gaps in base axes [m], shape (m, 3)."""
        stacked = np.concatenate(jacobians)
        known = calibration.fit_covariance
        self._terms = np.concatenate(noise), stacked, known
        self.shifts: FloatArray = np.concatenate(np.swapaxes(R_base_camera, -1, -2))
        """How a common shift in base moves the gaps, shape (3 m, 3)."""
        self.slips: FloatArray = stacked[:, 6 : 6 + k]
        """How slipped joints of the head move them, shape (3 m, k)."""

    @cached_property
    def _whiten(self) -> FloatArray:
        noise, stacked, known = self._terms
        covariance = np.diag(noise) + stacked @ known @ stacked.T
        return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))

    def columns(self, cause: str) -> FloatArray:
        """Return the columns of one cause, "none", "shifts" or "slips", (3 m, c)."""
        if cause == "none":
            return np.zeros((self.gaps.size, 0))
        return self.shifts if cause == "shifts" else self.slips

    def solved(self, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Weighted least squares of the gaps on columns, and its covariance."""
        A, y = self._whiten @ columns, self._whiten @ self.gaps
        covariance = np.asarray(np.linalg.pinv(A.T @ A), dtype=np.float64)
        return covariance @ A.T @ y, covariance

    def remainder(self, columns: FloatArray) -> float:
        """Squared gaps, in units of their variance, that the columns don't explain."""
        A, y = self._whiten @ columns, self._whiten @ self.gaps
        if not columns.shape[1]:
            return float(y @ y)
        return float(y @ y - y @ A @ np.linalg.pinv(A.T @ A) @ A.T @ y)

    def test(self, columns: FloatArray) -> float:
        """How often noise alone is explained by the columns as well as the gaps are."""
        y = self._whiten @ self.gaps
        return float(
            chdtrc(columns.shape[1], max(y @ y - self.remainder(columns), 0.0))
        )
