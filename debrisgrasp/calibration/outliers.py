"""Which observations a fitted model can't explain."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.special import chdtri

from debrisgrasp._arrays import BoolArray, FloatArray

from .fit import Fit, predicted
from .observations import Observations

__all__ = ["Residuals", "residuals_of", "settled"]

_MOST_ROUNDS = 8
_FEWEST = 3


class Residuals:
    """What each observation says against a fit, itself left out of it."""

    def __init__(
        self, fit: Fit, observations: Observations, is_used: BoolArray
    ) -> None:
        seen, jacobian = predicted(observations, fit.head, fit.fiducial, fit.terms)
        gaps = observations.points_camera - seen
        variances = observations.total_sigmas**2
        noise = variances[:, :, None] * np.eye(3)
        explained = jacobian @ fit.covariance @ np.swapaxes(jacobian, -1, -2)
        sign = np.where(is_used, -1.0, 1.0)[:, None, None]
        # A trace of noise keeps the matrix invertible where an observation determines
        # an unknown alone; its residual vanishes there, and with it what is added.
        spread = noise + sign * explained + 1e-6 * noise
        weighted = np.linalg.solve(spread, gaps[..., None])
        self.gaps: FloatArray = gaps
        """Measured less predicted place, camera frame [m], shape (n, 3)."""
        self.squared: FloatArray = (gaps * weighted[..., 0]).sum(axis=-1)
        """Squared size in units of its variance, 3 degrees of freedom, shape (n,)."""
        held_out = np.where(is_used[:, None], (noise @ weighted)[..., 0], gaps)
        self.held_out: FloatArray = np.linalg.norm(held_out, axis=-1)
        """Distance from what a fit to all other observations predicts [m], (n,)."""


def residuals_of(fit: Fit, observations: Observations, is_used: BoolArray) -> Residuals:
    """Residuals of all observations against a fit to those that were used."""
    return Residuals(fit, observations, is_used)


def settled(
    observations: Observations,
    start: BoolArray,
    fit_to: Callable[[Observations], Fit],
    significance: float,
) -> tuple[Fit, BoolArray]:
    """Fit, drop what the fit can't explain, take back what it can, until nothing moves.

    Parameters
    ----------
    observations
        All of them.
    start
        Which to begin with, shape (n,).
    fit_to
        Fits a model to some observations.
    significance
        How often a sound set of observations may lose one.

    Returns
    -------
    fit, is_used
        The last fit, and the observations it was made from, shape (n,).
    """
    n = len(observations)
    limit = float(chdtri(3, significance / n))
    is_used = start
    fit = fit_to(observations.selected(is_used))
    tried = {is_used.tobytes()}
    for _ in range(_MOST_ROUNDS):
        squared = residuals_of(fit, observations, is_used).squared
        wanted = squared <= limit
        # One at a time: a wrong pick makes its neighbours look bad.
        lost = is_used & ~wanted
        if lost.any():
            wanted = is_used.copy()
            wanted[np.argmax(np.where(lost, squared, -1.0))] = False
        if wanted.sum() < _FEWEST or wanted.tobytes() in tried:
            break
        tried.add(wanted.tobytes())
        is_used = wanted
        fit = fit_to(observations.selected(is_used))
    return fit, is_used
