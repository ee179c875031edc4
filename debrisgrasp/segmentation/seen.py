"""What was seen of the objects, and of where they meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.geometry import PointCloud

from .contacts import Contacts, find_contacts
from .occlusion import occluded_shares
from .segmentation import Segmentation
from .surface import LabelledSurface, Shapes

__all__ = ["Columns", "Seen"]

_COLUMN = 0.015
"""Edge of the columns in which two objects are one below the other [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """Upright columns of a grid in which both ends of a contact were seen.

    Arrays of two columns tell of the first end over the second, and of the second over
    the first.
    """

    number: IntArray
    """How many there are, shape (c,)."""
    least: FloatArray
    """How far the lowest of one is over the highest of the other [m], the least of all
    columns, shape (c, 2); NaN if there are none."""
    middle: FloatArray
    """The median of that, shape (c, 2)."""

    @classmethod
    def of(cls, pairs: IntArray, surface: LabelledSurface) -> Columns:
        """Measure pairs of labels (c, 2)."""
        grid = np.floor(surface.points[:, :2] / _COLUMN).astype(np.int64)
        grid -= grid.min(axis=0, initial=0)
        key = grid[:, 0] * (grid[:, 1].max(initial=0) + 1) + grid[:, 1]
        heights = {}
        for label in np.unique(pairs).tolist():
            own = surface.cells_of(label)
            order = np.lexsort((surface.points[own, 2], key[own]))
            where, z = key[own][order], surface.points[own, 2][order]
            starts = np.flatnonzero(np.diff(where, prepend=-1))
            ends = np.append(starts[1:], len(where)) - 1
            heights[label] = where[starts], z[starts], z[ends]
        number = np.zeros(len(pairs), dtype=np.int64)
        least, middle = np.full((2, len(pairs), 2), np.nan)
        for k, (a, b) in enumerate(pairs.tolist()):
            (of_a, low_a, high_a), (of_b, low_b, high_b) = heights[a], heights[b]
            common, at_a, at_b = np.intersect1d(
                of_a, of_b, assume_unique=True, return_indices=True
            )
            number[k] = len(common)
            if len(common):
                over = low_a[at_a] - high_b[at_b], low_b[at_b] - high_a[at_a]
                least[k], middle[k] = np.min(over, axis=1), np.median(over, axis=1)
        return cls(number, least, middle)


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
    kinship: FloatArray
    """Probability of two labels being one object, shape (s + 1, s + 1)."""
    overlaps: FloatArray
    """Share of each end of a contact over the other's outline, shape (c, 2)."""
    columns: Columns
    """Where both ends of each contact were seen one below the other."""

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
        kinship = np.zeros((n + 1, n + 1))
        if segmentation.kinship is not None:
            kinship[1:, 1:] = segmentation.kinship
            np.fill_diagonal(kinship, 0.0)
        contacts, shapes = find_contacts(surface, reach), Shapes.of(surface, n)
        return cls(
            contacts=contacts,
            surface=surface,
            shapes=shapes,
            occluded=occluded_shares(cloud, segmentation.labels, n),
            certainty=np.array([s.certainty for s in segmentation.segments]),
            kinship=kinship,
            overlaps=_overlaps(contacts, surface, shapes),
            columns=Columns.of(contacts.labels, surface),
        )

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


def _overlaps(
    contacts: Contacts, surface: LabelledSurface, shapes: Shapes
) -> FloatArray:
    return np.array(
        [
            [
                shapes.share_over(surface.points[surface.cells_of(own)], to)
                for own, to in ((a, b), (b, a))
            ]
            for a, b in contacts.labels.tolist()
        ]
    ).reshape(-1, 2)
