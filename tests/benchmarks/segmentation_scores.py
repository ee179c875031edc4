"""Scores of a segmentation against reference labels.

Stein et al., "Object Partitioning using Local Convexity", CVPR 2014, and the adjusted
Rand index.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Scores", "scores"]


@dataclass(frozen=True, slots=True)
class Scores:
    """How well segments cover objects; 0 in either labelling is not an object."""

    wov: float
    """Weighted overlap: IoU of the best segment, weighted by the objects' sizes."""
    fos: float
    """Over-segmentation: share of the objects outside their best segments."""
    fus: float
    """Under-segmentation: what best segments cover beyond their objects, relative to
    the objects' size; may exceed 1 when a segment swallows the ground."""
    fusc: float
    """The same with each object's part limited to its own size."""
    ari: float
    """Adjusted Rand index over the points of objects."""
    found: float
    """Share of the objects with a segment of IoU 0.5 or more."""


def scores(labels: np.ndarray, truth: np.ndarray) -> Scores:
    """Compare labels with the truth; points with a negative truth are not scored."""
    scored = truth >= 0
    objects, i = np.unique(truth[scored], return_inverse=True)
    segments, j = np.unique(labels[scored], return_inverse=True)
    shape = (len(objects), len(segments))
    table = np.bincount(i * shape[1] + j, minlength=shape[0] * shape[1]).reshape(shape)
    on_objects = table[objects > 0]
    size = on_objects.sum(axis=1)
    common = on_objects[:, segments > 0]
    segment_size = table[:, segments > 0].sum(axis=0)
    if not common.size:
        return Scores(wov=0.0, fos=1.0, fus=0.0, fusc=0.0, ari=0.0, found=0.0)
    iou = common / (size[:, None] + segment_size - common)
    best = common.argmax(axis=1)
    true = common[np.arange(len(size)), best]
    false = segment_size[best] - true
    total = size.sum()
    return Scores(
        wov=float(size @ iou.max(axis=1) / total),
        fos=float(1 - true.sum() / total),
        fus=float(false.sum() / total),
        fusc=float(np.minimum(false, size).sum() / total),
        ari=_adjusted_rand_index(on_objects),
        found=float(np.mean(iou.max(axis=1) >= 0.5)),
    )


def _adjusted_rand_index(table: np.ndarray) -> float:
    def pairs(n: np.ndarray) -> float:
        return float((n * (n - 1.0) / 2.0).sum())

    together = pairs(table)
    rows, columns = pairs(table.sum(axis=1)), pairs(table.sum(axis=0))
    expected = rows * columns / pairs(table.sum(keepdims=True))
    most = 0.5 * (rows + columns)
    return 1.0 if most == expected else (together - expected) / (most - expected)
