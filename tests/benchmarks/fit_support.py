"""Fit the evidence that objects bear on one another, to simulated piles at rest.

Run: python -m tests.benchmarks.fit_support --out FOLDER [--piles N]

The same piles, seed and singulation give the same files. Every pile is seen clean and
noisy, and divided by the truth and by singulation. What is learnt is whether the first
end of a contact puts more than 5 % of its weight on the second, as the physics engine
knows, and whether anything does so to an object. The second builds on the first, as
told by a fit to the other half of the piles.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from debrisgrasp.segmentation import Segmentation, SupportConfig, segment_cloud
from debrisgrasp.segmentation.bearing import (
    BEARING,
    BURDEN,
    Seen,
    bearing_features,
    burden_features,
)
from debrisgrasp.segmentation.support import labelled_surface

from .boosting import Boosting, Cases, write_evidence
from .fit_singulation import FIRST_SEED
from .piles import FreshPile, fresh_piles
from .support import Truth, bodies_of, captures, seen_labels, true_segmentation

BEARING_FIT = Boosting(n_terms=200, depth=5, rate=0.08)
BURDEN_FIT = Boosting(n_terms=150, depth=4, rate=0.06)


@dataclass
class Scene:
    """One division of one capture, and what is true of it."""

    half: int
    seen: Seen
    relations: np.ndarray
    features: np.ndarray
    bodies: np.ndarray
    truth: Truth

    def bearing_cases(self) -> Cases:
        """Contacts of two bodies, in both directions."""
        ends = self.bodies[self.relations].reshape(-1, 2)
        chosen = (ends > 0).all(axis=1) & (ends[:, 0] != ends[:, 1])
        is_so = [(int(a), int(b)) in self.truth.bearing for a, b in ends[chosen]]
        n = len(is_so)
        return Cases(self.features[chosen], np.array(is_so, dtype=bool), np.ones(n))

    def burden_cases(self, confidence: np.ndarray) -> Cases:
        """Objects, given how sure every relation is."""
        carriers = {below for _, below in self.truth.bearing}
        features = burden_features(self.relations, confidence, self.seen)
        own = self.bodies[1:]
        is_so = np.isin(own, list(carriers))
        return Cases(features[own > 0], is_so[own > 0], np.ones(int((own > 0).sum())))


def scenes_of(pile: FreshPile) -> Iterator[Scene]:
    """Both captures of a pile, divided by singulation and by the truth."""
    config = SupportConfig()
    for _, capture in captures(pile):
        cloud = capture.cloud()
        labels = seen_labels(pile, cloud)
        truth = Truth.of(pile, cloud, labels)
        found = segment_cloud(cloud)
        divisions: tuple[tuple[Segmentation, np.ndarray], ...] = (
            (found, bodies_of(found, labels)),
            true_segmentation(found, cloud, labels),
        )
        for segmentation, bodies in divisions:
            surface = labelled_surface(segmentation, cloud, config)
            seen = Seen.of(segmentation, cloud, surface, config.reach)
            if len(bodies) > 1:
                relations, features = bearing_features(seen)
                half = pile.seed % 2
                yield Scene(half, seen, relations, features, bodies, truth)


def fitted(scenes: Iterable[Scene], out: Path, rng: np.random.Generator) -> None:
    """Fit both kinds of evidence and write them."""
    scenes = list(scenes)
    bearing = Cases.joined(scene.bearing_cases() for scene in scenes)
    burden = []
    for half in (0, 1):
        others = Cases.joined(s.bearing_cases() for s in scenes if s.half != half)
        evidence = BEARING_FIT.evidence(others, BEARING, rng)
        burden += [
            scene.burden_cases(evidence.probability(scene.features))
            for scene in scenes
            if scene.half == half
        ]
    fits = (
        ("bearing", BEARING_FIT, bearing, BEARING, "contacts, both ways,"),
        ("burden", BURDEN_FIT, Cases.joined(burden), BURDEN, "objects"),
    )
    for name, boosting, cases, features, what in fits:
        about = (
            "Symmetric trees of Evidence, fitted by tests.benchmarks.fit_support to "
            f"{len(cases)} {what} in {len(scenes)} divisions of captures of piles"
        )
        terms = boosting.fitted(cases, features, rng)
        write_evidence(out / f"{name}.json", about, *terms)


def main() -> None:
    """Fit and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--piles", type=int, default=100)
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    seeds = range(FIRST_SEED, FIRST_SEED + options.piles)
    scenes = (scene for pile in fresh_piles(seeds) for scene in scenes_of(pile))
    fitted(scenes, options.out, np.random.default_rng(options.seed))


if __name__ == "__main__":
    main()
