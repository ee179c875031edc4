"""How well the pads can press on the faces that they meet.

Two opposite pads hold by friction if the closing axis lies within the friction cone of
the surface at both (Nguyen 1988). A prototype promises such faces; where the camera saw
the object's own ones, they count instead. Where it did not, the curve of what it saw of
the object between the fingers tells how far the hidden side is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from debrisgrasp._arrays import (
    BoolArray,
    Float32Array,
    FloatArray,
    IntArray,
    bounded,
    require_range,
)
from debrisgrasp._checked import checked_fields
from debrisgrasp.prototypes import PrototypeLibrary

from .borders import is_behind
from .finger_faces import HEIGHTS, FingerFaces, meets_both
from .near_pads import ROOM_ERROR, SAME, SIDES, NearPads
from .scene import GraspScene

__all__ = ["ContactConfig", "PadContacts", "PadLook", "PadZones"]

_TURNED = 0.15
"""Cosine to the closing axis from which on a face is turned to a finger at all."""
_ROOM = 0.005
"""A finger that goes down behind a hidden side needs so much room [m]."""
_UNDER = 0.01
"""What was seen so far beyond a finger's inner face lies under the finger [m]."""
_HALF_PAD = 0.015
"""An object that ends by more than this before the middle of a pad misses it [m]."""
_END_ERROR = 0.008
"""Standard deviation of where an object ends [m]."""
_LEAN_ERROR = 0.08
"""Standard deviation of the lean of a finger on what is round, but for that of the
hand's place [rad]."""
_EDGE, _TIP_ERROR = 0.73, 0.0045
"""The edges of fingertips hold on what slants by so much of a pad's cone, and the
standard deviation of their height there [m]. Of 694 grasps of wide pipes in flights
(2026-11-29), whose sides were expected to slant by 0.2 to 0.3, 0.36, 0.4, 0.44 rad and
more, 94, 74, 55, 21 and 1 % held."""
_UNTOLD = 0.025
"""Normals of what is thinner than twice that are smoothed over its sides: if it is
round they don't tell [m]. Where leaning fingers meet it they squeeze it out all the
same."""
_THINNEST = 0.005
"""Half of it; what is thinner bends, or was not seen well [m]."""
_DEEP = 0.01
"""So much of a face lies deeper than where fingers press on it: at its end they would
hook rather than squeeze [m]."""
_BY_THE_REST = 0.05
"""Probability that the other fingers hold what one of them misses."""
_TOGETHER = 200_000
"""Points of all poses looked at together: their arrays stay in the cache."""


@checked_fields
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
        require_range("ContactConfig.min_points", self.min_points, 1, 10_000)
        require_range("ContactConfig.least", self.least, 0.0, 0.5)


@dataclass(frozen=True, slots=True, eq=False)
class PadZones:
    """Where the pads of p hands meet the object: boxes in the palm frame."""

    lower: Float32Array
    """[m], shape (p, 3)."""
    upper: Float32Array
    """[m], shape (p, 3)."""
    faces: FingerFaces

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
        faces = FingerFaces.of(library)
        return cls(np.array(lower, np.float32), np.array(upper, np.float32), faces)


@dataclass(frozen=True, slots=True, eq=False)
class PadLook:
    """What k poses find at their pads."""

    probability: FloatArray
    """That both sides get to press within their cones, in [0, 1], shape (k,). A side of
    which too little was seen is taken to lean as the outline of the object does, and
    as the face above it does, if what was seen of that leaves a finger room there.
    Where the object ends before it gets to a finger, that one presses on nothing.
    Fingertips that end before the middle of what is round press it out of the hand."""
    causes: FloatArray
    """What of it the lean of the faces leaves, then pads beyond the end of the object,
    in [0, 1], shape (k, 2)."""
    squeezed: FloatArray
    """Probability that the fingers squeeze what they close on, in [0, 1], shape (k,).
    They hook what is narrower than closed fingers leave between them at its height, and
    what is round where they lean over it: it comes up, and they feel nothing of it."""
    is_too_wide: BoolArray
    """Whether a hidden side is so far out that a finger would land on it, (k,)."""
    angles: FloatArray
    """Between the closing axis and the face that each side comes to lie on [rad], shape
    (k, 2), thumb side first; NaN where too little was seen."""
    is_seen: BoolArray
    """Whether enough was seen of both of them, shape (k,)."""
    room: FloatArray
    """Gap between each open finger and the hidden side that is expected there [m],
    shape (k, 2), negative where the object is expected to be in the way; infinite where
    the side itself was seen, or too little."""


class _Between(NamedTuple):
    """What k poses have between, and under, their open fingers."""

    around: NearPads
    """Between them and under them ..."""
    near: NearPads
    """... and of these only what is between them, m pairs."""
    curve: tuple[FloatArray, FloatArray, BoolArray]
    """Of the latter."""
    is_behind: BoolArray
    """Which of those may go on behind something nearer, shape (m,) ..."""
    is_cut: BoolArray
    """... and which beyond the edge of the image, shape (m,)."""
    lower: Float32Array
    """Corners of the zones of the pads [m], shape (k, 3) ..."""
    upper: Float32Array
    """... and (k, 3)."""


class PadContacts:
    """How likely pads press within the friction cones, in one scene."""

    def __init__(
        self, scene: GraspScene, zones: PadZones, config: ContactConfig
    ) -> None:
        usable = scene.is_target & np.isfinite(scene.cloud.normals[:, 0])
        self._points = scene.cloud.points[usable].T.astype(np.float32, order="C")
        self._normals = scene.cloud.normals[usable].T.astype(np.float32, order="C")
        self._is_cut = scene.is_cut[usable]
        self._is_behind = is_behind(scene, usable)
        self._viewpoint = np.asarray(scene.cloud.viewpoint)
        self._zones, self._config = zones, config

    def look(self, Ts_base_hand: FloatArray, prototype: IntArray) -> PadLook:
        """Look at the faces that the pads of poses meet.

        Where a side was not seen, it is at least as far out as anything that was seen
        between the fingers, and the curve of that leads to it: on a cylinder of
        radius r, x = c + r n_x for all points and normals, and nearly so on the faces
        of a box that reaches from c - r to c + r.

        Parameters
        ----------
        Ts_base_hand, prototype
            Poses (k, 4, 4), and whose hand each carries (k,).
        """
        found = np.empty((len(Ts_base_hand), 10))
        n_poses = max(1, _TOGETHER // max(1, self._points.shape[1]))
        for first in range(0, len(found), n_poses):
            some = slice(first, first + n_poses)
            found[some] = self._look(Ts_base_hand[some], prototype[some])
        angles, room, leaning = found[:, :2], found[:, 2:4], found[:, 4:6]
        config = self._config
        cone, error = np.arctan(config.friction), config.angle_error
        share = ndtr((cone - np.where(np.isnan(angles), leaning, angles)) / error)
        share /= ndtr(cone / error)
        fits = ndtr((room - _ROOM) / ROOM_ERROR).prod(axis=1)
        meets = ndtr((_HALF_PAD - found[:, 6]) / _END_ERROR)
        meets = _BY_THE_REST + (1.0 - _BY_THE_REST) * meets
        keeps, squeezed, wide = found[:, 7:].T
        causes = np.stack([share.prod(axis=1) * keeps, meets], axis=1)
        return PadLook(
            probability=causes.prod(axis=1) * fits,
            causes=causes,
            squeezed=squeezed * wide,
            is_too_wide=fits < config.least,
            angles=angles,
            is_seen=np.asarray(np.isfinite(angles).all(axis=1)),
            room=room,
        )

    def _look(self, Ts: FloatArray, prototype: IntArray) -> FloatArray:
        """Collect what is known at the pads of poses, shape (k, 10).

        Angles, room and lean of both sides, overhang, and probabilities: that what is
        round stays in the fingers, that these squeeze it, and that they don't meet.
        """
        lower, upper = self._zones.lower[prototype], self._zones.upper[prototype]
        under = np.array([_UNDER, 0.0, 0.0], dtype=np.float32)
        around = self._between(Ts, lower - under, upper + under)
        near = around.picked(np.abs(around.x) < upper[:, 0].take(around.pose))
        near, deep = near.face(HEIGHTS[1] - HEIGHTS[0], self._config.min_points)
        is_behind, is_cut = self._is_behind[near.point], self._is_cut[near.point]
        width = upper[:, 1] - lower[:, 1]
        between = _Between(around, near, near.curve(), is_behind, is_cut, lower, upper)
        angles, rooms, slopes, leaning, seen, open_ = zip(
            *(self._side(side, between) for side in SIDES), strict=True
        )
        over = self._overhang(near, is_behind | is_cut, width)
        to_hand = Ts[:, :3, 3] - self._viewpoint
        sight = np.einsum("ki,kij->kj", to_hand, Ts[:, :3, :3])
        extents, outlines = near.extents(slopes, seen, open_, width, sight)
        half = np.maximum(0.5 * extents.sum(axis=0), _THINNEST)
        middle, radius, is_round = near.bulge(half)
        is_thin = (half < _UNTOLD) & (near.n_each >= self._config.min_points)
        top = -near.greatest(-near.z, -np.inf)
        middle, radius = np.where(is_thin, [top + half, half], [middle, radius])
        # Fingertips that end before the middle of what is round press on what is turned
        # to the palm; on a box they get past that of its sides.
        short = np.arcsin(bounded((middle - upper[:, 2]) / radius, 0.0, 1.0))
        lean = self._zones.faces.lean(prototype, middle, radius)
        # A wall goes on to the fingertips.
        lean[deep > middle + radius + np.where(is_thin, _DEEP, 0.0)] = 0.0
        is_round |= is_thin
        # Sides of a round thing slant alike: what squeezes one out does the other.
        cone, unsure = np.arctan(self._config.friction), self._config.angle_error
        held_to = np.where(is_thin, cone, _EDGE * cone)
        error = np.where(is_thin, unsure, _TIP_ERROR / radius)
        keeps = _within(np.where(is_round, short, 0.0), held_to, error)
        error = np.where(is_thin, unsure, np.hypot(_LEAN_ERROR, ROOM_ERROR / radius))
        squeezed = _within(np.where(is_round, lean, 0.0), cone, error)
        wide = meets_both(extents, outlines, self._least_gap(top, deep, prototype))
        wide[near.n_each < self._config.min_points] = 1.0
        columns = [*angles, *rooms, *leaning, over, keeps, squeezed, wide]
        return np.stack(columns, axis=1)

    def _side(
        self, side: float, between: _Between
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, BoolArray, BoolArray]:
        """Look at what one side (-1 or 1) of the fingers meets, shape (k,) each.

        The angle of its face, NaN where too little was seen, the room before it, the
        slope of its outline, how far a face that was not seen leans by that and by what
        was seen above it, whether it was seen, and whether it may go on unseen.
        """
        around, near, (middle, radius, turns), is_behind, is_cut, lower, upper = between
        least = self._config.min_points
        cosine = np.float32(side) * near.along
        is_beside = near.z > lower[:, 2].take(near.pose)
        faces = is_beside & (cosine > np.float32(_TURNED))
        is_seen = near.count(faces) >= least
        # On a curved face the pad comes to lie where it is turned to it most.
        steepest = near.greatest(np.where(faces, cosine, np.float32(0.0)), 0.0)
        angle = np.where(is_seen, np.arccos(bounded(steepest, 0.0, 1.0)), np.nan)
        # Where its face was seen to end above the pads it goes on below.
        pads = lower[:, 2] + np.float32(self._config.zone)
        is_above = (cosine > np.float32(_TURNED)) & ~is_seen.take(near.pose)
        below = near.turned_below(cosine, is_above, pads)
        room = upper[:, 0] - (side * middle + radius)
        room[np.isnan(room)] = np.inf
        # What goes on to the finger has hardly a side before it, what goes on under it
        # has none; what vanishes behind something nearer may go on; what the image cuts
        # off does.
        is_under = np.float32(side) * around.x > upper[:, 0].take(around.pose)
        is_open = around.count(is_under) >= least
        room[is_open] = -np.inf
        out = np.float32(side) * near.x
        reaches = out > (upper[:, 0] - np.float32(_ROOM)).take(near.pose)
        farthest = near.greatest(out, -1.0)
        is_last = out > (farthest - np.float32(SAME)).take(near.pose)
        for goes_on, left in (
            (reaches, 0.0),
            (is_behind & is_last, 0.0),
            (is_cut & is_last, -np.inf),
        ):
            enough = near.count(goes_on) >= least
            room[enough] = np.minimum(room[enough], left)
            is_open |= enough
        slope = near.slope(out, is_behind, upper[:, 1] - lower[:, 1])
        # Behind a flat face that is turned to the other side anything may be. What lies
        # askew ends in a corner of few points.
        ends = near.count(is_last & (cosine > -np.float32(_TURNED)))
        is_open |= (ends < np.minimum(near.count(is_last), least)) & ~turns
        leaning = np.fmax(np.arctan(np.abs(slope)), np.arccos(below))
        room[is_seen] = np.inf
        return angle, room, slope, leaning, is_seen, is_open

    def _least_gap(
        self, top: Float32Array, deep: Float32Array, prototype: IntArray
    ) -> FloatArray:
        """Least gap of closed fingers at the heights of what was seen [m], (k,)."""
        half = 0.5 * (HEIGHTS[1] - HEIGHTS[0])
        last = bounded(deep - _DEEP, half, HEIGHTS[-1])[:, None]
        first = np.minimum(top[:, None], last)
        is_level = (HEIGHTS + half >= first) & (HEIGHTS - half < last)
        gaps = np.where(is_level, self._zones.faces.gaps[prototype], np.inf)
        least: FloatArray = gaps.min(axis=1)
        return least

    def _overhang(
        self, near: NearPads, is_open: BoolArray, width: Float32Array
    ) -> FloatArray:
        """How far the object ends before the middle of the outermost pad [m], (k,).

        Where it may go on out of sight, that is taken to be so.

        Parameters
        ----------
        is_open
            Which points it may go on behind, shape (m,).
        width
            Of the zone of the pads [m], shape (k,).
        """
        over = np.full(near.n_poses, -np.inf)
        margin = np.float32(self._config.margin)
        for along, end in ((near.y, width), (-near.y, np.zeros_like(width))):
            last = near.greatest(along, -np.inf)
            is_last = is_open & (along > (last - np.float32(SAME)).take(near.pose))
            is_hidden = near.count(is_last) >= self._config.min_points
            short = np.where(is_hidden, -np.inf, end - margin - last)
            over = np.maximum(over, short)
        tells = near.n_each >= self._config.min_points
        return np.where(tells, over, -np.inf)

    def _between(
        self, Ts: FloatArray, lower: Float32Array, upper: Float32Array
    ) -> NearPads:
        """Points between the open fingers of each pose (k, 4, 4)."""
        to_hand = Ts[:, :3, :3].astype(np.float32).transpose(0, 2, 1)
        begin = (to_hand @ Ts[:, :3, 3:].astype(np.float32))[..., 0]
        low, n = lower.copy(), self._points.shape[1]
        low[:, 2] = 0.0
        least, most = low + begin, upper + begin
        # Fingers are narrow: few points of an object are level with them.
        y = to_hand[:, 1] @ self._points
        found = np.flatnonzero((y > least[:, 1, None]) & (y < most[:, 1, None]))
        pose, point = np.divmod(found, n)
        points = self._points.take(point, axis=1)
        x, z = (
            np.einsum("im,im->m", to_hand[:, axis].T.take(pose, axis=1), points)
            for axis in (0, 2)
        )
        is_near = (x > least[:, 0].take(pose)) & (x < most[:, 0].take(pose))
        is_near &= (z > least[:, 2].take(pose)) & (z < most[:, 2].take(pose))
        pose, point, x, z = pose[is_near], point[is_near], x[is_near], z[is_near]
        y = y.ravel().take(found[is_near])
        normals = self._normals.take(point, axis=1)
        closing = to_hand[:, 0].T.take(pose, axis=1)
        axis_of_palm = to_hand[:, 2].T.take(pose, axis=1)
        return NearPads(
            pose=pose,
            point=point,
            x=x - begin[:, 0].take(pose),
            y=y - (begin + lower)[:, 1].take(pose),
            z=z - begin[:, 2].take(pose),
            along=(closing * normals).sum(axis=0),
            facing=-(axis_of_palm * normals).sum(axis=0),
            n_poses=len(Ts),
        )


def _within(
    angle: FloatArray, cone: FloatArray | float, error: FloatArray
) -> FloatArray:
    """Probability that angles are within a cone, 1 for none (k,); all are [rad]."""
    inside: FloatArray = ndtr((cone - angle) / error) / ndtr(cone / error)
    return inside
