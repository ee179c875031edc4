"""Settings of motion planning."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from debrisgrasp._arrays import require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp.kinematics import IkConfig

from .rrt import PathSearch, connect

__all__ = ["Engine", "MotionConfig"]

Engine = Callable[..., PathSearch]
"""Called as ``engine(query, rng=rng)``: `connect`, or `ompl_engine.connect_by_ompl`."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class MotionConfig:
    """What motions keep, and how hard they are sought."""

    margin: float = 0.005
    """Distance of the links from measured points, unknown cells and ground [m]."""
    self_margin: float = 0.002
    """Distance of the parts of the robot from one another [m]."""
    spare: float = 0.005
    """What the search keeps beyond these margins [m]: for what happens between its
    samples."""
    step: float = 0.08
    """Largest change of a joint between two samples of the search [rad or m]."""
    exact_step: float = 0.01
    """The same for the final check by the links' solids."""
    start_room: float = 0.05
    """Unknown space nearer than this to where the robot stands counts as free [m]."""
    n_goals: int = 24
    """Postures sought at the goal; any of them may end the motion."""
    max_rounds: int = 300
    """Of the search by trees, all attempts together."""
    shortcut_rounds: int = 6
    """Batches of shortcuts that are tried."""
    attempts: int = 4
    """Searches made if the final check refuses what one has found; each with half the
    step of the one before."""
    engine: Engine = connect
    """Finds a path where no straight edge does."""
    ik: IkConfig = IkConfig(attempts=16)

    def __post_init__(self) -> None:
        for name in ("margin", "self_margin", "spare", "start_room"):
            require_range(f"MotionConfig.{name} [m]", getattr(self, name), 0.0, 0.5)
        require_range("MotionConfig.exact_step", self.exact_step, 1e-4, 0.1)
        require_range("MotionConfig.step", self.step, self.exact_step, 0.5)
        for name in ("n_goals", "max_rounds", "attempts"):
            require_range(f"MotionConfig.{name}", getattr(self, name), 1, 1e6)
        require_range("MotionConfig.shortcut_rounds", self.shortcut_rounds, 0, 1e6)
