"""The chain samples what it should: known densities, at several temperatures."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError
from debrisgrasp.planning.annealing import Schedule, Walkers, anneal, sweep

SIGMA = 0.3
K = 4000


def poses(x: np.ndarray) -> np.ndarray:
    Ts = np.tile(np.eye(4), (len(x), 1, 1))
    Ts[:, 0, 3] = x
    return Ts


def log_gaussian(Ts: np.ndarray, _needed: np.ndarray) -> np.ndarray:
    return -0.5 * (Ts[:, 0, 3] / SIGMA) ** 2


def local(walkers, _progress, rng):
    x = walkers.Ts_base_hand[:, 0, 3]
    return poses(x + rng.normal(0, 0.4, len(x))), np.zeros(len(x))


def jump_with_power(power):
    """Independent proposals whose density is exactly Q ** power."""

    def propose(walkers, _progress, rng):
        k = len(walkers.log_quality)
        return poses(rng.normal(0, SIGMA / np.sqrt(power), k)), np.full(k, power)

    return propose


def mixture(walkers, progress, rng):
    near, zero = local(walkers, progress, rng)
    far, one = jump_with_power(1.0)(walkers, progress, rng)
    is_far = rng.random(len(zero)) < 0.5
    return np.where(is_far[:, None, None], far, near), np.where(is_far, one, zero)


def sampled(propose, beta, rng):
    start = poses(rng.normal(0, 2.0, K))
    walkers = Walkers.at(start, log_gaussian(start, None))
    for _ in range(80):
        walkers = sweep(
            walkers, propose, log_gaussian, beta=beta, progress=0.0, rng=rng
        )
    return walkers.Ts_base_hand[:, 0, 3]


@pytest.mark.parametrize("beta", [2.0, 5.0, 20.0])
@pytest.mark.parametrize("propose", [local, jump_with_power(1.0), mixture])
def test_moments_match_the_target_at_every_temperature(propose, beta, rng):
    x = sampled(propose, beta, rng)
    sigma = SIGMA / np.sqrt(beta)
    assert abs(x.mean()) < 4 * sigma / np.sqrt(K)
    assert x.std() == pytest.approx(sigma, rel=4 / np.sqrt(2 * K))


def test_a_jump_whose_density_is_declared_wrongly_misses_the_target(rng):
    """The power matters: without it the same jumps sample too narrowly."""

    def undeclared(walkers, progress, rng):
        candidates, power = jump_with_power(1.0)(walkers, progress, rng)
        return candidates, 0 * power

    x = sampled(undeclared, 2.0, rng)
    assert x.std() < 0.9 * SIGMA / np.sqrt(2.0)


def test_best_pose_never_gets_worse(rng):
    start = poses(rng.normal(0, 2.0, 50))
    walkers = Walkers.at(start, log_gaussian(start, None))
    history = []

    def watch(_index, now):
        history.append(now.best_log_quality)
        return True

    final = anneal(
        walkers, mixture, log_gaussian, Schedule(sweeps=30), rng=rng, on_sweep=watch
    )
    assert (np.diff(np.array(history), axis=0) >= 0).all()
    assert np.array_equal(
        final.best_log_quality, log_gaussian(final.best_Ts_base_hand, None)
    )


def test_search_stops_when_told_to(rng):
    start = poses(np.zeros(3))
    count = []

    def stop_at_five(index, _walkers):
        count.append(index)
        return index < 4

    anneal(
        Walkers.at(start, log_gaussian(start, None)),
        local,
        log_gaussian,
        Schedule(sweeps=100),
        rng=rng,
        on_sweep=stop_at_five,
    )
    assert len(count) == 5


def test_temperature_falls_geometrically_and_then_stays():
    schedule = Schedule(hot=0.5, cold=0.05, cooling_share=0.5)
    assert schedule.beta(0.0) == pytest.approx(2.0)
    assert schedule.beta(0.25) == pytest.approx(np.sqrt(2.0 * 20.0))
    assert schedule.beta(0.5) == schedule.beta(1.0) == pytest.approx(20.0)


@pytest.mark.parametrize(
    "settings",
    [{"sweeps": 0}, {"hot": 1.0}, {"cold": 0.0}, {"hot": 0.1, "cold": 0.2}],
)
def test_a_schedule_that_does_not_cool_is_refused(settings):
    with pytest.raises(ConfigError, match="schedule"):
        Schedule(**settings)
