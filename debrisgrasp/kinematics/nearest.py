"""Inverse kinematics that stays near a posture, or says that it can't."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import (
    FloatArray,
    IntArray,
    Rng,
    require_range,
)
from debrisgrasp.geometry import SE3

from .chain import KinematicChain
from .descent import SINGLE_FLOOR, Descent, Goals
from .ik import solve, solve_distinct
from .ik_input import checked_config, checked_poses, checked_postures
from .ik_types import IkConfig, IkResult, IkStatus
from .program import LaneKernel
from .reach_map import ReachMap
from .serial import Lanes

__all__ = ["solve_nearest"]

_ATTEMPTS = 8
"""Most descents within the bound."""
_CANDIDATES = 8
"""Distinct postures of which the nearest is returned where none keeps the bound."""
_POLISH_STEPS = 4


def solve_nearest(
    chain: KinematicChain,
    T_base_tip: SE3,
    q_near: ArrayLike,
    *,
    bound: float,
    reach_map: ReachMap | None = None,
    rng: Rng,
    config: IkConfig | None = None,
) -> IkResult:
    """Find for each pose a posture within a bound of a given one.

    The bound acts as a limit of every joint while the descent starts from the given
    posture, and then from others within the bound.

    Parameters
    ----------
    chain
        The arm.
    T_base_tip
        Poses wanted of the chain's tip, any leading axes (...).
    q_near
        Posture to stay near, shape (d,) or (..., d); within the limits.
    bound
        Largest motion allowed of any joint [rad or m]. Joints with limits can't go the
        short way round; endless ones can.
    reach_map, rng, config
        As for `solve`.

    Returns
    -------
    IkResult
        Leading axes as the poses. Solved poses keep the bound. Where the pose can be
        reached, but no posture found keeps the bound, the status is ``FAR`` and ``q``
        the nearest found.

    Raises
    ------
    InputError
        As for `solve`, and if the bound is not above zero.
    """
    require_range("bound", bound, 1e-6)
    config = checked_config(chain, reach_map, config, rng)
    targets, batch = checked_poses(T_base_tip), T_base_tip.batch
    wanted = checked_postures(chain, q_near, "q_near", batch)
    lower = np.clip(wanted - bound, chain.lower, chain.upper)
    upper = np.clip(wanted + bound, chain.lower, chain.upper)
    goals = Goals.from_matrices(chain.form, targets)
    q = _descended(chain, goals, wanted, lower, upper, rng, config)
    errors = goals.errors(chain.formulas(config.freedom), q.T)
    tolerance = (config.position_tolerance, config.rotation_tolerance)
    keeps_bound = chain.travel(q, wanted) <= bound
    is_found = (tolerance >= errors.T).all(axis=1) & keeps_bound
    found = IkResult(
        q=q,
        status=np.where(is_found, IkStatus.SOLVED, IkStatus.FAR),
        position_error=errors[0],
        rotation_error=errors[1],
    )
    left = np.flatnonzero(~is_found)
    if len(left):
        others = _nearest_elsewhere(
            chain, SE3(targets[left]), wanted[left], reach_map, rng, config
        )
        is_far = others.is_solved & (chain.travel(others.q, wanted[left]) > bound)
        found.q[left] = others.q
        found.status[left] = np.where(is_far, IkStatus.FAR, others.status)
        found.position_error[left] = others.position_error
        found.rotation_error[left] = others.rotation_error
    return found.reshaped(batch)


def _descended(
    chain: KinematicChain,
    goals: Goals,
    start: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    rng: Rng,
    config: IkConfig,
) -> FloatArray:
    """Postures (n, d) at which descents within own limits (n, d) have ended."""
    formulas = chain.formulas(config.freedom)
    rows = np.concatenate([goals.rows, lower.T, upper.T])

    def seeds(index: IntArray, attempt: IntArray) -> Lanes:
        anywhere = rng.uniform(lower[index], upper[index])
        is_first = (attempt == 0)[:, None]
        q = np.where(is_first, start[index], anywhere).clip(lower[index], upper[index])
        return np.ascontiguousarray(q.T, dtype=np.float32)

    enough = max(SINGLE_FLOOR, config.weighted_tolerance)
    descent = Descent(formulas.boxed_step_of_lanes, config, enough)
    end = descent.run(rows, seeds, min(_ATTEMPTS, config.attempts))
    q = end.q.astype(np.float64)
    if config.weighted_tolerance < SINGLE_FLOOR:
        step = LaneKernel(formulas.exact_boxed_step_of_lanes, np.float64)
        weights = np.array(config.rotation_weight), np.array(config.damping)
        for _ in range(_POLISH_STEPS):
            q = step(*q, *rows, *weights)[1:].copy()
    return q.T.clip(lower, upper)


def _nearest_elsewhere(
    chain: KinematicChain,
    poses: SE3,
    wanted: FloatArray,
    reach_map: ReachMap | None,
    rng: Rng,
    config: IkConfig,
) -> IkResult:
    """Of several postures of each pose the one that is nearest to ``wanted`` (n, d)."""
    near = solve(
        chain, poses, q_seed=wanted, reach_map=reach_map, rng=rng, config=config
    )
    others = solve_distinct(
        chain, poses, _CANDIDATES, reach_map=reach_map, rng=rng, config=config
    )
    q = chain.unwound(
        np.concatenate([near.q[:, None], others.q], axis=1), wanted[:, None]
    )
    travel = chain.travel(q, wanted[:, None])
    status = np.concatenate([near.status[:, None], others.status], axis=1)
    choice = np.where(status == IkStatus.SOLVED, travel, np.inf).argmin(axis=1)
    errors = [
        np.concatenate([first[:, None], rest], axis=1)
        for first, rest in (
            (near.position_error, others.position_error),
            (near.rotation_error, others.rotation_error),
        )
    ]
    picked = np.arange(len(q)), choice
    return IkResult(
        q=q[picked],
        status=status[picked],
        position_error=errors[0][picked],
        rotation_error=errors[1][picked],
    )
