"""What speaks for an object carrying anything, also what wasn't seen to touch it."""

from __future__ import annotations

from functools import cache

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray

from .bearing import likeliest_kin
from .evidence import Evidence
from .seen import Seen

__all__ = ["BURDEN", "burden_evidence", "burden_features"]

BURDEN = (
    "carries",
    "carries_most",
    "n_on_it",
    "rests",
    "occluded",
    "certainty",
    "log_cells",
    "lowest",
    "highest",
    "below_top",
    *(f"log_extent_{k}" for k in (0, 1, 2)),
    "n_contacts",
    "covered",
    "covered_most",
    "lies_over",
    "higher_neighbours",
    "steepest_front",
    "n_objects",
    "kin",
    "kin_carries",
)
"""Names of the columns of `burden_features`; lengths in [m]."""


@cache
def burden_evidence() -> Evidence:
    """Evidence that anything bears on an object, fitted to simulated piles at rest."""
    return Evidence.shipped(__package__, "burden.json", BURDEN)


def burden_features(
    relations: IntArray, confidence: FloatArray, seen: Seen
) -> FloatArray:
    """Gather what speaks for anything bearing on each object: `BURDEN`, shape (s, f).

    Parameters
    ----------
    relations, confidence
        (above, below) labels of what was seen, shape (r, 2), and probability, (r,).
    """
    contacts, shapes = seen.contacts, seen.shapes
    n = len(seen.occluded)
    bears = np.zeros((n + 1, n + 1))
    bears[relations[:, 0], relations[:, 1]] = confidence
    over = np.zeros((n + 1, n + 1))
    front = np.full(n + 1, -1.0)
    higher = np.zeros(n + 1)
    for k, share in enumerate(seen.overlaps):
        a, b = contacts.labels[k]
        over[a, b], over[b, a] = share
        front[b] = max(front[b], contacts.front[k])
        front[a] = max(front[a], -contacts.front[k])
        higher[b if shapes.highest[a] > shapes.highest[b] else a] += 1
    alone = seen.of_objects()
    kin, likely = likeliest_kin(seen.kinship)
    on_kin = bears[:, kin].T
    np.fill_diagonal(on_kin, 0.0)  # its own weight
    features = np.column_stack(
        [
            1.0 - np.prod(1.0 - bears, axis=0),
            bears.max(axis=0),
            bears.sum(axis=0),
            bears[:, 1:].sum(axis=1),
            alone[:, 5],
            alone[:, 4],
            alone[:, 3],
            shapes.lowest,
            shapes.highest,
            shapes.highest.max() - shapes.highest,
            alone[:, :3],
            alone[:, 6],
            over.sum(axis=0),
            over.max(axis=0),
            over.max(axis=1),
            higher,
            front,
            np.full(n + 1, n),
            likely,
            likely * (1.0 - np.prod(1.0 - on_kin, axis=1)),
        ]
    )
    return features[1:]
