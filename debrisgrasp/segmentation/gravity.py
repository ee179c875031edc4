"""Whether the scene agrees with the pose of the camera about what is level."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray

__all__ = ["DominantPlane", "dominant_plane", "pose_doubt", "viewpoint_doubt"]

_N_SAMPLES = 3000
"""Points that vote."""
_N_HYPOTHESES = 150
"""Points whose tangent planes are voted on."""
_BAND = 0.02
"""Distance from a plane up to which a point is on it [m]."""
_MAX_TURN = float(np.cos(np.deg2rad(20)))
"""Cosine of the largest angle between the normals of a plane and of a point on it."""
_MAX_STEEP = float(np.deg2rad(60))
"""Beyond this tilt the largest plane is a wall rather than a slanted ground [rad]."""
_MAX_DROP = 0.05
"""How far below z = 0 a camera may be before its pose is doubted [m]."""
_LOWEST_VIEW = 0.05
"""Ground is hardly seen from less above it [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class DominantPlane:
    """The plane that holds most points, whatever its orientation."""

    plane: FloatArray
    """(a, b, c, d) with (a, b, c) a unit normal towards the viewpoint, shape (4,)."""
    share: float
    """Of the points with a normal, those that lie on it."""
    height: float
    """z of the mean of its points [m]."""

    @property
    def tilt(self) -> float:
        """Angle between the normal and the vertical [rad]; above pi/2 it faces down."""
        return float(np.arccos(np.clip(self.plane[2], -1, 1)))


def dominant_plane(points: FloatArray, normals: FloatArray) -> DominantPlane | None:
    """Find the plane that holds most points by a vote on their tangent planes.

    Parameters
    ----------
    points, normals
        Positions [m] and unit normals towards the viewpoint, shapes (n, 3), z up;
        points without a normal don't vote.

    Returns
    -------
    DominantPlane or None
        None if fewer than ten points have a normal.
    """
    known = np.flatnonzero(np.isfinite(normals[:, 0]))
    if len(known) < 10:
        return None
    chosen = known[:: max(1, len(known) // _N_SAMPLES)]
    p, n = points[chosen], normals[chosen]
    tried = slice(None, None, max(1, len(chosen) // _N_HYPOTHESES))
    offset = np.einsum("ij,ij->i", p[tried], n[tried])
    on_plane = np.abs(n[tried] @ p.T - offset[:, None]) < _BAND
    on_plane &= n[tried] @ n.T > _MAX_TURN
    votes = on_plane.sum(axis=1)
    members = on_plane[votes.argmax()]
    if np.count_nonzero(members) < 10:
        return None
    towards = n[members].mean(axis=0)
    for _ in range(2):
        center = p[members].mean(axis=0)
        away = p[members] - center
        normal = np.linalg.eigh(away.T @ away)[1][:, 0]
        normal *= np.copysign(1.0, normal @ towards)
        members = np.abs((p - center) @ normal) < _BAND
        members &= n @ normal > _MAX_TURN
        if np.count_nonzero(members) < 10:
            return None
    return DominantPlane(
        plane=np.append(normal, -normal @ center),
        share=float(members.mean()),
        height=float(center[2]),
    )


def pose_doubt(
    largest: DominantPlane | None,
    viewpoint: FloatArray,
    *,
    max_tilt: float,
    max_height: float,
    min_share: float,
) -> str:
    """Say what speaks against the pose of the camera; empty if nothing does.

    Parameters
    ----------
    largest
        The largest plane of a scene in which no ground was found.
    viewpoint
        Position of the camera in the base frame [m], shape (3,).
    max_tilt, max_height
        Largest tilt [rad] and height [m] of a ground that would have been accepted.
    min_share
        Smallest share of the points that makes a plane evidence.
    """
    mend = "check T_base_camera (base frame: z up, ground at z = 0)"
    if viewpoint[2] < -_MAX_DROP:
        return (
            f"the camera would be {-viewpoint[2]:.2f} m below the ground at z = 0; "
            f"{mend}"
        )
    if largest is None or largest.share < min_share:
        return ""
    what = f"the largest surface ({largest.share:.0%} of the points)"
    degrees = np.degrees(largest.tilt)
    if degrees > 120:
        return (
            f"{what} faces down, like a ceiling: gravity disagrees with the scene, and "
            f"the camera pose may be upside down; {mend}"
        )
    if largest.tilt > _MAX_STEEP:
        return (
            f"{what} stands at {min(degrees, 180 - degrees):.0f} deg to the horizontal "
            f"and no level one is larger: the view shows a wall, or gravity disagrees "
            f"with the camera pose; {mend}"
        )
    if largest.tilt > max_tilt:
        return (
            f"{what} tilts {degrees:.0f} deg: gravity disagrees with the scene, unless "
            f"something large and slanted fills the view; {mend}"
        )
    if abs(largest.height) > max_height:
        side = "above" if largest.height > 0 else "below"
        return (
            f"{what} tilts {degrees:.0f} deg and lies {abs(largest.height):.2f} m "
            f"{side} the expected ground: it is a table, a shelf or the floor of a "
            f"bin, or the camera pose is off; {mend}"
        )
    return ""


def viewpoint_doubt(plane: FloatArray, viewpoint: FloatArray) -> str:
    """Say that ground can't have been seen from where the sensor is said to stand.

    Parameters
    ----------
    plane
        (a, b, c, d) of the ground, with a unit normal upwards, shape (4,).
    viewpoint
        Position of the sensor in the same frame [m], shape (3,).
    """
    height = float(plane[:3] @ viewpoint + plane[3])
    if height > _LOWEST_VIEW:
        return ""
    side = "above" if height >= 0.0 else "below"
    return (
        f"the sensor would be {abs(height):.2f} m {side} the ground that it sees; "
        "check the viewpoint (of a cloud: in the frame of its points) and T_base_camera"
    )
