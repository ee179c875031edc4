"""Inverse kinematics of any serial chain, for batches of poses.

Seeds descend side by side in single precision. What converges is checked in double
precision, and polished if need be, so that every pose reported solved is solved to
tolerance by the chain's own forward kinematics, within its limits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray, Rng, require_finite, require_trailing
from debrisgrasp.errors import InputError, ShapeError
from debrisgrasp.geometry import SE3

from .chain import KinematicChain
from .ik_types import IkConfig, IkResult, IkStatus
from .reach_map import ReachMap
from .search import PoseSearch
from .serial import Lanes

__all__ = ["solve", "solve_distinct"]

_RIGID_TOLERANCE = 1e-3
"""How far ``R.T @ R`` of a target may be from the identity."""


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
    config = config or IkConfig()
    targets, batch = _require_poses(T_base_tip), T_base_tip.batch
    search = PoseSearch(chain, config, targets, reach_map, rng)
    if q_seed is not None:
        seeds = _seed_lanes(chain, q_seed, batch)
        near = np.flatnonzero(~search.is_far)
        search.improve(near, lambda index, _: seeds[:, near[index]], 1)
    search.exhaust(np.zeros(len(targets), dtype=np.intp))
    return search.result(batch)


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
    """
    if n_solutions < 1:
        raise InputError("n_solutions", got=n_solutions, expected="at least 1")
    config = config or IkConfig()
    targets, batch = _require_poses(T_base_tip), T_base_tip.batch
    repeated = np.repeat(targets, n_solutions, axis=0)
    search = PoseSearch(chain, config, repeated, reach_map, rng)
    # Every copy of a target starts from another seed.
    search.exhaust(np.tile(n_seeds_used + np.arange(n_solutions), len(targets)))
    found = search.result((*batch, n_solutions))
    q = found.q.reshape(-1, n_solutions, chain.n_joints)
    status = found.status.reshape(-1, n_solutions).copy()
    for later in range(1, n_solutions):
        gap = np.abs(chain.difference(q[:, :later], q[:, later : later + 1]))
        is_same = (gap < config.separation).all(axis=-1)
        is_same &= status[:, :later] == IkStatus.SOLVED
        is_repeat = is_same.any(axis=1) & (status[:, later] == IkStatus.SOLVED)
        status[is_repeat, later] = IkStatus.STALLED
    order = np.argsort(status, axis=1, kind="stable")
    shape = (*batch, n_solutions)

    def sorted_by_status(values: FloatArray) -> FloatArray:
        return np.take_along_axis(values.reshape(-1, n_solutions), order, 1)

    return IkResult(
        q=np.take_along_axis(q, order[..., None], 1).reshape(*shape, -1),
        status=np.take_along_axis(status, order, 1).reshape(shape),
        position_error=sorted_by_status(found.position_error).reshape(shape),
        rotation_error=sorted_by_status(found.rotation_error).reshape(shape),
    )


def _require_poses(T_base_tip: SE3) -> FloatArray:
    """Poses as (n, 4, 4), checked to be finite and rigid."""
    T = T_base_tip.matrix.reshape(-1, 4, 4)
    require_finite(T, "target pose")
    x, y, z = np.ascontiguousarray(T[:, :3, :3].transpose(2, 1, 0))
    products = ((x, x, 1), (y, y, 1), (z, z, 1), (x, y, 0), (y, z, 0), (z, x, 0))
    error = np.max(
        [np.abs((a * b).sum(axis=0) - want) for a, b, want in products], axis=0
    )
    is_mirrored = (np.cross(x, y, axis=0) * z).sum(axis=0) < 0.0
    is_bad = (error > _RIGID_TOLERANCE) | is_mirrored
    if is_bad.any():
        raise InputError(
            "target pose",
            got=f"{np.count_nonzero(is_bad)} of {len(T)} with a rotation that is "
            f"mirrored or not orthonormal (error {error.max():.3g})",
            expected=f"rigid transforms (error at most {_RIGID_TOLERANCE:g})",
            mend="SE3.from_matrix projects a nearly rigid matrix onto a rigid one.",
        )
    return T


def _seed_lanes(
    chain: KinematicChain, q_seed: ArrayLike, batch: tuple[int, ...]
) -> Lanes:
    """Seeds brought within the limits, one for each pose, shape (d, n)."""
    seed = np.asarray(q_seed, dtype=np.float64)
    require_trailing(seed, "q_seed", (chain.n_joints,))
    require_finite(seed, "q_seed")
    try:
        seed = np.broadcast_to(seed, (*batch, chain.n_joints))
    except ValueError as error:
        raise ShapeError(
            "shape of q_seed",
            got=seed.shape,
            expected=f"({chain.n_joints},) or {(*batch, chain.n_joints)}",
        ) from error
    lanes = chain.clipped(seed).reshape(-1, chain.n_joints).T
    return lanes.astype(np.float32)
