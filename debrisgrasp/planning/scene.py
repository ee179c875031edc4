"""The scene of one search: thinned cloud, the object in it, and the space around."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from debrisgrasp._arrays import (
    BoolArray,
    Float32Array,
    FloatArray,
    IntArray,
    require_range,
)
from debrisgrasp._checked import checked_fields
from debrisgrasp._workers import beside
from debrisgrasp.errors import CaptureError, ShapeError
from debrisgrasp.geometry import (
    MAX_REACH,
    Bounds,
    DistanceField,
    LineOfSight,
    PointCloud,
    Space,
    voxel_downsample,
)

from .hands import SPHERE_RADIUS
from .mass import SeenSurface
from .occlusion import is_beside_nearer

__all__ = ["NEAREST_MASK", "UNKNOWN_FLAG", "GraspScene", "SceneConfig"]

UNKNOWN_FLAG = np.int32(1 << 30)
"""Set in `GraspScene.nearest` where the camera never looked."""
_ROUNDING = 1e-9
"""Seven cells of 5 mm are a little more than 35 mm [m]."""
_LEVEL = 0.7
"""Least z of the normal of a plane that can be the floor of the grid."""
_MAX_NEIGHBORS = 32
"""From so many the direction of the surface around a point is told."""
NEAREST_MASK = np.int32(UNKNOWN_FLAG - 1)
"""The rest of it: the index of a point."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class SceneConfig:
    """How finely the scene is represented."""

    spacing: float = 0.01
    """Edge of a grid cell, and distance between thinned points [m]. Smaller finds
    smaller objects and costs time and memory with the cube."""
    truncation: float = 0.05
    """Distances saturate here [m]: at no less than the radius of the hand's spheres,
    which would touch something everywhere, and at no more than seven cells."""
    hand_reach: float = 0.30
    """How far around V the hand and its approach may be [m]; no less than the longest
    approach."""
    tangent_radius: float = 0.06
    """Neighbourhood that tells along which direction the object runs [m]."""
    ground_roughness: float = 0.02
    """How far below its plane the ground may lie [m]."""
    max_target_points: int = 1500
    """More points of the object than this add nothing to the proposals."""

    def __post_init__(self) -> None:
        finest = SPHERE_RADIUS / MAX_REACH
        require_range("SceneConfig.spacing", self.spacing, finest, 0.1)
        least = max(SPHERE_RADIUS, self.spacing)
        most = MAX_REACH * self.spacing + _ROUNDING
        require_range("SceneConfig.truncation", self.truncation, least, most)
        require_range("SceneConfig.hand_reach", self.hand_reach, 0.0, 2.0)
        require_range(
            "SceneConfig.tangent_radius [m]", self.tangent_radius, self.spacing, 1.0
        )
        require_range("SceneConfig.ground_roughness", self.ground_roughness, 0.0, 1.0)
        require_range("SceneConfig.max_target_points", self.max_target_points, 1)


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class GraspScene:
    """What grasps are matched against, in the base frame."""

    cloud: PointCloud
    """All measured points within reach of V, one per cell; every one an obstacle."""
    is_target: BoolArray
    """Which of them belong to the object and lie in V, shape (n,)."""
    is_own: BoolArray
    """Which of them are part of what the object is part of, in V or outside, (n,)."""
    is_cut: BoolArray
    """Which of them lie where the image ends: what they belong to goes on, (n,)."""
    region: Bounds
    """The volume V (section 5.2 of the paper)."""
    field: DistanceField
    clearance: Float32Array
    """Distance from the centre of each cell of the field to the nearest obstacle, the
    ground included [m]; negative in the ground. Flat, like ``field.gap``."""
    ground_plane: FloatArray | None
    """(a, b, c, d) with a x + b y + c z + d the height over the ground [m]; None where
    there is no evidence of one."""
    nearest: IntArray
    """``field.nearest`` with `UNKNOWN_FLAG` in cells of unknown space, shape (cells,):
    one lookup for both."""
    table: Float32Array
    """Rows of ``field.table``, then 1 for a target point or 0, then padding to 32
    bytes; shape (n + 1, 8)."""
    target: IntArray
    """Indices of target points that have a normal, shape (t,): where proposals may
    start."""
    tangents: FloatArray
    """Unit direction in which the object runs at each of ``target``, shape (t, 3)."""
    surface: SeenSurface
    """All that was seen of the object, in V and outside, and of its likely parts."""

    @classmethod
    def build(
        cls,
        cloud: PointCloud,
        is_object: BoolArray,
        region: Bounds,
        sight: LineOfSight,
        config: SceneConfig,
        *,
        ground_plane: FloatArray | None = None,
        belongs: FloatArray | None = None,
        workers: int = 1,
    ) -> GraspScene:
        """Prepare a scene.

        Parameters
        ----------
        cloud
            The capture in the base frame, not thinned.
        is_object
            Which of its points belong to the object sought, shape (n,).
        region
            The volume V.
        sight
            Tells free from unknown space.
        ground_plane
            (a, b, c, d) with a x + b y + c z + d the height over the ground [m], if
            there is evidence of one: what lies below is solid.
        belongs
            Probability that each point is part of what the object is part of, shape
            (n,); None: what is sought in V is all there is of it.
        workers
            With two, the grid is filled beside the work on the object's points.

        Raises
        ------
        ShapeError
            If ``is_object`` or ``belongs`` are not one value for each point.
        CaptureError
            If no point of the object lies in V.
        """
        cloud.require_frame("base")
        for name, values in (("object mask", is_object), ("belongs", belongs)):
            if values is not None and values.shape != (len(cloud),):
                raise ShapeError(name, got=values.shape, expected=f"({len(cloud)},)")
        around = _above(ground_plane, region.grown(config.hand_reach), config)
        near = np.flatnonzero(around.contains(cloud.points))
        wanted = is_object[near] & region.contains(cloud.points[near])
        if not wanted.any():
            raise CaptureError(
                "region",
                got="no measured point of the object inside it",
                expected="at least one",
                mend="Move or widen the region, or choose another object.",
            )
        # Thinned apart, or a cell that both touch would lose one of them.
        target, others = near[wanted], near[~wanted]
        kept = _thinned(cloud, (target, others), config.spacing)
        thinned = cloud.selected(kept)
        is_target = np.isin(kept, target, assume_unique=True)
        if belongs is None:
            belongs = np.zeros(len(cloud))
            belongs[target] = 1.0

        def filled() -> tuple[DistanceField, Float32Array, IntArray]:
            return _filled(thinned, around, sight, config, ground_plane)

        with beside(filled, workers=workers) as grid:
            usable = np.flatnonzero(is_target & np.isfinite(thinned.normals[:, 0]))
            usable = usable[:: max(1, -(-len(usable) // config.max_target_points))]
            tangents = _tangents(
                thinned.points[is_target],
                thinned.points[usable],
                thinned.normals[usable],
                config.tangent_radius,
            )
            surface = _seen_surface(cloud, belongs, near, config.spacing)
            field, clearance, nearest = grid()
        table = np.zeros((len(thinned) + 1, 8), dtype=np.float32)
        table[:, :6] = field.table
        table[:-1, 6] = is_target
        return cls(
            cloud=thinned,
            is_target=is_target,
            is_own=belongs[kept] == 1.0,
            is_cut=cloud.at_rim(kept),
            region=region,
            field=field,
            clearance=clearance,
            ground_plane=ground_plane,
            nearest=nearest,
            table=table,
            target=usable,
            tangents=tangents,
            surface=surface,
        )

    @property
    def centroid(self) -> FloatArray:
        """Mean of the object's visible points, one per cell [m], shape (3,)."""
        mean: FloatArray = self.cloud.points[self.is_target].mean(axis=0)
        return mean


def _thinned(cloud: PointCloud, parts: Iterable[IntArray], spacing: float) -> IntArray:
    """One point per cell of each part of a cloud: indices as those of the parts."""
    return np.concatenate(
        [
            part[voxel_downsample(cloud.points.take(part, axis=0), spacing)]
            for part in parts
            if len(part)
        ]
    )


def _filled(
    thinned: PointCloud,
    around: Bounds,
    sight: LineOfSight,
    config: SceneConfig,
    ground_plane: FloatArray | None,
) -> tuple[DistanceField, Float32Array, IntArray]:
    """Fill the grid of a scene; with its ``clearance`` and ``nearest``."""
    field = DistanceField.build(
        thinned,
        around,
        sight,
        spacing=config.spacing,
        truncation=config.truncation,
    )
    clearance = _with_ground(field, ground_plane, config.ground_roughness)
    is_unknown = field.space == Space.UNKNOWN
    nearest = field.nearest | np.where(is_unknown, UNKNOWN_FLAG, np.int32(0))
    # Kept in `clearance` alone: a grid of them takes megabytes.
    field.__dict__.pop("gap", None)
    return field, clearance, nearest


def _seen_surface(
    cloud: PointCloud, belongs: FloatArray, near: IntArray, spacing: float
) -> SeenSurface:
    """Thin what belongs to an object and what may, and see where both end.

    What hides them is sought among the points ``near``.
    """
    own = np.flatnonzero(belongs == 1.0)
    kin = np.flatnonzero((belongs > 0.0) & (belongs < 1.0))
    kept = np.concatenate(
        [
            part[voxel_downsample(cloud.points.take(part, axis=0), spacing)]
            for part in (own, kin)
            if len(part)
        ]
    )
    points, others = cloud.points[kept], cloud.points[near[belongs[near] == 0.0]]
    goes_on = is_beside_nearer(points, others, cloud.viewpoint) | cloud.at_rim(kept)
    return SeenSurface(points, cloud.normals[kept], belongs[kept], goes_on)


def _above(plane: FloatArray | None, box: Bounds, config: SceneConfig) -> Bounds:
    """Leave out what lies deep in the ground: it is solid, and nothing else is."""
    if plane is None or plane[2] < _LEVEL:
        return box
    x, y = (np.array([box.lower[i], box.upper[i]]) for i in range(2))
    ground = -(plane[0] * x[:, None] + plane[1] * y + plane[3]) / plane[2]
    floor = float(ground.min()) - config.ground_roughness - 4 * config.spacing
    lower = box.lower.copy()
    # Not so far that the region itself is cut.
    lower[2] = np.clip(floor, lower[2], lower[2] + config.hand_reach)
    return Bounds(lower, box.upper)


def _with_ground(
    field: DistanceField, plane: FloatArray | None, roughness: float
) -> Float32Array:
    """Lower the distances of cells near and below the ground."""
    if plane is None:
        return field.gap
    x, y, z = (
        plane[axis] * (field.origin[axis] + field.spacing * np.arange(n))
        for axis, n in enumerate(field.shape)
    )
    level = (x[:, None] + y + (plane[3] + roughness)).astype(np.float32)
    lowered: Float32Array = (level[..., None] + z.astype(np.float32)).ravel()
    np.minimum(field.gap, lowered, out=lowered)
    return lowered


def _tangents(
    surface: FloatArray, points: FloatArray, normals: FloatArray, radius: float
) -> FloatArray:
    """Direction along which the surface extends most around each point, (t, 3)."""
    if not len(points):
        return np.zeros((0, 3))
    tree = cKDTree(surface)
    k = min(_MAX_NEIGHBORS, len(surface))
    found = tree.query(points, k=np.arange(1, k + 1), distance_upper_bound=radius)
    distance, index = np.asarray(found[0]), np.asarray(found[1])
    u, v = _tangent_axes(normals)
    offset = surface[np.minimum(index, len(surface) - 1)] - points[:, None]
    offset[~np.isfinite(distance)] = 0.0
    a, b = (offset @ u[..., None])[..., 0], (offset @ v[..., None])[..., 0]
    # The major axis of the 2 x 2 scatter in the tangent plane, in closed form.
    angle = 0.5 * np.arctan2(2 * (a * b).sum(axis=1), (a * a - b * b).sum(axis=1))
    tangent: FloatArray = np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v
    return tangent


def _tangent_axes(normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors at right angles to each normal and to each other, (t, 3)."""
    spare = np.where(np.abs(normals[:, :1]) < 0.7, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    u = np.cross(normals, spare)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return u, np.cross(normals, u)
