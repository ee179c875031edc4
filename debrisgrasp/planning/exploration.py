"""From nothing to promising poses: informed starts, then annealing by elimination."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from debrisgrasp._arrays import FloatArray, IntArray, Rng

from .annealing import Walkers, anneal
from .config import SETTLED, PlannerConfig
from .modes import distinct
from .postures import Postures, Settled
from .proposals import GlobalMove, MixtureMove
from .quality import NOTHING, GraspQuality

__all__ = ["LogMerit", "exchanged", "explore", "refine"]


class LogMerit(Protocol):
    """Log of what is sought, and the way to where a pose fits."""

    def __call__(
        self, Ts_base_hand: FloatArray, prototype: IntArray, needed: FloatArray
    ) -> FloatArray:
        """Of poses (k, 4, 4) of prototypes (k,), if above what is needed (k,)."""
        ...

    def aligned(self, Ts_base_hand: FloatArray, prototype: IntArray) -> FloatArray:
        """See `ShapeSimilarity.aligned`."""
        ...


_FEWEST = 200
"""Walkers that a search has at least, however few the prototypes."""
_EARLY = 1.5
"""Above 1 the first rounds, of many walkers, are shorter than the last, of few."""
_IN_ANY_CASE = 3
"""Sweeps of the refinement that are made however late it is."""
_ASK_EVERY = 4
"""Sweeps of the refinement after which the arms are asked."""


def explore(
    quality: GraspQuality,
    postures: Postures,
    jump: GlobalMove,
    gripper_of: NDArray[np.str_],
    config: PlannerConfig,
    *,
    rng: Rng,
    on_sweep: Callable[[int, Walkers], bool],
) -> tuple[Settled, IntArray]:
    """Anneal walkers of every prototype; after each round only the best go on.

    Prototypes that resemble nothing in the scene show it after a few sweeps, and the
    time goes to the others. Of walkers that came to the same place the best goes on.
    In the end they are solved for the arms, and one whose best is out of reach is worth
    nothing.

    Parameters
    ----------
    gripper_of
        Name of the hand of each prototype, shape (p,).

    Returns
    -------
    settled, prototype
        Last state of every walker, also of those left behind, and what each places.
    """
    Ts, prototype = _starts(quality, jump, len(gripper_of), config, rng)
    walkers = Walkers.at(Ts, quality(Ts, prototype, np.full(len(Ts), -np.inf)))
    before = Walkers.at(Ts, np.full(len(Ts), NOTHING))
    shares = np.linspace(0.0, 1.0, config.rounds + 1) ** _EARLY
    ends = (config.schedule.sweeps * shares).round().astype(int)
    left: list[tuple[Settled, IntArray]] = []
    is_over = False

    def tell(index: int, state: Walkers) -> bool:
        nonlocal is_over
        is_over = not on_sweep(index, state)
        return not is_over

    for first, last in pairwise(ends):
        if is_over:
            break
        walkers = anneal(
            walkers,
            MixtureMove(config.local, jump, prototype, config.global_share),
            quality.of(prototype),
            config.schedule,
            rng=rng,
            sweeps=range(first, last),
            on_sweep=tell,
        )
        kept = distinct(
            walkers.best_Ts_base_hand,
            gripper_of[prototype],
            walkers.best_log_quality,
            distance=config.mode_distance / 2,
            angle=config.mode_angle / 2,
            limit=max(1, round(len(prototype) * config.survivors)),
        )
        others = np.setdiff1d(np.arange(len(prototype)), kept)
        left.append((postures.unknown(walkers[others]), prototype[others]))
        prototype = prototype[kept]
        walkers, before = walkers[kept], before[kept]
    settled = postures.settled(postures.unknown(before), walkers, prototype)
    left.append((settled, prototype))
    states, places = zip(*left, strict=True)
    return Settled.together(states), np.concatenate(places)


def exchanged(
    settled: Settled,
    prototype: IntArray,
    quality: GraspQuality,
    gripper_of: NDArray[np.str_],
) -> tuple[Settled, IntArray]:
    """Try every other prototype of the same hand where walkers are.

    What one of them finds, its neighbours in the dictionary often fit better.

    Returns
    -------
    settled, prototype
        One state for each of them, with the joints of the walker as a guess.
    """
    is_other = gripper_of[prototype][:, None] == gripper_of
    row, other = np.nonzero(
        is_other & (prototype[:, None] != np.arange(len(gripper_of)))
    )
    Ts = quality.aligned(settled.walkers.best_Ts_base_hand[row], other)
    walkers = Walkers.at(Ts, quality(Ts, other, np.full(len(other), NOTHING)))
    return Settled(walkers, settled.joints[row]), other


def refine(
    settled: Settled,
    prototype: IntArray,
    merit: LogMerit,
    postures: Postures,
    config: PlannerConfig,
    *,
    sweeps: range,
    rng: Rng,
    is_late: Callable[[], bool],
) -> Settled:
    """Take walkers uphill on what grasps are ranked by; only improvements count.

    Each sweep offers the same number of steps to fewer walkers: at first a few each, in
    the end many to the best few. The last sweeps, for doubtful walkers, end once the
    best of them scores `SETTLED`.

    Parameters
    ----------
    settled
        States whose value is merit already.
    merit
        What is sought.
    sweeps
        Which of `PlannerConfig.first_sweeps` and `PlannerConfig.last_sweeps` to make.
    """
    n, (many, few) = config.refinement_sweeps, config.refined
    sizes = np.geomspace(many, few, n).round().astype(int).tolist()
    walkers = settled.walkers
    for index in sweeps:
        if index >= _IN_ANY_CASE and is_late():
            break
        best = walkers.best_log_quality.max(initial=-np.inf)
        if index >= n and best >= np.log(SETTLED):
            break
        rows = distinct(
            walkers.best_Ts_base_hand,
            prototype,
            walkers.best_log_quality,
            distance=config.mode_distance / 3,
            angle=config.mode_angle / 3,
            limit=sizes[min(index, n - 1)],
        )
        if not len(rows):
            break  # no pose has any merit, as under a mass that nothing can lift
        tries = -(-config.refinement_steps // len(rows))
        every = np.repeat(rows, tries)
        Ts = config.refinement.moved(
            walkers.best_Ts_base_hand[every], min(index / n, 1.0), rng
        )
        # Every other one is fitted to the surface again: long steps along it are free.
        fitted = every[::2]
        Ts[::2] = merit.aligned(Ts[::2], prototype[fitted])
        value = merit(Ts, prototype[every], walkers.best_log_quality[every])
        best = value.reshape(len(rows), tries).argmax(axis=1)
        best += tries * np.arange(len(rows))
        walkers = walkers.offered(rows, Ts[best], value[best])
        # What no arm reaches must not end the search.
        if (index + 1) % _ASK_EVERY == 0 or index + 1 == n:
            settled = postures.settled(settled, walkers, prototype)
            walkers = settled.walkers
    return postures.settled(settled, walkers, prototype)


def _starts(
    quality: GraspQuality,
    jump: GlobalMove,
    n_prototypes: int,
    config: PlannerConfig,
    rng: Rng,
) -> tuple[FloatArray, IntArray]:
    """Poses (k, 4, 4) from which the chains start, and their prototypes (k,).

    The most promising of some jumps of each prototype, aligned with the surface.
    """
    # A small dictionary leaves time for more walkers of each.
    more = max(1, round(_FEWEST / (n_prototypes * config.walkers)))
    starts, walkers = more * config.starts, more * config.walkers
    prototype = np.repeat(np.arange(n_prototypes), starts)
    Ts = jump.sample(prototype, rng)
    promise = quality.promise(Ts, prototype).reshape(n_prototypes, -1)
    best = np.argsort(-promise, axis=1, kind="stable")[:, :walkers]
    kept = (best + starts * np.arange(n_prototypes)[:, None]).ravel()
    Ts, prototype = Ts[kept], prototype[kept]
    for _ in range(config.alignments):
        Ts = quality.aligned(Ts, prototype)
    return Ts, prototype
