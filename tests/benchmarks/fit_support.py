"""Fit the evidence that objects bear on one another, to simulated piles at rest.

Run: python -m tests.benchmarks.fit_support --out FOLDER [--piles N]

The same piles, seed and singulation give the same files. Every pile is seen clean and
noisy, and divided by the truth and by singulation. What is learnt is whether the first
end of a contact puts more than 5 % of its weight on the second, as the physics engine
knows: from the contact by itself, then twice among the others; and whether anything
does so to an object. What builds on another fit learns from what that says of piles
that it did not see. The weights of support by the ground are printed.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from debrisgrasp.geometry import PointCloud
from debrisgrasp.segmentation import Segmentation, SupportConfig, segment_cloud
from debrisgrasp.segmentation.bearing import (
    BEARING,
    CONTACT,
    contact_features,
    in_context,
)
from debrisgrasp.segmentation.burden import BURDEN, burden_features
from debrisgrasp.segmentation.seen import Seen
from debrisgrasp.segmentation.support import ground_features, labelled_surface
from debrisgrasp.segmentation.surface import LabelledSurface

from .boosting import Boosting, Cases, write_evidence
from .piles import FreshPile, fresh_piles
from .report import begin
from .support import Truth, bodies_of, captures, seen_labels, true_segmentation

FIRST_SEED = 31_000
"""Of the piles to learn from: singulation divides those that it was fitted to too well,
and benchmarks report on others."""
CONTACT_FIT = BEARING_FIT = Boosting(n_terms=350, depth=5, rate=0.06, ridge=10.0)
BURDEN_FIT = Boosting(n_terms=250, depth=5, rate=0.05)

_NO_POINTS = np.zeros((0, 3))
_NO_SURFACE = LabelledSurface.of(
    PointCloud(_NO_POINTS, _NO_POINTS, np.zeros(3)),
    np.zeros(0, dtype=np.int64),
    None,
    size=0.01,
    noise=0.0,
)


@dataclass
class Scene:
    """One division of one capture, and what is true of it."""

    half: int
    seen: Seen
    """Without the surface: those of thousands would not fit into memory."""
    relations: np.ndarray
    features: np.ndarray
    bodies: np.ndarray
    truth: Truth

    def contact_cases(self, features: np.ndarray) -> Cases:
        """Contacts of two bodies, in both directions."""
        ends = self.bodies[self.relations].reshape(-1, 2)
        chosen = (ends > 0).all(axis=1) & (ends[:, 0] != ends[:, 1])
        is_so = [(int(a), int(b)) in self.truth.bearing for a, b in ends[chosen]]
        n = len(is_so)
        return Cases(features[chosen], np.array(is_so, dtype=bool), np.ones(n))

    def burden_cases(self, confidence: np.ndarray) -> Cases:
        """Objects, given how sure every relation is."""
        carriers = {below for _, below in self.truth.bearing}
        features = burden_features(self.relations, confidence, self.seen)
        own = self.bodies[1:]
        is_so = np.isin(own, list(carriers))
        return Cases(features[own > 0], is_so[own > 0], np.ones(int((own > 0).sum())))

    def ground_cases(self, confidence: np.ndarray) -> Cases:
        """Objects, and whether they rest on the ground."""
        own = self.bodies[1:]
        free = np.ones(len(self.bodies))
        np.multiply.at(free, self.relations[:, 0], 1.0 - confidence)
        features = ground_features(self.seen.shapes.lowest, 1.0 - free)[1:]
        is_so = np.array([(int(body), 0) in self.truth.bearing for body in own])
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
                relations, features = contact_features(seen)
                kept = replace(seen, surface=_NO_SURFACE)
                half = pile.seed % 2
                yield Scene(half, kept, relations, features, bodies, truth)


def told_by_others(
    scenes: list[Scene],
    features: list[np.ndarray],
    boosting: Boosting,
    names: tuple[str, ...],
    rng: np.random.Generator,
) -> list[np.ndarray]:
    """What a fit to the other half of the piles says of the relations of each scene."""
    evidence = []
    for half in (0, 1):
        others = Cases.joined(
            scene.contact_cases(columns)
            for scene, columns in zip(scenes, features, strict=True)
            if scene.half != half
        )
        evidence.append(boosting.evidence(others, names, rng))
    return [
        evidence[scene.half].probability(columns)
        for scene, columns in zip(scenes, features, strict=True)
    ]


def fitted(scenes: list[Scene], out: Path, rng: np.random.Generator) -> None:
    """Fit all kinds of evidence, write them, and print the weights of the ground's."""

    def among(confidence: list[np.ndarray]) -> list[np.ndarray]:
        return [
            in_context(scene.relations, scene.features, own, scene.seen.kinship)
            for scene, own in zip(scenes, confidence, strict=True)
        ]

    def cases(columns: list[np.ndarray]) -> list[Cases]:
        pairs = zip(scenes, columns, strict=True)
        return [scene.contact_cases(own) for scene, own in pairs]

    contacts = [scene.features for scene in scenes]
    first = among(told_by_others(scenes, contacts, CONTACT_FIT, CONTACT, rng))
    second = among(told_by_others(scenes, first, BEARING_FIT, BEARING, rng))
    confidence = told_by_others(scenes, second, BEARING_FIT, BEARING, rng)
    told = list(zip(scenes, confidence, strict=True))
    both_ways = "contacts, both ways,"
    fits = (
        ("contact", CONTACT_FIT, CONTACT, both_ways, cases(contacts)),
        ("context", BEARING_FIT, BEARING, both_ways, cases(first)),
        ("bearing", BEARING_FIT, BEARING, both_ways, cases(second)),
        ("burden", BURDEN_FIT, BURDEN, "objects",
         [scene.burden_cases(own) for scene, own in told]),
    )  # fmt: skip
    for name, boosting, names, what, parts in fits:
        joined = Cases.joined(parts)
        about = (
            "Symmetric trees of Evidence, fitted by tests.benchmarks.fit_support to "
            f"{len(joined)} {what} in {len(scenes)} divisions of captures of piles"
        )
        terms = boosting.fitted(joined, names, rng)
        write_evidence(out / f"{name}.json", about, *terms)
    ground = Cases.joined(scene.ground_cases(own) for scene, own in told)
    print("ground:", logistic_weights(ground).round(3).tolist())


def logistic_weights(cases: Cases) -> np.ndarray:
    """Weight of each feature and the log-odds without any, shape (f + 1,)."""
    columns = np.column_stack([cases.features, np.ones(len(cases))])
    sign = np.where(cases.is_so, -1.0, 1.0)

    def loss(weights: np.ndarray) -> float:
        return float(np.logaddexp(0.0, sign * (columns @ weights)).mean())

    return np.asarray(minimize(loss, np.zeros(columns.shape[1])).x)


def main() -> None:
    """Fit and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--piles", type=int, default=2000)
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    seeds = range(FIRST_SEED, FIRST_SEED + options.piles)
    scenes = [scene for pile in fresh_piles(seeds) for scene in scenes_of(pile)]
    fitted(scenes, options.out, np.random.default_rng(options.seed))


if __name__ == "__main__":
    begin(main)
