"""Start of a fit where an arm carries the camera and the fiducial stands still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray

from .decision import CalibrationConfig
from .fit import Fit, Prior, Terms, fit_terms, predicted
from .head import Head
from .observations import Observations
from .plausibility import Pairs, agreeing
from .rigid import NEAR, fit_rigid

__all__ = ["least_turn", "start_standing"]

_AN_ARM_AWAY = 0.5
"""How far the fiducial may be from where it was said to be, for its looks to be told
from wrong picks [m]."""

_MOST_ROUNDS = 8


def start_standing(
    observations: Observations, nominal: Head, pairs: Pairs, config: CalibrationConfig
) -> tuple[Head, BoolArray]:
    """Return a camera to begin with, and which looks agree with it, shape (n,).

    Parameters
    ----------
    observations
        With a `link`.
    nominal
        The camera in that link as the model has it.
    pairs
        The places in the link, and the points.
    config
        How well the fiducial's place is known, and how many looks may be wrong picks.

    Raises
    ------
    InputError
        As `agreeing` does.
    """
    # Wide: that the fiducial stands elsewhere than was said is told later, and clearly.
    sigma = max(config.fiducial_sigma, _AN_ARM_AWAY)
    prior = Prior(head=nominal, fiducial_sigma=sigma)
    spared = config.spared(len(observations))

    def vote(
        places: FloatArray,
        points: FloatArray,
        variances: FloatArray,  # those of the observations
    ) -> tuple[BoolArray, float]:
        del places, variances
        seen = replace(observations, points_camera=points)
        return _fitted(seen, prior, spared)[1:]

    agrees = agreeing(pairs, vote)
    return _fitted(observations, prior, spared)[0].head, agrees


def _fitted(
    observations: Observations, prior: Prior, spared: int
) -> tuple[Fit, BoolArray, float]:
    """Fit camera and fiducial together to all but the looks that fit them worst.

    Three places tell no camera while that of the fiducial is in doubt, so that no vote
    by triples is possible. From where the model has the camera, and from where it would
    be if the fiducial stood as said, the looks that fit worst are left out until they
    stay the same; one of the two is near enough.

    Returns the better fit; the looks that agree with it, shape (n,); and the sum of
    what each adds, as in `consensus`.
    """
    as_said = fit_rigid(observations.points_base, observations.points_camera)
    n, best = len(observations), None
    for start in (prior.head, prior.head.mounted(as_said)):
        kept, terms = np.arange(n), Terms(has_fiducial=True)
        for _ in range(_MOST_ROUNDS):
            fit = fit_terms(observations.selected(kept), start, terms, prior)
            seen, _ = predicted(observations, fit.head, fit.fiducial, terms)
            gaps = (observations.points_camera - seen) / observations.total_sigmas
            squared = (gaps**2).sum(axis=1)
            before, kept = kept, np.sort(np.argsort(squared)[: n - spared])
            if np.array_equal(before, kept):
                break
        cost = float(np.minimum(squared, NEAR).sum())
        if best is None or cost < best[2]:
            best = fit, squared < NEAR, cost
    assert best is not None
    return best


def least_turn(observations: Observations) -> float:
    """How far looks turn about the axis about which they do least [rad], rms.

    Zero if all turns are about one axis: a shift of the fiducial along it, and of the
    camera, look the same.
    """
    if observations.R_base_wrist is None:
        return 0.0
    # An axis that all share comes through the mean as long as it was.
    longest = np.linalg.svd(observations.R_base_wrist.mean(axis=0), compute_uv=False)[0]
    return float(np.arccos(min(longest, 1.0)))
