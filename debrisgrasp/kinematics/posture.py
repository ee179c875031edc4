"""Which of the postures that reach a pose to prefer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray, as_floats, require_finite

from .chain import KinematicChain

__all__ = ["PostureCost", "dexterity", "mobility", "self_motions"]

_LIMIT_ZONE = 0.05
"""Part of a joint's range, at either end, that postures rather avoid."""
_CLEAR_ENOUGH = 0.05
"""Clearance beyond which more of it is worth nothing [m]."""
_LENGTH = 0.3
"""Metres that one radian of the tip's rotation counts as."""
_SEED, _N_SAMPLES = 2_718_281_828, 16
"""Of the random postures that tell in how many ways a chain moves its tip."""
_MOVES = 0.01
"""A tip moves some way if unit speeds of the joints move it so much [m/s or rad/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PostureCost:
    """Cost of a posture in radians of travel; what it weighs against one another."""

    limit_weight: float
    """Cost of a joint that stands at its limit; falls to zero over a twentieth of its
    range."""
    singularity_weight: float
    """Cost of a singular posture; falls to zero where the tip moves freely."""
    free_dexterity: float
    """`dexterity` from which on the tip moves freely."""
    scene_weight: float
    """Cost of touching the scene; falls to zero over 5 cm."""

    def __call__(
        self,
        chain: KinematicChain,
        q: FloatArray,
        q_present: FloatArray,
        clearance: FloatArray,
    ) -> FloatArray:
        """Cost of postures (..., d) with this clearance (...) [m], shape (...)."""
        is_bounded = np.isfinite(chain.lower)
        # Joints with limits can't take the short way round, even if it would fit.
        gap = np.where(is_bounded, q - q_present, chain.difference(q, q_present))
        lower, upper = chain.lower[is_bounded], chain.upper[is_bounded]
        inner = q[..., is_bounded]
        edge = np.minimum(inner - lower, upper - inner) / (upper - lower)
        nearness = np.maximum(0.0, 1.0 - edge / _LIMIT_ZONE).sum(axis=-1)
        stiffness = np.maximum(0.0, 1.0 - dexterity(chain, q) / self.free_dexterity)
        closeness = np.clip(1.0 - clearance / _CLEAR_ENOUGH, 0.0, 1.0)
        cost: FloatArray = (
            np.sqrt((gap * gap).sum(axis=-1))
            + self.limit_weight * nearness
            + self.singularity_weight * stiffness
            + self.scene_weight * closeness
        )
        return cost


def dexterity(chain: KinematicChain, q: FloatArray) -> FloatArray:
    """Smallest singular value of the body Jacobian, its rotation in units of 0.3 m.

    The slowest motion of the tip [m] that joints at unit speed can make in its worst
    direction; zero where the posture (..., d) is singular. Shape (...).

    Raises
    ------
    InputError
        If a joint value is not finite.
    """
    q = as_floats(q, "joint values", (chain.n_joints,))
    require_finite(q, "joint values")
    J = chain.jacobian(q)
    J[..., 3:, :] *= _LENGTH
    square = J @ np.swapaxes(J, -1, -2)
    least = np.linalg.eigvalsh(square)[..., 0]
    return np.asarray(np.sqrt(np.maximum(least, 0.0)), dtype=np.float64)


def mobility(chain: KinematicChain) -> int:
    """In how many of the six ways a chain moves its tip; with less, few poses are met.

    A SCARA moves it in four, on a rail in no more.
    """
    q = chain.sampled(_N_SAMPLES, rng=np.random.default_rng(_SEED))
    return int(np.linalg.matrix_rank(chain.jacobian(q), tol=_MOVES).max())


def self_motions(chain: KinematicChain, q: FloatArray, length: float) -> FloatArray:
    """Joint motions that leave the tip where it is, to first order, both ways.

    Parameters
    ----------
    chain
        The arm; with six joints or fewer it has no such motion.
    q
        Postures (n, d) [rad or m].
    length
        Largest change of a joint [rad or m].

    Returns
    -------
    FloatArray
        Shape (2 (d - 6), n, d): along every axis of the nullspace and back.
    """
    J = chain.jacobian(q)
    _, _, rows = np.linalg.svd(J)
    null = np.moveaxis(rows[:, 6:], 1, 0)
    null = null * (length / np.abs(null).max(axis=-1, keepdims=True))
    return np.concatenate([null, -null])
