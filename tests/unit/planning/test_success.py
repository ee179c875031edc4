"""The forecast of success: monotone, honest about its range, and loud when broken."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from debrisgrasp._files import data_path
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.planning import SUCCESS_TERMS, SuccessForecast, SuccessModel
from debrisgrasp.planning.success import success_terms

MODEL = SuccessModel.load()
GOOD = {
    "expected": 0.5, "contact": 1.0, "demand": 0.2, "lever": 0.3, "margin": 0.02,
    "slack": 0.015, "sight": 0.8, "unseen": 1.0,
    "missing": 0.1,
}  # fmt: skip
BETTER = {
    "expected": 1, "contact": 1, "demand": -1, "lever": -1, "margin": 1, "slack": 1,
    "sight": 1, "unseen": -1, "missing": -1,
}  # fmt: skip
"""Sign of what is good."""


def terms_of(**values):
    return success_terms(**{k: np.asarray(v) for k, v in (GOOD | values).items()})


def test_more_of_anything_good_never_hurts():
    assert (MODEL.weights >= 0).all()
    for name, sign in BETTER.items():
        steps = np.linspace(0.01, 1.0, 30) * GOOD[name]
        found = MODEL.probability(terms_of(**{name: steps}))
        assert (np.diff(found) * sign >= -1e-12).all()


@given(
    st.floats(0, 1),
    st.floats(0, 1),
    st.floats(0, 1e6),
    st.floats(0, 1),
    st.floats(-1, 1),
)
def test_whatever_is_known_of_a_grasp_gives_a_probability(a, b, c, d, e):
    terms = terms_of(expected=a, contact=b, demand=c, lever=d, margin=e)
    told = MODEL.forecast(terms)
    assert 0.0 <= told.probability <= 1.0
    assert told.terms == tuple(terms)


def test_what_no_flight_covered_is_said_to_be_extrapolated():
    seen = terms_of(unseen=0.1, missing=0.0)
    usual = MODEL.forecast(np.clip(seen, MODEL.lower, MODEL.upper))
    assert usual.outside == ()
    assert "extrapolated" not in usual.in_words
    assert "guess" not in usual.in_words
    assert "guess" in MODEL.forecast(terms_of(sight=0.1)).in_words
    assert "not seen" in MODEL.forecast(terms_of()).in_words
    assert "part of" in MODEL.forecast(terms_of()).in_words
    assert "not seen" not in usual.in_words
    heavy = MODEL.forecast(terms_of(demand=1e4))
    assert "load" in heavy.outside
    assert "extrapolated in load" in heavy.in_words


def test_a_batch_is_told_as_each_of_it():
    many = terms_of(expected=np.array([0.2, 0.5, 0.9]))
    alone = [MODEL.forecast(row).probability for row in many]
    assert MODEL.probability(many) == pytest.approx(alone)


def test_shipped_coefficients_say_when_and_on_what_they_were_fitted():
    assert len(MODEL.date) == 10
    assert "flights" in MODEL.campaign


@pytest.mark.parametrize(
    "spoil",
    [
        lambda c: c["terms"].pop("load"),
        lambda c: c["terms"]["fit"].update(weight=float("1e999")),
        lambda c: c["terms"]["fit"].update(weight="much"),
        lambda c: c.update(schema="debrisgrasp.success/9"),
        lambda c: c.pop("intercept"),
        lambda c: c.update(intercept=float("nan")),
        lambda c: c["terms"]["fit"].update(weight=-1.0),
        lambda c: c["terms"]["fit"].update(weight=10**400),
        lambda c: c["terms"]["fit"].update(least=1.0),
        lambda c: c.update(terms=[]),
    ],
)
def test_broken_coefficients_are_refused(spoil, tmp_path):
    content = json.loads(data_path("planning", "success.json").read_text())
    assert set(content["terms"]) == set(SUCCESS_TERMS)
    spoil(content)
    path = tmp_path / "success.json"
    path.write_text(json.dumps(content))
    with pytest.raises(ConfigError, match=r"success\.json"):
        SuccessModel.load(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weights": np.ones(8)}, "SuccessModel.weights: .*for each of fit, contact"),
        ({"lower": np.full(9, np.nan)}, "SuccessModel.lower"),
        ({"intercept": np.inf}, "intercept"),
        ({"weights": -np.ones(9)}, "weight of fit"),
        ({"upper": MODEL.lower - 1.0}, "least and greatest of fit"),
    ],
)
def test_coefficients_that_mean_nothing_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        replace(MODEL, **change)


@pytest.mark.parametrize(("squeezed", "is_told"), [(0.1, True), (1.0, False)])
def test_what_is_only_hooked_holds_as_likely_and_is_told(squeezed, is_told):
    terms = terms_of()
    found = MODEL.forecast(terms, squeezed)
    assert found.probability == pytest.approx(float(MODEL.probability(terms)))
    assert found.squeezed == squeezed
    assert ("hooked" in found.in_words) == is_told


@pytest.mark.parametrize(
    ("margin", "least", "most"), [(0.3, 0.0, 0.2), (0.7, 0.6, 0.85), (2.0, 0.99, 1.0)]
)
def test_what_is_loaded_to_its_limits_turns_in_the_hand(margin, least, most):
    terms = terms_of(demand=1.0 / margin)
    found = MODEL.forecast(terms)
    assert least <= found.steady <= most
    assert ("likely to turn" in found.in_words) == (margin < 0.5)
    assert SuccessForecast(probability=0.5).steady == 1.0  # of an old file
