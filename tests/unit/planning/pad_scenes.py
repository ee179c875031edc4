"""Points between the fingers of a hand at the origin, as contacts read them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from debrisgrasp.geometry import SE3, PointCloud
from debrisgrasp.planning.contacts import ContactConfig, PadContacts
from debrisgrasp.prototypes import PrototypeLibrary

LIBRARY = PrototypeLibrary.load().select(names=["bar_4x4"])
PROTOTYPE = next(iter(LIBRARY))
PADS = LIBRARY.grippers[PROTOTYPE.gripper].pad_positions(
    PROTOTYPE.preshape, PROTOTYPE.width
)
CONFIG = ContactConfig()
FIRST = np.zeros(1, dtype=int)
ACROSS = np.linspace(-0.048, 0.048, 5)
"""Places across the fingers, from beyond one of the pair to beyond the other [m]."""


def scene_of(cloud: PointCloud, *, is_target: bool = True) -> SimpleNamespace:
    """What contacts read of a scene."""
    which = np.full(len(cloud), is_target)
    is_cut = cloud.at_rim(np.arange(len(cloud)))
    return SimpleNamespace(cloud=cloud, is_target=which, is_cut=is_cut)


def extruded(points: np.ndarray) -> np.ndarray:
    """Copies of points (n, 3) all across the fingers, (5 n, 3)."""
    beside = np.stack([0.0 * ACROSS, ACROSS, 0.0 * ACROSS], axis=1)
    found: np.ndarray = (points + beside[:, None]).reshape(-1, 3)
    return found


def at(found: PadContacts, T: SE3 | None = None) -> float:
    return float(found.look((T or SE3.identity()).matrix[None], FIRST).probability[0])
