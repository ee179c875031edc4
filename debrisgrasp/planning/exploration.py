"""From nothing to promising poses: informed starts, then annealing by elimination."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray, Rng

from .annealing import Walkers, anneal
from .config import PlannerConfig
from .proposals import GlobalMove, MixtureMove
from .quality import GraspQuality

__all__ = ["climb", "explore"]


def explore(
    quality: GraspQuality,
    jump: GlobalMove,
    n_prototypes: int,
    config: PlannerConfig,
    *,
    rng: Rng,
    on_sweep: Callable[[int, Walkers], bool],
) -> tuple[Walkers, IntArray]:
    """Anneal walkers of every prototype; after each round only the best go on.

    Prototypes that resemble nothing in the scene show it after a few sweeps, and the
    time goes to the others.

    Returns
    -------
    walkers, prototype
        Last state of every walker, also of those left behind, and what each places.
    """
    Ts, prototype = _starts(quality, jump, n_prototypes, config, rng)
    nothing = np.full(len(Ts), -np.inf)
    walkers = Walkers.at(Ts, quality(Ts, prototype, nothing))
    ends = np.linspace(0, config.schedule.sweeps, config.rounds + 1).astype(int)
    left: list[tuple[Walkers, IntArray]] = []
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
            left.append((walkers[others], prototype[others]))
            walkers, prototype = walkers[kept], prototype[kept]
        walkers = anneal(
            walkers,
            MixtureMove(config.local, jump, prototype, config.global_share),
            quality.of(prototype),
            config.schedule,
            rng=rng,
            sweeps=range(first, last),
            on_sweep=tell,
        )
    left.append((walkers, prototype))
    states, places = zip(*left, strict=True)
    return Walkers.together(states), np.concatenate(places)


def climb(
    walkers: Walkers,
    prototype: IntArray,
    quality: GraspQuality,
    config: PlannerConfig,
    *,
    rng: Rng,
    on_sweep: Callable[[int, Walkers], bool],
) -> Walkers:
    """Take every walker to the top nearby: aligned first, then by small steps."""
    score = quality.of(prototype)

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
    return walkers


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
