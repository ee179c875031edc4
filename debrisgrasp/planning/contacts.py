"""How well the pads can press on the faces that they meet.

Two opposite pads hold by friction if the closing axis lies within the friction cone of
the surface at both (Nguyen 1988). A prototype promises such faces; where the camera saw
the object's own ones, they count instead. Where it did not, the curve of what it saw of
the object between the fingers tells how far the hidden side is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from debrisgrasp._arrays import (
    BoolArray,
    Float32Array,
    FloatArray,
    IntArray,
    require_range,
)
from debrisgrasp.prototypes import PrototypeLibrary

from .scene import GraspScene

__all__ = ["ContactConfig", "PadContacts", "PadZones"]

_TURNED = 0.15
"""Cosine to the closing axis from which on a face is turned to a finger at all."""
_ROOM = 0.005
"""A finger that goes down behind a hidden side needs so much room [m]."""
_ROOM_ERROR = 0.008
"""Standard deviation of where a hidden side is expected [m]."""
_LEAST_CURVED = 6
"""Fewer points between the fingers don't tell where the hidden side is."""
_FLAT = 0.01
"""Variance of the normals along the closing axis that comes from noise alone."""


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
        return self._looks(Ts_base_hand, prototype)[:, :2]

    def room(self, Ts_base_hand: FloatArray, prototype: IntArray) -> FloatArray:
        """Gap between each open finger and the hidden side that is expected there.

        On a cylinder of radius r, x = c + r n_x for all points and normals, and nearly
        so on the faces of a box that reaches from c - r to c + r: a line through what
        was seen between the fingers leads to the side that was not.

        Parameters
        ----------
        Ts_base_hand, prototype
            Poses (k, 4, 4), and whose hand each carries (k,).

        Returns
        -------
        FloatArray
            [m], shape (k, 2), thumb side first, negative where the object is expected
            to be in the way; infinite where the side itself was seen, or too little.
        """
        return self._looks(Ts_base_hand, prototype)[:, 2:]

    def __call__(self, Ts_base_hand: FloatArray, prototype: IntArray) -> FloatArray:
        """Probability that both sides get to press within their cones, in [0, 1], (k,).

        A side of which too little was seen is taken to be as the prototype says, if
        what was seen of the object leaves a finger room there.
        """
        looks = self._looks(Ts_base_hand, prototype)
        config = self._config
        angle = np.nan_to_num(looks[:, :2], nan=0.0)
        cone, error = np.arctan(config.friction), config.angle_error
        share = ndtr((cone - angle) / error) / ndtr(cone / error)
        both: FloatArray = share.prod(axis=1) * _fits(looks[:, 2:])
        return both

    def is_too_wide(self, Ts_base_hand: FloatArray, prototype: IntArray) -> BoolArray:
        """Whether a hidden side is so far out that a finger would land on it, (k,)."""
        found = _fits(self.room(Ts_base_hand, prototype)) < self._config.least
        return np.asarray(found)

    def _looks(self, Ts_base_hand: FloatArray, prototype: IntArray) -> FloatArray:
        """Angles and room of the sides, shape (k, 4)."""
        found = np.empty((len(Ts_base_hand), 4))
        for first in range(0, len(found), _BATCH):
            some = slice(first, first + _BATCH)
            found[some] = self._look(Ts_base_hand[some], prototype[some])
        return found

    def _look(self, Ts: FloatArray, prototype: IntArray) -> FloatArray:
        to_hand = Ts[:, :3, :3].astype(np.float32).transpose(0, 2, 1)
        local = to_hand @ self._points - to_hand @ Ts[:, :3, 3:].astype(np.float32)
        along = to_hand[:, 0] @ self._normals
        lower, upper = self._zones.lower[prototype], self._zones.upper[prototype]
        is_near = (local[:, :2] > lower[:, :2, None]).all(axis=1)
        is_near &= (local < upper[..., None]).all(axis=1)
        is_near &= local[:, 2] > 0.0
        is_beside = is_near & (local[:, 2] > lower[:, 2, None])
        middle, radius = _curve(local[:, 0], along, is_near)
        angles, rooms = [], []
        for side in (-1.0, 1.0):
            cosine = np.float32(side) * along
            faces = is_beside & (cosine > np.float32(_TURNED))
            is_seen = np.count_nonzero(faces, axis=1) >= self._config.min_points
            # On a curved face the pad comes to lie where it is turned to it most.
            steepest = np.where(faces, cosine, np.float32(0.0)).max(axis=1, initial=0.0)
            angle = np.arccos(np.clip(steepest, 0.0, 1.0))
            angles.append(np.where(is_seen, angle, np.nan))
            room = upper[:, 0] - (side * middle + radius)
            rooms.append(np.where(is_seen | np.isnan(room), np.inf, room))
        return np.stack(angles + rooms, axis=1)


def _curve(
    x: Float32Array, along: Float32Array, is_near: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Middle and half width [m] that points x [m] with normals have, NaN if unknown.

    All of shape (k, n); least squares of x = middle + half width * normal, (k,) each.
    """
    count = np.count_nonzero(is_near, axis=1)
    n = np.maximum(count, 1)
    near = is_near.astype(np.float32)
    weighted = near * along
    mean_x = np.einsum("kn,kn->k", near, x) / n
    mean_along = weighted.sum(axis=1) / n
    covariance = np.einsum("kn,kn->k", weighted, x) / n - mean_x * mean_along
    variance = np.einsum("kn,kn->k", weighted, along) / n - mean_along**2
    radius = np.maximum(covariance, 0.0) / (variance + _FLAT)
    radius = np.where(count >= _LEAST_CURVED, radius, np.nan)
    return mean_x - radius * mean_along, radius


def _fits(room: FloatArray) -> FloatArray:
    """Probability that both fingers have room (k, 2), shape (k,)."""
    found: FloatArray = ndtr((room - _ROOM) / _ROOM_ERROR).prod(axis=1)
    return found


_BATCH = 64
"""Poses looked at together."""
