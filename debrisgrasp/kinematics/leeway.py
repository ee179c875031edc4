"""Can an arm give way? Its hand pushed and turned aside, on all of a straight way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from debrisgrasp._arrays import FloatArray, Rng
from debrisgrasp.geometry import SE3, so3

from .chain import KinematicChain
from .following import follow
from .ik_types import IkConfig
from .limits import DeflectionLimits

__all__ = ["leeway"]

_NEAR = 1.0
"""A joint that would have to turn farther than this [rad] takes another posture."""


def leeway(
    chain: KinematicChain,
    q: FloatArray,
    T_base_tip: SE3,
    Ts_base_away: SE3,
    deflection: DeflectionLimits,
    *,
    rng: Rng,
    config: IkConfig | None = None,
) -> FloatArray:
    """Share of the ways in which the tip may be pushed aside that the joints follow.

    At each pose, and where straight ways from it lead, the tip is pushed to both sides
    along every axis of base, and turned about it, as far as compliance lets it go. A
    controller tests such a way step by step; this one looks at its ends only, for many
    poses at once.

    Parameters
    ----------
    q
        Postures at the poses, shape (k, d).
    T_base_tip, Ts_base_away
        Poses (k,), and w places that straight ways from each lead to (k, w).
    deflection
        How far the tip may be pushed.

    Returns
    -------
    FloatArray
        In [0, 1], shape (k,); 0 where one of the ways itself can't be followed.
    """
    single = replace(config or IkConfig(), attempts=1)

    def followed(Ts: FloatArray, before: FloatArray) -> tuple[FloatArray, FloatArray]:
        shape = Ts.shape[:-2]
        start = np.ascontiguousarray(np.broadcast_to(before, (*shape, chain.n_joints)))
        flat = start.reshape(-1, chain.n_joints)
        poses = SE3(Ts.reshape(-1, 4, 4))
        found = follow(chain, poses, flat, rng=rng, config=single)
        turned = np.abs(chain.difference(found.q, flat)).max(axis=-1, initial=0.0)
        is_done = (found.is_solved & (turned < _NEAR)).reshape(shape)
        return is_done, np.where(
            is_done[..., None], found.q.reshape(start.shape), start
        )

    away = Ts_base_away.matrix
    is_way, q_away = followed(away, q[:, None])
    places = np.concatenate([T_base_tip.matrix[:, None], away], axis=1)
    postures = np.concatenate([q[:, None], q_away], axis=1)
    is_pushed, _ = followed(_pushed(places, deflection), postures[:, :, None])
    share: FloatArray = is_pushed.mean(axis=(1, 2)) * is_way.all(axis=1)
    return share


def _pushed(Ts: FloatArray, deflection: DeflectionLimits) -> FloatArray:
    """Poses (..., 4, 4) pushed and turned along the axes of base, (..., 12, 4, 4)."""
    both = np.concatenate([np.eye(3), -np.eye(3)])
    found = np.repeat(Ts[..., None, :, :], 12, axis=-3)
    found[..., :6, :3, 3] += deflection.translation * both
    turn = so3.exp(deflection.rotation * both)
    found[..., 6:, :3, :3] = turn @ found[..., 6:, :3, :3]
    return found
