"""Least squares over the mount of the camera, slipped joints and the fiducial."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3, so3

from .head import Head
from .observations import Observations

__all__ = ["Fit", "Prior", "Terms", "fit_terms"]

_MOST_STEPS = 30
_SMALL_STEP = 1e-11
"""Largest entry of a step [m, rad] at which the fit has settled."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Prior:
    """What is known before the first observation."""

    head: Head
    """Head and mount as an earlier calibration or the robot's model has them."""
    mount_covariance: FloatArray | None = None
    """Of the twist of the camera in its own frame that corrects the mount of ``head``,
    (v, omega) [m, rad], shape (6, 6); None if that mount is not to be relied on."""
    offset_sigma: float = 0.05
    """How far a joint of the head may have slipped [rad]."""
    fiducial_sigma: float = 0.02
    """How far the fiducial may sit from where the model has it [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Terms:
    """Which unknowns a model has beside the mount of the camera."""

    keeps_mount: bool = False
    """The mount is that of the prior within its covariance, not free."""
    n_offsets: int = 0
    has_fiducial: bool = False

    @property
    def n_parameters(self) -> int:
        """Unknowns p: mount twist, then offsets, then place of the fiducial."""
        return 6 + self.n_offsets + 3 * self.has_fiducial

    @property
    def n_free(self) -> int:
        """Unknowns that the observations have to determine by themselves."""
        return self.n_parameters - 6 * self.keeps_mount


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Fit:
    """One model fitted to some observations."""

    terms: Terms
    head: Head
    """Head with mount and offsets as fitted."""
    fiducial: FloatArray
    """Shift of the fiducial in the frame of its link [m], shape (3,)."""
    covariance: FloatArray
    """Of all unknowns, shape (p, p); the twist of the mount is in the camera frame."""
    chi_square: float
    """Squared residuals in units of their variance, prior terms included: but for that
    of the fiducial, which the looks have to determine."""
    degrees_of_freedom: int


def predicted(
    observations: Observations, head: Head, fiducial: FloatArray, terms: Terms
) -> tuple[FloatArray, FloatArray]:
    """Where the camera should see the fiducial, and how that depends on the unknowns.

    Returns
    -------
    points, jacobian
        Camera frame [m], shapes (n, 3) and (n, 3, p).
    """
    T_base_camera = head.T_base_camera(observations.readings)
    R_camera_base = np.swapaxes(T_base_camera.R, -1, -2)
    points = observations.points_base
    wrist = observations.R_base_wrist
    if wrist is not None:
        points = points + (wrist @ fiducial[:, None])[..., 0]
    seen = T_base_camera.inverse().apply(points)
    jacobian = np.zeros((len(observations), 3, terms.n_parameters))
    jacobian[:, :, :3] = -np.eye(3)
    jacobian[:, :, 3:6] = so3.hat(seen)
    if terms.n_offsets:
        screws = head.screws(observations.readings)
        moved = screws[..., :3] + np.cross(screws[..., 3:], points[:, None])
        jacobian[:, :, 6 : 6 + terms.n_offsets] = -R_camera_base @ np.swapaxes(
            moved, -1, -2
        )
    if terms.has_fiducial and wrist is not None:
        jacobian[:, :, -3:] = R_camera_base @ wrist
    return seen, jacobian


def fit_terms(
    observations: Observations, start: Head, terms: Terms, prior: Prior
) -> Fit:
    """Fit by Gauss-Newton steps on the group, from a start that is already close.

    Parameters
    ----------
    observations
        Outliers removed.
    start
        Head whose mount and offsets the steps begin with.
    terms, prior
        The unknowns, and what is known about them.
    """
    head, fiducial = start, np.zeros(3)
    information = _prior_information(terms, prior)
    inverse_sigmas = 1.0 / observations.total_sigmas
    for _ in range(_MOST_STEPS):
        seen, jacobian = predicted(observations, head, fiducial, terms)
        rows = (jacobian * inverse_sigmas[..., None]).reshape(-1, terms.n_parameters)
        residuals = ((seen - observations.points_camera) * inverse_sigmas).reshape(-1)
        away = _from_prior(head, fiducial, terms, prior)
        normal = rows.T @ rows + information
        step = -np.linalg.solve(normal, rows.T @ residuals + information @ away)
        head = head.mounted(head.T_base_camera_at_zero @ SE3.exp(step[:6]))
        if terms.n_offsets:
            head = head.slipped(step[6 : 6 + terms.n_offsets])
        if terms.has_fiducial:
            fiducial = fiducial + step[-3:]
        if np.abs(step).max() < _SMALL_STEP:
            break
    seen, jacobian = predicted(observations, head, fiducial, terms)
    rows = (jacobian * inverse_sigmas[..., None]).reshape(-1, terms.n_parameters)
    residuals = ((seen - observations.points_camera) * inverse_sigmas).reshape(-1)
    away = _from_prior(head, fiducial, terms, prior)
    if terms.has_fiducial:
        away[-3:] = 0.0  # counted as free, and so not as evidence
    return Fit(
        terms=terms,
        head=head,
        fiducial=fiducial,
        covariance=np.asarray(np.linalg.inv(rows.T @ rows + information), np.float64),
        chi_square=float(residuals @ residuals + away @ information @ away),
        degrees_of_freedom=3 * len(observations) - terms.n_free,
    )


def _prior_information(terms: Terms, prior: Prior) -> FloatArray:
    """Inverse covariance of the prior, shape (p, p); zero for what is free."""
    out = np.zeros((terms.n_parameters, terms.n_parameters))
    if terms.keeps_mount and prior.mount_covariance is not None:
        out[:6, :6] = np.linalg.inv(prior.mount_covariance)
    offsets = np.arange(6, 6 + terms.n_offsets)
    out[offsets, offsets] = prior.offset_sigma**-2
    if terms.has_fiducial:
        last = np.arange(terms.n_parameters - 3, terms.n_parameters)
        out[last, last] = prior.fiducial_sigma**-2
    return out


def _from_prior(
    head: Head, fiducial: FloatArray, terms: Terms, prior: Prior
) -> FloatArray:
    """How far the unknowns are from what the prior expects, shape (p,)."""
    away = np.zeros(terms.n_parameters)
    if terms.keeps_mount:
        expected = prior.head.T_base_camera_at_zero
        away[:6] = (expected.inverse() @ head.T_base_camera_at_zero).log()
    if terms.n_offsets:
        slip = np.asarray(head.offsets) - np.asarray(prior.head.offsets)
        away[6 : 6 + terms.n_offsets] = slip
    if terms.has_fiducial:
        away[-3:] = fiducial
    return away
