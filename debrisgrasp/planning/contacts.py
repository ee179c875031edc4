"""How well the pads can press on the faces that they meet.

Two opposite pads hold by friction if the closing axis lies within the friction cone of
the surface at both (Nguyen 1988). A prototype promises such faces; where the camera saw
the object's own ones, they count instead.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from debrisgrasp._arrays import Float32Array, FloatArray, IntArray, require_range
from debrisgrasp.prototypes import PrototypeLibrary

from .scene import GraspScene

__all__ = ["ContactConfig", "PadContacts", "PadZones"]

_TURNED = 0.15
"""Cosine to the closing axis from which on a face is turned to a finger at all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactConfig:
    """When a pad holds on a face."""

    zone: float = 0.02
    """How far above the pads, towards the palm, faces count [m]; below, as far as the
    fingertips reach."""
    margin: float = 0.015
    """How far beside the pads faces count [m]."""
    friction: float = 0.57
    """Of pads on debris: its cone is how far a face may be off."""
    angle_error: float = 0.3
    """Standard deviation of a measured direction, and of the hand's [rad]."""
    min_points: int = 3
    """Fewer points of a side tell nothing."""
    least: float = 0.02
    """Poses less likely than this to press within both cones are ruled out; 0 keeps
    all."""

    def __post_init__(self) -> None:
        require_range("ContactConfig.zone", self.zone, 0.0, 0.2)
        require_range("ContactConfig.margin", self.margin, 0.0, 0.2)
        require_range("ContactConfig.friction", self.friction, 0.05, 5.0)
        require_range("ContactConfig.angle_error", self.angle_error, 0.01, 2.0)
        require_range("ContactConfig.min_points", self.min_points, 1)
        require_range("ContactConfig.least", self.least, 0.0, 0.5)


@dataclass(frozen=True, slots=True, eq=False)
class PadZones:
    """Where the pads of p hands meet the object: boxes in the palm frame."""

    lower: Float32Array
    """[m], shape (p, 3)."""
    upper: Float32Array
    """[m], shape (p, 3)."""

    @classmethod
    def of(cls, library: PrototypeLibrary, config: ContactConfig) -> PadZones:
        """Collect the zone of each prototype's hand."""
        lower, upper = [], []
        for prototype in library:
            gripper = library.grippers[prototype.gripper]
            pads = gripper.pad_positions(prototype.preshape, prototype.width)
            reach = gripper.fingertip_reach(prototype.preshape, prototype.width)
            half = prototype.opening / 2
            beside, height = pads[:, 1], float(pads[:, 2].mean())
            low = max(height - config.zone, 0.0)
            lower.append([-half, beside.min() - config.margin, low])
            upper.append([half, beside.max() + config.margin, reach])
        return cls(np.array(lower, np.float32), np.array(upper, np.float32))


class PadContacts:
    """How likely pads press within the friction cones, in one scene."""

    def __init__(
        self, scene: GraspScene, zones: PadZones, config: ContactConfig
    ) -> None:
        usable = scene.is_target & np.isfinite(scene.cloud.normals[:, 0])
        self._points = scene.cloud.points[usable].T.astype(np.float32)
        self._normals = scene.cloud.normals[usable].T.astype(np.float32)
        self._zones, self._config = zones, config

    def angles(self, Ts_base_hand: FloatArray, prototype: IntArray) -> FloatArray:
        """Angle between the closing axis and the face that each side comes to lie on.

        Parameters
        ----------
        Ts_base_hand, prototype
            Poses (k, 4, 4), and whose hand each carries (k,).

        Returns
        -------
        FloatArray
            [rad], shape (k, 2), thumb side first; NaN where too little was seen.
        """
        found = np.full((len(Ts_base_hand), 2), np.nan)
        for first in range(0, len(found), _BATCH):
            some = slice(first, first + _BATCH)
            found[some] = self._angles(Ts_base_hand[some], prototype[some])
        return found

    def __call__(self, Ts_base_hand: FloatArray, prototype: IntArray) -> FloatArray:
        """Probability that both sides press within their cones, in [0, 1], (k,).

        A side of which too little was seen is taken to be as the prototype says.
        """
        config = self._config
        angle = np.nan_to_num(self.angles(Ts_base_hand, prototype), nan=0.0)
        cone, error = np.arctan(config.friction), config.angle_error
        share = ndtr((cone - angle) / error) / ndtr(cone / error)
        both: FloatArray = share.prod(axis=1)
        return both

    def _angles(self, Ts: FloatArray, prototype: IntArray) -> FloatArray:
        to_hand = Ts[:, :3, :3].astype(np.float32).transpose(0, 2, 1)
        local = to_hand @ self._points - to_hand @ Ts[:, :3, 3:].astype(np.float32)
        along = to_hand[:, 0] @ self._normals
        is_near = (local > self._zones.lower[prototype][..., None]).all(axis=1)
        is_near &= (local < self._zones.upper[prototype][..., None]).all(axis=1)
        columns = []
        for side in (-1.0, 1.0):
            cosine = np.float32(side) * along
            faces = is_near & (cosine > np.float32(_TURNED))
            count = np.count_nonzero(faces, axis=1)
            # On a curved face the pad comes to lie where it is turned to it most.
            steepest = np.where(faces, cosine, np.float32(0.0)).max(axis=1, initial=0.0)
            angle = np.arccos(np.clip(steepest, 0.0, 1.0))
            columns.append(np.where(count >= self._config.min_points, angle, np.nan))
        return np.stack(columns, axis=1)


_BATCH = 64
"""Poses looked at together."""
