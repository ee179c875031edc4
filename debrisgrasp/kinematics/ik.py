"""Inverse kinematics of any serial chain, for batches of poses.

Seeds descend side by side in single precision. What converges is checked in double
precision, and polished if need be, so that every pose reported solved is solved to
tolerance by the chain's own forward kinematics, within its limits.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray, Rng, require_count
from debrisgrasp.geometry import SE3

from .chain import KinematicChain
from .formulas import AxisGoals
from .ik_input import checked_config, checked_poses, checked_postures
from .ik_types import IkConfig, IkResult, IkStatus
from .reach_map import ReachMap
from .search import HANDFUL, PoseSearch
from .single import PoseByPose, Posture

__all__ = ["solve", "solve_distinct"]

_STARTS = 8
"""Seeds tried one by one before the search on lanes."""


def solve(
    chain: KinematicChain,
    T_base_tip: SE3,
    *,
    q_seed: ArrayLike | None = None,
    reach_map: ReachMap | None = None,
    rng: Rng,
    config: IkConfig | None = None,
) -> IkResult:
    """Find one posture for each pose.

    Parameters
    ----------
    chain
        The arm.
    T_base_tip
        Poses wanted of the chain's tip, any leading axes (...).
    q_seed
        Posture to start from, shape (d,) or (..., d); it is first brought within the
        limits. The descent stays in its neighbourhood where it can; poses it fails on
        are tried from elsewhere.
    reach_map
        Map of this chain. It rules poses out at once and gives the others seeds next to
        their solution; random seeds still serve what these fail on.
    rng
        Source of the random seeds; the same state gives the same result.
    config
        Tolerances and budget.

    Returns
    -------
    IkResult
        Leading axes as the poses. Where a pose is not solved, ``q`` is the nearest
        approach found.

    Raises
    ------
    InputError
        If a pose is not finite or not rigid, or the seed has the wrong shape.
    """
    config = checked_config(chain, reach_map, config, rng)
    targets, batch = checked_poses(T_base_tip), T_base_tip.batch
    wanted = seeds = None
    if q_seed is not None:
        wanted = checked_postures(chain, q_seed, "q_seed", batch)
        seeds = chain.clipped(wanted)
    if len(targets) <= HANDFUL and chain.has_turning_ends and not config.freedom.n_axes:
        found = _solve_few(chain, config, targets, seeds, reach_map, rng)
    else:
        search = PoseSearch(chain, config, targets, reach_map, rng)
        if seeds is not None:
            search.try_from(seeds)
        search.exhaust(np.zeros(len(targets), dtype=np.intp))
        found = search.result()
    if wanted is not None:
        found = replace(found, q=chain.unwound(found.q, wanted))
    return found.reshaped(batch)


def solve_distinct(
    chain: KinematicChain,
    T_base_tip: SE3,
    n_solutions: int,
    *,
    reach_map: ReachMap | None = None,
    n_seeds_used: int = 0,
    rng: Rng,
    config: IkConfig | None = None,
) -> IkResult:
    """Find several postures for each pose that differ from one another.

    Parameters
    ----------
    chain, T_base_tip, reach_map, rng, config
        As for `solve`.
    n_solutions
        Postures sought for each pose.
    n_seeds_used
        Seeds of the map to pass over, because an earlier call has started from them.

    Returns
    -------
    IkResult
        Leading axes (..., n_solutions); solved ones first. Postures that came out equal
        to an earlier one (`IkConfig.separation`) have status ``STALLED``.

    Raises
    ------
    InputError
        As for `solve`, and if one of the counts is none.
    """
    require_count("n_solutions", n_solutions, 1)
    require_count("n_seeds_used", n_seeds_used)
    config = checked_config(chain, reach_map, config, rng)
    targets, batch = checked_poses(T_base_tip), T_base_tip.batch
    repeated = np.repeat(targets, n_solutions, axis=0)
    search = PoseSearch(chain, config, repeated, reach_map, rng)
    # Every copy of a target starts from another seed.
    first = n_seeds_used + np.arange(n_solutions)
    search.exhaust(np.tile(first, len(targets)), n_solutions)
    found = search.result()
    # An empty array can't tell how many rows it has.
    rows = (len(targets), n_solutions)
    q = found.q.reshape(*rows, chain.n_joints)
    status = found.status.reshape(rows).copy()
    for later in range(1, n_solutions):
        gap = np.abs(chain.difference(q[:, :later], q[:, later : later + 1]))
        is_same = (gap < config.separation).all(axis=-1)
        is_same &= status[:, :later] == IkStatus.SOLVED
        is_repeat = is_same.any(axis=1) & (status[:, later] == IkStatus.SOLVED)
        status[is_repeat, later] = IkStatus.STALLED
    order = np.argsort(status, axis=1, kind="stable")
    shape = (*batch, n_solutions)

    def sorted_by_status(values: FloatArray) -> FloatArray:
        return np.take_along_axis(values.reshape(rows), order, 1)

    return IkResult(
        q=np.take_along_axis(q, order[..., None], 1).reshape(*shape, chain.n_joints),
        status=np.take_along_axis(status, order, 1).reshape(shape),
        position_error=sorted_by_status(found.position_error).reshape(shape),
        rotation_error=sorted_by_status(found.rotation_error).reshape(shape),
    )


def _solve_few(
    chain: KinematicChain,
    config: IkConfig,
    targets: FloatArray,
    seeds: FloatArray | None,
    reach_map: ReachMap | None,
    rng: Rng,
) -> IkResult:
    """Solve a handful of targets (n, 4, 4) one by one; seeds (n, d)."""
    one = PoseByPose(chain, config)
    n_tried = min(_STARTS, config.attempts)
    if reach_map is not None:
        reach_map.require_chain(chain)
    found: list[Posture | None] = []
    for i, target in enumerate(targets):
        goal = one.goal(target)
        posture = None
        if seeds is not None:
            posture = one.from_posture(goal, seeds[i].tolist())
        if posture is None:
            if reach_map is not None:
                starts = reach_map.middles_of_one(*AxisGoals.of_one(goal))[:n_tried]
            else:
                starts = chain.sampled(n_tried, rng=rng)[:, 1:-1].tolist()
            posture = one.from_any(goal, starts)
        found.append(posture)
    missing = [i for i, posture in enumerate(found) if posture is None]
    n, d = len(targets), chain.n_joints
    q, errors, status = np.empty((n, d)), np.empty((2, n)), np.zeros(n, dtype=np.intp)
    for i, posture in enumerate(found):
        if posture is not None:
            q[i], errors[0, i], errors[1, i] = posture
    if missing:
        search = PoseSearch(chain, config, targets[missing], reach_map, rng)
        search.exhaust(np.full(len(missing), n_tried, dtype=np.intp))
        rest = search.result()
        q[missing], status[missing] = rest.q, rest.status
        errors[:, missing] = rest.position_error, rest.rotation_error
    return IkResult(
        q=q, status=status, position_error=errors[0], rotation_error=errors[1]
    )
