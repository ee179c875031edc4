"""Things that no prototype, threshold or fit was made for, in scenes for trials.

What the debris generator makes is what thresholds were set by. These are other things
that lie about where something fell down: `LEARNT` may be used to fit and to mend,
`UNKNOWN` only to report.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray, Rng
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, Capsule, Cylinder, random_rotations, so3
from debrisgrasp.sim import Settled, TierScene, let_fall, scene_of
from debrisgrasp.worlds import Body, Ground, Hull, Part, World, frustum, staves
from debrisgrasp.worlds.shapes import _beam, _box, _pose

__all__ = ["LEARNT", "UNKNOWN", "Kinds", "settled_strangers", "stranger_scene"]

Parts = tuple[Part, ...]
Drawn = tuple[Parts, tuple[float, float]]
"""Convex parts, and the range of the mass [kg]."""

_CENTER = np.array([1.1, 0.0])
_SPREAD = 0.16
_ATTEMPTS = 30
_CONCRETE = 2200.0
_LIGHTEST, _HEAVIEST = 0.5, 10.0


def _limb(start: ArrayLike, end: ArrayLike, radius: float) -> Capsule:
    a, b = np.array(start, dtype=float), np.array(end, dtype=float)
    return Capsule(radius, float(np.linalg.norm(b - a)), _pose((a + b) / 2, b - a))


def _lying(parts: Parts) -> Parts:
    """Turn what stands along z so that it lies along x."""
    turn = SE3.from_parts(so3.exp(np.array([0.0, np.pi / 2, 0.0])))
    return tuple(part.moved(turn) for part in parts)


def _heavy(parts: Parts, density: float) -> Drawn:
    mass = density * Body("stone", "stone", parts, 1.0).volume
    mass = float(np.clip(mass, _LIGHTEST, _HEAVIEST))
    return parts, (mass, mass)


def _ball(rng: Rng, count: int) -> FloatArray:
    points = rng.normal(size=(count, 3))
    return np.asarray(points / np.linalg.norm(points, axis=1, keepdims=True))


def rubble(rng: Rng) -> Drawn:
    """Broken concrete."""
    points = _ball(rng, int(rng.integers(9, 20))) * rng.uniform(0.7, 1.0)
    axes = rng.uniform([0.9, 0.6, 0.5], [1.3, 1.0, 0.9])
    return _heavy(
        (Hull.around(points * axes * rng.uniform(0.05, 0.12)),), density=_CONCRETE
    )


def stone(rng: Rng) -> Drawn:
    """Round stone."""
    axes = rng.uniform([0.9, 0.8, 0.6], [1.4, 1.1, 1.0]) * rng.uniform(0.06, 0.1)
    return _heavy((Hull.around(_ball(rng, 60) * axes),), density=2600.0)


def slab(rng: Rng) -> Drawn:
    """Piece of a floor."""
    angle = np.sort(rng.uniform(0.0, 2 * np.pi, 7))
    ring = rng.uniform(0.1, 0.2, 7) * np.array([np.cos(angle), np.sin(angle)])
    half = rng.uniform(0.025, 0.045)
    ends = [np.insert(ring.T, 2, side * half, axis=1) for side in (-1, 1)]
    return _heavy((Hull.around(np.concatenate(ends)),), density=_CONCRETE)


def tyre(rng: Rng) -> Drawn:
    """Tyre of a car, without its bulge."""
    outer, half = rng.uniform(0.22, 0.3), rng.uniform(0.065, 0.095)
    radii = (rng.uniform(0.6, 0.66) * outer, outer)
    return staves(radii, radii, -half, half, count=24), (4.0, 8.0)


def wheel(rng: Rng) -> Drawn:
    """Rim with six spokes."""
    radius = rng.uniform(0.2, 0.3)
    radii, turns = (radius - 0.03, radius), np.arange(6) * np.pi / 3
    ring = staves(radii, radii, -0.015, 0.015, count=24)
    spoke = (radius - 0.02) * np.array([np.cos(turns), np.sin(turns), 0 * turns]).T
    spokes = (_beam((0, 0, 0), tuple(end), 0.006) for end in spoke)
    return (*ring, *spokes, _beam((0, 0, -0.04), (0, 0, 0.04), 0.02)), (1.0, 3.0)


def beam(rng: Rng) -> Drawn:
    """Steel beam with two flanges."""
    length, height = rng.uniform(0.4, 1.0), rng.uniform(0.08, 0.14)
    width, wall = rng.uniform(0.05, 0.09), 0.007
    flange = (length, width, wall)
    return (
        _box(flange, (0, 0, height / 2)),
        _box(flange, (0, 0, -height / 2)),
        _box((length, wall, height - wall)),
    ), (3.0, 8.0)


def angle(rng: Rng) -> Drawn:
    """Steel angle."""
    length, side = rng.uniform(0.5, 1.2), rng.uniform(0.04, 0.08)
    return (
        _box((length, side, 0.006), (0, side / 2, 0)),
        _box((length, 0.006, side), (0, 0, side / 2)),
    ), (1.5, 6.0)


def channel(rng: Rng) -> Drawn:
    """Steel channel."""
    length, width = rng.uniform(0.4, 1.0), rng.uniform(0.08, 0.14)
    side = (length, 0.006, rng.uniform(0.04, 0.06))
    walls = (_box(side, (0, end * width / 2, side[2] / 2)) for end in (-1, 1))
    return (_box((length, width, 0.006)), *walls), (2.0, 6.0)


def rebar(rng: Rng) -> Drawn:
    """Thin bent rod."""
    length, radius = rng.uniform(0.6, 1.2), rng.uniform(0.006, 0.01)
    places = np.linspace(-0.5, 0.5, 4) * length
    bend = rng.uniform(-0.12, 0.12, 2) * length
    y = np.array([0.0, 0.0, bend[0], bend.sum()])
    points = np.stack([places, y, np.zeros(4)], axis=-1)
    return tuple(_limb(a, b, radius) for a, b in pairwise(points)), (0.5, 2.0)


def branch(rng: Rng) -> Drawn:
    """Crooked trunk with twigs."""
    length, radius = rng.uniform(0.6, 1.1), rng.uniform(0.025, 0.05)
    bend = (0.0, rng.uniform(-0.06, 0.06), 0.0)
    parts = [
        _limb((-length / 2, 0, 0), bend, radius),
        _limb(bend, (length / 2, 0, rng.uniform(-0.05, 0.05)), 0.85 * radius),
    ]
    for way in _ball(rng, int(rng.integers(1, 4))):
        root = np.array([rng.uniform(-0.2, 0.4) * length, 0.0, 0.0])
        way[0] = abs(way[0])
        tip = root + way * rng.uniform(0.15, 0.35)
        parts.append(_limb(tuple(root), tuple(tip), 0.45 * radius))
    return tuple(parts), (1.5, 5.0)


def canister(rng: Rng) -> Drawn:
    """Can with a handle on top."""
    depth, width, height = rng.uniform([0.3, 0.15, 0.36], [0.36, 0.18, 0.44])
    top = height / 2
    posts = (_box((0.02, 0.02, 0.05), (x, 0, top + 0.025)) for x in (-0.1, 0.08))
    grip = _box((0.22, 0.025, 0.02), (-0.01, 0, top + 0.06))
    return (_box((depth, width, height)), *posts, grip), (2.0, 8.0)


def toolbox(rng: Rng) -> Drawn:
    """Box with a lid and a handle."""
    length, width, height = rng.uniform([0.36, 0.18, 0.15], [0.5, 0.22, 0.2])
    top = height / 2
    posts = (_box((0.015, 0.015, 0.05), (x, 0, top + 0.05)) for x in (-0.07, 0.07))
    grip = _limb((-0.07, 0, top + 0.075), (0.07, 0, top + 0.075), 0.014)
    lid = _box((0.9 * length, 0.5 * width, 0.04), (0, 0, top + 0.02))
    return (_box((length, width, height)), lid, grip, *posts), (3.0, 8.0)


def flask(rng: Rng) -> Drawn:
    """Gas cylinder with its valve."""
    half, radius = rng.uniform(0.17, 0.3), rng.uniform(0.06, 0.11)
    end = half + radius
    valve = _beam((end - 0.01, 0, 0), (end + 0.07, 0, 0), 0.025)
    return (_limb((-half, 0, 0), (half, 0, 0), radius), valve), (3.0, 8.0)


def keg(rng: Rng) -> Drawn:
    """Small barrel."""
    length, wide = rng.uniform(0.25, 0.35), rng.uniform(0.07, 0.09)
    radii = (0.8 * wide, wide, wide, 0.8 * wide)
    heights = np.array([-0.5, -0.25, 0.25, 0.5]) * length
    parts = (frustum(*radii[k : k + 2], *heights[k : k + 2]) for k in range(3))
    return tuple(parts), (2.0, 6.0)


def drum(rng: Rng) -> Drawn:
    """Closed drum with two rims, wider than hands open."""
    radius, half = rng.uniform(0.13, 0.17), rng.uniform(0.15, 0.21)
    rim = radius + 0.008
    rims = (frustum(rim, rim, *np.sort([s * half, s * (half - 0.02)])) for s in (-1, 1))
    return (frustum(radius, radius, -half, half), *rims), (2.0, 6.0)


def chair(rng: Rng) -> Drawn:
    """Wooden chair."""
    side, height, leg = rng.uniform(0.36, 0.42), rng.uniform(0.4, 0.46), 0.03
    edge = (side - leg) / 2
    legs = (
        _box((leg, leg, height), (x * edge, y * edge, height / 2))
        for x in (-1, 1)
        for y in (-1, 1)
    )
    posts = (_box((leg, leg, 0.42), (-edge, y * edge, height + 0.21)) for y in (-1, 1))
    back = _box((0.02, side, 0.12), (-edge, 0, height + 0.36))
    return (_box((side, side, 0.03), (0, 0, height)), *legs, *posts, back), (2.5, 6.0)


def shovel(rng: Rng) -> Drawn:
    """Shovel with a cross-grip."""
    end = rng.uniform(0.35, 0.55)
    return (
        _limb((-end, 0, 0), (end, 0, 0), 0.017),
        _box((0.28, 0.2, 0.012), (end + 0.12, 0, 0)),
        _limb((-end, -0.06, 0), (-end, 0.06, 0), 0.015),
    ), (1.0, 2.5)


def sign(rng: Rng) -> Drawn:
    """Round sign on its post."""
    end, radius = rng.uniform(0.35, 0.55), rng.uniform(0.15, 0.25)
    plate = Cylinder(radius, 0.006, SE3.from_parts(p=(end - 0.1, 0, 0.03)))
    return (_beam((-end, 0, 0), (end, 0, 0), 0.025), plate), (2.0, 5.0)


def sandbag(rng: Rng) -> Drawn:
    """Full bag."""
    points = _ball(np.random.default_rng(0), 90)
    points = np.sign(points) * np.abs(points) ** 0.6
    axes = rng.uniform([0.2, 0.12, 0.05], [0.28, 0.16, 0.08])
    return (Hull.around(points * axes),), (5.0, 8.0)


def tee(rng: Rng) -> Drawn:
    """Pipe with a branch."""
    end, radius = rng.uniform(0.15, 0.25), rng.uniform(0.03, 0.055)
    arm = _beam((0, 0, 0), (0, rng.uniform(0.15, 0.25), 0), radius)
    return (_beam((-end, 0, 0), (end, 0, 0), radius), arm), (1.5, 5.0)


def table_leg(rng: Rng) -> Drawn:
    """Turned leg with a square end."""
    end = rng.uniform(0.3, 0.4)
    block = _box((0.09, 0.09, 0.08), (0, 0, end + 0.03))
    return _lying((frustum(0.02, 0.035, -end, end), block)), (1.0, 3.0)


def masonry(rng: Rng) -> Drawn:
    """Bricks that still hold together."""
    bricks = [
        _box((0.23, 0.11, 0.065), ((j - 0.5) * 0.235 + shift, 0, k * 0.072))
        for k, shift in enumerate((-0.06, 0.06, -0.06)[: int(rng.integers(2, 4))])
        for j in range(2)
    ]
    return tuple(bricks), (6.0, 10.0)


def frame(rng: Rng) -> Drawn:
    """Frame of a window."""
    length, width, edge = rng.uniform([0.5, 0.4, 0.04], [0.8, 0.6, 0.06])
    x, y = (length - edge) / 2, (width - edge) / 2
    long = (_box((length, edge, 0.035), (0, side * y, 0)) for side in (-1, 1))
    short = (_box((edge, 2 * y - edge, 0.035), (s * x, 0, 0)) for s in (-1, 1))
    return (*long, *short), (1.5, 4.0)


def gutter(rng: Rng) -> Drawn:
    """Half a pipe."""
    radius, half = rng.uniform(0.06, 0.09), rng.uniform(0.25, 0.5)
    radii = (radius - 0.004, radius)
    return _lying(staves(radii, radii, -half, half)[:8]), (0.8, 2.5)


Kinds = Mapping[str, Callable[[Rng], Drawn]]
LEARNT: Kinds = {
    kind.__name__: kind
    for kind in (
        rubble, tyre, angle, rebar, canister, flask, shovel, wheel, drum, frame, stone,
        beam,
    )
}  # fmt: skip
"""Kinds that causes of failures were sought with."""
UNKNOWN: Kinds = {
    kind.__name__: kind
    for kind in (
        slab, channel, branch, chair, sandbag, sign, toolbox, tee, table_leg, masonry,
        gutter, keg,
    )
}  # fmt: skip
"""Kinds that are only reported on."""


def _drawn(kind: str, kinds: Kinds, rng: Rng, name: str) -> Body:
    parts, (least, most) = kinds[kind](rng)
    mass = float(np.exp(rng.uniform(np.log(least), np.log(most))))
    body = Body(name, kind, parts, mass).recentered()
    if rng.random() < 0.35:
        turn = random_rotations(1, rng=rng)[0]
    else:
        roll = rng.choice([0.0, 0.0, np.pi / 2, np.pi]) + rng.normal(0.0, 0.15)
        turn = so3.from_rpy([roll, rng.normal(0.0, 0.15), rng.uniform(-np.pi, np.pi)])
    return body.at(SE3.from_parts(turn))


def settled_strangers(rng: Rng, kinds: Kinds, n_bodies: tuple[int, int]) -> Settled:
    """Drop some things, fewest to most, until they rest in one place."""
    for _ in range(_ATTEMPTS):
        n = int(rng.integers(n_bodies[0], n_bodies[1] + 1))
        bodies = []
        for k in range(n):
            kind = str(rng.choice(list(kinds)))
            body = _drawn(kind, kinds, rng, f"{kind}_{k + 1}")
            off = np.clip(rng.normal(0, _SPREAD * np.sqrt(n / 10), 2), -0.4, 0.4)
            pose = SE3.from_parts(body.T_base_body.R, [*(_CENTER + off), 0.0])
            bodies.append(body.at(pose))
        settled = let_fall(World(tuple(bodies), Ground.level()))
        places = np.array([b.T_base_body.p[:2] for b in settled.world.bodies])
        is_near = np.linalg.norm(places - _CENTER, axis=1).max() < 0.7
        if settled.is_at_rest and is_near:
            return settled
    raise SystemExit(f"no things at rest in {_ATTEMPTS} tries")


def stranger_scene(
    seed: int, kinds: Kinds, n_bodies: tuple[int, int], name: str
) -> TierScene:
    """Drop some things, and look at them from the robot."""
    rng = np.random.default_rng([seed, len(kinds), *n_bodies])
    for _ in range(_ATTEMPTS):
        with suppress(InputError):  # too little in sight
            return scene_of(settled_strangers(rng, kinds, n_bodies), seed, name=name)
    raise SystemExit(f"seed {seed}: nothing in sight in {_ATTEMPTS} tries")
