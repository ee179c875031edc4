"""Fit the evidence that singulation joins regions by, from labelled captures.

Run: python -m tests.benchmarks.fit_singulation FOLDER... --out evidence.json

Every capture is divided by the evidence that is shipped, and once by touch alone. All
pairs of regions met on the way are noted with their features and whether most points of
both lie on one object. Boosted symmetric trees are fitted to them by Newton steps
(Friedman, "Greedy function approximation", 2001). Lengths of a share of the pairs are
scaled at random, so that the size of things decides little.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from debrisgrasp.io import Capture
from debrisgrasp.segmentation import SegmentationConfig
from debrisgrasp.segmentation.ground import find_ground
from debrisgrasp.segmentation.singulation.borders import patch_graph
from debrisgrasp.segmentation.singulation.camera import inverse_depth_image
from debrisgrasp.segmentation.singulation.cells import cell_image
from debrisgrasp.segmentation.singulation.evidence import fitted_evidence
from debrisgrasp.segmentation.singulation.features import FEATURES
from debrisgrasp.segmentation.singulation.merging import merged_regions
from debrisgrasp.segmentation.singulation.patches import planar_patches
from debrisgrasp.segmentation.singulation.refine import pixel_patches

LENGTHS = {
    *("step", "offset_at_border", "opening", "jump", "plane_offset", "aside", "noise"),
    *(f"{edge}_{of}" for edge in ("length", "width", "thickness")
      for of in ("small", "large", "both")),
}  # fmt: skip
BINS = 48
MIN_POINTS = 20
MIN_PURITY = 0.75


@dataclass
class Pairs:
    """Pairs of regions: features (n, f), one object or not (n,), weights (n,)."""

    features: np.ndarray
    is_one: np.ndarray
    weight: np.ndarray

    @classmethod
    def joined(cls, parts: Iterable[Pairs]) -> Pairs:
        columns = zip(*((p.features, p.is_one, p.weight) for p in parts), strict=True)
        return cls(*(np.concatenate(column) for column in columns))

    def scaled(self, share: float, smallest: float, rng: np.random.Generator) -> Pairs:
        """Scale the lengths of some pairs by a factor from ``smallest`` to 1.2."""
        features = self.features.copy()
        chosen = np.flatnonzero(rng.random(len(features)) < share)
        factor = np.exp(rng.uniform(np.log(smallest), np.log(1.2), len(chosen)))
        for column, name in enumerate(FEATURES):
            if name in LENGTHS:
                features[chosen, column] *= factor
        return Pairs(features, self.is_one, self.weight)


def by_touch(features: np.ndarray) -> np.ndarray:
    """Return a crude score, so that pairs are also met that good scores avoid."""
    touch = features[:, FEATURES.index("touch_over_root_area")]
    smooth = np.nan_to_num(features[:, FEATURES.index("smooth")], nan=-1.0)
    sure = 0.6 + 0.39 * np.clip(smooth, 0, 1) * np.clip(touch / 2, 0, 1)
    return np.where((touch > 0.35) & (smooth > 0.3), sure, 0.0)


def pairs_of(path: Path, scores: list[Callable[[np.ndarray], np.ndarray]]) -> Pairs:
    """Collect the pairs met while merging one capture."""
    capture = Capture.load(path)
    config = SegmentationConfig()
    cloud = capture.cloud()
    standing = ~find_ground(cloud, config.ground)[0]
    image = inverse_depth_image(cloud)
    pixels = cloud.pixels[standing]
    mask = np.zeros(image.values.shape, dtype=bool)
    mask.ravel()[pixels] = True
    method = config.method
    cells = cell_image(image, mask, method.max_gap)
    gap = method.max_gap * max(1.0, 300.0 / cells.focal)
    patches = planar_patches(
        cells,
        max_gap=gap,
        max_increase=method.max_increase,
        sweeps=method.sweeps,
        min_cells=method.min_patch,
    )
    graph = patch_graph(cells, patches, gap)
    own = pixel_patches(image, cells, patches, pixels, gap)
    truth = capture.labels.ravel()[pixels].astype(np.int64)
    scored = (own >= 0) & (truth >= 0)
    counts = np.zeros((len(patches), int(truth.max()) + 1))
    np.add.at(counts, (own[scored], truth[scored]), 1.0)
    parts: list[Pairs] = []

    def note(region: np.ndarray, edges: np.ndarray, features: np.ndarray) -> None:
        table = np.zeros((int(region.max()) + 1, counts.shape[1]))
        np.add.at(table, region, counts)
        total, best = table.sum(axis=1), table.argmax(axis=1)
        clear = (total >= MIN_POINTS) & (table.max(axis=1) > MIN_PURITY * total)
        edges, features = (part[clear[edges].all(axis=1)] for part in (edges, features))
        a, b = edges.T
        weight = np.sqrt(np.minimum(total[a], total[b]))
        parts.append(Pairs(features, (best[a] == best[b]) & (best[a] > 0), weight))

    for score in scores:
        merged_regions(graph, cells, score, 0.5, observe=note)
    return Pairs.joined(parts)


def fitted_terms(
    pairs: Pairs,
    rng: np.random.Generator,
    *,
    n_terms: int = 200,
    depth: int = 4,
    rate: float = 0.12,
    ridge: float = 30.0,
) -> tuple[float, list[dict]]:
    """Prior log-odds and the terms of `Evidence`."""
    X = np.where(np.isnan(pairs.features), -np.inf, pairs.features).astype(np.float32)
    y, w = pairs.is_one.astype(float), pairs.weight / pairs.weight.mean()
    cuts = [thresholds_of(column) for column in X.T]
    # A value is above threshold j exactly if its bin is above j.
    bins = np.stack([np.searchsorted(c, x) for c, x in zip(cuts, X.T, strict=True)])
    share = np.average(y, weights=w)
    prior = float(np.log(share / (1 - share)))
    z = np.full(len(y), prior)
    terms = []
    for _ in range(n_terms):
        p = 1.0 / (1.0 + np.exp(-z))
        slope, bend = w * (y - p), w * p * (1 - p)
        rows = np.flatnonzero(rng.random(len(y)) < 0.4)
        columns = np.flatnonzero(rng.random(len(cuts)) < 0.5)
        leaf = np.zeros(len(rows), dtype=np.int64)
        questions = []
        for bit in range(depth):
            gains = [
                split_gains(
                    leaf, bins[k, rows], slope[rows], bend[rows], 1 << bit, ridge
                )[: len(cuts[k])]
                for k in columns
            ]
            at = int(np.argmax([gain.max() for gain in gains]))
            k, j = int(columns[at]), int(gains[at].argmax())
            questions.append((k, float(cuts[k][j])))
            leaf += (bins[k, rows] > j).astype(np.int64) << bit
        sums = [np.bincount(leaf, v[rows], 1 << depth) for v in (slope, bend)]
        value = rate * sums[0] / (sums[1] + ridge)
        answers = [(X[:, k] > t).astype(np.int64) << i
                   for i, (k, t) in enumerate(questions)]  # fmt: skip
        z += value[sum(answers)]
        terms.append(
            {
                "questions": [[FEATURES[k], float(f"{t:.5g}")] for k, t in questions],
                "log_odds": [float(f"{v:.4g}") for v in value],
            }
        )
    return prior, terms


def thresholds_of(column: np.ndarray) -> np.ndarray:
    """Quantiles of the known values, and one threshold that only unknown ones miss."""
    known = column[np.isfinite(column)]
    cuts = np.quantile(known, np.linspace(0, 1, BINS + 1)[1:-1]) if len(known) else []
    return np.unique(np.append(cuts, -1e9)).astype(np.float32)


def split_gains(leaf, bins, slope, bend, n_leaves, ridge):
    """Gain of splitting all leaves after each bin, shape (bins,)."""
    n_bins = BINS + 2
    key = leaf * n_bins + bins
    g, h = (
        np.bincount(key, v, n_leaves * n_bins).reshape(n_leaves, n_bins).cumsum(axis=1)
        for v in (slope, bend)
    )
    above_g, above_h = g[:, -1:] - g, h[:, -1:] - h
    return (g**2 / (h + ridge) + above_g**2 / (above_h + ridge)).sum(axis=0)


def main() -> None:
    """Fit and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scaled-share", type=float, default=0.4)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    paths = sorted(p for folder in options.folders for p in folder.glob("*.npz"))
    paths = [p for p in paths if not p.stem.endswith("_ground")]
    scores = [by_touch, fitted_evidence().probability]
    pairs = Pairs.joined(pairs_of(path, scores) for path in paths)
    pairs = pairs.scaled(options.scaled_share, 0.3, rng)
    prior, terms = fitted_terms(pairs, rng)
    about = f"Fitted to {len(pairs.is_one)} pairs of regions from {len(paths)} captures"
    rows = ",\n".join(f"    {json.dumps(term)}" for term in terms)
    options.out.write_text(
        f'{{\n  "about": {json.dumps(about)},\n  "prior": {prior:.5g},\n'
        f'  "terms": [\n{rows}\n  ]\n}}\n',
        encoding="utf-8",
    )


if __name__ == "__main__":
    main()
