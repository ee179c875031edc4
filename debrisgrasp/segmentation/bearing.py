"""What speaks for one object bearing on another, and for one carrying anything."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.geometry import PointCloud

from .contacts import Contacts, find_contacts
from .evidence import Evidence
from .occlusion import occluded_shares
from .segmentation import Segmentation
from .surface import LabelledSurface, Shapes

__all__ = [
    "BEARING",
    "BURDEN",
    "Seen",
    "bearing_evidence",
    "bearing_features",
    "burden_evidence",
    "burden_features",
]

BEARING = (
    # The contact, as the upper one sees it.
    "slope_above",
    "slope_below",
    "log_length",
    "front",
    "convexity",
    "overlap",
    "normal_up",
    "overlap_back",
    "upright",
    "rise",
    "gap",
    "gap_in_noise",
    "noise",
    "start_above",
    "end_above",
    "start_below",
    "end_below",
    "apart",
    "facing_above",
    "facing_below",
    # Heights over the ground.
    "contact_height",
    "contact_share_above",
    "contact_share_below",
    "lowest_above",
    "lowest_below",
    "highest_above",
    "highest_below",
    "middle_rise",
    "lowest_rise",
    "highest_rise",
    # Each of the two.
    *(f"log_extent_{k}_{of}" for of in ("above", "below") for k in (0, 1, 2)),
    *(
        f"{what}_{of}"
        for what in (
            "log_cells", "certainty", "occluded", "n_contacts",
            "from_middle", "from_middle_share", "from_foot",
        )
        for of in ("above", "below")
    ),
    # What a first guess from the contacts alone says of all.
    "guess",
    "guess_back",
    "guess_other_support",
    "guess_supports",
    "guess_others_on_below",
    "guess_on_above",
)  # fmt: skip
"""Names of the columns of `bearing_features`; lengths in [m]."""

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
)
"""Names of the columns of `burden_features`; lengths in [m]."""

_GUESS = np.array([1.64, -1.42, 0.41, 1.42, -1.03, 0.24, 0.87])
_GUESS_PRIOR = -0.89
"""Weights of the first seven features in a first guess, and its odds without any."""
_LENGTH_FLOOR = 0.01
"""Added to the length of contacts before its logarithm is taken [m]."""
_SMALL = 0.02
"""Added to lengths that others are divided by [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What was seen of the objects and of where they meet."""

    contacts: Contacts
    surface: LabelledSurface
    shapes: Shapes
    occluded: FloatArray
    """Share of each object's outline at which another one is in front, shape (s,)."""
    certainty: FloatArray
    """Of each object being one, shape (s,)."""

    @classmethod
    def of(
        cls,
        segmentation: Segmentation,
        cloud: PointCloud,
        surface: LabelledSurface,
        reach: float,
    ) -> Seen:
        """Measure a thinned cloud; surfaces touch up to ``reach`` [m] apart."""
        n = len(segmentation.segments)
        return cls(
            contacts=find_contacts(surface, reach),
            surface=surface,
            shapes=Shapes.of(surface, n),
            occluded=occluded_shares(cloud, segmentation.labels, n),
            certainty=np.array([s.certainty for s in segmentation.segments]),
        )

    def overlaps(self) -> FloatArray:
        """Share of each end of a contact over the other's outline, shape (c, 2)."""
        cells = self.surface.cells_of
        return np.array(
            [
                [
                    self.shapes.share_over(
                        self.surface.points[cells(int(own))], int(to)
                    )
                    for own, to in ((a, b), (b, a))
                ]
                for a, b in self.contacts.labels
            ]
        ).reshape(-1, 2)

    def of_objects(self) -> FloatArray:
        """Log extents and cells, certainty, occlusion, contacts, shape (s + 1, 7)."""
        shapes, labels = self.shapes, self.contacts.labels
        return np.column_stack(
            [
                np.log(shapes.extents + 0.005),
                np.log(np.maximum(shapes.n_cells, 1)),
                np.append(1.0, self.certainty),
                np.append(0.0, self.occluded),
                np.bincount(labels.ravel(), minlength=len(shapes.n_cells)),
            ]
        )

    def ground_level(self) -> FloatArray:
        """Find z of the ground under the middle cell of each object [m], (s + 1,)."""
        surface = self.surface
        level = np.append(surface.points[:, 2] - surface.height, 0.0)
        start = np.searchsorted(surface.labels, np.arange(len(self.shapes.n_cells)))
        middle: FloatArray = level[start + self.shapes.n_cells // 2]
        return middle


@cache
def bearing_evidence() -> Evidence:
    """Evidence that one object bears on another, fitted to simulated piles at rest."""
    return Evidence.shipped(__package__, "bearing.json", BEARING)


@cache
def burden_evidence() -> Evidence:
    """Evidence that anything bears on an object, fitted to simulated piles at rest."""
    return Evidence.shipped(__package__, "burden.json", BURDEN)


def bearing_features(seen: Seen) -> tuple[IntArray, FloatArray]:
    """Both directions of each contact, and what speaks for the first bearing.

    Returns
    -------
    relations, features
        (above, below) labels, shape (2 c, 2): all contacts, then all turned round; and
        the columns of `BEARING`, shape (2 c, f).
    """
    labels = seen.contacts.labels
    relations = np.concatenate([labels, labels[:, ::-1]])
    if not len(relations):
        return relations, np.zeros((0, len(BEARING)))
    over, alone, level = seen.overlaps(), seen.of_objects(), seen.ground_level()
    one_way = [
        np.column_stack(
            [
                *_at_contact(seen.contacts, seen.surface, over, above),
                *_heights(seen.contacts, seen.shapes, level, above),
                *_ends(seen.contacts, seen.shapes, alone, above),
            ]
        )
        for above in (0, 1)
    ]
    features = np.concatenate(one_way)
    guess = _sigmoid(features[:, : len(_GUESS)] @ _GUESS + _GUESS_PRIOR)
    return relations, np.column_stack([features, *_in_context(relations, guess)])


def _at_contact(
    contacts: Contacts, surface: LabelledSurface, over: FloatArray, above: int
) -> list[FloatArray]:
    sign, below = (1.0, 1) if above == 0 else (-1.0, 0)
    noise = _noise_at(contacts, surface)
    start, end = contacts.span[..., 0], contacts.span[..., 1]
    return [
        contacts.slope[:, above],
        contacts.slope[:, below],
        np.log(contacts.length + _LENGTH_FLOOR),
        sign * contacts.front,
        contacts.convexity,
        over[:, above],
        sign * contacts.normal[:, 2],
        over[:, below],
        np.abs(contacts.normal[:, 2]),
        sign * contacts.rise,
        contacts.gap,
        contacts.gap / np.maximum(noise, 1e-4),
        noise,
        start[:, above],
        end[:, above],
        start[:, below],
        end[:, below],
        0.5 * (start + end) @ np.array([sign, -sign]),
        contacts.facing[:, above],
        contacts.facing[:, below],
    ]


def _noise_at(contacts: Contacts, surface: LabelledSurface) -> FloatArray:
    """Estimate the deviation of the distance measured at each contact [m], (c,)."""
    share = np.median(
        surface.noise / np.square(surface.points - surface.viewpoint).sum(axis=1)
    )
    noise: FloatArray = share * np.square(contacts.place - surface.viewpoint).sum(1)
    return noise


def _heights(
    contacts: Contacts, shapes: Shapes, level: FloatArray, above: int
) -> list[FloatArray]:
    a, b = contacts.labels[:, above], contacts.labels[:, 1 - above]
    height = contacts.place[:, 2] - level[a]

    def share(label: IntArray) -> FloatArray:
        tall = shapes.highest[label] - shapes.lowest[label] + _SMALL
        part: FloatArray = (height - shapes.lowest[label]) / tall
        return part

    return [
        height,
        share(a),
        share(b),
        shapes.lowest[a],
        shapes.lowest[b],
        shapes.highest[a],
        shapes.highest[b],
        shapes.middle[a, 2] - shapes.middle[b, 2],
        shapes.lowest[a] - shapes.lowest[b],
        shapes.highest[a] - shapes.highest[b],
    ]


def _ends(
    contacts: Contacts, shapes: Shapes, alone: FloatArray, above: int
) -> list[FloatArray]:
    ends = contacts.labels[:, [above, 1 - above]]
    place = contacts.place[:, None, :2]
    from_middle = np.linalg.norm(place - shapes.middle[ends, :2], axis=2)
    share = from_middle / (shapes.extents[ends, 0] + _SMALL)
    from_foot = np.linalg.norm(place - shapes.foot[ends, :2], axis=2)
    extents = alone[ends, :3].reshape(len(ends), 6)
    others = [alone[ends, k] for k in range(3, alone.shape[1])]
    columns = [extents, *others, from_middle, share, from_foot]
    return [column for pair in columns for column in pair.T]


def _in_context(relations: IntArray, guess: FloatArray) -> list[FloatArray]:
    """Ask the first guess about the other relations of both ends."""
    a, b = relations.T
    n = int(relations.max()) + 1
    bears = np.zeros((n, n))
    bears[a, b] = guess
    row = np.arange(len(relations))
    supports, burdens = bears[a], bears[:, b].T
    on_above = bears[:, a].T
    supports[row, b] = burdens[row, a] = on_above[row, b] = 0.0
    return [
        guess,
        bears[b, a],
        supports.max(axis=1),
        supports.sum(axis=1),
        burdens.max(axis=1),
        on_above.max(axis=1),
    ]


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
    for k, share in enumerate(seen.overlaps()):
        a, b = contacts.labels[k]
        over[a, b], over[b, a] = share
        front[b] = max(front[b], contacts.front[k])
        front[a] = max(front[a], -contacts.front[k])
        higher[b if shapes.highest[a] > shapes.highest[b] else a] += 1
    alone = seen.of_objects()
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
        ]
    )
    return features[1:]


def _sigmoid(x: FloatArray) -> FloatArray:
    result: FloatArray = 1.0 / (1.0 + np.exp(-np.clip(x, -60.0, 60.0)))
    return result
