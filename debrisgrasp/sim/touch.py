"""Who touches the hand, where, how hard and how deep."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray

from ._mujoco import mujoco

__all__ = ["Touch", "touches", "touches_others"]


@dataclass(frozen=True, slots=True)
class Touch:
    """All contacts of one body with the hand."""

    body: int
    """Position in the world; -1 is the ground."""
    sides: frozenset[str]
    """Parts of the hand that touch: finger names, or ``"hand"`` for the palm."""
    force: float
    """Sum of the pressures [N]."""
    depth: float
    """Deepest interpenetration [m]."""


def touches(model: Any, data: Any, n_bodies: int) -> dict[int, Touch]:
    """Contacts between the hand and each body, by the body's position.

    Parameters
    ----------
    n_bodies
        Bodies of the world; all MuJoCo bodies after them belong to the hand.
    """
    owner = model.geom_bodyid
    wrench = np.zeros(6)
    sides: dict[int, set[str]] = {}
    sums: dict[int, FloatArray] = {}
    for number in range(data.ncon):
        contact = data.contact[number]
        a, b = int(owner[contact.geom1]), int(owner[contact.geom2])
        if (a > n_bodies) == (b > n_bodies):
            continue
        body, part = (b, a) if a > n_bodies else (a, b)
        mujoco().mj_contactForce(model, data, number, wrench)
        if wrench[0] <= 0.0:
            continue
        name = model.body(part).name.split("/")[0]
        sides.setdefault(body - 1, set()).add(name)
        total = sums.setdefault(body - 1, np.zeros(2))
        total[0] += wrench[0]
        total[1] = max(total[1], -float(contact.dist))
    return {
        body: Touch(body, frozenset(sides[body]), float(total[0]), float(total[1]))
        for body, total in sums.items()
    }


def touches_others(model: Any, data: Any, n_bodies: int, body: int) -> bool:
    """Whether a body, by its position, touches another one; the ground is none."""
    for contact in data.contact[: data.ncon]:
        a, b = (int(model.geom_bodyid[g]) - 1 for g in contact.geom)
        other = b if a == body else a
        if body in (a, b) and 0 <= other < n_bodies:
            return True
    return False
