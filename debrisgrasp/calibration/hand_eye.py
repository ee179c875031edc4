"""Where the camera is, how well that is known, and whether it is good enough."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc

from debrisgrasp._arrays import BoolArray, FloatArray, finite
from debrisgrasp._checked import checked
from debrisgrasp._words import counted
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3

from .camera import CalibratedCamera, Known
from .decision import CalibrationConfig, Decision, Evidence, decide
from .fit import Fit, Prior, Terms, fit_terms
from .head import Head
from .observations import Observations, require_in_base
from .outliers import residuals_of, settled
from .plausibility import Pairs, agreeing, require_right_way_round
from .rigid import fit_rigid
from .standing import least_turn, start_standing
from .uncertainty import WorkspaceError, camera_covariance, lever_arm

__all__ = ["Attempt", "Calibration", "calibrate"]


_FEWEST = 3
"""Points without which no rotation is determined."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Attempt:
    """One model that was tried, smallest first."""

    model: str
    n_used: int
    chi_square: float
    degrees_of_freedom: int
    p_value: float
    """How often noise alone leaves residuals as large as these."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Calibration(CalibratedCamera):
    """A fitted `CalibratedCamera` with all that speaks for and against it."""

    model: str
    """Name of the model that was kept."""
    attempts: tuple[Attempt, ...]
    why_model: str
    observations: Observations
    gaps: FloatArray
    """Measured less predicted place of each observation, base frame [m], (n, 3)."""
    held_out: FloatArray
    """Distance of each from what the others predict [m], shape (n,)."""
    is_outlier: BoolArray
    """Which observations were left out, shape (n,)."""
    error: WorkspaceError
    """Predicted error over the workspace."""
    lever: float
    """How well the used places fix a rotation, see `lever_arm` [m]."""
    rmse: float
    """Root mean square residual of the used observations [m]. It tells about the noise
    of the camera, not about the error in the workspace."""
    decision: Decision

    def __repr__(self) -> str:
        used, n = int(np.count_nonzero(~self.is_outlier)), len(self.observations)
        error = f"error {1e3 * self.error.rms:.1f} mm"
        words = f"{self.model} from {used} of {counted(n, 'look')}, {error}"
        return f"<Calibration of {words}, {self.decision}>"

    def T_base_camera_at(self, readings: ArrayLike) -> SE3:
        """Pose of the camera for other readings (..., k) of the head [rad]."""
        require_in_base(self._called, self.link)
        return self.head.T_base_camera(readings)

    def covariance_at(self, readings: ArrayLike) -> FloatArray:
        """Covariance of that pose, for one reading (k,), shape (6, 6)."""
        return camera_covariance(self.head, np.asarray(readings), self.head_covariance)

    @property
    def kept(self) -> Attempt:
        """The attempt that was kept."""
        return next(a for a in self.attempts if a.model == self.model)


@checked
def calibrate(
    observations: Observations,
    known: Known | None = None,
    *,
    reference: ArrayLike | None = None,
    config: CalibrationConfig | None = None,
) -> Calibration:
    """Fit the pose of the camera to a fiducial that the arm moved (section 4.1).

    The paper fits five points and looks at their residual. Here models of growing size
    are tried, wrong picks are found by consensus and dropped, and the result is judged
    by the error it predicts over the workspace.

    Parameters
    ----------
    observations
        Where the arm and where the camera has the fiducial.
    known
        The camera's carrier and, with an earlier calibration, how well its mount is
        known. Without it the camera is taken to stand still, anywhere. Needed if an arm
        carries it: its pose in that link, as drawn.
    reference
        Readings of the head for which the pose is reported [rad], shape (k,); those of
        the last observation by default.
    config
        Limits of acceptance.

    Raises
    ------
    InputError
        If the observations have no honest result: points on a line, swapped frames,
        mixed units, a mirrored axis.
    """
    config = config or CalibrationConfig()
    if len(observations) < _FEWEST:
        raise InputError(
            "observations",
            got=len(observations),
            expected=f"at least {_FEWEST}, better 8",
            mend="Move the arm to more places: `debrisgrasp calibrate choose`.",
        )
    readings = observations.readings
    if known is not None and readings.shape[1] != known.head.n_joints:
        raise InputError(
            "readings of the head",
            got=f"{readings.shape[1]} joints",
            expected=f"{known.head.n_joints} "
            f"({', '.join(known.head.joint_names) or 'none'})",
        )
    if known is None and readings.shape[1]:
        raise InputError(
            "readings of the head",
            got=f"{readings.shape[1]} joints, but no head",
            expected="known=Known(head=...), which says what these joints turn",
        )
    if known is None and observations.link is not None:
        raise InputError(
            "known",
            got=f"none, and a camera that link {observations.link!r} carries",
            expected="Known(head=Head.fixed(T_link_camera)), as it is drawn",
        )
    expected = known or Known(head=Head.fixed(SE3.identity()))
    pairs = _pairs(observations, expected.head)
    if observations.link is None:
        agrees = agreeing(pairs)
        mount = fit_rigid(pairs[0][agrees], pairs[1][agrees])
        start = expected.head.mounted(mount)
    else:
        start, agrees = start_standing(observations, expected.head, pairs, config)
    at = finite(readings[-1] if reference is None else reference, "reference", (None,))
    require_right_way_round(
        start.T_base_camera(at),
        None if known is None else known.head.T_base_camera(at),
        observations.link,
    )
    fit, is_used, model, attempts, why = _smallest_that_fits(
        observations, agrees, start, expected, config
    )
    return _described(
        observations, fit, is_used, model, attempts, why, at, known, config
    )


def _pairs(observations: Observations, head: Head) -> Pairs:
    """Return both places in frames that the mount of the camera joins rigidly."""
    carriers = head.carriers(observations.readings)
    by_arm = carriers.inverse().apply(observations.points_base)
    variances = (observations.total_sigmas**2).mean(axis=1)
    return by_arm, observations.points_camera, variances


def _models(observations: Observations, known: Known) -> Iterator[tuple[str, Terms]]:
    """Models that these observations may support, by growing number of unknowns."""
    k = observations.readings.shape[1]
    # Where it stands on the ground is never known as well as on a link of a robot.
    stands = observations.link is not None
    if known.mount_covariance is not None:
        yield "as before", Terms(keeps_mount=True, has_fiducial=stands)
        if k:
            yield "slipped head", Terms(keeps_mount=True, n_offsets=k)
    if not stands:
        yield "mount", Terms()
    turns = np.ptp(observations.readings, axis=0).max(initial=0.0)
    # Without turns of the head its offsets can't be told from the mount.
    if k and turns > 0.02:
        yield "mount, head", Terms(n_offsets=k)
    if observations.R_base_wrist is not None:
        yield "mount, fiducial", Terms(has_fiducial=True)


def _smallest_that_fits(
    observations: Observations,
    agrees: BoolArray,
    start: Head,
    known: Known,
    config: CalibrationConfig,
) -> tuple[Fit, BoolArray, str, tuple[Attempt, ...], str]:
    """Try models until one explains all looks; say why the one kept was kept."""
    prior = Prior(
        head=known.head,
        mount_covariance=known.mount_covariance,
        offset_sigma=config.offset_sigma,
        fiducial_sigma=config.fiducial_sigma,
    )
    n = len(observations)
    tried: list[tuple[Fit, BoolArray, Attempt]] = []
    for model, terms in _models(observations, known):
        if 3 * n < terms.n_free + 3:
            continue
        begin = known.head if terms.keeps_mount else start

        def fit_to(
            some: Observations, begin: Head = begin, terms: Terms = terms
        ) -> Fit:
            return fit_terms(some, begin, terms, prior)

        fit, is_used = settled(observations, agrees, fit_to, config.significance)
        # As many unknowns as coordinates left fit anything: no evidence.
        if fit.degrees_of_freedom < 1:
            continue
        p_value = float(chdtrc(fit.degrees_of_freedom, fit.chi_square))
        attempt = Attempt(
            model=model,
            n_used=int(is_used.sum()),
            chi_square=fit.chi_square,
            degrees_of_freedom=fit.degrees_of_freedom,
            p_value=p_value,
        )
        tried.append((fit, is_used, attempt))
        if p_value >= config.significance and attempt.n_used == n:
            break

    if not tried:
        raise InputError(
            "observations",
            got=f"{n}, of which {int(agrees.sum())} agree on a pose of the camera",
            expected="at least 4 that agree, better 8",
            mend="Add looks, and see that each names the joints it was made with.",
        )

    def nearness(candidate: tuple[Fit, BoolArray, Attempt]) -> tuple[bool, int, float]:
        attempt = candidate[2]
        is_noise = attempt.p_value >= config.significance
        left = attempt.chi_square / attempt.degrees_of_freedom
        return is_noise, attempt.n_used, 0.0 if is_noise else -left

    # To a model that lacks a misplaced fiducial it looks like a few wrong picks, so one
    # that uses more looks is preferred to a smaller one; of equals the first is kept.
    fit, is_used, attempt = max(tried, key=nearness)
    attempts = tuple(t[2] for t in tried)
    if attempt.p_value < config.significance or n - attempt.n_used > config.spared(n):
        why = (
            f"no model explains all but {config.spared(n)} of {n} observations; "
            f"{attempt.model!r} comes nearest with {attempt.n_used}"
        )
    else:
        why = _why(attempt, attempts[: attempts.index(attempt)])
    return fit, is_used, attempt.model, attempts, why


def _why(kept: Attempt, smaller: Sequence[Attempt]) -> str:
    words = (
        f"{kept.model!r} leaves no more than noise in {kept.n_used} looks (chi-square "
        f"{kept.chi_square:.1f} with {kept.degrees_of_freedom} degrees of freedom, "
        f"p = {kept.p_value:.2g})"
    )
    if smaller:
        failed = ", ".join(
            f"{a.model!r} (p = {a.p_value:.1g}, {a.n_used} used)" for a in smaller
        )
        return f"{words}; smaller models do not: {failed}"
    return f"{words}, and is the smallest model"


def _described(
    observations: Observations,
    fit: Fit,
    is_used: BoolArray,
    model: str,
    attempts: tuple[Attempt, ...],
    why: str,
    at: FloatArray,
    known: Known | None,
    config: CalibrationConfig,
) -> Calibration:
    residuals = residuals_of(fit, observations, is_used)
    T_base_camera = fit.head.T_base_camera(at)
    fit_covariance = np.zeros((9 + fit.head.n_joints,) * 2)
    fitted = np.arange(6 + fit.terms.n_offsets)
    if fit.terms.has_fiducial:
        fitted = np.append(fitted, np.arange(-3, 0))
    fit_covariance[np.ix_(fitted, fitted)] = fit.covariance
    head_covariance = fit_covariance[:-3, :-3]
    covariance = camera_covariance(fit.head, at, head_covariance)
    link = observations.link
    used = observations.selected(is_used)
    places = _pairs(used, fit.head)[0] if link is None else used.points_camera
    error = WorkspaceError.of(
        covariance if link is None else head_covariance, config.workspace_of(link)
    )
    lever = lever_arm(places)
    gaps = fit.head.T_base_camera(observations.readings).rotate(residuals.gaps)
    attempt = next(a for a in attempts if a.model == model)
    rmse = float(np.sqrt((gaps[is_used] ** 2).sum(axis=1).mean()))
    evidence = Evidence(
        names=observations.names,
        is_used=is_used,
        places=observations.points_base if link is None else observations.points_camera,
        link=link,
        turn=least_turn(used),
        has_prior=fit.terms.keeps_mount,
        fiducial=fit.fiducial if fit.terms.has_fiducial else None,
        p_value=attempt.p_value,
        noise_ratio=float(np.sqrt(fit.chi_square / fit.degrees_of_freedom)),
        error=error,
        lever=lever,
        rmse=rmse,
        T_base_camera=T_base_camera,
        nominal=None if known is None else known.head.T_base_camera(at),
    )
    return Calibration(
        T_link_camera=T_base_camera,
        link=observations.link,
        covariance=covariance,
        head=fit.head,
        reference=at,
        fit_covariance=fit_covariance,
        fiducial=fit.fiducial,
        model=model,
        attempts=attempts,
        why_model=why,
        observations=observations,
        gaps=gaps,
        held_out=residuals.held_out,
        is_outlier=~is_used,
        error=error,
        lever=lever,
        rmse=rmse,
        decision=decide(evidence, config),
    )
