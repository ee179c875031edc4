"""Which places an arm can grip, and from which directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    Rng,
    as_rows,
    finite,
    require_count,
    require_metres,
    require_range,
)
from debrisgrasp._checked import checked
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, Bounds, lattice

from .chain import KinematicChain
from .ik import solve, solve_distinct
from .reach import ArmReach

__all__ = [
    "APPROACHES",
    "Approach",
    "ReachSurvey",
    "grid_places",
    "palm_poses",
    "survey_reach",
]

GRIP_DEPTH = 0.06
"""What is gripped lies so far in front of the palm [m]."""
_N_POSTURES = 4
"""Further postures looked at where the first touches the robot itself."""
_MOST_PLACES = 200_000


@dataclass(frozen=True, slots=True, eq=False)
class Approach:
    """A kind of approach: one or several directions that serve the same purpose."""

    name: str
    directions: FloatArray
    """Unit vectors along which the palm comes, base frame; shape (m, 3)."""

    @classmethod
    def sloped(cls, name: str, slope: float, headings: Sequence[float]) -> Approach:
        """Come down at an angle [rad] below the horizontal, from several headings.

        A heading [rad] is that of the palm's motion: 0 along the base's x axis.
        """
        turn = np.asarray(headings, dtype=np.float64)
        level, down = np.cos(slope), -np.sin(slope)
        x, y, z = np.broadcast_arrays(level * np.cos(turn), level * np.sin(turn), down)
        return cls(name, np.stack([x, y, z], axis=-1))


_HEADINGS = tuple(np.deg2rad((-60.0, -30.0, 0.0, 30.0, 60.0)))
APPROACHES = (
    Approach("top-down", np.array([[0.0, 0.0, -1.0]])),
    Approach.sloped("45 deg", np.pi / 4, _HEADINGS),
    Approach.sloped("frontal", 0.0, _HEADINGS),
)
"""From above, and away from the robot within 60 degrees of its x axis."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ReachSurvey:
    """What one arm can do at p places by D directions."""

    arm: str
    gripper: str
    places: FloatArray
    """Where the middle of the gripped thing is, base frame [m]; shape (p, 3)."""
    approaches: tuple[Approach, ...]
    kind: IntArray
    """Which of the approaches each direction belongs to, shape (D,)."""
    is_reached: BoolArray
    """Within the limits of the joints, with some turn of the hand; shape (p, D)."""
    is_free: BoolArray
    """With a posture found that doesn't touch the robot itself; shape (p, D)."""

    def share(self, approach: int | None = None) -> FloatArray:
        """Share of the directions that are free at each place, shape (p,).

        Of one kind of approach, or of all directions.
        """
        chosen = slice(None) if approach is None else self.kind == approach
        share: FloatArray = self.is_free[:, chosen].mean(axis=1)
        return share

    def part(self, approach: int) -> Bounds | None:
        """Box around the places that this approach can grip; None if there is none."""
        at = self.places[self.share(approach) > 0]
        return Bounds(at.min(axis=0), at.max(axis=0)) if len(at) else None

    def joined(self, other: ReachSurvey) -> ReachSurvey:
        """Return what either of two arms can do at the same places."""
        return ReachSurvey(
            arm=f"{self.arm} or {other.arm}",
            gripper="any",
            places=self.places,
            approaches=self.approaches,
            kind=self.kind,
            is_reached=self.is_reached | other.is_reached,
            is_free=self.is_free | other.is_free,
        )


@checked
def survey_reach(
    arm: ArmReach,
    places: ArrayLike,
    approaches: Sequence[Approach] = APPROACHES,
    *,
    grip_depth: float = GRIP_DEPTH,
    n_turns: int = 4,
    rng: Rng,
) -> ReachSurvey:
    """Try to bring an arm's palm to every place from every direction.

    The scene is left out: it is what the arm can do with nothing in its way. "Reached"
    is certain, as is "free"; what is not found may exist in rare cases, because few
    postures are looked at.

    Parameters
    ----------
    arm
        The arm, with its solver settings.
    places
        Where the middle of the gripped thing is, base frame [m]; shape (p, 3).
    approaches
        Directions to try.
    grip_depth
        How far in front of the palm that middle lies [m].
    n_turns
        Turns of the hand about its approach that are tried. Where the last joint turns
        a full circle they make no difference to what is reached.
    rng
        Source of the random seeds.

    Raises
    ------
    InputError
        If places are not (p, 3), not finite or in millimetres, or no direction is to be
        tried.
    """
    at = finite(places, "places", (None, 3))
    require_metres("places", at)
    if not approaches:
        raise InputError("approaches", got="none", expected="at least one")
    directions = np.concatenate([a.directions for a in approaches])
    counts = [len(a.directions) for a in approaches]
    kind = np.repeat(np.arange(len(approaches)), counts)
    T = palm_poses(at, directions, grip_depth, n_turns).matrix
    n = len(at) * len(directions)
    T = T.reshape(n, n_turns, 4, 4)
    is_reached, is_free = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    is_idle = _turns_freely(arm.chain)
    for turn in range(n_turns):
        # If the last joint alone can turn the hand, a further turn reaches no more; it
        # only may free a hand that touches the robot.
        todo = np.flatnonzero(~is_free & (is_reached | (not (turn and is_idle))))
        poses = SE3(T[todo, turn])
        todo = todo[arm.may_reach(poses)]
        poses = SE3(T[todo, turn])
        found = solve(
            arm.chain, poses, reach_map=arm.reach_map, rng=rng, config=arm.config.ik
        )
        todo, q = todo[found.is_solved], found.q[found.is_solved]
        is_reached[todo] = True
        is_free[todo] = ~arm.collision.hits_itself(q)
    _look_closer(arm, T, is_reached, is_free, rng)
    shape = (len(at), len(directions))
    return ReachSurvey(
        arm=arm.name,
        gripper=arm.gripper,
        places=at,
        approaches=tuple(approaches),
        kind=kind,
        is_reached=is_reached.reshape(shape),
        is_free=is_free.reshape(shape),
    )


def _turns_freely(chain: KinematicChain) -> bool:
    """Whether the last joint turns the palm about its approach without limits."""
    palm = chain.T_base_tip_at_zero
    axis, offset = chain.axes[-1], palm.p - chain.points[-1]
    across = np.linalg.norm(offset - (offset @ axis) * axis)
    is_aligned = abs(axis @ palm.R[:, 2]) > 1.0 - 1e-9 and across < 1e-6
    return bool(chain.is_cyclic[-1] and is_aligned)


def _look_closer(
    arm: ArmReach, T: FloatArray, is_reached: BoolArray, is_free: BoolArray, rng: Rng
) -> None:
    """Seek further postures where all found so far touch the robot; fills is_free."""
    for turn in range(T.shape[1]):
        todo = np.flatnonzero(is_reached & ~is_free)
        if not len(todo):
            return
        found = solve_distinct(
            arm.chain,
            SE3(T[todo, turn]),
            _N_POSTURES,
            reach_map=arm.reach_map,
            rng=rng,
            config=arm.config.ik,
        )
        clear = found.is_solved
        clear[clear] = ~arm.collision.hits_itself(found.q[clear])
        is_free[todo] = clear.any(axis=1)


def palm_poses(
    places: FloatArray, directions: FloatArray, grip_depth: float, n_turns: int = 1
) -> SE3:
    """Palm poses that hold places (p, 3) from directions (D, 3), shape (p, D, turns).

    The palm's z axis is along the direction; turn zero has its x axis as level as it
    can be, and the turns divide a full one.

    Raises
    ------
    InputError
        If places or directions are of another shape, or a direction has no length.
    """
    require_count("n_turns", n_turns, 1)
    places = as_rows(places, "places")
    directions = as_rows(directions, "directions")
    if not (np.linalg.norm(directions, axis=-1) > 0.0).all():
        raise InputError(
            "directions", got="one without a length", expected="a direction each"
        )
    z = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    up = np.where(np.abs(z[:, 2:]) < 0.99, [[0.0, 0.0, 1.0]], [[-1.0, 0.0, 0.0]])
    x = np.cross(z, up)
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    y = np.cross(z, x)
    angle = 2.0 * np.pi * np.arange(n_turns) / n_turns
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    R = np.empty((len(z), n_turns, 3, 3))
    R[..., 0] = x[:, None] * cos + y[:, None] * sin
    R[..., 1] = y[:, None] * cos - x[:, None] * sin
    R[..., 2] = z[:, None]
    T = np.zeros((len(places), *R.shape[:2], 4, 4))
    T[..., :3, :3], T[..., 3, 3] = R, 1.0
    T[..., :3, 3] = (places[:, None] - grip_depth * z)[:, :, None]
    return SE3(T)


@checked
def grid_places(bounds: Bounds, step: float) -> FloatArray:
    """Evenly spaced places that fill a box, at most ``step`` [m] apart; (p, 3).

    Raises
    ------
    InputError
        If there would be more than 200 000, or the step is not above zero.
    """
    require_range("step [m]", step, 1e-6)
    counts = np.maximum(np.ceil(bounds.size / step - 1e-9), 0).astype(int) + 1
    if np.prod(counts.astype(float)) > _MOST_PLACES:
        raise InputError(
            "region",
            got=f"{np.prod(counts.astype(float)):.0f} places {step} m apart",
            expected=f"at most {_MOST_PLACES}",
            mend="Take a smaller region or a coarser step.",
        )
    lines = [
        np.linspace(low, high, n) if n > 1 else np.array([0.5 * (low + high)])
        for low, high, n in zip(bounds.lower, bounds.upper, counts, strict=True)
    ]
    return lattice(*lines).reshape(-1, 3)
