"""The things that both kinds of report draw in three dimensions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy.spatial import KDTree

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.geometry import Bounds, PointCloud, Solid
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.planning import Grasp
from debrisgrasp.prototypes import GripperModel

from .colors import HAND_COLORS, ROBOT_COLOR
from .raster import Mesh

__all__ = [
    "approach_arrow",
    "arrow",
    "box_edges",
    "ground_grid",
    "hand_mesh",
    "merged",
    "point_spacing",
    "robot_mesh",
    "shown_ranks",
    "thinned",
]

Color = tuple[float, float, float]


def merged(solids: Iterable[Solid], color: Color) -> Mesh:
    """One mesh of many solids; without any, a mesh of no triangles."""
    vertices: list[FloatArray] = [np.zeros((0, 3))]
    faces: list[IntArray] = [np.zeros((0, 3), dtype=np.int64)]
    count = 0
    for solid in solids:
        corners, triangles = solid.mesh()
        vertices.append(np.asarray(corners, dtype=np.float64))
        faces.append(np.asarray(triangles) + count)
        count += len(corners)
    return Mesh(np.concatenate(vertices), np.concatenate(faces), color)


def shown_ranks(grasps: Sequence[Grasp]) -> tuple[int, ...]:
    """Ranks (from 0) of the best grasps that differ enough to be seen apart.

    At most as many as there are colours for hands; the best grasp is always among them.
    """
    ranks: list[int] = []
    for rank, grasp in enumerate(grasps):
        if len(ranks) == len(HAND_COLORS):
            break
        if all(_looks_different(grasp, grasps[other]) for other in ranks):
            ranks.append(rank)
    return tuple(ranks)


def _looks_different(a: Grasp, b: Grasp) -> bool:
    distance = float(np.linalg.norm(a.T_base_hand.p - b.T_base_hand.p))
    cosine = float(a.T_base_hand.R[:, 2] @ b.T_base_hand.R[:, 2])
    return distance > 0.12 or cosine < np.cos(np.deg2rad(50.0))


def hand_mesh(grasp: Grasp, grippers: Mapping[str, GripperModel], color: Color) -> Mesh:
    """Hand of a grasp where it closes, open as during the approach; base frame.

    A gripper that the mapping does not hold is drawn as nothing: its pose still shows
    by the arrow of its approach.
    """
    hand = grippers.get(grasp.gripper)
    solids = () if hand is None else hand.solids(grasp.preshape, grasp.opening)
    return merged(solids, color).moved(grasp.T_base_hand)


def robot_mesh(robot: RobotModel, grasp: Grasp | None) -> Mesh:
    """Robot in the posture of a grasp, or at rest without one; base frame.

    The hand that grips is left out: `hand_mesh` draws it with its fingers in place.
    """
    hidden: frozenset[str] = frozenset()
    moved: Mapping[str, float] = {}
    if grasp is not None and grasp.joints is not None and grasp.arm is not None:
        moved = grasp.joints
        hidden = robot.tree.links_below(robot.arm(grasp.arm).hand)
    solids = (s for link, s in robot.links_solids(moved) if link not in hidden)
    return merged(solids, ROBOT_COLOR)


def approach_arrow(grasp: Grasp, color: Color) -> Mesh:
    """Arrow [m] along the straight path of the palm to its place."""
    return arrow(grasp.T_base_pregrasp.p, grasp.T_base_hand.p, color, 0.006)


def arrow(start: FloatArray, end: FloatArray, color: Color, radius: float) -> Mesh:
    """Arrow [m] from one place (3,) to another."""
    length = float(np.linalg.norm(end - start))
    if length < 1e-6:
        return merged((), color)
    head = min(6.0 * radius, 0.5 * length)
    rings = np.array(
        [
            [0, 0],
            [0, radius],
            [length - head, radius],
            [length - head, 2.5 * radius],
            [length, 0],
        ]
    )
    return _revolved(rings, start, (end - start) / length, color)


def _revolved(
    rings: FloatArray, start: FloatArray, axis: FloatArray, color: Color
) -> Mesh:
    """Surface of a profile of (height, radius) turned about an axis."""
    sides = 12
    other = np.eye(3)[np.argmin(np.abs(axis))]
    u = np.cross(axis, other)
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    angle = 2.0 * np.pi * np.arange(sides) / sides
    circle = np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v
    vertices = start + rings[:, :1, None] * axis + rings[:, 1:, None] * circle
    i, k = np.meshgrid(np.arange(len(rings) - 1), np.arange(sides), indexing="ij")
    low, low_next = i * sides + k, i * sides + (k + 1) % sides
    quads = np.stack([low, low_next, low_next + sides, low + sides], axis=-1)
    faces = quads[..., [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    return Mesh(vertices.reshape(-1, 3), faces, color)


def box_edges(bounds: Bounds) -> FloatArray:
    """Return the twelve edges of a box, shape (12, 2, 3) [m]."""
    corners = np.array(list(np.ndindex(2, 2, 2)))
    pairs = [
        (i, j)
        for i in range(8)
        for j in range(i + 1, 8)
        if np.abs(corners[i] - corners[j]).sum() == 1
    ]
    ends = np.where(corners, bounds.upper, bounds.lower)
    edges: FloatArray = ends[np.array(pairs)]
    return edges


def ground_grid(points: FloatArray, step: float) -> FloatArray:
    """Lines every ``step`` [m] on the plane z = 0 below points, shape (l, 2, 3)."""
    low = np.floor(points[:, :2].min(axis=0) / step).astype(int)
    high = np.ceil(points[:, :2].max(axis=0) / step).astype(int)
    xs, ys = (step * np.arange(a, b + 1) for a, b in zip(low, high, strict=True))
    along_y = [[[x, ys[0], 0.0], [x, ys[-1], 0.0]] for x in xs]
    along_x = [[[xs[0], y, 0.0], [xs[-1], y, 0.0]] for y in ys]
    return np.array(along_y + along_x)


def thinned(cloud: PointCloud, limit: int, keep: IntArray) -> IntArray:
    """Choose at most about ``limit`` points, spread evenly; ascending indices.

    Parameters
    ----------
    cloud
        The points to choose from.
    limit
        How many are wanted [points].
    keep
        Indices of points that stay in any case, counted within the limit if they fit.
    """
    n = len(cloud)
    if n <= limit:
        return np.arange(n)
    quota = max(limit - len(keep), limit // 2)
    # Multiples of the golden ratio are spread evenly at every length, and unlike a
    # stride they draw no stripes over the rows of an image.
    phase = (np.arange(n) * 0.6180339887498949) % 1.0
    return np.union1d(np.flatnonzero(phase < quota / n), keep)


def point_spacing(points: FloatArray) -> FloatArray:
    """Size [m] at which squares on points just close the surface, shape (n,)."""
    if len(points) < 6:
        return np.full(len(points), 0.005)
    distance = np.asarray(KDTree(points).query(points, k=5)[0])
    spacing: FloatArray = 1.25 * distance[:, -1]
    return np.minimum(spacing, 3.0 * np.median(spacing))
