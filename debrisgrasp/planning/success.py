"""How likely a grasp holds: a logistic model fitted to grasps flown in physics.

What the planner measures of a grasp are numbers of different kinds. How much each
of them matters was not guessed but fitted to flights of whole plans on debris of known
shape and mass; the file of coefficients says which, and when.
"""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
from scipy.special import expit, ndtr

from debrisgrasp._arrays import FloatArray, bounded, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp._files import data_path, read_schema
from debrisgrasp.errors import ConfigError, InputError

__all__ = ["SUCCESS_TERMS", "SuccessForecast", "SuccessModel", "success_terms"]

SCHEMA = "debrisgrasp.success/1"
SUCCESS_TERMS = (
    "fit", "contact", "load", "lever", "margin", "slack", "sight", "view",
    "whole",
)  # fmt: skip
"""What success depends on, in the order of `success_terms`."""
_LEAST = 1e-3
"""Qualities below this are as bad as this."""
_LITTLE_LOAD = 0.1
"""Smaller loads, over the limit, don't help: something else fails then."""
_SHORT_LEVER = 0.1
"""Shorter levers don't help: the centre of mass isn't known better [m]."""
_LONG_LEVER = 0.6
"""Longer levers hurt no more [m]."""
_ENOUGH_MARGIN = 0.024
"""Wider margins around the hand don't help [m]."""
_ENOUGH_SLACK = 0.020
"""Wider gaps between fingers and prototype don't help [m]."""

_LITTLE_UNSEEN = 0.3
"""Less of palm or fingers in space that was never seen doesn't hurt."""
_LARGEST_PART = 0.2
"""What falls short of a whole object by more hurts no more [m]."""
_MOST_ODDS = 1e3
"""Log-odds beyond these are certainty, whatever is known of a grasp."""
_GUESSED = -0.5
"""With less sight than this a grasp is called a guess."""
_PART = -0.05
"""With less of it in sight an object is said to be a part."""
_HOOKED = 0.5
"""Squeezed with a smaller probability, it is said to be hooked."""
_UNSTEADY = 0.5
"""Likely to stay as it was gripped with a smaller probability, it is said to turn."""
_BLIND = -0.35
"""With less view than this the hand is said to go where nothing was seen."""
_TURNS, _TURNS_SPREAD = 0.52, 0.45
"""Margin of the load at which every other object turns or slides in the hand, and how
the logarithms of such margins spread. Of 285 that were held in flights (2026-11-29;
`stacked` from 945000, 945100 and 950000 on, `pile` from 950500 on) 6 of 19 stayed
within 12 degrees and 25 mm at margins below 0.55, 15 of 22 up to 0.85, and 226 of 244
above that."""


def success_terms(
    *,
    expected: FloatArray,
    contact: FloatArray,
    demand: FloatArray,
    lever: FloatArray,
    margin: FloatArray,
    slack: FloatArray,
    sight: FloatArray,
    unseen: FloatArray,
    missing: FloatArray,
) -> FloatArray:
    """Put what is known of k grasps into the terms of the model.

    Parameters
    ----------
    expected
        Quality expected over the errors of the pose, in [0, 1], shape (k,).
    contact
        Probability that the pads press within the friction cones, shape (k,).
    demand
        Load over limit at the mass expected, shape (k,). The mass is known to a factor,
        so that what counts is how many such factors the limit is away.
    lever
        Horizontal distance from the middle of the grip to the centre of mass [m], shape
        (k,). The load has it too; but what the mass really is, it only multiplies, and
        what hangs far beside the hand tilts and drags.
    margin
        How far the hand may be off before it touches something [m], shape (k,).
    slack
        Least distance between the open fingers and the prototype [m], shape (k,).
    sight
        How much tells that the object lies between the fingers and no farther, in
        [0, 1], shape (k,): 1 where both sides were seen, 0 where neither a side nor
        what joins the two was, so that only the prototype says so.
    unseen
        Share of palm or fingers of a side in space that was never seen, in [0, 1],
        shape (k,): something may stand there.
    missing
        How much smaller than debris mostly is what was seen of the object is, where
        that meets other things [m], shape (k,): it is part of something larger.

    Returns
    -------
    FloatArray
        Shape (k, 9), see `SUCCESS_TERMS`.
    """
    columns = (
        np.log(np.maximum(expected, _LEAST)),
        np.log(np.maximum(contact, _LEAST)),
        -np.log(np.maximum(demand, _LITTLE_LOAD)),
        _SHORT_LEVER - bounded(lever, _SHORT_LEVER, _LONG_LEVER),
        bounded(margin, 0.0, _ENOUGH_MARGIN),
        bounded(slack, 0.0, _ENOUGH_SLACK),
        bounded(sight, 0.0, 1.0) - 1.0,
        _LITTLE_UNSEEN - bounded(unseen, _LITTLE_UNSEEN, 1.0),
        -bounded(missing, 0.0, _LARGEST_PART),
    )
    terms = np.empty((*np.broadcast(*columns).shape, len(columns)))
    for index, column in enumerate(columns):
        terms[..., index] = column
    return terms


@dataclass(frozen=True, slots=True, kw_only=True)
class SuccessForecast:
    """How likely a grasp holds."""

    probability: float
    """That the object comes up with the hand and stays in it, in [0, 1]."""
    terms: tuple[float, ...] = ()
    """What it follows from, in the order of `SUCCESS_TERMS`."""
    outside: tuple[str, ...] = ()
    """Terms (`SUCCESS_TERMS`) outside what the flights covered: the probability is
    extrapolated."""
    squeezed: float = 1.0
    """Probability that the fingers squeeze the object, in [0, 1]. What only hangs in
    the hook of a claw comes up, too, but who feels for it with the fingers can't tell
    that from an empty hand."""

    @property
    def steady(self) -> float:
        """Probability that what comes up stays as it was gripped, in [0, 1].

        Near the limits of the hand it turns between the fingers, or slides along them,
        and is lost where it is carried on. Known by the load alone.
        """
        load = dict(zip(SUCCESS_TERMS, self.terms, strict=False)).get("load", np.inf)
        return float(ndtr((load - np.log(_TURNS)) / _TURNS_SPREAD))

    @property
    def in_words(self) -> str:
        """Say it, and how far it can be trusted."""
        said = f"holds with a probability of {self.probability:.0%}"
        told = dict(zip(SUCCESS_TERMS, self.terms, strict=False))
        if told.get("sight", 0.0) < _GUESSED:
            said += ", a guess at sides that were not seen"
        if told.get("view", 0.0) < _BLIND:
            said += ", the hand in space that was not seen"
        if told.get("whole", 0.0) < _PART:
            said += ", of what may be part of something larger"
        if self.squeezed < _HOOKED:
            said += ", hooked rather than squeezed"
        if self.steady < _UNSTEADY:
            said += ", likely to turn in the hand as it is carried"
        if self.outside:
            said += f", extrapolated in {' and '.join(self.outside)}"
        return said


@checked_fields
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SuccessModel:
    """Log-odds of success, linear in the terms of a grasp."""

    weights: FloatArray
    """Shape (9,), in the order of `SUCCESS_TERMS`, none below zero: more of a term
    can't hurt."""
    intercept: float
    lower: FloatArray
    """Least value of each term in the flights, shape (9,)."""
    upper: FloatArray
    """Greatest one, shape (9,)."""
    date: str = ""
    """When it was fitted."""
    campaign: str = ""
    """To what."""

    def __post_init__(self) -> None:
        require_range("intercept", self.intercept, -_MOST_ODDS, _MOST_ODDS)
        for name in ("weights", "lower", "upper"):
            values = np.asarray(getattr(self, name))
            if values.shape != (len(SUCCESS_TERMS),) or not np.isfinite(values).all():
                raise ConfigError(
                    f"SuccessModel.{name}",
                    got=values.tolist(),
                    expected=f"a finite number for each of {', '.join(SUCCESS_TERMS)}",
                )
        for index, term in enumerate(SUCCESS_TERMS):
            require_range(f"weight of {term}", float(self.weights[index]), 0.0)
            if self.lower[index] > self.upper[index]:
                raise ConfigError(
                    f"least and greatest of {term}",
                    got=f"{self.lower[index]:g} and {self.upper[index]:g}",
                    expected="the smaller one first",
                )

    @classmethod
    def load(cls, path: str | os.PathLike[str] | None = None) -> SuccessModel:
        """Read coefficients; those shipped by default.

        Raises
        ------
        ConfigError
            If the file can't be read or is malformed.
        """
        path = data_path("planning", "success.json") if path is None else path
        content = read_schema(path, SCHEMA)
        try:
            terms = [content["terms"][name] for name in SUCCESS_TERMS]
            values = np.array(
                [[t["weight"], t["least"], t["greatest"]] for t in terms], dtype=float
            )
            intercept = float(content["intercept"])
            told = str(content["date"]), str(content["campaign"])
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise ConfigError(
                f"coefficients in {path}",
                got=repr(error),
                expected="date, campaign, intercept, and weight, least and greatest of "
                + ", ".join(SUCCESS_TERMS),
            ) from error
        weights, lower, upper = values.T
        try:
            return cls(
                weights=weights,
                intercept=intercept,
                lower=lower,
                upper=upper,
                date=told[0],
                campaign=told[1],
            )
        except InputError as error:
            what = f"coefficients in {path}, {error.what}"
            raise ConfigError.about(what, error) from error

    def probability(self, terms: FloatArray) -> FloatArray:
        """Probability of success of grasps with these terms (k, 9), shape (k,)."""
        found: FloatArray = expit(self.log_odds(terms))
        return found

    def log_odds(self, terms: FloatArray) -> FloatArray:
        """Log-odds of success of grasps with these terms (k, 9), shape (k,)."""
        found: FloatArray = terms @ self.weights + self.intercept
        return found

    def forecast(self, terms: FloatArray, squeezed: float = 1.0) -> SuccessForecast:
        """Probability for one grasp (9,), and whether it is extrapolated.

        Parameters
        ----------
        squeezed
            See `SuccessForecast`.
        """
        is_off = (terms < self.lower) | (terms > self.upper)
        names = tuple(
            name for name, off in zip(SUCCESS_TERMS, is_off, strict=True) if off
        )
        return SuccessForecast(
            probability=float(expit(self.log_odds(terms))),
            squeezed=squeezed,
            terms=tuple(terms.tolist()),
            outside=names,
        )
