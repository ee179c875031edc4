"""R of Eq. 2-3: joints for the states that the search settles in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, Rng
from debrisgrasp.geometry import SE3

from .annealing import Walkers
from .quality import NOTHING
from .reach import Arm

__all__ = ["Postures", "Settled", "joint_columns"]

_WORTH_ASKING = float(np.log(0.02))
"""Log of the share of the best quality below which a state isn't worth solving."""
_STEP, _TURN = 0.1, 0.6
"""Distance [m] and angle [rad] over which joints are followed."""


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """Walkers whose best states hold, and the joints that take these, k of them."""

    walkers: Walkers
    joints: FloatArray
    """Those of all arms side by side, NaN where an arm has no posture or was not asked;
    shape (k, d)."""

    @classmethod
    def together(cls, parts: Sequence[Settled]) -> Settled:
        """Put several sets of walkers side by side."""
        return cls(
            Walkers.together([part.walkers for part in parts]),
            np.concatenate([part.joints for part in parts]),
        )

    def __getitem__(self, kept: IntArray) -> Settled:
        return Settled(self.walkers[kept], self.joints[kept])


class Postures:
    """Follows walkers with the arms that carry the hands they place.

    A walker's best state changes little from one time to the next, so its joints are
    found from those before.

    Parameters
    ----------
    arms
        Arms to choose from; with none every state holds.
    gripper_of
        Name of the hand of each prototype, shape (p,).
    rng
        Source of the solver's seeds.
    """

    def __init__(
        self, arms: Sequence[Arm], gripper_of: NDArray[np.str_], rng: Rng
    ) -> None:
        self._columns = joint_columns(arms)
        self._arms, self._gripper_of, self._rng = arms, gripper_of, rng
        self._missed: list[tuple[FloatArray, IntArray, FloatArray]] = []
        self._n_joints = sum(len(arm.joint_names) for arm in arms)

    def unknown(self, walkers: Walkers) -> Settled:
        """Take walkers as they are, with no joints known."""
        n = len(walkers.log_quality)
        return Settled(walkers, np.full((n, self._n_joints), np.nan))

    def settled(
        self, before: Settled, walkers: Walkers, prototype: IntArray
    ) -> Settled:
        """Solve the best states found since; those that don't hold are undone.

        Parameters
        ----------
        before
            The same walkers when they were last settled.
        walkers
            Where they are now.
        prototype
            What each places, shape (k,).
        """
        best, value = walkers.best_Ts_base_hand, walkers.best_log_quality
        is_new = value > before.walkers.best_log_quality
        least = value.max(initial=NOTHING) + _WORTH_ASKING
        asked = np.flatnonzero(is_new & (value > max(least, NOTHING)))
        is_far = ~_is_close(before.walkers.best_Ts_base_hand[asked], best[asked])
        seeds = before.joints[asked]
        seeds[is_far] = np.nan
        holds, found = self._solved(prototype[asked], best[asked], seeds)
        lost = asked[~holds]
        self._missed.append((best[lost], prototype[lost], value[lost]))
        joints = before.joints.copy()
        joints[is_new] = np.nan
        joints[asked] = found
        joints[lost] = before.joints[lost]
        return Settled(walkers.with_rows(lost, before.walkers), joints)

    def completed(
        self, before: Settled, prototype: IntArray
    ) -> tuple[BoolArray, Settled]:
        """Solve the best states, however poor; tell which walkers hold, (k,).

        The joints that they have are where the solver begins.
        """
        best = before.walkers.best_Ts_base_hand
        holds, joints = self._solved(prototype, best, before.joints)
        lost = np.flatnonzero(~holds)
        value = before.walkers.best_log_quality[lost]
        self._missed.append((best[lost], prototype[lost], value))
        return holds, Settled(before.walkers, joints)

    def _solved(
        self, prototype: IntArray, Ts: FloatArray, seeds: FloatArray
    ) -> tuple[BoolArray, FloatArray]:
        """Whether arms take poses (n, 4, 4), and their joints (n, d)."""
        if not self._arms or not len(Ts):
            return np.ones(len(Ts), dtype=bool), seeds
        gripper, found = self._gripper_of[prototype], np.full_like(seeds, np.nan)
        for arm, columns in zip(self._arms, self._columns, strict=True):
            mine = np.flatnonzero(gripper == arm.gripper)
            if len(mine):
                found[mine, columns] = arm.follow(
                    SE3(Ts[mine]), seeds[mine, columns], rng=self._rng
                )
        return np.asarray(np.isfinite(found).any(axis=1)), found

    def missed(self) -> tuple[FloatArray, IntArray, FloatArray]:
        """States that did not hold: poses, prototypes and log Q-hat."""
        nothing = (np.zeros((0, 4, 4)), np.zeros(0, dtype=np.intp), np.zeros(0))
        Ts, prototype, value = zip(nothing, *self._missed, strict=True)
        return np.concatenate(Ts), np.concatenate(prototype), np.concatenate(value)


def joint_columns(arms: Sequence[Arm]) -> list[slice]:
    """Where the joints of each arm are if those of all stand side by side."""
    ends = np.cumsum([0, *(len(arm.joint_names) for arm in arms)]).tolist()
    return [slice(first, end) for first, end in pairwise(ends)]


def _is_close(a: FloatArray, b: FloatArray) -> BoolArray:
    """Whether the poses (n, 4, 4) of both are a small step apart, (n,)."""
    apart = np.square(a[:, :3] - b[:, :3]).sum(axis=1)
    # Of two rotations: four times one minus the cosine of the angle between them.
    is_near = (apart[:, 3] < _STEP**2) & (apart[:, :3].sum(axis=1) < 2.0 * _TURN**2)
    return np.asarray(is_near)
