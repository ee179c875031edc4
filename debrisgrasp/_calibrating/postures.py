"""Postures of an arm in which the camera sees the fiducial, and the best of them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, Rng
from debrisgrasp.calibration import (
    Calibration,
    CalibrationConfig,
    Choice,
    choose_places,
    information_at,
)
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, Bounds, Intrinsics, sight_points
from debrisgrasp.io.observations_file import ObservationFile, ObservationRow

from .of_file import Rig
from .rig import CalibrationRig
from .wrist import WristRig

__all__ = ["Posture", "PosturePlan", "View", "choose_postures", "information_of"]

_ARM_MARGIN = 0.02
"""Distance that the links keep from one another and from the ground [m]."""
_CELL = 0.05
"""Candidates are thinned to one in each cube of this size [m]."""
_IN_A_CELL = 2
_BATCH = 60_000
_MOST_BATCHES = 3
_SEAT = 0.03
"""So near to the fiducial is what it sits on [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """What the camera can see of a fiducial."""

    intrinsics: Intrinsics = Intrinsics(
        fx=617.0, fy=617.0, cx=423.5, cy=239.5, width=848, height=480
    )
    """Colour camera of a RealSense D435 by default (69 degrees wide)."""
    border: float = 24.0
    """Distance kept from the border of the image [pixels]."""
    nearest: float = 0.4
    farthest: float = 1.8
    """Range along the optical axis [m]."""
    max_angle: float = 1.2
    """Largest angle between the fiducial's z axis and the line to the camera [rad]; pi
    for a fiducial that is seen from all sides."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Posture:
    """One posture of the arm to measure in."""

    name: str
    joints: Mapping[str, float]
    """Joint values [rad or m], those of the head included."""
    place: tuple[float, float, float]
    """Where the fiducial then is, base frame [m]; in the camera frame of a camera that
    the arm carries."""
    pixel: tuple[float, float]
    """Where the camera should see it."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PosturePlan:
    """Postures to measure in, most telling first, and what each brings."""

    postures: tuple[Posture, ...]
    choice: Choice

    def shortened(self, n: int) -> PosturePlan:
        """Keep the first n postures."""
        choice = Choice(indices=self.choice.indices[:n], errors=self.choice.errors[:n])
        return replace(self, postures=self.postures[:n], choice=choice)

    def renamed(self, taken: Collection[str]) -> PosturePlan:
        """Give the postures names that no look has yet."""
        free = (name for i in count(1) if (name := f"look_{i}") not in taken)
        named = zip(self.postures, free, strict=False)
        return replace(self, postures=tuple(replace(p, name=name) for p, name in named))

    def to_file(
        self, robot: str, fiducial: str | Sequence[float], sigma: float | None = None
    ) -> ObservationFile:
        """Observations yet to be made: joints are filled in, points are not.

        With how well the place of the fiducial is known, if that is stated [m].
        """
        rows = [
            ObservationRow(name=p.name, joints=dict(p.joints)) for p in self.postures
        ]
        return ObservationFile(
            rows=tuple(rows),
            robot=robot,
            fiducial=fiducial if isinstance(fiducial, str) else tuple(fiducial),
            fiducial_sigma=sigma,
        )


def choose_postures(
    rig: Rig,
    n: int,
    *,
    rng: Rng,
    information: FloatArray | None = None,
    T_link_camera: SE3 | None = None,
    apart: float = 0.1,
    view: View | None = None,
    config: CalibrationConfig | None = None,
) -> PosturePlan:
    """Choose the postures whose measurement tells most about the camera.

    Random postures are kept if the camera sees the fiducial in them (inside the
    image, in range, turned towards it, nothing of the robot between) and the robot
    touches neither itself nor the ground. The way from one to the next is not
    looked at.

    Parameters
    ----------
    rig
        The robot and its fiducial, one of which the arm moves before the other.
    n
        How many to choose.
    rng
        Source of the random postures.
    information
        What is known already, as `choose_places` takes it: the inverse of a
        calibration's covariance; of a camera that the arm carries, in its frame.
    T_link_camera
        Pose of the camera in base, or in the link that carries it; that of the robot's
        model by default.
    apart
        Least distance of the places [m].
    view
        What the camera sees; None: as a RealSense D435.
    config
        Where the camera's error is to be small, and how well the place of a fiducial is
        known that stands still.

    Raises
    ------
    InputError
        If the robot can't show the fiducial in so many places.
    """
    view, config = view or View(), config or CalibrationConfig()
    sight = _Sight(rig, T_link_camera or rig.head.T_base_camera(rig.reference))
    q = _shown(sight, view, rng)
    if len(q) < n:
        raise InputError(
            "postures that show the fiducial to the camera",
            got=len(q),
            expected=f"at least {n}",
            mend="Turn the head towards the arm's workspace, or check which way z "
            f"of link {rig.fiducial!r} points."
            if isinstance(rig, CalibrationRig)
            else "Put it where the camera gets to see it from above, or check the "
            "camera's pose in the robot's file.",
        )
    places, points, link = sight.places(q), sight.points(q), None
    turns = None
    if isinstance(rig, WristRig):
        link = rig.link
        turns = np.swapaxes(sight.T_base_camera(q).R, -1, -2)
    choice = choose_places(
        places,
        n,
        information=information,
        apart=apart,
        workspace=config.workspace_of(link),
        turns=turns,
        fiducial_sigma=config.fiducial_sigma,
    )
    pixels, _ = view.intrinsics.project(points)
    rest = dict(zip(rig.head.joint_names, map(float, rig.reference), strict=True))
    postures = tuple(
        Posture(
            name=f"look_{rank}",
            joints={**rig.shared, **rest, **rig.chain.named(q[i])},
            place=_triple(places[i]),
            pixel=(float(pixels[i, 0]), float(pixels[i, 1])),
        )
        for rank, i in enumerate(choice.indices, start=1)
    )
    return PosturePlan(postures=postures, choice=choice)


def information_of(found: Calibration) -> FloatArray:
    """Return what looks have told of the camera, as `choose_postures` takes it."""
    used = found.observations.selected(~found.is_outlier)
    if found.link is None or used.R_base_wrist is None:
        return np.asarray(np.linalg.inv(found.covariance))
    turns = np.swapaxes(found.T_link_camera.R, -1, -2) @ used.R_base_wrist
    sigmas = np.sqrt((used.total_sigmas**2).mean(axis=1))
    return np.asarray(information_at(used.points_camera, sigmas, turns).sum(axis=0))


@dataclass(frozen=True, slots=True, eq=False)
class _Sight:
    """Where camera and fiducial are in postures (n, d), one of which stays."""

    rig: Rig
    mount: SE3
    """Of the camera, in base or in the link that carries it."""

    def T_base_camera(self, q: FloatArray) -> SE3:
        """Pose of the camera, for each posture or for all."""
        moves = isinstance(self.rig, WristRig)
        return self.rig.chain.fk(q) @ self.mount if moves else self.mount

    def T_base_fiducial(self, q: FloatArray) -> SE3:
        """Pose of the fiducial, for each posture or for all."""
        if isinstance(self.rig, WristRig):
            return self.rig.T_base_fiducial
        return self.rig.chain.fk(q)

    def points(self, q: FloatArray) -> FloatArray:
        """Where the camera sees the fiducial, its frame [m], shape (n, 3)."""
        seen = self.T_base_camera(q).inverse()
        return np.asarray(seen.apply(self.T_base_fiducial(q).p))

    def places(self, q: FloatArray) -> FloatArray:
        """Places that are to be spread [m], (n, 3): in base, or in a moving camera."""
        if isinstance(self.rig, WristRig):
            return self.points(q)
        return self.rig.chain.fk(q).p


def _shown(sight: _Sight, view: View, rng: Rng) -> FloatArray:
    """Postures that show the fiducial, a few in each cell of its places."""
    rig = sight.rig
    kept, values = np.zeros((0, rig.chain.n_joints)), rig.robot.joint_values()
    idle = np.array([values[name] for name in rig.chain.joint_names])
    for _ in range(_MOST_BATCHES):
        # A joint that turns by more than a circle shows the same from nearer by.
        q = rig.chain.unwound(rig.chain.sampled(_BATCH, rng=rng), idle)
        q = q[is_in_view(sight.T_base_fiducial(q), sight.T_base_camera(q), view)]
        kept = np.concatenate([kept, q])
        cells = np.floor(sight.places(kept) / _CELL).astype(int)
        _, first = np.unique(cells, axis=0, return_index=True)
        if len(first) > 0.5 * len(kept):
            continue  # most cells hold one posture only: there are more to find
        break
    # More than one for each cell, since collision will cost some; of many, those that
    # the arm gets to with the least motion.
    nearest = np.argsort(rig.chain.travel(kept, idle), kind="stable")
    kept = kept[nearest]
    _, cell = np.unique(cells[nearest], axis=0, return_inverse=True)
    cell = cell.reshape(-1)
    order = np.argsort(cell, kind="stable")
    starts = np.searchsorted(cell[order], cell[order])
    kept = kept[order[np.arange(len(order)) - starts < _IN_A_CELL]]
    return kept[_is_free(sight, kept)]


def _is_free(sight: _Sight, q: FloatArray) -> BoolArray:
    """Whether nothing is touched, and nothing is between fiducial and camera."""
    collision = sight.rig.collision
    height = collision.scene_clearance(q, lambda points: points[..., 2])
    is_free = height > _ARM_MARGIN
    poses = collision.body.segment_poses(q)
    camera, fiducial = sight.T_base_camera(q).p, sight.T_base_fiducial(q).p
    rays = sight_points(camera, fiducial, short=_SEAT)
    for part in collision.body.parts:
        T = SE3(poses[:, part.segment])
        if part.is_hand:
            corners = _corners(part.solid.bounds)
            is_free &= T[:, None].apply(corners)[..., 2].min(axis=1) > _ARM_MARGIN
        near = np.flatnonzero(is_free)
        local = T[near].inverse()[:, None].apply(rays[near])
        is_blocked = (part.solid.signed_distance(local) < 0.005).any(axis=1)
        is_free[near[is_blocked]] = False
    near = np.flatnonzero(is_free)
    is_free[near[collision.may_hit_itself(q[near])]] = False
    return np.asarray(is_free)


def is_in_view(T_base_fiducial: SE3, T_base_camera: SE3, view: View) -> BoolArray:
    """Whether the camera could see fiducials, were nothing else there, shape (n,)."""
    points = T_base_camera.inverse().apply(T_base_fiducial.p)
    pixels, depth = view.intrinsics.project(points)
    size = np.array([view.intrinsics.width, view.intrinsics.height])
    with np.errstate(invalid="ignore"):
        inside = (pixels > view.border) & (pixels < size - 1 - view.border)
    towards = T_base_camera.p - T_base_fiducial.p
    towards = towards / np.linalg.norm(towards, axis=-1, keepdims=True)
    facing = (towards * T_base_fiducial.R[..., 2]).sum(axis=-1)
    return np.asarray(
        inside.all(axis=-1)
        & (depth > view.nearest)
        & (depth < view.farthest)
        & (facing >= np.cos(view.max_angle))
    )


def _corners(bounds: Bounds) -> FloatArray:
    ends = np.array(list(np.ndindex(2, 2, 2)))
    return np.asarray(np.where(ends, bounds.upper, bounds.lower))


def _triple(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z
