"""Where visible surfaces of different objects meet, and which face they meet on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from debrisgrasp._arrays import FloatArray, IntArray, frozen

from .surface import LabelledSurface

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
    pairs = _touching(surface, reach)
    ends = surface.labels[pairs].astype(np.int64)
    labels, index = np.unique(ends, axis=0, return_inverse=True)
    order = np.argsort(index.reshape(-1), kind="stable")
    cuts = np.cumsum(np.bincount(index.reshape(-1), minlength=len(labels)))[:-1]
    groups = np.split(order, cuts) if len(labels) else []
    measured = [_measured(surface, pairs[own]) for own in groups]

    def column(field: str, trailing: tuple[int | None, ...]) -> FloatArray:
        values = np.array([m[field] for m in measured], dtype=np.float64)
        return frozen(values.reshape(len(labels), *trailing), field, trailing)

    slope = column("slope", (2,))
    difference = slope[:, 0] - slope[:, 1]
    upper = np.where(difference > 0, labels[:, 0], labels[:, 1])
    return Contacts(
        labels=frozen(labels.reshape(-1, 2), "contact labels", (2,), np.int64),
        place=column("place", (3,)),
        length=column("length", ()),
        normal=column("normal", (3,)),
        convexity=column("convexity", ()),
        front=column("front", ()),
        gap=column("gap", ()),
        rise=column("rise", ()),
        slope=slope,
        span=column("span", (2, 2)),
        facing=column("facing", (2,)),
        upper=np.where(np.abs(difference) > _CLEAR_SLOPE, upper, 0),
    )


def _touching(surface: LabelledSurface, reach: float) -> IntArray:
    """Pairs of cells of two objects as near as touching ones, smaller label first."""
    if len(surface.points) < 2:
        return np.empty((0, 2), dtype=np.int64)
    near = _beside_others(surface, reach + 2.0 * float(surface.noise.max()))
    points, noise = surface.points[near], surface.noise[near]
    limit = reach + 2.0 * float(noise.max(initial=0.0))
    pairs = cKDTree(points).query_pairs(limit, output_type="ndarray")
    labels = surface.labels[near]
    pairs = pairs[labels[pairs[:, 0]] != labels[pairs[:, 1]]]
    gap = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    pairs = pairs[gap < reach + noise[pairs].sum(axis=1)]
    # Cells ascend by label, so the smaller index has the smaller label.
    found: IntArray = near[np.sort(pairs, axis=1)]
    return found


def _beside_others(surface: LabelledSurface, reach: float) -> IntArray:
    """Cells that may have a cell of another label within reach, ascending.

    A coarse grid is enough, and leaves little for the exact search.
    """
    grid = np.floor(surface.points / reach).astype(np.int64)
    grid -= grid.min(axis=0) - 1
    shape = grid.max(axis=0) + 2
    flat = (grid[:, 0] * shape[1] + grid[:, 1]) * shape[2] + grid[:, 2]
    cells, index = np.unique(flat, return_inverse=True)
    low = np.full(len(cells), np.iinfo(np.int64).max)
    high = np.zeros(len(cells), dtype=np.int64)
    np.minimum.at(low, index, surface.labels)
    np.maximum.at(high, index, surface.labels)
    least, most = low.copy(), high.copy()
    steps = np.arange(-1, 2)
    for offset in (
        (steps[:, None, None] * shape[1] + steps[:, None]) * shape[2] + steps
    ).ravel():
        at = np.minimum(np.searchsorted(cells, cells + offset), len(cells) - 1)
        there = cells[at] == cells + offset
        least[there] = np.minimum(least[there], low[at[there]])
        most[there] = np.maximum(most[there], high[at[there]])
    return np.flatnonzero((least != most)[index])


def _measured(surface: LabelledSurface, pairs: IntArray) -> dict[str, object]:
    """Measure one contact from its pairs of cells (k, 2)."""
    points, normals = surface.points, surface.normals
    ends, facing = points[pairs], normals[pairs]
    middles = ends.mean(axis=1)
    _, first = np.unique(_step_keys(middles), return_index=True)
    thinned = np.linspace(0, len(first) - 1, min(len(first), _MOST_PLACES)).astype(int)
    places = middles[np.sort(first)[thinned]]
    between = ends[:, 0] - ends[:, 1]
    gap = np.maximum(np.linalg.norm(between, axis=1), 1e-9)
    turn = np.einsum("ki,ki->k", facing[:, 0] - facing[:, 1], between)
    away = np.linalg.norm(ends - surface.viewpoint, axis=2)
    labels = surface.labels[pairs[0]]
    zones = [_zone(surface, int(label), places) for label in labels]
    noise = float(np.median(surface.noise[pairs]))
    spacing = float(np.median(surface.spacing[pairs]))
    middle = places.mean(axis=0)
    return {
        "place": middle,
        "length": _touching_length(surface, labels, middles, noise + 2.0 * spacing),
        "normal": _face(surface, zones, surface.size + 1.5 * noise),
        "convexity": 0.5 * np.mean(turn / gap),
        "front": np.mean((away[:, 1] - away[:, 0]) / gap),
        "gap": gap.mean(),
        "rise": np.mean(between[:, 2] / gap),
        "slope": [slope for _, _, slope in zones],
        "span": [_span(points[index, 2] - middle[2]) for index, _, _ in zones],
        "facing": [
            normals[index, 2].sum() / max(len(index), 1) for index, _, _ in zones
        ],
    }


def _span(height: FloatArray) -> FloatArray:
    """Heights at which a surface starts and ends, (2,); zero if none of it is near."""
    if not len(height):
        return np.zeros(2)
    span: FloatArray = np.quantile(height, _SPAN)
    return span


def _touching_length(
    surface: LabelledSurface, labels: IntArray, middles: FloatArray, tolerance: float
) -> float:
    """Length over which measured points of two objects come within a tolerance [m]."""
    low, high = middles.min(axis=0) - _STEP, middles.max(axis=0) + _STEP
    near = []
    for label in labels:
        points = surface.points_of(int(label))
        inside = np.ones(len(points), dtype=bool)
        for axis, least, most in zip(points.T, low, high, strict=True):
            inside &= (axis > least) & (axis < most)
        near.append(points[inside])
    n_steps = 0
    for own, other in (near, near[::-1]):
        tree = cKDTree(other, balanced_tree=False, compact_nodes=False)
        gap, _ = tree.query(own, distance_upper_bound=tolerance)
        n_steps += len(np.unique(_step_keys(own[np.isfinite(gap)])))
    return _STEP_LENGTH * n_steps / 2


def _step_keys(points: FloatArray) -> IntArray:
    """Numbers of the cells of a grid that points (n, 3) lie in, ordered as these."""
    key = np.zeros(len(points), dtype=np.int64)
    for axis in points.T:
        step = np.floor(axis / _STEP).astype(np.int64)
        step -= step.min(initial=np.iinfo(np.int64).max)
        key = key * (step.max(initial=0) + 1) + step
    return key


Zone = tuple[IntArray, FloatArray, float]
"""Cells around a contact, their distance from it, and how they rise from it."""


def _zone(surface: LabelledSurface, label: int, places: FloatArray) -> Zone:
    """Find the cells of a label around a contact."""
    own = surface.cells_of(label)
    points = surface.points[own]
    box = (places.min(axis=0) - _ZONE, places.max(axis=0) + _ZONE)
    index = np.flatnonzero(((points > box[0]) & (points < box[1])).all(axis=1))
    distances = cdist(points[index], places)
    nearest = distances.argmin(axis=1)
    away = distances[np.arange(len(index)), nearest]
    inside = away < _ZONE
    index, away, nearest = index[inside], away[inside], nearest[inside]
    rise = points[index, 2] - places[nearest, 2]
    slope = float(np.mean(rise / np.maximum(away, surface.size))) if len(index) else 0.0
    return index + own.start, away, slope


def _face(surface: LabelledSurface, zones: list[Zone], tolerance: float) -> FloatArray:
    """Estimate the normal of the face on which two objects meet.

    Bodies that touch lie on two sides of a face of one of them. Faces near the contact
    are tried: the more cells lie on the wrong side, the less likely is the face.
    """
    origins, normals = [], []
    for sign, (index, away, _) in zip((-1.0, 1.0), zones, strict=True):
        known = np.abs(surface.normals[index]).sum(axis=1) > 0
        near = index[known][np.argsort(away[known], kind="stable")[: 4 * _MOST_FACES]]
        pick = np.linspace(0, len(near) - 1, min(len(near), _MOST_FACES)).astype(int)
        origins.append(surface.points[near[pick]])
        normals.append(sign * surface.normals[near[pick]])
    origin, normal = np.concatenate(origins), np.concatenate(normals)
    if not len(normal):
        return np.zeros(3)
    level = np.einsum("fi,fi->f", origin, normal)
    first, second = (surface.points[index] @ normal.T - level for index, _, _ in zones)
    wrong = (first < -tolerance).mean(axis=0) + (second > tolerance).mean(axis=0)
    # Where the body hides what is behind it, its front divides them too; of faces that
    # divide alike, the level one is that on which things rest.
    mean = (np.exp(-wrong / _SOFTNESS) * (_UPRIGHT + normal[:, 2] ** 2)) @ normal
    length = float(np.linalg.norm(mean))
    direction: FloatArray = mean / length if length > 1e-6 else np.zeros(3)
    return direction
