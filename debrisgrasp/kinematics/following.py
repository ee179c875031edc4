"""Inverse kinematics of poses that move a little at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from debrisgrasp._arrays import FloatArray, Rng, as_floats
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3

from .chain import KinematicChain
from .ik import solve
from .ik_input import checked_config, checked_poses
from .ik_types import IkConfig, IkResult
from .reach_map import ReachMap
from .search import PoseSearch

__all__ = ["follow"]

_ATTEMPTS = 3
"""Seeds of the map, all side by side; what they miss counts as out of reach."""
_ITERATIONS = 8
"""Of each; most need four."""


def follow(
    chain: KinematicChain,
    T_base_tip: SE3,
    q_before: FloatArray,
    *,
    reach_map: ReachMap | None = None,
    rng: Rng,
    config: IkConfig | None = None,
) -> IkResult:
    """Find one posture for each pose, quickly, from that of a pose nearby.

    For a search that asks thousands of times: what a few iterations from there, or a
    few seeds of the map where no posture is known, do not bring in is given up. A pose
    at the edge of the reach may be missed that `solve` finds.

    Parameters
    ----------
    chain, reach_map, rng, config
        As for `solve`.
    T_base_tip
        Poses, shape (k,).
    q_before
        Posture near each, within the limits, shape (k, d); rows of NaN where none is
        known.

    Returns
    -------
    IkResult
        Shape (k,).

    Raises
    ------
    InputError
        If the postures are not one for each pose.
    """
    config = checked_config(chain, reach_map, config, rng)
    targets = checked_poses(T_base_tip)
    q_before = as_floats(q_before, "q_before", (chain.n_joints,))
    if q_before.shape != (len(targets), chain.n_joints):
        raise InputError(
            "q_before",
            got=f"shape {q_before.shape}",
            expected=f"({len(targets)}, {chain.n_joints})",
        )
    if config.freedom.n_axes or not chain.has_turning_ends:
        start = np.where(np.isnan(q_before), chain.middle, q_before)
        return solve(chain, T_base_tip, q_seed=start, rng=rng, config=config)
    quick = replace(config, max_iterations=_ITERATIONS)
    search = PoseSearch(chain, quick, targets, reach_map, rng)
    search.follow(q_before, min(_ATTEMPTS, config.attempts))
    return search.result()
