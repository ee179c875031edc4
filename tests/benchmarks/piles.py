"""Fresh piles with known truth, so that benchmarks report on seeds nobody tuned on.

Run: python -m tests.benchmarks.piles [--json FILE]
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from debrisgrasp.geometry import SE3, Intrinsics, so3
from debrisgrasp.io import Capture
from debrisgrasp.sim import Settled, let_fall, settled_pile
from debrisgrasp.worlds import (
    Body,
    Ground,
    Measured,
    PileConfig,
    Rendered,
    StereoNoise,
    World,
    draw_intrinsics,
    draw_view,
    make_body,
    render,
)

from .report import arguments, begin, publish
from .strangers import Kinds, settled_strangers

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
            depth=np.where(depth > 0, depth, np.nan).astype(np.float32),
            intrinsics=self.intrinsics,
            T_base_camera=self.T_base_camera,
            name=f"pile_{self.seed}_{kind}",
        )


def fresh_pile(seed: int, config: PileConfig | None = None) -> FreshPile:
    """Draw one pile and one view of it that shows most of its bodies."""
    rng = np.random.default_rng(seed)
    return _seen(seed, settled_pile(rng=rng, config=config, name=str(seed)), rng)


def fresh_stack(seed: int) -> FreshPile:
    """Draw a stack of cartons, books, tins and buckets of any proportions."""
    rng = np.random.default_rng([seed, 1])
    # Towers stand only if each body comes down on the middle of the others.
    spread = float(rng.choice([0.04, 0.18]))
    bodies = [
        _household(rng, f"{seed}_{k}", spread) for k in range(int(rng.integers(4, 13)))
    ]
    world = World(tuple(bodies), Ground.level(), f"{seed} stack")
    return _seen(seed, let_fall(world), rng)


def fresh_strangers(seed: int, kinds: Kinds) -> FreshPile:
    """Draw a pile of three to eight things that the generator does not make."""
    rng = np.random.default_rng([seed, 2])
    return _seen(seed, settled_strangers(rng, kinds, (3, 8)), rng)


def _household(rng: np.random.Generator, name: str, spread: float) -> Body:
    """Draw one body, mostly a box, over the place where it is let down."""
    kind = rng.choice(["brick", "bucket", "pipe_wide"], p=[0.76, 0.12, 0.12])
    radius = float(rng.uniform(0.04, 0.1))
    length = float(rng.uniform(0.1, 0.45))
    sizes = {
        "brick": {
            "length": length,
            "width": length * float(rng.uniform(0.3, 1.0)),
            "height": length * float(rng.uniform(0.1, 0.9)),
        },
        "bucket": {
            "height": float(rng.uniform(0.1, 0.3)),
            "radius_low": radius,
            "radius_high": radius * float(rng.uniform(1.0, 1.6)),
            "wall": 0.006,
        },
        "pipe_wide": {
            "length": float(rng.uniform(0.1, 0.35)),
            "radius": radius,
            "wall": 0.01,
        },
    }[str(kind)]
    rpy = [rng.choice([0.0, np.pi / 2]), 0.0, rng.uniform(-np.pi, np.pi)]
    rpy += rng.normal(0.0, [0.03, 0.03, 0.0])
    place = [*rng.normal([1.3, 0.0], spread), 0.0]
    body = make_body(str(kind), sizes, float(rng.uniform(1, 3)), name=name)
    return body.at(SE3.from_parts(so3.from_rpy(rpy), place))


def _seen(seed: int, settled: Settled, rng: np.random.Generator) -> FreshPile:
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
    begin(main)
