"""Fresh piles with known truth, so that benchmarks report on seeds nobody tuned on.

Run: python -m tests.benchmarks.piles [--json FILE]
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from debrisgrasp.geometry import SE3, Intrinsics
from debrisgrasp.io import Capture
from debrisgrasp.sim import Settled, settled_pile
from debrisgrasp.worlds import (
    Measured,
    PileConfig,
    Rendered,
    StereoNoise,
    draw_intrinsics,
    draw_view,
    render,
)

from .report import arguments, publish

FEWEST_PIXELS = 60


@dataclass(frozen=True)
class FreshPile:
    """A pile at rest, seen once."""

    seed: int
    settled: Settled
    intrinsics: Intrinsics
    T_base_camera: SE3
    exact: Rendered
    measured: Measured

    @property
    def labels(self) -> np.ndarray:
        """0 ground, 1.. bodies, -1 not scored: nothing there, or a flying pixel."""
        return np.where(self.measured.is_flying, -1, self.exact.labels)

    @property
    def clean(self) -> Capture:
        """What a perfect camera would have captured."""
        return self._capture(self.exact.depth, "clean")

    @property
    def noisy(self) -> Capture:
        """What a stereo camera would have captured."""
        return self._capture(self.measured.depth, "noisy")

    def _capture(self, depth: np.ndarray, kind: str) -> Capture:
        return Capture(
            depth=np.where(depth > 0, depth, np.nan),
            intrinsics=self.intrinsics,
            T_base_camera=self.T_base_camera,
            name=f"pile_{self.seed}_{kind}",
        )


def fresh_pile(seed: int, config: PileConfig | None = None) -> FreshPile:
    """Draw one pile and one view of it that shows most of its bodies."""
    rng = np.random.default_rng(seed)
    settled = settled_pile(rng=rng, config=config, name=str(seed))
    bodies = settled.world.bodies
    middle = np.mean([body.T_base_body.p[:2] for body in bodies], axis=0)
    intrinsics = draw_intrinsics(rng)
    for _ in range(50):
        pose = draw_view([*middle, 0.12], rng=rng)
        exact = render(settled.world, intrinsics, pose)
        pixels = np.bincount(exact.labels[exact.labels > 0], minlength=len(bodies) + 1)
        if (pixels[1:] >= FEWEST_PIXELS).sum() >= max(1, len(bodies) - 2):
            break
    noise = StereoNoise(sigma=float(rng.uniform(0.0015, 0.002)))
    measured = noise.noisy(exact.depth, intrinsics, rng=rng)
    return FreshPile(seed, settled, intrinsics, pose, exact, measured)


def fresh_piles(
    seeds: Iterable[int], config: PileConfig | None = None
) -> Iterator[FreshPile]:
    """Piles of many seeds, one at a time; nothing is kept."""
    return (fresh_pile(seed, config) for seed in seeds)


def main() -> None:
    """Measure what the generator makes, and what it costs."""
    options = arguments(__doc__.splitlines()[0])
    start = time.process_time()
    piles = list(fresh_piles(range(500, 512)))
    seconds = (time.process_time() - start) / len(piles)
    bodies = [len(pile.settled.world.bodies) for pile in piles]
    holes = [(pile.measured.depth == 0).mean() for pile in piles]
    touching = [
        sum(contact.a >= 0 for contact in pile.settled.contacts) for pile in piles
    ]
    errors = [
        np.abs(
            pile.settled.loads[1:].sum(axis=1)
            - [9.81 * body.mass for body in pile.settled.world.bodies]
        ).max()
        for pile in piles
    ]
    publish(
        {
            "seconds_per_pile": seconds,
            "bodies_mean": float(np.mean(bodies)),
            "contacts_between_bodies_mean": float(np.mean(touching)),
            "holes_share_mean": float(np.mean(holes)),
            "load_error_newton_max": float(np.max(errors)),
        },
        options.json,
    )


if __name__ == "__main__":
    main()
