"""A grasp for tests to which it hardly matters how it was found."""

from __future__ import annotations

from debrisgrasp.geometry import SE3
from debrisgrasp.planning import Grasp


def grasp_at(T_base_hand: SE3, T_base_pregrasp: SE3 | None = None, **changes) -> Grasp:
    """A perfect grasp at a pose; some of it is as a test wants it."""
    usual = {
        "gripper": "robotiq_3f",
        "preshape": "basic",
        "opening": 0.10,
        "width": 0.06,
        "prototype": "cylinder_060_tip",
        "S": 1.0,
        "C": 1.0,
        "R": 1.0,
        "coverage": 1.0,
        "support": 1,
        "expected": 1.0,
        "score": 1.0,
    }
    return Grasp(
        T_base_hand=T_base_hand,
        T_base_pregrasp=T_base_hand if T_base_pregrasp is None else T_base_pregrasp,
        **{**usual, **changes},
    )
