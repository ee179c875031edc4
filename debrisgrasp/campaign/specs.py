"""What each run of a campaign is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from debrisgrasp._arrays import Rng, require_range
from debrisgrasp._checked import checked
from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.executive import state_named
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.robot import Injection
from debrisgrasp.worlds import (
    SCENES,
    PileConfig,
    World,
    come_to_rest,
    draw_body,
    generate_pile,
    let_down,
    named_scene,
)

__all__ = [
    "FAKE_TIERS",
    "LEVELS",
    "MARKED",
    "WORLDS",
    "RunSpec",
    "draw_specs",
    "fake_world",
]

WORLDS = ("fake", "mujoco")
LEVELS = ("hand", "arm")
_CENTER = (0.98, 0.0)
_STURDY = ("cinder_block", "lumber_4x4", "brick", "pipe_wide", "crate_handle")
"""Kinds that a hand can take hold of in any attitude."""

FaultSource = Callable[[Rng], tuple[Injection, ...]]


def _one_of(*kinds: str) -> Callable[[Rng], World]:
    """Lay one object of these kinds down in front of the robot."""

    def lay(rng: Rng) -> World:
        body = draw_body(str(rng.choice(kinds)), rng=rng)
        yaw = so3.from_rpy(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))
        place = [_CENTER[0] + rng.uniform(-0.1, 0.1), rng.uniform(-0.15, 0.15), 0.3]
        return World((body.at(SE3.from_parts(yaw, place)),))

    return lay


def _pile(fewest: int, most: int) -> Callable[[Rng], World]:
    config = PileConfig(
        n_bodies=(fewest, most), center=_CENTER, uneven_share=0.0, large_share=0.0
    )
    return lambda rng: generate_pile(rng=rng, config=config)


FAKE_TIERS: Mapping[str, Callable[[Rng], World]] = {
    "single": _one_of(*_STURDY),
    "handle": _one_of("crate_handle"),
    "few": _pile(1, 3),
    "pile": _pile(3, 8),
    **{name: lambda _, name=name: named_scene(name) for name in SCENES},  # type: ignore[misc]
}
"""Scenes in memory by name; those of the paper are always the same."""
MARKED = ("handle",)
"""Tiers in which one object is to be taken, with the prototypes for special ones."""


def fake_world(tier: str, rng: Rng) -> World:
    """Make the scene of a tier, at rest, or raise `UnknownNameError`."""
    if tier not in FAKE_TIERS:
        raise UnknownNameError("tier", tier, FAKE_TIERS)
    return come_to_rest(let_down(FAKE_TIERS[tier](rng)).world).world


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSpec:
    """One run; equal specs give equal records, but for the time they take.

    Raises
    ------
    ConfigError
        If a field is of another kind, or a number out of range.
    UnknownNameError
        If there is no such world or level, no such tier in memory, or no state at which
        a fault is to strike.
    """

    name: str
    seed: int
    world: str = "fake"
    """One of `WORLDS`: a robot in memory, or the physics of the extra ``sim``."""
    tier: str = "few"
    """Kind of scene: of `FAKE_TIERS`, or of `debrisgrasp.sim.TIERS`."""
    level: str = "hand"
    """In physics, one of `LEVELS`: the first grasp by a flying hand, or the whole task
    by both arms."""
    site: str | None = None
    """File of settings of a site: robot, hands and prototypes; None: RoMan's."""
    faults: tuple[Injection, ...] = ()
    recovery: bool = True
    """Whether the task answers faults; if not, the first one ends the run."""
    max_removals: int | None = None
    """End a run after so many; None: when the way is clear."""
    max_attempts: int = 12
    """Give a run up after so many tries in which an arm went to an object, or three
    times as many plans that led to none."""

    def __post_init__(self) -> None:
        self._require_kinds()
        if self.world not in WORLDS:
            raise UnknownNameError("world", self.world, WORLDS)
        if self.level not in LEVELS:
            raise UnknownNameError("level", self.level, LEVELS)
        if self.world == "fake" and self.tier not in FAKE_TIERS:
            raise UnknownNameError("tier", self.tier, FAKE_TIERS)
        if (self.world, self.level) == ("mujoco", "arm") and self.tier in MARKED:
            raise ConfigError(
                "tier",
                got=f"{self.tier} at level arm",
                expected="one where nothing is marked, such as pile",
                mend="Both arms clear all that is in the way. One marked object is "
                f"taken in world fake, tier {self.tier}, or at level hand.",
            )
        if self.seed < 0:
            raise ConfigError("seed", got=self.seed, expected="0 or more")
        require_range("max_attempts", self.max_attempts, 1, 10_000)
        if self.max_removals is not None:
            require_range("max_removals", self.max_removals, 1, 10_000)
        for injection in self.faults:
            if injection.state is not None:
                state_named(injection.state)
        if self.world != "fake" and self.faults:
            raise ConfigError(
                "faults",
                got=f"{len(self.faults)} in world {self.world}",
                expected="none: only the robot in memory can be struck by them",
            )

    def _require_kinds(self) -> None:
        kinds: Mapping[str, tuple[str, tuple[type, ...]]] = {
            "name": ("text", (str,)),
            "seed": ("an integer", (int,)),
            "tier": ("text", (str,)),
            "site": ("text, or none", (str, type(None))),
            "faults": ("a tuple of Injection", (tuple,)),
            "recovery": ("true or false", (bool,)),
            "max_removals": ("an integer, or none", (int, type(None))),
            "max_attempts": ("an integer", (int,)),
        }
        for name, (words, kind) in kinds.items():
            value = getattr(self, name)
            if type(value) not in kind:  # True is no number here
                raise ConfigError(name, got=repr(value), expected=words)
        for injection in self.faults:
            if not isinstance(injection, Injection):
                raise ConfigError(
                    "faults", got=repr(injection), expected=kinds["faults"][0]
                )

    def to_json(self) -> dict[str, Any]:
        """Everything that repeats the run."""
        content = asdict(self)
        content["faults"] = [injection.to_json() for injection in self.faults]
        return content

    @staticmethod
    def from_json(content: Mapping[str, Any]) -> RunSpec:
        """Read what `to_json` wrote, for instance to repeat the run of a record.

        Raises
        ------
        ConfigError
            If a field is missing, or means nothing.
        """
        values = dict(content)
        entries = values.pop("faults", ())
        if not isinstance(entries, list | tuple):
            raise ConfigError("faults", got=repr(entries), expected="a list")
        faults = tuple(Injection.from_json(entry) for entry in entries)
        try:
            return RunSpec(**values, faults=faults)
        except TypeError as error:
            raise ConfigError(
                "run", got=str(error), expected=", ".join(RunSpec.__slots__)
            ) from error


@checked
def draw_specs(
    n: int,
    *,
    seed: int,
    world: str = "fake",
    tier: str = "few",
    level: str = "hand",
    site: str | None = None,
    faults: FaultSource | None = None,
    recovery: bool = True,
    max_removals: int | None = None,
    max_attempts: int = 12,
) -> tuple[RunSpec, ...]:
    """Draw the runs of a campaign; the first ones stay the same if n grows.

    Parameters
    ----------
    faults
        Draws the faults of a run, as `FaultRates.drawn` and `random_faults` do.

    Raises
    ------
    ConfigError
        If ``n`` is not in 1 to 1000000, or the seed is negative.
    """
    require_range("seed", seed, 0)
    if not 1 <= n <= 1_000_000:
        raise ConfigError("runs of a campaign", got=n, expected="1 to 1000000")
    specs = []
    for i in range(n):
        rng = np.random.default_rng([seed, i])
        specs.append(
            RunSpec(
                name=f"{i:06d}",
                seed=int(rng.integers(2**31)),
                world=world,
                tier=tier,
                level=level,
                site=site,
                faults=() if faults is None else faults(rng),
                recovery=recovery,
                max_removals=max_removals,
                max_attempts=max_attempts,
            )
        )
    return tuple(specs)
