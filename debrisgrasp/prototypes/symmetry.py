"""Motions that leave a shape as it is, and so give other grasps that match as well."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import permutations, product

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3, so3

__all__ = ["SpinAxis", "Symmetry", "cuboid_turns"]


@dataclass(frozen=True, slots=True, eq=False)
class SpinAxis:
    """An axis about which any turn leaves the shape as it is."""

    point: FloatArray
    """Some point of the axis [m], shape (3,)."""
    direction: FloatArray
    """Unit direction, shape (3,)."""


@dataclass(frozen=True, slots=True, eq=False)
class Symmetry:
    """Symmetries of a shape; of the shape alone, not of the hand that holds it.

    If g is one of them, a hand at ``T_base_hand @ g`` faces the same surface as one at
    ``T_base_hand``, but from another side: equally suitable, differently free.
    """

    turns: SE3 = field(default_factory=lambda: SE3(np.eye(4)[None]))
    """Finitely many motions, the identity first, batch (s,)."""
    spin: SpinAxis | None = None
    """Free turns that may come before each of ``turns``."""

    def moved(self, T_new_frame: SE3) -> Symmetry:
        """Express the symmetries in another frame."""
        turns = T_new_frame @ self.turns @ T_new_frame.inverse()
        if self.spin is None:
            return Symmetry(turns)
        spin = SpinAxis(
            T_new_frame.apply(self.spin.point), T_new_frame.rotate(self.spin.direction)
        )
        return Symmetry(turns, spin)

    def elements(self, n_spins: int = 12) -> SE3:
        """Return all motions, with a free turn in ``n_spins`` equal steps, (e,)."""
        if self.spin is None:
            return self.turns
        angles = np.arange(n_spins) * (2 * np.pi / n_spins)
        R = so3.exp(angles[:, None] * self.spin.direction)
        spins = SE3.from_parts(R, self.spin.point - R @ self.spin.point)
        matrices = (spins[:, None] @ self.turns).matrix
        return SE3(matrices.reshape(-1, 4, 4))


def cuboid_turns(size: FloatArray, *, keeps_y: bool) -> SE3:
    """Rotations, batch (s,), that map a centred box of edges ``size`` (3,) onto itself.

    Parameters
    ----------
    keeps_y
        The ends along y differ from the other faces, as those of a bar do.
    """
    turns = [np.eye(3)]
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            R = np.eye(3)[list(order)] * np.array(signs)[:, None]
            fits = np.allclose(np.abs(R) @ size, size, atol=1e-6)
            is_new = not np.array_equal(R, np.eye(3))
            if (
                np.linalg.det(R) > 0
                and fits
                and is_new
                and not (keeps_y and R[1, 1] == 0)
            ):
                turns.append(R)
    return SE3.from_parts(np.array(turns))
