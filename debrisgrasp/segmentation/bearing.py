"""What speaks for one object bearing on another."""

from __future__ import annotations

from functools import cache

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray

from .contacts import Contacts
from .evidence import Evidence
from .seen import Seen
from .surface import LabelledSurface, Shapes

__all__ = [
    "BEARING",
    "CONTACT",
    "bearing_evidence",
    "contact_evidence",
    "contact_features",
    "context_evidence",
    "in_context",
    "judged_relations",
    "likeliest_kin",
]

CONTACT = (
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
    # How they lie over one another.
    "drop",
    "log_pairs",
    "log_pairs_over",
    "share_above",
    "share_below",
    "log_columns",
    "least_clearance",
    "clearance",
    "along_above",
    "along_below",
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
            "tilt", "low_down", "place_along",
        )
        for of in ("above", "below")
    ),
    # What else may be the same object.
    "kinship",
    *(f"{what}_{of}" for what in ("kin", "kin_lowest") for of in ("above", "below")),
)  # fmt: skip
"""Names of the columns of `contact_features`; lengths in [m]."""

BEARING = (
    *CONTACT,
    # What the contacts alone say of this one, and of the others of both ends.
    "alone",
    "back",
    "other_support",
    "other_supports",
    "others_on_below",
    "others_on_above",
    "lead",
    "kin_support",
    "kin_carries",
)
"""Names of the columns of `in_context`; probabilities."""

_LENGTH_FLOOR = 0.01
"""Added to the length of contacts before its logarithm is taken [m]."""
_SMALL = 0.02
"""Added to lengths that others are divided by [m]."""


def likeliest_kin(kinship: FloatArray) -> tuple[IntArray, FloatArray]:
    """Find what each label is likeliest one with, and how likely, (s + 1,) each."""
    return kinship.argmax(axis=1), kinship.max(axis=1)


@cache
def contact_evidence() -> Evidence:
    """Evidence of a contact by itself, fitted to simulated piles at rest."""
    return Evidence.shipped(__package__, "contact.json", CONTACT)


@cache
def context_evidence() -> Evidence:
    """Evidence of a contact, knowing what `contact_evidence` says of the others."""
    return Evidence.shipped(__package__, "context.json", BEARING)


@cache
def bearing_evidence() -> Evidence:
    """Evidence of a contact, knowing what `context_evidence` says of the others."""
    return Evidence.shipped(__package__, "bearing.json", BEARING)


def judged_relations(seen: Seen) -> tuple[IntArray, FloatArray]:
    """Both directions of each contact, (2 c, 2), and how likely each bears, (2 c,).

    Each contact is judged by itself first, then twice more, knowing what was said of
    the others: what stands firmly on something else hardly leans on this.
    """
    relations, features = contact_features(seen)
    confidence = contact_evidence().probability(features)
    for evidence in (context_evidence(), bearing_evidence()):
        among = in_context(relations, features, confidence, seen.kinship)
        confidence = evidence.probability(among)
    return relations, confidence


def contact_features(seen: Seen) -> tuple[IntArray, FloatArray]:
    """Both directions of each contact, and what speaks for the first bearing.

    Returns
    -------
    relations, features
        (above, below) labels, shape (2 c, 2): all contacts, then all turned round; and
        the columns of `CONTACT`, shape (2 c, f).
    """
    labels = seen.contacts.labels
    relations = np.concatenate([labels, labels[:, ::-1]])
    if not len(relations):
        return relations, np.zeros((0, len(CONTACT)))
    over, alone, level = seen.overlaps, seen.of_objects(), seen.ground_level()
    one_way = [
        np.column_stack(
            [
                *_at_contact(seen.contacts, seen.surface, over, above),
                *_one_over_the_other(seen, above),
                *_heights(seen.contacts, seen.shapes, level, above),
                *_ends(seen.contacts, seen.shapes, alone, above),
                *_kin(seen, above),
            ]
        )
        for above in (0, 1)
    ]
    return relations, np.concatenate(one_way)


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


def _one_over_the_other(seen: Seen, above: int) -> list[FloatArray]:
    contacts, columns = seen.contacts, seen.columns
    sign, below = (1.0, 1) if above == 0 else (-1.0, 0)
    axes = seen.shapes.axis[contacts.labels]
    along = np.abs(np.einsum("ki,kji->kj", contacts.axis, axes))
    return [
        sign * contacts.drop,
        np.log1p(contacts.n_pairs),
        np.log1p(contacts.n_over),
        contacts.share[:, above],
        contacts.share[:, below],
        np.log1p(columns.number),
        columns.least[:, above],
        columns.middle[:, above],
        along[:, above],
        along[:, below],
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
    axes = shapes.axis[ends]
    off_middle = contacts.place[:, None] - shapes.middle[ends]
    place_along = np.abs(np.einsum("kji,kji->kj", off_middle, axes))
    place_along /= shapes.extents[ends, 0] + _SMALL
    held = [axes[..., 2], shapes.low_down[ends], place_along]
    columns = [extents, *others, from_middle, share, from_foot, *held]
    return [column for pair in columns for column in pair.T]


def _kin(seen: Seen, above: int) -> list[FloatArray]:
    a, b = seen.contacts.labels[:, above], seen.contacts.labels[:, 1 - above]
    kin, likely = likeliest_kin(seen.kinship)
    lowest = np.where(likely > 0.0, seen.shapes.lowest[kin], np.nan)
    return [seen.kinship[a, b], likely[a], likely[b], lowest[a], lowest[b]]


def in_context(
    relations: IntArray,
    features: FloatArray,
    alone: FloatArray,
    kinship: FloatArray,
) -> FloatArray:
    """Add to `CONTACT` what the relations say of each other: `BEARING`, (r, f).

    Parameters
    ----------
    relations, alone
        (above, below) labels, shape (r, 2), and how likely each is by itself, (r,).
    features
        `CONTACT` of each, shape (r, f).
    kinship
        See `Seen`.
    """
    if not len(relations):
        return np.zeros((0, len(BEARING)))
    a, b = relations.T
    n = len(kinship)
    bears = np.zeros((n, n))
    bears[a, b] = alone
    kin, likely = likeliest_kin(kinship)
    by_kin = likely[a, None] * bears[kin[a]]
    on_kin = likely[b, None] * bears[:, kin[b]].T
    row = np.arange(len(relations))
    supports, burdens, on_above = bears[a], bears[:, b].T, bears[:, a].T
    supports[row, b] = burdens[row, a] = on_above[row, b] = 0.0
    by_kin[row, b] = on_kin[row, a] = 0.0
    # Parts of one object that hold each other tell nothing of it.
    by_kin[row, a] = on_kin[row, b] = 0.0
    return np.column_stack(
        [
            features,
            alone,
            bears[b, a],
            supports.max(axis=1),
            supports.sum(axis=1),
            burdens.max(axis=1),
            on_above.max(axis=1),
            alone - supports.max(axis=1),
            by_kin.max(axis=1),
            on_kin.max(axis=1),
        ]
    )
