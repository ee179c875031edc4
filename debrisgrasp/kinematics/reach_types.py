"""Records of what an arm reaches: settings and answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, require_range
from debrisgrasp._checked import checked_fields

from .ik_types import IkConfig, IkStatus

__all__ = ["HITS_ITSELF", "HITS_SCENE", "WORDS", "ReachConfig", "ReachResult"]

WORDS = {
    IkStatus.SOLVED: "",
    IkStatus.UNREACHABLE: "out of reach",
    IkStatus.LIMIT: "joint limit",
    IkStatus.STALLED: "no posture found",
    IkStatus.BUDGET: "no posture found",
}
"""Why a pose is not reached, empty where it is."""
HITS_SCENE = "arm hits the scene"
HITS_ITSELF = "arm hits itself"
_MOST = 1e6
"""Weight beside which no other counts; infinite ones of nothing would cost NaN."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class ReachConfig:
    """How hard to look for a posture, and which to prefer."""

    n_postures: int = 6
    """Further postures looked at in each round; more find a collision-free one more
    often."""
    rounds: int = 2
    """How often poses are looked at: first the posture nearest to the present one, and
    where that isn't free, others."""
    margin: float = 0.01
    """Clearance from the scene that the links keep [m]."""
    self_margin: float = 0.005
    """Distance that the parts of the robot keep from one another [m]."""
    limit_weight: float = 1.0
    """Cost of a joint at its limit, in radians of travel; see `PostureCost`."""
    singularity_weight: float = 1.0
    """Cost of a singular posture, in radians of travel."""
    free_dexterity: float = 0.04
    """Smallest singular value of the Jacobian from which on a posture counts as free of
    singularities; see `dexterity`."""
    scene_weight: float = 0.5
    """Cost of a link that touches the scene, in radians of travel."""
    slides: int = 1
    """Steps in which a chain with more than six joints moves within its nullspace to
    where the posture costs less; 0 takes it as it was found."""
    ik: IkConfig = IkConfig(attempts=16)
    """Solver settings; seeds of the map make further attempts pointless."""

    def __post_init__(self) -> None:
        for name, least, most in (
            ("n_postures", 1, np.inf),
            ("rounds", 1, np.inf),
            ("slides", 0, np.inf),
            ("free_dexterity", 1e-9, np.inf),
            ("margin", 0.0, 1.0),
            ("self_margin", 0.0, 1.0),
            ("limit_weight", 0.0, _MOST),
            ("singularity_weight", 0.0, _MOST),
            ("scene_weight", 0.0, _MOST),
        ):
            require_range(f"ReachConfig.{name}", getattr(self, name), least, most)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ReachResult:
    """For each of k poses: the posture that takes it, or why there is none."""

    joints: FloatArray
    """Joint values [rad or m], shape (k, d); NaN where not reached."""
    is_reached: BoolArray
    """Taken within limits, clear of scene and robot; shape (k,)."""
    reasons: tuple[str, ...]
    """Why a pose is not reached, empty where it is; k of them."""
    clearance: FloatArray
    """Distance between links and scene [m], shape (k,); NaN where no posture."""

    def improved(self, rows: IntArray, other: ReachResult) -> ReachResult:
        """Take over what another result, for the poses of rows (m,), has reached."""
        better = np.flatnonzero(other.is_reached)
        joints, clearance = self.joints.copy(), self.clearance.copy()
        is_reached, reasons = self.is_reached.copy(), list(self.reasons)
        joints[rows[better]] = other.joints[better]
        clearance[rows[better]] = other.clearance[better]
        is_reached[rows[better]] = True
        for row in rows[better]:
            reasons[row] = ""
        return ReachResult(
            joints=joints,
            is_reached=is_reached,
            reasons=tuple(reasons),
            clearance=clearance,
        )
