"""Where visible surfaces of different objects meet, and which face they meet on."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from debrisgrasp._arrays import FloatArray, IntArray, frozen

from .surface import LabelledSurface, inside_box, main_axes, quantiles
from .touching import touching_cells

__all__ = ["Contacts", "find_contacts"]

_ZONE = 0.04
"""How far around a contact the surfaces are looked at [m]."""
_STEP = 0.02
"""Edge of the cells in which the length of a contact is counted [m]."""
_STEP_LENGTH = 0.009
"""Length of contact for each such cell [m]: the band of points that touch is wider than
one, and crosses them at any angle."""
_MOST_PLACES = 40
"""Places along a contact that distances are measured to."""
_MOST_FACES = 10
"""Cells of each surface whose faces are tried as the face of contact."""
_SOFTNESS = 0.08
"""Share of cells on the wrong side that makes a face of contact unlikely."""
_UPRIGHT = 0.05
"""Weight of an upright face of contact against that of a level one."""
_SPAN = (0.1, 0.9)
"""Quantiles of the heights around a contact at which a surface starts and ends."""
_NEAREST, _NEARLY = 0.3, 0.006
"""Share of the pairs of cells, and distance beyond that of the nearest [m], that the
direction of a contact is told by."""
_OVER = 0.012
"""Level distance up to which one cell lies over another [m]."""
_CLEAR_SLOPE = 0.25
"""Difference of slope from which one object lies higher than the other."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Contacts:
    """Where objects meet, as far as it was seen.

    Arrays of two columns tell of the first and of the second object of each pair.
    """

    labels: IntArray
    """Pairs of labels (a, b), a < b, ascending, shape (c, 2)."""
    place: FloatArray
    """Middle of the contact [m], shape (c, 3)."""
    length: FloatArray
    """Length over which the surfaces were seen to touch, within noise [m], shape (c,);
    0 where one merely passes close before the other."""
    normal: FloatArray
    """Unit normal of the face on which they meet, from b to a, shape (c, 3); zero if no
    face of either divides them."""
    convexity: FloatArray
    """Cosine of how the normals turn away from each other, from -1 (inner corner) to 1
    (outer edge), shape (c,)."""
    front: FloatArray
    """How far a is before b as the sensor sees them, over their distance, from -1 (b
    hides a) to 1, shape (c,)."""
    gap: FloatArray
    """Mean distance between the cells that touch [m], shape (c,)."""
    rise: FloatArray
    """Mean sine of the elevation of a's cells over those of b that they touch, (c,)."""
    slope: FloatArray
    """Mean rise of each surface over its distance from the contact, shape (c, 2)."""
    span: FloatArray
    """Where each surface starts and ends around the contact, over its middle along
    gravity [m], shape (c, 2, 2)."""
    facing: FloatArray
    """How far each surface faces up around the contact, the mean z of its normals,
    shape (c, 2)."""
    axis: FloatArray
    """Unit direction along which they touch, shape (c, 3)."""
    drop: FloatArray
    """How far a's cells are over those of b that they touch and that lie below or over
    them, the median [m], shape (c,); NaN if none do."""
    n_over: FloatArray
    """How many such pairs of cells there are, shape (c,)."""
    n_pairs: FloatArray
    """How many pairs of cells touch, shape (c,)."""
    share: FloatArray
    """Share of the cells of each object that touch the other, shape (c, 2)."""
    upper: IntArray
    """Label of the one that lies above the other along gravity, 0 if neither does,
    shape (c,)."""

    def __len__(self) -> int:
        return len(self.labels)


def find_contacts(surface: LabelledSurface, reach: float) -> Contacts:
    """Find and measure the contacts of a thinned cloud.

    Parameters
    ----------
    surface
        The thinned cloud, z up.
    reach
        Largest gap between touching surfaces [m]; the noise of both comes on top.
    """
    pairs = touching_cells(surface, reach)
    ends = surface.labels[pairs]
    is_first = (np.diff(ends, axis=0, prepend=0) != 0).any(axis=1)
    contact, labels = np.cumsum(is_first) - 1, ends[is_first]
    points, normals = surface.points[pairs], surface.normals[pairs]
    middles, between = points.mean(axis=1), points[:, 0] - points[:, 1]
    gap = np.maximum(np.linalg.norm(between, axis=1), 1e-9)
    turn = np.einsum("ki,ki->k", normals[:, 0] - normals[:, 1], between)
    away = np.linalg.norm(points - surface.viewpoint, axis=2)
    apart = _first_in_steps(middles, contact)
    around = [
        _Around.of(surface, pairs[own], middles[own], between[own], middles[places])
        for own, places in zip(
            _parted(contact, len(labels)),
            (
                _spread(apart[own], _MOST_PLACES)
                for own in _parted(contact[apart], len(labels))
            ),
            strict=True,
        )
    ]

    def mean(values: FloatArray) -> FloatArray:
        means = np.bincount(contact, values, len(labels)) / np.bincount(contact)
        return frozen(means, "mean over the pairs of cells", ())

    def column(field: str, trailing: tuple[int | None, ...]) -> FloatArray:
        values = np.array([getattr(item, field) for item in around], dtype=np.float64)
        return frozen(values.reshape(len(labels), *trailing), field, trailing)

    slope = column("slope", (2,))
    difference = slope[:, 0] - slope[:, 1]
    upper = np.where(difference > 0, labels[:, 0], labels[:, 1])
    return Contacts(
        labels=frozen(labels, "contact labels", (2,), np.int64),
        place=column("place", (3,)),
        length=frozen(_lengths([item.touching for item in around]), "length", ()),
        normal=column("normal", (3,)),
        convexity=mean(0.5 * turn / gap),
        front=mean((away[:, 1] - away[:, 0]) / gap),
        gap=mean(gap),
        rise=mean(between[:, 2] / gap),
        slope=slope,
        span=column("span", (2, 2)),
        facing=column("facing", (2,)),
        axis=column("axis", (3,)),
        drop=column("drop", ()),
        n_over=column("n_over", ()),
        n_pairs=column("n_pairs", ()),
        share=column("n_touching", (2,)) / np.bincount(surface.labels)[labels],
        upper=np.where(np.abs(difference) > _CLEAR_SLOPE, upper, 0),
    )


def _parted(group: IntArray, n: int) -> list[slice]:
    """Where each of n groups is among rows whose groups ascend."""
    cuts = np.searchsorted(group, np.arange(n + 1)).tolist()
    return [slice(start, stop) for start, stop in pairwise(cuts)]


def _spread(index: IntArray, most: int) -> IntArray:
    """Keep at most so many, from the first to the last."""
    if len(index) <= most:
        return index
    kept: IntArray = index[np.linspace(0, len(index) - 1, most).astype(int)]
    return kept


@dataclass(frozen=True, slots=True, eq=False)
class _Around:
    """The surfaces around one contact; see `Contacts`."""

    place: FloatArray
    normal: FloatArray
    slope: list[float]
    span: list[FloatArray]
    facing: list[float]
    axis: FloatArray
    drop: float
    n_over: int
    n_pairs: int
    n_touching: list[int]
    """Cells of each object in the pairs."""
    touching: tuple[FloatArray, FloatArray]
    """Measured points of each object that touch the other, shapes (k, 3)."""

    @classmethod
    def of(
        cls,
        surface: LabelledSurface,
        pairs: IntArray,
        middles: FloatArray,
        between: FloatArray,
        places: FloatArray,
    ) -> _Around:
        """Measure pairs of cells (k, 2).

        Given are their middles, the way from the second cell of each to the first
        (k, 3), and the middles of a few of them (m, 3).
        """
        gap = np.linalg.norm(between, axis=1)
        nearest = max(float(quantiles(gap, (_NEAREST,))[0]), gap.min() + _NEARLY)
        drop = between[np.hypot(between[:, 0], between[:, 1]) < _OVER, 2]
        low, high = middles.min(axis=0), middles.max(axis=0)
        margin = max(_ZONE, _STEP + surface.size)
        near = [
            _cells_in(surface, int(label), low - margin, high + margin)
            for label in surface.labels[pairs[0]]
        ]
        measured = [surface.points_in(cells) for cells in near]
        beside = [p[inside_box(p, low - _STEP, high + _STEP)] for p in measured]
        noise, spacing = (
            float(quantiles(of[pairs].ravel(), (0.5,))[0])
            for of in (surface.noise, surface.spacing)
        )
        first = _within(beside[0], beside[1], noise + 2.0 * spacing)
        # What touches something of the first touches one of those.
        second = _within(beside[1], first, noise + 2.0 * spacing)
        zones = [_Zone.of(surface, cells, places) for cells in near]
        middle = places.mean(axis=0)
        return cls(
            place=middle,
            normal=_face(surface, zones, surface.size + 1.5 * noise),
            slope=[zone.slope for zone in zones],
            span=[_span(surface.points[zone.cells, 2] - middle[2]) for zone in zones],
            facing=[
                surface.normals[zone.cells, 2].sum() / max(len(zone.cells), 1)
                for zone in zones
            ],
            axis=main_axes(middles[gap <= nearest])[:, 0],
            drop=float(np.median(drop)) if len(drop) else np.nan,
            n_over=len(drop),
            n_pairs=len(pairs),
            n_touching=[len(np.unique(side)) for side in pairs.T],
            touching=(first, second),
        )


def _cells_in(
    surface: LabelledSurface, label: int, low: FloatArray, high: FloatArray
) -> IntArray:
    """Cells of a label inside a box."""
    own = surface.cells_of(label)
    found: IntArray = inside_box(surface.points[own], low, high) + own.start
    return found


def _span(height: FloatArray) -> FloatArray:
    """Heights at which a surface starts and ends, (2,); zero if none of it is near."""
    return quantiles(height, _SPAN) if len(height) else np.zeros(2)


def _within(points: FloatArray, others: FloatArray, reach: float) -> FloatArray:
    """Keep the points (n, 3) nearer than some reach to any of the others (m, 3)."""
    tree = cKDTree(others, balanced_tree=False, compact_nodes=False)
    gap, _ = tree.query(points, distance_upper_bound=reach)
    near: FloatArray = points[np.isfinite(gap)]
    return near


def _lengths(touching: list[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Length of each contact, by the points of both sides that touch [m], (c,)."""
    sides = [side for sides in touching for side in sides]
    group = np.repeat(np.arange(len(sides)), [len(side) for side in sides])
    steps = group[_first_in_steps(np.concatenate([np.zeros((0, 3)), *sides]), group)]
    n_steps = np.bincount(steps, minlength=len(sides)).reshape(-1, 2)
    lengths: FloatArray = _STEP_LENGTH * n_steps.sum(axis=1) / 2
    return lengths


def _first_in_steps(points: FloatArray, group: IntArray) -> IntArray:
    """First point of each group in each cell of a grid, ascending."""
    key = group
    for axis in points.T:
        step = np.floor(axis / _STEP).astype(np.int64)
        step -= step.min(initial=np.iinfo(np.int64).max)
        key = key * (step.max(initial=0) + 1) + step
    first: IntArray = np.sort(np.unique(key, return_index=True)[1])
    return first


@dataclass(frozen=True, slots=True, eq=False)
class _Zone:
    """Cells of an object around a contact."""

    cells: IntArray
    away: FloatArray
    """Their distance from the contact [m]."""
    slope: float
    """How they rise from it, over that distance."""

    @classmethod
    def of(cls, surface: LabelledSurface, cells: IntArray, places: FloatArray) -> _Zone:
        """Find which of some cells are around a contact."""
        distances = cdist(surface.points[cells], places)
        nearest = distances.argmin(axis=1)
        away = distances[np.arange(len(cells)), nearest]
        inside = np.flatnonzero(away < _ZONE)
        cells, away = cells[inside], away[inside]
        rise = surface.points[cells, 2] - places[nearest[inside], 2]
        slopes = rise / np.maximum(away, surface.size)
        return cls(cells, away, float(slopes.mean()) if len(cells) else 0.0)


def _face(surface: LabelledSurface, zones: list[_Zone], tolerance: float) -> FloatArray:
    """Estimate the normal of the face on which two objects meet.

    Bodies that touch lie on two sides of a face of one of them. Faces near the contact
    are tried: the more cells lie on the wrong side, the less likely is the face.
    """
    origins, normals = [], []
    for sign, zone in zip((-1.0, 1.0), zones, strict=True):
        known = np.flatnonzero(surface.normals[zone.cells].any(axis=1))
        nearest = np.argsort(zone.away[known], kind="stable")[: 4 * _MOST_FACES]
        tried = zone.cells[_spread(known[nearest], _MOST_FACES)]
        origins.append(surface.points[tried])
        normals.append(sign * surface.normals[tried])
    origin, normal = np.concatenate(origins), np.concatenate(normals)
    # Contacts across wide gaps may have no cell near: then nothing tells the sides.
    if not len(normal) or not all(len(zone.cells) for zone in zones):
        return np.zeros(3)
    level = np.einsum("fi,fi->f", origin, normal)
    first, second = (surface.points[z.cells] @ normal.T - level for z in zones)
    wrong = (first < -tolerance).mean(axis=0) + (second > tolerance).mean(axis=0)
    # Where the body hides what is behind it, its front divides them too; of faces that
    # divide alike, the level one is that on which things rest.
    mean = (np.exp(-wrong / _SOFTNESS) * (_UPRIGHT + normal[:, 2] ** 2)) @ normal
    length = float(np.linalg.norm(mean))
    direction: FloatArray = mean / length if length > 1e-6 else np.zeros(3)
    return direction
