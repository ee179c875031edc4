"""Where the base should stand so that the arms reach what they are to grip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    Rng,
    require_finite,
    require_range,
    require_trailing,
)
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp.errors import ConfigError, ShapeError
from debrisgrasp.geometry import SE3, lattice

from .ik import solve
from .reach import ArmReach

__all__ = ["BasePlacement", "PlacementConfig", "base_placements"]

_CHUNK = 100_000
"""Poses looked up at once; bounds memory."""
_FEW = 64
"""Poses by which placements are compared before the best are examined on all."""
_COARSE = 48
"""Placements of the first look that the solver compares."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class PlacementConfig:
    """Which placements are compared."""

    reach: float = 1.2
    """How far the base may move along x and y [m]."""
    step: float = 0.2
    """Between the placements of the first look [m]; the second halves it."""
    n_headings: int = 12
    """Headings of the base over a full turn, in the first look."""
    n_proven: int = 12
    """How many distinct placements are examined by the solver."""
    spacing: float = 0.15
    """Placements nearer than this [m] and 20 degrees count as the same."""
    clearance: float = 0.05
    """What is to be gripped stays so far out of the base [m]."""
    turn_weight: float = 0.3
    """Metres of travel that turning by one radian counts as."""

    def __post_init__(self) -> None:
        for name in ("reach", "step", "n_headings", "n_proven"):
            if not getattr(self, name) > 0:
                raise ConfigError(
                    f"PlacementConfig.{name}",
                    got=getattr(self, name),
                    expected="above zero",
                )
        for name in ("spacing", "clearance", "turn_weight"):
            require_range(f"PlacementConfig.{name}", getattr(self, name), 0.0, 10.0)
        if self.reach / self.step > 50:
            raise ConfigError(
                "PlacementConfig.step",
                got=self.step,
                expected=f"at least {self.reach / 50:g} m",
            )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BasePlacement:
    """One place for the base, and what can be reached from there."""

    x: float
    y: float
    """Where the base should stand, in the present base frame [m]."""
    yaw: float
    """How far it should turn to the left [rad]."""
    predicted: float
    """Share of the poses that the reachability map does not rule out."""
    share: float
    """Share of the poses for which a posture was found that doesn't touch the robot
    itself."""
    is_reached: BoolArray
    """Which of the n poses those are, shape (n,)."""
    travel: float
    """Way to go, turning included [m]."""

    @property
    def T_base_placed(self) -> SE3:
        """Pose of the base when it stands there, in the present base frame."""
        return SE3(_planar(np.array([[self.x, self.y, self.yaw]]))[0])


@checked
def base_placements(
    arms: Sequence[ArmReach],
    T_base_hand: SE3,
    *,
    grippers: Sequence[str] | None = None,
    keep_out: ArrayLike | None = None,
    config: PlacementConfig | None = None,
    rng: Rng,
) -> tuple[BasePlacement, ...]:
    """Rank places for the base by the share of palm poses that the arms then reach.

    All placements of a grid are judged by the reachability maps. The best that differ
    are compared by the solver on some of the poses, then those around the best of
    these, and the best of all are examined on every pose. The place where the base
    stands now is always among them, so that a gain can be read off.

    Parameters
    ----------
    arms
        Arms of one robot, any of which may take a pose.
    T_base_hand
        Palm poses wanted, present base frame; shape (n,).
    grippers
        Gripper that each pose is for, n of them; None: any will do.
    keep_out
        Points that the base must not stand on, present base frame [m], shape (m, 3);
        None: where the palms come to be.
    config
        What to compare.
    rng
        Source of the solver's random seeds.

    Returns
    -------
    tuple of BasePlacement
        Best share first; of equal ones the nearest.

    Raises
    ------
    ShapeError
        If there is no pose or no arm, or not one gripper for each pose.
    """
    config = config or PlacementConfig()
    T = np.asarray(T_base_hand.matrix)
    require_trailing(T, "palm poses", (None, 4, 4))
    if T.ndim != 3 or not len(T) or not arms:
        raise ShapeError(
            "palm poses and arms",
            got=f"poses of shape {T.shape[:-2]}, {len(arms)} arms",
            expected="(n,) with n of 1 or more, and at least one arm",
        )
    if grippers is not None and len(grippers) != len(T):
        raise ShapeError(
            "grippers", got=len(grippers), expected=f"{len(T)}, one for each pose"
        )
    points = T[:, :3, 3] if keep_out is None else np.asarray(keep_out, dtype=float)
    require_trailing(points, "keep_out", (None, 3))
    for array, name in ((T, "palm poses"), (points, "keep_out")):
        require_finite(array, name)
    judge = _Judge(arms, T, grippers, points, config)
    few: IntArray = np.arange(len(T))
    if len(T) > _FEW:
        few = np.sort(rng.permutation(len(T))[:_FEW])
    coarse = _grid(config.reach, config.step, 2.0 * np.pi / config.n_headings)
    best = _distinct(coarse, judge.predicted(coarse, few), _COARSE, config)
    places = coarse[best]
    share = judge.reached(places, few, rng).mean(axis=1)
    places = _around(places[_distinct(places, share, config.n_proven, config)], config)
    places = places[np.isfinite(judge.predicted(places, few))]
    share = judge.reached(places, few, rng).mean(axis=1)
    chosen = places[_distinct(places, share, config.n_proven, config)]
    elsewhere = chosen[_travel(chosen, config) > 0.0]
    places = np.concatenate([np.zeros((1, 3)), elsewhere])
    every = np.arange(len(T))
    predicted = judge.predicted(places, every)
    is_reached = judge.reached(places, every, rng)
    found = [
        BasePlacement(
            x=float(place[0]),
            y=float(place[1]),
            yaw=float(_wrapped(place[2])),
            predicted=max(float(allowed), 0.0),
            share=float(reached.mean()),
            is_reached=reached,
            travel=float(_travel(place, config)),
        )
        for place, allowed, reached in zip(places, predicted, is_reached, strict=True)
    ]
    return tuple(sorted(found, key=lambda p: (-round(p.share, 6), p.travel)))


class _Judge:
    """Poses and arms of one question."""

    def __init__(
        self,
        arms: Sequence[ArmReach],
        T: FloatArray,
        grippers: Sequence[str] | None,
        points: FloatArray,
        config: PlacementConfig,
    ) -> None:
        self._T, self._points, self._config = T, points, config
        wanted = [None] * len(T) if grippers is None else list(grippers)
        self._arms = []
        for arm in arms:
            mine = [i for i, g in enumerate(wanted) if g in (None, arm.gripper)]
            self._arms.append((arm, np.array(mine, dtype=np.intp)))
        still = [p.solid.bounds for p in arms[0].collision.body.parts if not p.segment]
        margin = config.clearance
        self._lower = np.min([b.lower for b in still] or [np.full(3, np.inf)], axis=0)
        self._upper = np.max([b.upper for b in still] or [np.full(3, -np.inf)], axis=0)
        self._lower, self._upper = self._lower - margin, self._upper + margin
        # What lies under the base is as much in its way as what it stands in.
        self._lower[2] = -np.inf

    def predicted(self, places: FloatArray, rows: IntArray) -> FloatArray:
        """Share of poses that the maps allow, minus infinity where the base can't be.

        ``places`` (m, 3) are x, y and yaw, ``rows`` the poses that are asked for; the
        result has shape (m,).
        """
        share = np.empty(len(places))
        step = max(1, _CHUNK // len(rows))
        for start in range(0, len(places), step):
            part = slice(start, start + step)
            to_placed = SE3(_planar(places[part])).inverse()
            may_reach = np.zeros((len(places[part]), len(self._T)), dtype=bool)
            for arm, mine in self._arms:
                asked = np.intersect1d(mine, rows)
                if not len(asked):
                    continue
                T = (to_placed.matrix[:, None] @ self._T[asked]).reshape(-1, 4, 4)
                may = arm.may_reach(SE3(T)).reshape(len(to_placed.matrix), -1)
                may_reach[:, asked] |= may
            share[part] = may_reach[:, rows].mean(axis=1)
            share[part][self._is_blocked(to_placed)] = -np.inf
        return share

    def _is_blocked(self, to_placed: SE3) -> BoolArray:
        inside = to_placed[:, None].apply(self._points)
        is_in = (inside > self._lower) & (inside < self._upper)
        return np.asarray(is_in.all(axis=-1).any(axis=-1))

    def reached(self, places: FloatArray, rows: IntArray, rng: Rng) -> BoolArray:
        """Poses taken without touching the robot, found by the solver; (m, rows)."""
        to_placed = SE3(_planar(places)).inverse().matrix
        is_reached = np.zeros((len(places), len(self._T)), dtype=bool)
        for arm, mine in self._arms:
            asked = np.intersect1d(mine, rows)
            place, column = np.nonzero(~is_reached[:, asked])
            pose = asked[column]
            T = SE3(to_placed[place] @ self._T[pose])
            found = solve(
                arm.chain,
                T,
                reach_map=arm.reach_map,
                rng=rng,
                config=replace(arm.config.ik, attempts=8),
            )
            solved = np.flatnonzero(found.is_solved)
            hits = arm.collision.hits_itself(found.q[solved])
            if hits.any():
                # Where one posture touches the robot another may not.
                others = arm.reach(T[solved[hits]], _nothing, rng=rng)
                hits[hits] = ~others.is_reached
            free = solved[~hits]
            is_reached[place[free], pose[free]] = True
        return is_reached[:, rows]


def _nothing(points: FloatArray) -> FloatArray:
    """Distance of points (..., 3) from obstacles where there are none [m]."""
    return np.full(points.shape[:-1], np.inf)


def _grid(reach: float, step: float, turn: float) -> FloatArray:
    n = int(reach / step + 1e-9)
    line = step * np.arange(-n, n + 1)
    yaw = turn * np.arange(round(2.0 * np.pi / turn))
    return lattice(line, line, yaw).reshape(-1, 3)


def _around(places: FloatArray, config: PlacementConfig) -> FloatArray:
    """Placements half a step away from some (m, 3), and those themselves."""
    half = np.array([config.step, config.step, 2.0 * np.pi / config.n_headings]) / 2
    offsets = (np.array(list(np.ndindex(3, 3, 3))) - 1) * half
    return (places[:, None] + offsets).reshape(-1, 3)


def _travel(places: FloatArray, config: PlacementConfig) -> FloatArray:
    """Way to placements (..., 3), turning included [m]."""
    level: FloatArray = np.hypot(places[..., 0], places[..., 1])
    return level + config.turn_weight * np.abs(_wrapped(places[..., 2]))


def _distinct(
    places: FloatArray, value: FloatArray, most: int, config: PlacementConfig
) -> IntArray:
    """Best placements that differ from one another, best first."""
    travel = _travel(places, config)
    kept: list[int] = []
    for i in np.lexsort((travel, -np.round(value, 3))):
        if not np.isfinite(value[i]) or len(kept) == most:
            break
        gap = places[kept] - places[i]
        is_near = np.hypot(gap[:, 0], gap[:, 1]) < config.spacing
        is_near &= np.abs(_wrapped(gap[:, 2])) < np.deg2rad(20.0)
        if not is_near.any():
            kept.append(int(i))
    return np.array(kept, dtype=np.intp)


def _planar(places: FloatArray) -> FloatArray:
    """Matrices (m, 4, 4) of x, y and yaw (m, 3)."""
    T = np.tile(np.eye(4), (len(places), 1, 1))
    cos, sin = np.cos(places[:, 2]), np.sin(places[:, 2])
    T[:, 0, 0], T[:, 0, 1], T[:, 1, 0], T[:, 1, 1] = cos, -sin, sin, cos
    T[:, :2, 3] = places[:, :2]
    return T


def _wrapped(angle: FloatArray) -> FloatArray:
    wrapped: FloatArray = angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi))
    return wrapped
