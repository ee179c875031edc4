"""The last climb leads to where the score is higher, and only where arms follow."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.planning import PlannerConfig
from debrisgrasp.planning.exploration import refine
from debrisgrasp.planning.postures import Postures
from tests.unit.planning.test_postures import HANDS, SlidingArm, at

CONFIG = PlannerConfig(refinement_sweeps=40, refined=(10, 10), mode_distance=0.0)


class Hill:
    """Log of a score in (0, 1] that is highest at x = top, on a surface that is flat
    along x: nothing to align to."""

    def __init__(self, top: float) -> None:
        self.top = top

    def __call__(
        self, Ts: np.ndarray, _prototype: np.ndarray, _needed: np.ndarray
    ) -> np.ndarray:
        return -0.5 * ((Ts[:, 0, 3] - self.top) / 0.1) ** 2

    def aligned(self, Ts: np.ndarray, _prototype: np.ndarray) -> np.ndarray:
        return Ts


def climbed(top: float, arms, rng) -> np.ndarray:
    x = np.linspace(0.9, 0.99, 10)
    which = np.ones(10, dtype=int)
    postures = Postures(arms, HANDS, rng)
    score = Hill(top)
    start = at(x, score(at(x, 0.0).Ts_base_hand, which, x))
    found = refine(
        postures.unknown(start),
        which,
        score,
        postures,
        CONFIG,
        sweeps=CONFIG.first_sweeps,
        rng=rng,
        is_late=lambda: False,
    )
    assert (found.walkers.best_log_quality >= start.best_log_quality).all()
    return found.walkers.best_Ts_base_hand[:, 0, 3] - x


def test_walkers_end_nearer_to_the_top(rng):
    assert climbed(0.8, (), rng).mean() < -0.05


def test_walkers_do_not_climb_out_of_reach(rng):
    arm = SlidingArm("right", "right_hand", length=1.0)
    gained = climbed(1.2, (arm,), rng)
    assert (np.linspace(0.9, 0.99, 10) + gained <= 1.0).all()


class Level(Hill):
    """The same score everywhere, which counts how often it is asked."""

    def __init__(self, probability: float) -> None:
        self.value, self.n_asked = np.log(probability), 0

    def __call__(
        self, Ts: np.ndarray, _prototype: np.ndarray, _needed: np.ndarray
    ) -> np.ndarray:
        self.n_asked += 1
        return np.full(len(Ts), self.value)


@pytest.mark.parametrize(("probability", "more"), [(0.5, 3), (0.9, 0)])
def test_doubtful_walkers_go_on_climbing_until_the_deadline(probability, more, rng):
    config = PlannerConfig(refinement_sweeps=5, doubtful_sweeps=3)
    asked = []
    for late_after in (100, 6):
        level = Level(probability)
        postures = Postures((), HANDS, rng)
        start = at(np.linspace(0.5, 1.5, 10), np.full(10, level.value))
        refine(
            postures.unknown(start),
            np.ones(10, dtype=int),
            level,
            postures,
            config,
            sweeps=range(8),
            rng=rng,
            is_late=lambda level=level, most=late_after: level.n_asked >= most,
        )
        asked.append(level.n_asked)
    assert asked == [5 + more, 5 + min(more, 1)]


@pytest.mark.parametrize("sweeps", [4, 5])
def test_what_no_arm_reaches_ends_no_search(sweeps, rng):
    config = PlannerConfig(refinement_sweeps=sweeps, doubtful_sweeps=1)

    class Beyond(Level):
        """Sure where no arm gets, and doubtful elsewhere."""

        def __call__(self, Ts, prototype, needed):
            super().__call__(Ts, prototype, needed)
            return np.where(Ts[:, 0, 3] > 1.0, np.log(0.9), np.log(0.5))

    level = Beyond(0.5)
    arm = SlidingArm("right", "right_hand", length=1.0)
    postures = Postures((arm,), HANDS, rng)
    refine(
        postures.unknown(at(np.ones(10), np.full(10, np.log(0.5)))),
        np.ones(10, dtype=int),
        level,
        postures,
        config,
        sweeps=range(sweeps + 1),
        rng=rng,
        is_late=lambda: False,
    )
    assert level.n_asked == sweeps + 1
