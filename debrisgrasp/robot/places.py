"""Where a hand is in a body, or nearly so, and how that would push it out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray

from .shapes import ways_out
from .springs import HELD, REACH, Near, Watch

__all__ = ["Key", "Places", "Push", "Sides", "is_behind"]

Key = tuple[int, int]
"""Who touches, and which body: as in `Near`, but parts of what the hand holds touch
each by itself, with numbers from `HELD` down."""
Push = tuple[FloatArray, float, FloatArray]
"""Normal (3,) of a place that pushed, how deep it was [m], and where (3,); odom."""

_EDGE = 3e-4
"""So near to an edge both of its sides push: nothing jumps on the way around it [m]."""
_SHIFTS = 0.004
"""So far does the middle of a contact go from one look to the next at most [m]: from
one part of a body to another the load goes over bit by bit."""
_DEEPENS = 5e-4
"""So much at most does a contact deepen from one look to the next [m]."""
_STAYS = 5e-4
"""By so much another place must be deeper than one that pushes as the last one did: it
must not change from look to look [m]."""
_ALONG = 0.7
"""Cosine to the last push from which on a place pushes as that did."""
_SHARPNESS = 4
"""How much more the deeper points count for the direction of a push."""
_NO_WAY = 0.01
"""Squares of shorter means say nothing of a direction."""
_BEHIND = -0.3
"""Cosine to the last push beyond which a side lies behind what is pushed."""
_ASIDE = 5e-4
"""So far aside of a side is still before it [m]: round bodies have flat ones."""


class Sides(NamedTuple):
    """Sides of a convex part."""

    normals: FloatArray
    """Outwards, shape (s, 3)."""
    is_covered: BoolArray
    """Which lie in another part, shape (s,)."""


def _blended(normals: FloatArray, beyond: FloatArray) -> FloatArray:
    """Directions in which a body pushes points out, smooth around its edges, (n, 3).

    Parameters
    ----------
    normals, beyond
        Of the sides, shapes (s, 3) and (n, s) [m], negative inside.
    """
    nearest = beyond.max(axis=1, keepdims=True)
    means = np.exp((beyond - nearest) / _EDGE) @ normals
    sizes = np.linalg.norm(means, axis=1, keepdims=True)
    own = normals[beyond.argmax(axis=1)]
    return np.asarray(np.where(sizes > 0.5, means / np.maximum(sizes, 0.5), own))


def is_behind(normals: FloatArray, push: FloatArray) -> BoolArray:
    """Whether sides, (..., 3), lie behind what was pushed along (3,)."""
    return _is_within(-normals, push, -_BEHIND)


def _is_within(normals: FloatArray, push: FloatArray, cosine: float) -> BoolArray:
    """Whether normals (..., 3) are as near to a push (3,) as a cosine tells."""
    sizes = np.linalg.norm(normals, axis=-1) * float(np.linalg.norm(push))
    return np.asarray(normals @ push > cosine * sizes)


def _is_facing(beyond: FloatArray, sides: Sides) -> BoolArray:
    """Whether points outside a part lie straight in front of one of its sides, (n,)."""
    normals, is_covered = sides
    side, gaps = beyond.argmax(axis=1), beyond.max(axis=1, keepdims=True)
    feet = beyond - gaps * (normals[side] @ normals.T)
    return np.asarray((feet.max(axis=1) < _ASIDE) & ~is_covered[side])


class Places:
    """The deepest of each owner in each body, or the nearest where it is in none."""

    def __init__(self, before: Mapping[Key, Push]) -> None:
        """Begin with what pushed at the last look."""
        self.found: dict[Key, Near] = {}
        self._ranks: dict[Key, float] = {}
        """Depth of each that is inside, and more of one that stays [m]."""
        self._before = before

    def shifted(self) -> dict[Key, Near]:
        """All of them, none far from where it pushed at the last look."""
        return {
            key: _shifted(place, self._before[key][2]) if key in self._before else place
            for key, place in self.found.items()
        }

    def add_all(
        self,
        watch: Watch,
        where: FloatArray,
        beyond: FloatArray,
        sides: Sides,
    ) -> float:
        """Add the contacts of each owner of watched points; return the least gap.

        ``beyond`` is how far each point is from each side, as (n, s) [m].
        """
        gaps = beyond.max(axis=1)
        nearest = float(gaps.min())
        if nearest >= REACH:
            return nearest
        for owner in np.unique(watch.owners[gaps < REACH]).tolist():
            mine = watch.owners == owner
            key = owner, watch.body
            self.add(key, where[mine], beyond[mine], sides, 1.0)
        return nearest

    def add(
        self,
        key: Key,
        where: FloatArray,
        beyond: FloatArray,
        sides: Sides,
        sign: float,
    ) -> None:
        """Keep the deepest contact of an owner with a body.

        ``sign`` is 1 for points of the hand, -1 for points of the body.
        """
        inside = beyond.max(axis=1) < 0.0
        if not inside.any():
            self._add_nearest(key, where, beyond, sides, sign)
            return
        normals, is_covered = sides
        where, beyond = where[inside], ways_out(beyond[inside], is_covered)
        beyond = self._same_side(key, beyond, sign * normals)
        depths = -beyond.max(axis=1)
        depth = float(depths.max())
        best = self._ranks.get(key, -np.inf)
        if depth + _STAYS <= best:
            return
        # Where points are pushed by several sides none takes over all at once.
        shares = (depths / depth) ** _SHARPNESS
        ways = _blended(normals, beyond)
        normal = shares @ ways / shares.sum()
        if float(normal @ normal) < _NO_WAY:
            normal = ways[int(depths.argmax())]
        rank = depth + _STAYS * self._stays(key, sign * normal)
        if rank > best:
            middle = depths @ where / depths.sum()
            self._keep(key, middle, sign * normal, depth)
            self._ranks[key] = rank

    def _stays(self, key: Key, normal: FloatArray) -> bool:
        """Whether a place with a normal (3,) pushes as the last one did."""
        before = self._before.get(key)
        return before is not None and bool(_is_within(normal, before[0], _ALONG))

    def _add_nearest(
        self,
        key: Key,
        where: FloatArray,
        beyond: FloatArray,
        sides: Sides,
        sign: float,
    ) -> None:
        """Keep what an owner would touch first if the hand were bent towards a body."""
        gaps = beyond.max(axis=1)
        rows = np.flatnonzero(gaps < REACH)
        rows = rows[_is_facing(beyond[rows], sides)]
        if not len(rows):
            return
        row = rows[gaps[rows].argmin()]
        depth = -float(gaps[row])
        if key not in self.found or self.found[key].depth < depth:
            normal = sign * _blended(sides.normals, beyond[[row]])[0]
            self._keep(key, where[row], normal, depth)

    def _keep(
        self, key: Key, point: FloatArray, normal: FloatArray, depth: float
    ) -> None:
        owner, body = key
        self.found[key] = Near(max(owner, HELD), body, point, normal, depth)

    def _same_side(
        self, key: Key, beyond: FloatArray, pushes: FloatArray
    ) -> FloatArray:
        """Leave out sides of a body opposite to the one that pushed a tick ago.

        A finger that is pressed into a thin wall does not come out at its back.

        Parameters
        ----------
        beyond
            Of points inside, from each side [m], shape (n, s).
        """
        before = self._before.get(key)
        if before is None:
            return beyond
        normal, depth, _ = before
        kept = np.where(is_behind(pushes, normal), -np.inf, beyond)
        # Else it is another place that is touched now.
        now = -float(kept.max(axis=1).min())
        return kept if abs(now - depth) < _DEEPENS else beyond


def _shifted(place: Near, before: FloatArray) -> Near:
    """Contact whose middle was (3,) at the last look."""
    way = place.point - before
    far = float(np.linalg.norm(way))
    if far <= _SHIFTS:
        return place
    point = before + _SHIFTS / far * way
    return place._replace(point=point, lag=place.point - point)
