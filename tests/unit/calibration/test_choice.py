"""Chosen places tell more than others, and the prediction says how much."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.calibration import calibrate, choose_places, information_at
from debrisgrasp.errors import ConfigError, InputError, ShapeError

from .looks import looks


@pytest.fixture
def candidates(rng) -> np.ndarray:
    return rng.uniform([0.6, -0.6, 0.1], [1.3, 0.5, 0.8], (300, 3))


def test_information_adds_up_to_the_covariance_of_a_calibration():
    given = looks()
    sigma = float(np.asarray(given.total_sigmas)[0, 0])
    information = information_at(given.points_base, sigma).sum(axis=0)
    assert calibrate(given).covariance == pytest.approx(
        np.linalg.inv(information), rel=1e-6, abs=1e-15
    )


def test_chosen_places_beat_random_ones(candidates, rng):
    chosen = choose_places(candidates, 5)
    best_random = min(
        choose_places(candidates[rng.choice(300, 5, replace=False)], 5, apart=0.0)
        .errors[-1]
        .rms
        for _ in range(50)
    )
    assert chosen.errors[-1].rms < best_random


def test_chosen_places_pass_the_gate(candidates, rng):
    places = candidates[choose_places(candidates, 5).indices]
    assert calibrate(looks(places, noise=0.002, rng=rng)).decision.accepted


def test_chosen_places_lie_apart(candidates):
    places = candidates[choose_places(candidates, 8, apart=0.15).indices]
    gaps = np.linalg.norm(places[:, None] - places, axis=-1) + np.eye(8)
    assert gaps.min() > 0.15


def test_each_place_lowers_the_error(candidates):
    choice = choose_places(candidates, 8)
    errors = [error.rms for error in choice.errors]
    assert np.all(np.diff(errors) < 0)
    needed = choice.needed(0.004)
    assert needed is not None
    assert errors[needed - 1] <= 0.004 < errors[needed - 2]
    assert choice.needed(1e-5) is None


def test_what_is_known_is_not_measured_again(candidates):
    cluster = np.array([0.7, -0.5, 0.3]) + 0.05 * np.eye(3)
    known = information_at(cluster, 0.0027).sum(axis=0)
    first = candidates[choose_places(candidates, 1, information=known).indices[0]]
    assert np.linalg.norm(first - cluster.mean(axis=0)) > 0.4


def test_too_few_candidates_are_refused(candidates):
    with pytest.raises(InputError, match="far enough apart"):
        choose_places(candidates[:4], 5)
    with pytest.raises(InputError):
        choose_places(candidates, 0)
    with pytest.raises(InputError):
        choose_places(candidates * np.nan, 2)
    with pytest.raises(ShapeError):
        choose_places(candidates[:, :2], 2)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"information": np.full(6, 1e6)}, r"information: got \(6,\)"),
        ({"information": np.eye(9)}, r"\(9, 9\) with turns"),
        ({"information": np.full((6, 6), np.nan)}, "information: got 36 of 36"),
        ({"information": -np.eye(6)}, "information: got an eigenvalue of -1"),
        ({"turns": np.eye(3)}, r"turns: got \(3, 3\)"),
        ({"n": 2.5}, "n: got 2.5"),
        ({"apart": np.nan}, "apart: got nan"),
        ({"apart": 100.0}, "millimetres"),
        ({"fiducial_sigma": 0.0}, "fiducial_sigma"),
        ({"workspace": ((0, 0, 0), (1, 1, 1))}, "expected a Bounds"),
    ],
)
def test_what_nothing_can_be_chosen_by_is_refused(candidates, given, words):
    with pytest.raises(InputError, match=words):
        choose_places(candidates, **{"n": 3, **given})


@pytest.mark.parametrize("shape", [(3,), (2, 150, 3)])
def test_candidates_are_one_list_of_places(candidates, shape):
    with pytest.raises(ShapeError):
        choose_places(np.resize(candidates, shape), 1)


@pytest.mark.parametrize("of", [{"places": np.nan}, {"turns": np.nan}])
def test_places_that_are_nowhere_tell_nothing(of):
    """Rather than NaN, of which a sum over many looks is made."""
    places, turns = np.ones((2, 3)), np.ones((2, 3, 3))
    given = {"places": places, "turns": turns}
    ((name, value),) = of.items()
    with pytest.raises(InputError, match=f"{name}: got"):
        information_at(**{**given, name: value * given[name]}, sigmas=0.003)


def test_candidates_in_millimetres_are_refused(candidates):
    with pytest.raises(ConfigError, match="millimetres"):
        choose_places(1000.0 * candidates, 3)
