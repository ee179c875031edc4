"""Random piles: what lies where before it falls.

A pile is a list of bodies in the order in which they are let down, each at the place
and in the attitude from which it comes to rest by itself. What makes the arrangements
differ is what is let down, and onto what.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray, Rng, require_metres, require_range
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.geometry import SE3, random_rotations, so3

from .body import Body
from .ground import Ground
from .kinds import KINDS, draw_body
from .world import World

__all__ = ["ARRANGEMENTS", "PileConfig", "generate_pile"]

BARS = ("lumber_2x4", "lumber_2x4", "lumber_4x4", "pipe", "pipe_wide", "board")
BLOCKS = ("cinder_block", "brick", "lumber_4x4", "crate", "bucket", "cone")
FRAMES = ("pallet", "truss_ladder", "truss_triangle", "ladder")
LARGE = ("barrier", "hedgehog", "jersey")
COMMON = tuple(kind for kind in KINDS if kind not in LARGE)


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class PileConfig:
    """Which piles are drawn."""

    n_bodies: tuple[int, int] = (3, 10)
    """Fewest and most bodies."""
    center: tuple[float, float] = (1.45, 0.0)
    """Middle of the pile (x, y) in the base frame [m]."""
    spread: float = 0.16
    """Standard deviation of the places of ten bodies about the middle [m]; fewer lie
    closer together, in proportion to the root of their number."""
    arrangements: tuple[str, ...] = ()
    """Names from `ARRANGEMENTS` to draw from; empty: all."""
    uneven_share: float = 0.3
    """Share of the piles on uneven ground."""
    heavy_share: float = 0.0
    """Share of the bodies that are too heavy to carry, 10 to 25 kg."""
    large_share: float = 0.05
    """Share of dropped bodies that are barriers or hedgehogs."""

    def __post_init__(self) -> None:
        if not 1 <= self.n_bodies[0] <= self.n_bodies[1]:
            raise ConfigError(
                "n_bodies", got=self.n_bodies, expected="1 <= fewest <= most"
            )
        require_range("most of n_bodies", self.n_bodies[1], 1, 1000)
        require_metres("center", self.center)
        require_range("spread [m]", self.spread, 0.0, 2.0)
        for name in ("uneven_share", "heavy_share", "large_share"):
            require_range(name, getattr(self, name), 0.0, 1.0)
        for name in self.arrangements:
            if name not in ARRANGEMENTS:
                raise UnknownNameError("arrangement", name, ARRANGEMENTS)


class _Builder:
    """Bodies let down so far; lives inside `generate_pile` only."""

    def __init__(self, config: PileConfig, n_bodies: int, rng: Rng) -> None:
        self.config, self.n_bodies, self.rng = config, n_bodies, rng
        self.bodies: list[Body] = []
        self.spread = config.spread * np.sqrt(n_bodies / 10.0)
        self.yaw = float(rng.uniform(-np.pi, np.pi))

    @property
    def n_left(self) -> int:
        """How many bodies are still to come."""
        return max(0, self.n_bodies - len(self.bodies))

    def choice(self, kinds: Sequence[str]) -> str:
        """Draw one of the kinds."""
        return str(self.rng.choice(list(kinds)))

    def add(
        self,
        kind: str,
        *,
        at: ArrayLike | None = None,
        rpy: ArrayLike | None = None,
        height: float = 0.0,
    ) -> Body:
        """Let down a body of a kind; where and how is drawn unless given."""
        rng = self.rng
        is_heavy = rng.random() < self.config.heavy_share
        mass = float(rng.uniform(10.0, 25.0)) if is_heavy else None
        body = draw_body(
            kind, rng=rng, name=f"{kind}_{len(self.bodies) + 1}", mass=mass
        )
        offset = rng.normal(0.0, self.spread, 2) if at is None else np.asarray(at)
        turn = so3.from_rpy(np.array(rpy)) if rpy is not None else self._attitude()
        xy = np.clip(offset, -0.4, 0.4) + self.config.center
        body = body.at(SE3.from_parts(turn, [*xy, height]))
        self.bodies.append(body)
        return body

    def along(self, distance: float, across: float = 0.0) -> tuple[float, float]:
        """Offset from the middle in directions of the pile's own heading."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return float(c * distance - s * across), float(s * distance + c * across)

    def _attitude(self) -> FloatArray:
        """Lying or standing as in use, with some tilt, or any way at all."""
        if self.rng.random() < 0.35:
            return np.asarray(random_rotations(1, rng=self.rng)[0])
        roll = self.rng.choice([0.0, 0.0, np.pi / 2, np.pi]) + self.rng.normal(0, 0.15)
        pitch, yaw = self.rng.normal(0.0, 0.15), self.rng.uniform(-np.pi, np.pi)
        return so3.from_rpy(np.array([roll, pitch, yaw]))

    def rest(self, kinds: Sequence[str] = COMMON) -> None:
        """Drop what is left to come."""
        while self.n_left:
            is_large = self.rng.random() < self.config.large_share
            self.add(self.choice(LARGE if is_large else kinds))


def _dropped(pile: _Builder) -> None:
    pile.rest()


def _stacked(pile: _Builder) -> None:
    """Bars simply laid on two supports, one crosswise on the other."""
    base = pile.choice((*FRAMES, "cinder_block", "lumber_4x4", "brick"))
    pile.add(base, at=(0, 0), rpy=(0, 0, pile.yaw))
    for level in range(min(2, pile.n_left)):
        turn = pile.yaw + np.pi / 2 * (level + 1) + pile.rng.normal(0, 0.3)
        kind = pile.choice((*BARS, "cinder_block"))
        pile.add(kind, at=pile.rng.normal(0, 0.04, 2), rpy=(0, 0, turn))
    pile.rest((*BARS, *BLOCKS))


def _leaning(pile: _Builder) -> None:
    """Something stands, and others lean on it."""
    stand = pile.choice(("cinder_block", "crate", "pallet", "lumber_4x4", "jersey"))
    pile.add(stand, at=(0, 0), rpy=(0, 0, pile.yaw))
    for _ in range(min(int(pile.rng.integers(1, 4)), pile.n_left)):
        pitch = pile.rng.uniform(0.5, 0.9)
        across = pile.rng.normal(0, 0.08)
        side = pile.rng.choice([0.0, np.pi])
        reach = 0.26 if side == 0.0 else -0.26
        pile.add(
            pile.choice(("lumber_2x4", "lumber_4x4", "pipe", "board", "truss_ladder")),
            at=pile.along(reach, across),
            rpy=(0, pitch, pile.yaw + side),
        )
    pile.rest((*BARS, *BLOCKS))


def _covered(pile: _Builder) -> None:
    """Small things on the floor, a pallet or truss over them."""
    for _ in range(min(int(pile.rng.integers(1, 4)), pile.n_left - 1)):
        kind = pile.choice(("lumber_2x4", "pipe", "brick", "pipe_elbow", "board"))
        yaw = pile.rng.uniform(-np.pi, np.pi)
        pile.add(kind, at=pile.rng.normal(0, 0.12, 2), rpy=(0, 0, yaw))
    pile.add(pile.choice(FRAMES), at=(0, 0), rpy=(0, 0, pile.yaw))
    pile.rest()


def _boards(pile: _Builder) -> None:
    """Boards flat on the floor, some partly on each other, then clutter."""
    for _ in range(min(int(pile.rng.integers(2, 4)), pile.n_left)):
        yaw = pile.yaw + pile.rng.normal(0, 0.5)
        pile.add("board", at=pile.rng.normal(0, 0.2, 2), rpy=(0, 0, yaw))
    pile.rest((*BARS, *BLOCKS))


def _trusses(pile: _Builder) -> None:
    """Two trusses that touch, side by side or crossed."""
    kinds = ("truss_ladder", "truss_triangle")
    pile.add(pile.choice(kinds), at=pile.along(0, -0.12), rpy=(0, 0, pile.yaw))
    turn = pile.rng.choice([pile.rng.normal(0, 0.1), pile.rng.uniform(0.5, 2.6)])
    pile.add(pile.choice(kinds), at=pile.along(0, 0.12), rpy=(0, 0, pile.yaw + turn))
    pile.rest()


def _flush(pile: _Builder) -> None:
    """Bars or blocks side by side whose faces touch and whose tops are level."""
    kind = pile.choice(("lumber_4x4", "lumber_2x4", "brick", "cinder_block"))
    width = 0.0
    for k in range(min(int(pile.rng.integers(2, 4)), pile.n_left)):
        if k:
            width += 1e-3
        sizes = pile.add(kind, at=(0, 0), rpy=(0, 0, pile.yaw)).sizes
        width += sizes["width"] / 2 if k else 0.0
        body = pile.bodies.pop()
        offset = pile.along(pile.rng.normal(0, 0.04), width)
        xy = np.array(pile.config.center) + offset
        pile.bodies.append(body.at(SE3.from_parts(body.T_base_body.R, [*xy, 0.0])))
        width += sizes["width"] / 2
    pile.rest((*BARS, *BLOCKS))


ARRANGEMENTS: Mapping[str, Callable[[_Builder], None]] = {
    "dropped": _dropped,
    "stacked": _stacked,
    "leaning": _leaning,
    "covered": _covered,
    "boards": _boards,
    "trusses": _trusses,
    "flush": _flush,
}
"""Ways to make a pile, by name."""


@checked
def generate_pile(
    *, rng: Rng, config: PileConfig | None = None, name: str = ""
) -> World:
    """Draw bodies and where each of them is let down.

    The bodies interpenetrate: they are meant for a settling that lowers them onto each
    other in their order.

    Parameters
    ----------
    rng
        Source of randomness; the same state gives the same pile.
    config
        Which piles are drawn.
    name
        Name of the world; the arrangement is added.
    """
    config = config or PileConfig()
    arrangement = str(rng.choice(list(config.arrangements or ARRANGEMENTS)))
    n_bodies = int(rng.integers(config.n_bodies[0], config.n_bodies[1] + 1))
    ground = Ground.level()
    if rng.random() < config.uneven_share:
        peak = float(rng.uniform(0.015, 0.05))
        ground = Ground.uneven(rng, peak_to_peak=peak, center=config.center)
    pile = _Builder(config, n_bodies, rng)
    ARRANGEMENTS[arrangement](pile)
    title = f"{name} {arrangement}" if name else arrangement
    return World(tuple(pile.bodies), ground, title)
