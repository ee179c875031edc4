"""Checks of what the inverse kinematics is asked."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import (
    FloatArray,
    Rng,
    as_floats,
    require_finite,
    require_generator,
)
from debrisgrasp.errors import InputError, ShapeError
from debrisgrasp.geometry import SE3

from .chain import KinematicChain
from .ik_types import IkConfig
from .reach_map import ReachMap
from .walk import cross, dot

__all__ = ["checked_config", "checked_poses", "checked_postures"]

_RIGID_TOLERANCE = 1e-3
"""How far ``R.T @ R`` of a target may be from the identity."""
_FEW = 12
"""So many poses are looked at faster as floats than as arrays."""


def checked_config(
    chain: KinematicChain, reach_map: ReachMap | None, config: IkConfig | None, rng: Rng
) -> IkConfig:
    """Give the settings, or the default ones, once all is of its type.

    Not by `checked`, which costs a twentieth of one pose or more.
    """
    require_generator(rng)
    config = IkConfig() if config is None else config
    for name, value, kind, mend in (
        ("chain", chain, KinematicChain, "RobotModel.load(name).chain(arm) makes one."),
        ("reach_map", reach_map, ReachMap, "ReachMap.build(chain) makes one."),
        ("config", config, IkConfig, "IkConfig(attempts=20), for instance."),
    ):
        if not isinstance(value, kind) and (value is not None or name == "chain"):
            got = type(value).__name__
            raise InputError(name, got=got, expected=kind.__name__, mend=mend)
    return config


def checked_poses(T_base_tip: SE3) -> FloatArray:
    """Poses as (n, 4, 4), found to be finite and rigid."""
    if not isinstance(T_base_tip, SE3):
        raise InputError(
            "target pose",
            got=type(T_base_tip).__name__,
            expected="SE3",
            mend="Build it with SE3.from_matrix(matrix).",
        )
    T = T_base_tip.matrix.reshape(-1, 4, 4)
    require_finite(T, "target pose")
    if len(T) <= _FEW:
        error = np.array([max(map(abs, _gaps(rows))) for rows in T.tolist()])
    else:
        error = np.abs(np.stack(_gaps(T.transpose(1, 2, 0)))).max(axis=0)
    n_wrong = np.count_nonzero(error > _RIGID_TOLERANCE)
    if n_wrong:
        raise InputError(
            "target pose",
            got=f"{n_wrong} of {len(T)} with a rotation that is mirrored or not "
            f"orthonormal, or a last row other than 0 0 0 1 (error {error.max():.3g})",
            expected=f"rigid transforms (error at most {_RIGID_TOLERANCE:g})",
            mend="SE3.from_matrix says what is wrong, and removes what is rounding.",
        )
    return T


def _gaps(rows: Any) -> list[Any]:
    """List what is zero of a rigid transform, of floats or of arrays (4, 4, n)."""
    x, y, z = ([rows[i][k] for i in range(3)] for k in range(3))
    return [
        *(dot(a, a) - 1.0 for a in (x, y, z)),
        *(dot(a, b) for a, b in ((x, y), (y, z), (z, x))),
        dot(cross(x, y), z) - 1.0,
        *rows[3][:3],
        rows[3][3] - 1.0,
    ]


def checked_postures(
    chain: KinematicChain, q: ArrayLike, name: str, batch: tuple[int, ...]
) -> FloatArray:
    """Postures, one for each pose of a batch, shape (n, d)."""
    postures = as_floats(q, name, (chain.n_joints,))
    require_finite(postures, name)
    try:
        whole = np.broadcast_to(postures, (*batch, chain.n_joints))
    except ValueError as error:
        raise ShapeError(
            f"shape of {name}",
            got=postures.shape,
            expected=f"({chain.n_joints},) or {(*batch, chain.n_joints)}",
        ) from error
    return whole.reshape(-1, chain.n_joints)
