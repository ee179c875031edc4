"""Shapes of debris as compositions of convex parts.

Every function returns parts in a frame of its own: x along the length, z up when the
thing stands or lies as it is used. Lengths in [m].
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3, Box, Capsule, Cylinder, so3

from .body import Part
from .hull import Hull, frustum, prism, staves

__all__ = [
    "bar",
    "bucket",
    "cinder_block",
    "crate",
    "crate_with_handle",
    "elbow",
    "flat_truss",
    "folding_barrier",
    "hedgehog",
    "jersey_barrier",
    "ladder",
    "pallet",
    "rod",
    "traffic_cone",
    "triangular_truss",
    "tube",
]


def bar(length: float, width: float, height: float) -> tuple[Part, ...]:
    """Lumber, board or brick."""
    return (_box((length, width, height)),)


def rod(length: float, radius: float) -> tuple[Part, ...]:
    """Pipe that is closed at its ends."""
    return (_beam((-length / 2, 0, 0), (length / 2, 0, 0), radius),)


def tube(length: float, radius: float, wall: float) -> tuple[Part, ...]:
    """Wide pipe with open ends."""
    radii = (radius - wall, radius)
    lying = SE3.from_parts(so3.exp(np.array([0.0, np.pi / 2, 0.0])))
    return tuple(
        part.moved(lying) for part in staves(radii, radii, -length / 2, length / 2)
    )


def elbow(length: float, arm: float, radius: float) -> tuple[Part, ...]:
    """Two pipes at a right angle."""
    return (
        Capsule(radius, length, _pose((length / 2, 0, 0), (1, 0, 0))),
        Capsule(radius, arm, _pose((0, arm / 2, 0), (0, 1, 0))),
    )


def flat_truss(
    length: float, depth: float, radius: float, bays: float
) -> tuple[Part, ...]:
    """Two chords, posts between them, and a diagonal in every bay."""
    chords = np.array([[0, -depth / 2, 0], [0, depth / 2, 0]])
    return _truss(chords, [(0, 1)], length, radius, round(bays))


def triangular_truss(
    length: float, side: float, radius: float, bays: float
) -> tuple[Part, ...]:
    """Three chords, posts and diagonals on all three faces."""
    turn = np.radians([210, 330, 90])
    ring = np.stack([np.zeros(3), np.cos(turn), np.sin(turn)], axis=-1)
    chords = ring * side / np.sqrt(3)
    return _truss(chords, [(0, 1), (1, 2), (2, 0)], length, radius, round(bays))


def ladder(length: float, width: float, rungs: float) -> tuple[Part, ...]:
    """Two rails and round rungs."""
    rail = (length, 0.025, 0.065)
    stations = (np.arange(round(rungs)) + 0.5) / round(rungs) - 0.5
    return (
        *(_box(rail, (0, side * width / 2, 0)) for side in (-1, 1)),
        *(
            _beam((x, -width / 2, 0), (x, width / 2, 0), 0.014)
            for x in stations * length
        ),
    )


def pallet(
    length: float, width: float, height: float, slats: float
) -> tuple[Part, ...]:
    """Three stringers with slats above and three below."""
    thickness, plank = 0.018, 0.085
    parts: list[Part] = []
    web = height - 2 * thickness
    for y in np.linspace(-1, 1, 3) * (width / 2 - 0.02):
        parts.append(_box((length, 0.04, web), (0, y, 0)))
    for side, count in ((1, round(slats)), (-1, 3)):
        z = side * (height - thickness) / 2
        for x in np.linspace(-1, 1, count) * (length - plank) / 2:
            parts.append(_box((plank, width, thickness), (x, 0, z)))
    return tuple(parts)


def traffic_cone(height: float, base: float, radius: float) -> tuple[Part, ...]:
    """Square base with a blunt cone on it."""
    plate = 0.03
    return (
        _box((base, base, plate), (0, 0, plate / 2)),
        frustum(radius, 0.025, plate, height),
    )


def bucket(
    height: float, radius_low: float, radius_high: float, wall: float
) -> tuple[Part, ...]:
    """Open bucket with a rim; it widens upwards."""
    top, low = max(radius_high, radius_low), min(radius_high, radius_low)
    rim, bottom = 0.015, 0.008
    return (
        Cylinder(low, bottom, SE3.from_parts(p=[0, 0, bottom / 2])),
        *staves((low - wall, low), (top - wall, top), bottom, height - rim),
        *staves(
            (top - wall, top + 0.008), (top - wall, top + 0.008), height - rim, height
        ),
    )


def cinder_block(
    length: float, width: float, height: float, wall: float
) -> tuple[Part, ...]:
    """Two long walls and three webs; the two cells are open above and below."""
    web = (wall, width - 2 * wall, height)
    return (
        *(
            _box((length, wall, height), (0, side * (width - wall) / 2, 0))
            for side in (-1, 1)
        ),
        *(_box(web, (x * (length - wall) / 2, 0, 0)) for x in (-1, 0, 1)),
    )


def crate(length: float, width: float, height: float, wall: float) -> tuple[Part, ...]:
    """Open box."""
    return (
        _box((length, width, wall), (0, 0, wall / 2)),
        *(
            _box(
                (length, wall, height - wall),
                (0, side * (width - wall) / 2, (height + wall) / 2),
            )
            for side in (-1, 1)
        ),
        *(
            _box(
                (wall, width - 2 * wall, height - wall),
                (side * (length - wall) / 2, 0, (height + wall) / 2),
            )
            for side in (-1, 1)
        ),
    )


def crate_with_handle(
    length: float, width: float, height: float, wall: float, rise: float, grip: float
) -> tuple[Part, ...]:
    """Open box with a bar across its length, on a post at either end."""
    post = (wall, 0.04, rise)
    reach = (length - wall) / 2
    return (
        *crate(length, width, height, wall),
        *(_box(post, (side * reach, 0, height + rise / 2)) for side in (-1, 1)),
        _beam((-length / 2, 0, height + rise), (length / 2, 0, height + rise), grip),
    )


def hedgehog(length: float, flange: float, wall: float) -> tuple[Part, ...]:
    """Three angle beams through one point, at right angles, on three of their ends."""
    angle = (
        _box((length, flange, wall), (0, flange / 2, wall / 2)),
        _box((length, wall, flange - wall), (0, wall / 2, (flange + wall) / 2)),
    )
    # The beams are cyclic images of each other; their diagonal becomes the vertical.
    cyclic = np.eye(3)[[2, 0, 1]]
    upright = so3.exp(
        np.arccos(1 / np.sqrt(3)) * np.array([1.0, -1.0, 0.0]) / np.sqrt(2)
    )
    turns = [upright @ np.linalg.matrix_power(cyclic, k) for k in range(3)]
    return tuple(part.moved(SE3.from_parts(turn)) for turn in turns for part in angle)


def folding_barrier(
    width: float, height: float, board: float, spread: float
) -> tuple[Part, ...]:
    """Two frames that lean on each other, with two boards on each."""
    leg, plank = 0.035, 0.02
    parts: list[Part] = []
    for side in (-1, 1):
        lean = np.arctan2(side * spread / 2, height)
        pose = SE3.from_parts(so3.exp(np.array([lean, 0.0, 0.0])), (0, 0, height))
        slant = np.hypot(height, spread / 2)
        frame: list[Part] = [
            _box(
                (leg, leg, slant), (end * (width - leg) / 2, side * leg / 2, -slant / 2)
            )
            for end in (-1, 1)
        ]
        for center in (0.04 + board / 2, 0.10 + 1.5 * board):
            y = side * (leg + plank / 2)
            frame.append(_box((width, plank, board), (0, y, -center)))
        parts.extend(part.moved(pose) for part in frame)
    return tuple(parts)


def jersey_barrier(length: float, height: float, base: float) -> tuple[Part, ...]:
    """Solid barrier with a foot, a flat slope and a steep one."""
    foot, knee = 0.08 * height, 0.38 * height
    half, waist, top = base / 2, 0.27 * base, 0.16 * base

    def layer(low: float, half_low: float, high: float, half_high: float) -> Hull:
        corners = [(-half_low, low), (half_low, low), (half_high, high)]
        return prism([*corners, (-half_high, high)], length)

    return (
        layer(0.0, half, foot, half),
        layer(foot, half, knee, waist),
        layer(knee, waist, height, top),
    )


def _truss(
    chords: FloatArray,
    faces: list[tuple[int, int]],
    length: float,
    radius: float,
    bays: int,
) -> tuple[Part, ...]:
    x = np.array([1.0, 0.0, 0.0])
    stations = np.linspace(-0.5, 0.5, bays + 1) * (length - 4 * radius)
    parts: list[Part] = [
        _beam(chord - x * length / 2, chord + x * length / 2, radius)
        for chord in chords
    ]
    for a, b in faces:
        for k, station in enumerate(stations):
            low, high = chords[a] + x * station, chords[b] + x * station
            parts.append(_beam(low, high, 0.7 * radius))
            if k < bays:
                step = x * (stations[k + 1] - station)
                ends = (low, high + step) if k % 2 else (high, low + step)
                parts.append(_beam(*ends, 0.7 * radius))
    return tuple(parts)


def _box(edges: ArrayLike, center: ArrayLike = (0.0, 0.0, 0.0)) -> Box:
    return Box(np.asarray(edges, dtype=np.float64) / 2, SE3.from_parts(p=center))


def _pose(center: ArrayLike, axis: ArrayLike) -> SE3:
    """Put z along an axis."""
    z = np.asarray(axis, dtype=np.float64)
    z = z / np.linalg.norm(z)
    aside = np.eye(3)[np.argmin(np.abs(z))]
    x = np.cross(aside, z)
    x /= np.linalg.norm(x)
    return SE3.from_parts(np.stack([x, np.cross(z, x), z], axis=-1), center)


def _beam(start: ArrayLike, end: ArrayLike, radius: float) -> Cylinder:
    start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    span = end - start
    return Cylinder(radius, float(np.linalg.norm(span)), _pose((start + end) / 2, span))
