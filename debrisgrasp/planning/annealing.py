"""Simulated annealing on a Markov chain, all walkers side by side (section 5.4)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, Rng, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import ConfigError

__all__ = ["LogQuality", "Proposal", "Schedule", "Walkers", "anneal", "sweep"]

Proposal = Callable[["Walkers", float, Rng], tuple[FloatArray, FloatArray]]
"""Maps walkers, the progress in [0, 1] and a generator to candidate poses (k, 4, 4)
and the power (k,) of the quality to which their density is proportional: 0 for a
symmetric step around the current pose, 1 for a jump that finds good poses in proportion
to their quality."""

LogQuality = Callable[[FloatArray, FloatArray], FloatArray]
"""Maps poses (k, 4, 4) and the least value that matters (k,) to log Q-hat (k,);
where the value is provably below what matters it may be minus infinity."""


@dataclass(frozen=True, slots=True, eq=False)
class Walkers:
    """State of every chain, k of them."""

    Ts_base_hand: FloatArray
    """Poses, shape (k, 4, 4)."""
    log_quality: FloatArray
    """log Q-hat of each, shape (k,)."""
    best_Ts_base_hand: FloatArray
    """Best pose that each walker has seen."""
    best_log_quality: FloatArray
    """log Q-hat of those."""

    @classmethod
    def at(cls, Ts_base_hand: FloatArray, log_quality: FloatArray) -> Walkers:
        """Start walkers at poses of known quality."""
        return cls(Ts_base_hand, log_quality, Ts_base_hand, log_quality)

    @classmethod
    def together(cls, parts: Sequence[Walkers]) -> Walkers:
        """Put several sets of walkers side by side."""
        return cls(
            np.concatenate([part.Ts_base_hand for part in parts]),
            np.concatenate([part.log_quality for part in parts]),
            np.concatenate([part.best_Ts_base_hand for part in parts]),
            np.concatenate([part.best_log_quality for part in parts]),
        )

    def with_rows(self, rows: IntArray, other: Walkers) -> Walkers:
        """Take some of the walkers from elsewhere."""
        mine = (
            self.Ts_base_hand,
            self.log_quality,
            self.best_Ts_base_hand,
            self.best_log_quality,
        )
        Ts, value, best_Ts, best_value = (column.copy() for column in mine)
        Ts[rows], value[rows] = other.Ts_base_hand[rows], other.log_quality[rows]
        best_Ts[rows] = other.best_Ts_base_hand[rows]
        best_value[rows] = other.best_log_quality[rows]
        return Walkers(Ts, value, best_Ts, best_value)

    def __getitem__(self, kept: IntArray) -> Walkers:
        return Walkers(
            self.Ts_base_hand[kept],
            self.log_quality[kept],
            self.best_Ts_base_hand[kept],
            self.best_log_quality[kept],
        )

    def moved(
        self, accepted: BoolArray, Ts_base_hand: FloatArray, log_quality: FloatArray
    ) -> Walkers:
        """Take the candidates where accepted."""
        Ts = np.where(accepted[..., None, None], Ts_base_hand, self.Ts_base_hand)
        value = np.where(accepted, log_quality, self.log_quality)
        is_better = value > self.best_log_quality
        return Walkers(
            Ts,
            value,
            np.where(is_better[..., None, None], Ts, self.best_Ts_base_hand),
            np.maximum(value, self.best_log_quality),
        )

    def offered(
        self, rows: IntArray, Ts_base_hand: FloatArray, log_quality: FloatArray
    ) -> Walkers:
        """Take what is offered to some walkers where it is better than their best."""
        candidates, value = self.best_Ts_base_hand.copy(), self.best_log_quality.copy()
        candidates[rows], value[rows] = Ts_base_hand, log_quality
        return self.moved(value > self.best_log_quality, candidates, value)


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """How the temperature falls."""

    sweeps: int = 9
    """Moves offered to every walker. More finds more and takes proportionally long."""
    hot: float = 0.5
    """Temperature at the start."""
    cold: float = 0.05
    """Temperature at the end: quality enters acceptance to the power 20."""
    cooling_share: float = 0.5
    """Share of the run over which the temperature falls; then it stays."""

    def __post_init__(self) -> None:
        require_range("sweeps of the annealing schedule", self.sweeps, 1, 10_000)
        is_cooling = 0 < self.cold <= self.hot < 1 and self.cooling_share > 0
        if not is_cooling:
            raise ConfigError(
                "annealing schedule",
                got=self,
                expected="0 < cold <= hot < 1, cooling_share > 0",
            )

    def beta(self, progress: float) -> float:
        """Inverse temperature at ``progress`` in [0, 1]."""
        cooled = min(progress / self.cooling_share, 1.0)
        return 1.0 / float(self.hot * (self.cold / self.hot) ** cooled)


def sweep(
    walkers: Walkers,
    propose: Proposal,
    score: LogQuality,
    *,
    beta: float,
    progress: float,
    rng: Rng,
) -> Walkers:
    """Offer every walker one Metropolis-Hastings move at inverse temperature ``beta``.

    With a proposal density proportional to ``Q ** power`` the acceptance probability is
    ``(Q_new / Q_old) ** (beta - power)``. The uniform number that decides is drawn
    first, so that the score may stop early on a candidate that is lost anyway.
    """
    candidates, power = propose(walkers, progress, rng)
    log_u = np.log(rng.random(walkers.log_quality.shape))
    needed = walkers.log_quality + log_u / (beta - power)
    value = score(candidates, needed)
    return walkers.moved(value > needed, candidates, value)


def anneal(
    walkers: Walkers,
    propose: Proposal,
    score: LogQuality,
    schedule: Schedule,
    *,
    rng: Rng,
    sweeps: Iterable[int] | None = None,
    on_sweep: Callable[[int, Walkers], bool] = lambda _index, _walkers: True,
) -> Walkers:
    """Run the schedule, or some of its sweeps; stop early when ``on_sweep`` says so."""
    for index in range(schedule.sweeps) if sweeps is None else sweeps:
        progress = index / schedule.sweeps
        walkers = sweep(
            walkers,
            propose,
            score,
            beta=schedule.beta(progress),
            progress=progress,
            rng=rng,
        )
        if not on_sweep(index, walkers):
            break
    return walkers
