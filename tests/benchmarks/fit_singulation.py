"""Fit the evidence that singulation joins regions by, to piles and stacks of things.

Run: python -m tests.benchmarks.fit_singulation --out FILE [--piles N]

The same piles and seed give the same file. Every capture is divided by touch alone,
then by a first fit to what that met, and by a second one. All pairs of regions met on
the way are noted with their features and whether most points of both lie on one object
(Ross et al., "A reduction of imitation learning and structured prediction to no-regret
online learning", 2011: a score is to be right about what its own joins lead to). A fit
divides only captures that it did not learn from: on its own it would join too well.
Lengths of a share of the pairs are scaled at random, so that the size of things decides
little.
The labelled captures of real tables beside the checkout, if there are any, are learnt
from too: what is reported on them is no proof.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np

from debrisgrasp.geometry import PointCloud
from debrisgrasp.io import Capture
from debrisgrasp.segmentation import SegmentationConfig
from debrisgrasp.segmentation.ground import find_ground
from debrisgrasp.segmentation.singulation import SingulationConfig
from debrisgrasp.segmentation.singulation.borders import patch_graph
from debrisgrasp.segmentation.singulation.camera import inverse_depth_image
from debrisgrasp.segmentation.singulation.cells import CellImage, cell_image
from debrisgrasp.segmentation.singulation.features import FEATURES
from debrisgrasp.segmentation.singulation.graph import RegionGraph
from debrisgrasp.segmentation.singulation.merging import merged_regions
from debrisgrasp.segmentation.singulation.notches import flush_bars_apart
from debrisgrasp.segmentation.singulation.patches import planar_patches

from .boosting import Boosting, Cases, write_evidence
from .piles import FreshPile, fresh_piles, fresh_stack, fresh_strangers
from .report import begin
from .segmentation import DATA, reference
from .strangers import LEARNT

FIRST_SEED = 30_000
"""Of the piles to learn from; benchmarks report on others."""
STACKS = 24
"""Piles of debris for each stack of household things."""
STRANGERS = 5
"""Piles of debris for each pile of things that the generator does not make."""
STACK_WEIGHT = 2.0
"""What pairs of stacks count: they are few."""
REAL_WEIGHT = 4.0
"""What pairs of real captures count: these are three."""
SCALED_SHARE = 0.3
LENGTHS = {
    *("step", "offset_at_border", "opening", "jump", "plane_offset", "aside", "noise",
      "contact_width", "end_near", "end_far"),
    *(f"{edge}_{of}" for edge in ("length", "width", "thickness")
      for of in ("small", "large", "both")),
}  # fmt: skip
MIN_CELLS = 5
MIN_PURITY = 0.75
FALSE_JOIN = 1.5
"""What joining two objects counts against splitting one."""
ROUNDS = (Boosting(n_terms=60), Boosting(n_terms=160))
"""Fits whose joins lead to what the next one learns from."""
BOOSTING = Boosting(n_terms=400, depth=6, rate=0.12, row_share=0.2)
Score = Callable[[np.ndarray], np.ndarray]


@dataclass
class Divided:
    """One capture up to the point where regions are merged."""

    cells: CellImage
    graph: RegionGraph
    counts: np.ndarray
    """Cells of each patch on each object, shape (p, objects)."""
    weight: float = 1.0
    """What its pairs count."""
    half: int = 0
    """0 or 1: it is divided by what the other half of the captures taught."""

    @classmethod
    def of(cls, capture: Capture, truth: np.ndarray) -> Divided | None:
        """Divide what stands into patches; None if nothing does."""
        config = SegmentationConfig()
        cloud: PointCloud = capture.cloud()
        standing = ~find_ground(cloud, config.ground)[0]
        if not standing.any():
            return None
        image = inverse_depth_image(cloud)
        mask = np.zeros(image.values.shape, dtype=bool)
        mask.ravel()[cloud.pixels[standing]] = True
        return cls.of_cells(cell_image(image, mask, config.method.max_gap), truth)

    @classmethod
    def of_cells(cls, cells: CellImage, truth: np.ndarray) -> Divided:
        """Divide an image of cells into patches."""
        method = SingulationConfig()
        gap = method.max_gap * max(1.0, 300.0 / cells.focal)
        patches = planar_patches(
            cells,
            max_gap=gap,
            max_increase=method.max_increase,
            sweeps=method.sweeps,
            min_cells=method.min_patch,
        )
        patches = flush_bars_apart(cells, patches)
        labels = truth[:: cells.edge, :: cells.edge].astype(np.int64)
        scored = (patches.labels >= 0) & (labels >= 0)
        counts = np.zeros((len(patches), int(truth.max(initial=0)) + 1))
        np.add.at(counts, (patches.labels[scored], labels[scored]), 1.0)
        return cls(cells, patch_graph(cells, patches, gap), counts)

    def pairs(self, score: Score) -> Cases:
        """Collect the pairs met while merging by a score."""
        parts: list[Cases] = []

        def note(region: np.ndarray, edges: np.ndarray, features: np.ndarray) -> None:
            table = np.zeros((int(region.max()) + 1, self.counts.shape[1]))
            np.add.at(table, region, self.counts)
            total, best = table.sum(axis=1), table.argmax(axis=1)
            clear = (total >= MIN_CELLS) & (table.max(axis=1) > MIN_PURITY * total)
            chosen = clear[edges].all(axis=1)
            a, b = edges[chosen].T
            is_one = (best[a] == best[b]) & (best[a] > 0)
            weight = np.sqrt(np.minimum(total[a], total[b]))
            weight *= self.weight * np.where(is_one, 1.0, FALSE_JOIN)
            parts.append(Cases(features[chosen].astype(np.float32), is_one, weight))

        nothing = Cases(np.empty((0, len(FEATURES))), np.empty(0, bool), np.empty(0))
        merged_regions(self.graph, self.cells, score, 0.5, observe=note)
        return Cases.joined([nothing, *parts])


def by_touch(features: np.ndarray) -> np.ndarray:
    """Return a crude score, so that pairs are also met that good scores avoid."""
    touch = features[:, FEATURES.index("touch_over_root_area")]
    smooth = np.nan_to_num(features[:, FEATURES.index("smooth")], nan=-1.0)
    sure = 0.6 + 0.39 * np.clip(smooth, 0, 1) * np.clip(touch / 2, 0, 1)
    return np.where((touch > 0.35) & (smooth > 0.3), sure, 0.0)


def shaken(cases: Cases, rng: np.random.Generator) -> Cases:
    """Scale the lengths of some pairs by a factor from 0.3 to 1.2."""
    features = cases.features.copy()
    chosen = np.flatnonzero(rng.random(len(features)) < SCALED_SHARE)
    factor = np.exp(rng.uniform(np.log(0.3), np.log(1.2), len(chosen)))
    for column, name in enumerate(FEATURES):
        if name in LENGTHS:
            features[chosen, column] *= factor
    return replace(cases, features=features)


def divided(pile: FreshPile) -> Iterator[Divided]:
    """Both captures of a pile as far as their patches."""
    for capture in (pile.clean, pile.noisy):
        parts = Divided.of(capture, pile.labels)
        if parts is not None:
            yield replace(parts, half=pile.seed % 2)


def real() -> Iterator[Divided]:
    """Labelled captures of real tables, as far as their patches."""
    for number, path in enumerate(sorted(DATA.glob("real/osd_*.npz"))):
        parts = Divided.of(Capture.load(path).posed("level"), reference(path))
        if parts is not None:
            yield replace(parts, weight=REAL_WEIGHT, half=number % 2)


def met(captures: list[Divided], rng: np.random.Generator) -> Cases:
    """Pairs met by touch alone, and by what these teach; lengths of some scaled."""
    cases = [[part.pairs(by_touch)] for part in captures]
    for boosting in ROUNDS:
        scores = []
        for half in (0, 1):
            others = chain.from_iterable(
                noted
                for part, noted in zip(captures, cases, strict=True)
                if part.half != half
            )
            learnt = shaken(Cases.joined(others), rng)
            scores.append(boosting.evidence(learnt, FEATURES, rng).probability)
        for part, noted in zip(captures, cases, strict=True):
            noted.append(part.pairs(scores[part.half]))
    return shaken(Cases.joined(chain.from_iterable(cases)), rng)


def main() -> None:
    """Fit and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--piles", type=int, default=530)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    seeds = range(FIRST_SEED, FIRST_SEED + options.piles)
    stacks = map(fresh_stack, seeds[: options.piles // STACKS])
    others = (fresh_strangers(s, LEARNT) for s in seeds[: options.piles // STRANGERS])
    piles = chain(fresh_piles(seeds), others)
    captures = [part for pile in piles for part in divided(pile)]
    for pile in stacks:
        captures += [replace(part, weight=STACK_WEIGHT) for part in divided(pile)]
    captures += real()
    cases = met(captures, rng)
    about = (
        "Symmetric trees of Evidence, fitted by tests.benchmarks.fit_singulation to "
        f"{len(cases)} pairs of regions from {len(captures)} captures of piles"
    )
    write_evidence(options.out, about, *BOOSTING.fitted(cases, FEATURES, rng))


if __name__ == "__main__":
    begin(main)
