"""From nothing to promising poses: informed starts, then annealing by elimination."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray, Rng

from .annealing import Walkers, anneal
from .config import PlannerConfig
from .postures import Postures, Settled
from .proposals import GlobalMove, MixtureMove
from .quality import NOTHING, GraspQuality

__all__ = ["climb", "explore", "steady"]


def explore(
    quality: GraspQuality,
    postures: Postures,
    jump: GlobalMove,
    n_prototypes: int,
    config: PlannerConfig,
    *,
    rng: Rng,
    on_sweep: Callable[[int, Walkers], bool],
) -> tuple[Settled, IntArray]:
    """Anneal walkers of every prototype; after each round only the best go on.

    Prototypes that resemble nothing in the scene show it after a few sweeps, and the
    time goes to the others. Every few sweeps the best states are solved for the arms,
    and a walker whose best is out of reach goes back to where it was before.

    Returns
    -------
    settled, prototype
        Last state of every walker, also of those left behind, and what each places.
    """
    Ts, prototype = _starts(quality, jump, n_prototypes, config, rng)
    nothing = np.full(len(Ts), -np.inf)
    walkers = Walkers.at(Ts, quality(Ts, prototype, nothing))
    settled = postures.unknown(Walkers.at(Ts, np.full(len(Ts), NOTHING)))
    ends = np.linspace(0, config.schedule.sweeps, config.rounds + 1).astype(int)
    left: list[tuple[Settled, IntArray]] = []
    is_over = False

    def tell(index: int, state: Walkers) -> bool:
        nonlocal is_over
        is_over = not on_sweep(index, state)
        return not is_over

    for first, last in pairwise(ends):
        if is_over:
            break
        if first:
            order = np.argsort(-walkers.best_log_quality, kind="stable")
            n_kept = max(1, round(len(order) * config.survivors))
            kept, others = order[:n_kept], order[n_kept:]
            left.append((settled[others], prototype[others]))
            settled, prototype = settled[kept], prototype[kept]
            walkers = settled.walkers
        for sweeps in _parts(range(first, last), config.settle_every):
            walkers = anneal(
                walkers,
                MixtureMove(config.local, jump, prototype, config.global_share),
                quality.of(prototype),
                config.schedule,
                rng=rng,
                sweeps=sweeps,
                on_sweep=tell,
            )
            settled = postures.settled(settled, walkers, prototype)
            walkers = settled.walkers
            if is_over:
                break
    left.append((settled, prototype))
    states, places = zip(*left, strict=True)
    return Settled.together(states), np.concatenate(places)


def climb(
    settled: Settled,
    prototype: IntArray,
    quality: GraspQuality,
    postures: Postures,
    config: PlannerConfig,
    *,
    rng: Rng,
    on_sweep: Callable[[int, Walkers], bool],
) -> Settled:
    """Take every walker to the top nearby: aligned first, then by small steps."""
    score, walkers = quality.of(prototype), settled.walkers

    def offer(walkers: Walkers, Ts: FloatArray) -> Walkers:
        value = score(Ts, walkers.log_quality)
        return walkers.moved(value > walkers.log_quality, Ts, value)

    for _ in range(config.alignments):
        walkers = offer(walkers, quality.aligned(walkers.Ts_base_hand, prototype))
    for index in range(config.refinement_sweeps):
        progress = index / config.refinement_sweeps
        step = config.refinement.moved(walkers.Ts_base_hand, progress, rng)
        walkers = offer(walkers, step)
        if not on_sweep(index, walkers):
            break
    return postures.settled(settled, walkers, prototype)


def steady(
    settled: Settled,
    prototype: IntArray,
    score: Callable[[FloatArray, IntArray], FloatArray],
    postures: Postures,
    config: PlannerConfig,
    *,
    rng: Rng,
) -> Settled:
    """Take every walker to where the quality expected is highest nearby.

    Parameters
    ----------
    score
        Maps poses (k, 4, 4) and prototypes (k,) to the log of what is sought (k,).
    """
    walkers = settled.walkers
    for index in range(config.steadying_sweeps):
        progress = index / config.steadying_sweeps
        Ts = config.steadying.moved(walkers.Ts_base_hand, progress, rng)
        value = score(Ts, prototype)
        walkers = walkers.moved(value > walkers.log_quality, Ts, value)
    return postures.settled(settled, walkers, prototype)


def _parts(sweeps: range, length: int) -> list[range]:
    """Cut a range into parts of a length, the last may be shorter."""
    return [sweeps[first : first + length] for first in range(0, len(sweeps), length)]


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
    prototype = np.repeat(np.arange(n_prototypes), config.starts)
    Ts = jump.sample(prototype, rng)
    promise = quality.promise(Ts, prototype).reshape(n_prototypes, -1)
    best = np.argsort(-promise, axis=1, kind="stable")[:, : config.walkers]
    kept = (best + config.starts * np.arange(n_prototypes)[:, None]).ravel()
    Ts, prototype = Ts[kept], prototype[kept]
    for _ in range(config.alignments):
        Ts = quality.aligned(Ts, prototype)
    return Ts, prototype
