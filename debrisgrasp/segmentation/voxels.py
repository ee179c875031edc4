"""Voxel grids over clouds: occupied cells, their means, and who touches whom."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from scipy.sparse import coo_array

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import PointCloud

__all__ = [
    "Binning",
    "VoxelGrid",
    "binned",
    "cell_ids",
    "fitted_normals",
    "grid_axes",
    "voxelise",
]

_DENSE_CELLS = 1 << 25
"""Largest table of all cells, occupied or not (128 MB); beyond it cells are sorted."""

_MOST_CELLS = 9e18
"""So many cells, occupied or not, can be numbered with 64 bits."""

_CELLS_PER_POINT = 32
"""So many times as large as the cloud, a table costs more than to sort the points."""

_NORMAL_REACH = 5
"""Cells over which normals spread to cells without any."""


_NEIGHBOURHOOD = tuple(
    (i, j, k)
    for i in (-1, 0, 1)
    for j in (-1, 0, 1)
    for k in (-1, 0, 1)
    if (i, j, k) != (0, 0, 0)
)
"""Offsets to the 26 neighbours of a cell."""


class Binning(Enum):
    """Which coordinates the cells of a voxel grid divide evenly."""

    METRIC = "metric"
    """Cubes of one size everywhere."""
    SINGLE_CAMERA = "single_camera"
    """x/z, y/z and ln z along the line of sight: cells grow with the distance z, as the
    gaps between the samples of a depth camera do."""


@dataclass(frozen=True, slots=True, eq=False)
class VoxelGrid:
    """The occupied cells of a cloud, in an order that its points don't influence."""

    centers: FloatArray
    """Mean of the points of each cell [m], shape (v, 3)."""
    normals: FloatArray
    """Unit mean of their normals, shape (v, 3), or if no point of the cloud has any, of
    planes through the neighbours; NaN where none is known."""
    colors: FloatArray | None
    """Mean colour in [0, 1], shape (v, 3), if the points have any."""
    viewpoint: FloatArray
    """Position of the sensor [m], shape (3,)."""
    sizes: FloatArray
    """Edge length of each cell at its place [m], shape (v,)."""
    point_voxel: IntArray
    """Cell of each point, shape (n,)."""
    sources: IntArray
    """First voxel of each ordered pair of 26-neighbours, shape (p,)."""
    targets: IntArray
    """Second voxel of each pair, ascending, shape (p,); every pair occurs both ways."""

    def __len__(self) -> int:
        return len(self.centers)


@dataclass(frozen=True, slots=True, eq=False)
class Bins:
    """Which cell each point of a cloud falls into."""

    point_voxel: IntArray
    """Number of the cell of each point, shape (n,)."""
    cells: IntArray
    """Coordinates of the occupied cells, shape (3, v)."""
    scale: FloatArray | None
    """Size of a cell at each point relative to that at 1 m; None if all are equal."""

    @property
    def n_voxels(self) -> int:
        """How many cells are occupied."""
        return int(self.cells.shape[1])


def binned(cloud: PointCloud, resolution: float, binning: Binning) -> Bins:
    """Bin the points of a cloud.

    The grid is anchored at the viewpoint and turned towards the cloud (see
    `grid_axes`), so that moving scene and camera together leaves the cells as they are.

    Parameters
    ----------
    cloud
        At least one point, z up.
    resolution
        Edge length [m]; with `Binning.SINGLE_CAMERA` that of a cell at 1 m.

    Raises
    ------
    InputError
        If the points lie so far apart that the cells between can't be numbered.
    """
    axes = grid_axes(cloud, level=binning is Binning.METRIC)
    local = (axes / resolution) @ cloud.points.T
    local -= ((axes / resolution) @ cloud.viewpoint)[:, None]
    scale = None
    if binning is Binning.SINGLE_CAMERA:
        # Points beside or behind the sensor (a scanner sees all round) have no
        # perspective coordinates of their own; a floor on the depth keeps them finite.
        local *= resolution
        reach = np.sqrt(np.einsum("ij,ij->j", local, local))
        scale = np.maximum(np.maximum(local[0], 0.1 * reach), 1e-3)
        local[0] = np.log(scale)
        local[1:] /= scale
        local /= resolution
    np.floor(local, out=local)
    shape = local.max(axis=1) - local.min(axis=1) + 3
    if np.prod(shape) > _MOST_CELLS:
        raise InputError(
            "extent of the cloud",
            got=f"{shape.max() * resolution:.3g} m in voxels of {resolution:.2g} m",
            expected=f"no more than {_MOST_CELLS:.0e} voxels",
            mend="Drop broken points, or enlarge the voxels.",
        )
    point_voxel, cells = cell_ids(local.astype(np.int64))
    return Bins(point_voxel, cells, scale)


def voxelise(
    cloud: PointCloud,
    resolution: float,
    binning: Binning = Binning.METRIC,
    colors: FloatArray | None = None,
    bins: Bins | None = None,
) -> VoxelGrid:
    """Average a cloud in cells and find the 26-neighbours of every occupied one.

    Parameters
    ----------
    cloud, resolution, binning
        As `binned` takes them.
    colors
        One colour in [0, 1] per point, shape (n, 3).
    bins
        What `binned` returned for the same arguments, if it was called before.
    """
    bins = bins or binned(cloud, resolution, binning)
    point_voxel, n_voxels = bins.point_voxel, bins.n_voxels
    counts = np.bincount(point_voxel, minlength=n_voxels)

    def mean(values: FloatArray) -> FloatArray:
        return np.bincount(point_voxel, weights=values, minlength=n_voxels) / counts

    centers = np.stack([mean(x) for x in cloud.points.T], axis=1)
    known = np.isfinite(cloud.normals[:, 0])
    normals = np.stack([mean(np.where(known, n, 0.0)) for n in cloud.normals.T], axis=1)
    sources, targets = _neighbour_pairs(bins.cells)
    if known.any():
        normals = _completed_normals(normals, sources, targets)
    else:
        normals = fitted_normals(centers, cloud.viewpoint, sources, targets)
    return VoxelGrid(
        centers=centers,
        normals=normals,
        colors=None
        if colors is None
        else np.stack([mean(colors[:, i]) for i in range(3)], axis=1),
        viewpoint=cloud.viewpoint,
        sizes=np.full(n_voxels, resolution)
        if bins.scale is None
        else resolution * mean(bins.scale),
        point_voxel=point_voxel,
        sources=sources,
        targets=targets,
    )


def fitted_normals(
    centers: FloatArray, viewpoint: FloatArray, sources: IntArray, targets: IntArray
) -> FloatArray:
    """Fit planes to voxels and two rings of neighbours; their unit normals, (v, 3).

    With the adjacency A, each voxel its own neighbour too, a neighbourhood weighs
    voxels by I + A + A A, as the point cloud library does: a cone five cells wide.

    Parameters
    ----------
    centers
        Means of the voxels [m], shape (v, 3).
    viewpoint
        Position that normals face [m], shape (3,).
    sources, targets
        Ordered pairs of neighbours, both ways, shape (p,).

    Returns
    -------
    FloatArray
        NaN where fewer than three voxels, or voxels in one line, leave a plane open.
    """
    n = len(centers)
    ones = np.ones(len(sources))
    ring = coo_array((ones, (targets, sources)), shape=(n, n)).tocsr()
    x, y, z = centers.T - centers.mean(axis=0)[:, None]
    moments = np.stack([np.ones(n), x, y, z, x * x, x * y, x * z, y * y, y * z, z * z])
    own = np.ascontiguousarray(moments.T)
    around = own + ring @ own
    total = own + around + (around + ring @ around)
    mean = total[:, 1:4] / total[:, :1]
    scatter = np.empty((n, 3, 3))
    for k, (i, j) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))):
        scatter[:, i, j] = scatter[:, j, i] = (
            total[:, 4 + k] / total[:, 0] - mean[:, i] * mean[:, j]
        )
    variances, axes = np.linalg.eigh(scatter)
    normals: FloatArray = axes[:, :, 0]
    away = np.einsum("ij,ij->i", normals, viewpoint - centers) < 0
    normals[away] *= -1.0
    normals[variances[:, 1] < 1e-6 * variances[:, 2]] = np.nan
    normals[variances[:, 2] <= 0] = np.nan
    return normals


def grid_axes(cloud: PointCloud, *, level: bool) -> FloatArray:
    """Axes of a grid that turns with scene and camera, as rows, shape (3, 3).

    The first points from the viewpoint to the centroid of the cloud, in the horizontal
    if ``level``; the second lies in the horizontal; the third completes them upwards.
    """
    # One coordinate after the other: reductions along rows of three are slow.
    middle = [cloud.points[:, axis].mean() for axis in range(3)]
    forward = np.array(middle) - cloud.viewpoint
    horizontal = np.array([forward[0], forward[1], 0.0])
    reach = np.linalg.norm(horizontal)
    if reach < 1e-6:
        horizontal, reach = np.array([1.0, 0.0, 0.0]), np.float64(1.0)
    left = np.array([-horizontal[1], horizontal[0], 0.0]) / reach
    first = horizontal if level or not forward.any() else forward
    first = first / np.linalg.norm(first)
    return np.stack([first, left, np.cross(first, left)])


def cell_ids(keys: IntArray) -> tuple[IntArray, IntArray]:
    """Give the occupied cells numbers in the order of their coordinates.

    Parameters
    ----------
    keys
        Cell coordinates of each point, shape (3, n).

    Returns
    -------
    ids, cells
        Number of each point's cell, shape (n,), and the coordinates of the numbered
        cells, shape (3, v).
    """
    lower = keys.min(axis=1)
    shape = tuple(int(size) for size in keys.max(axis=1) - lower + 1)
    flat = _flattened(keys, lower, shape)
    most = min(_CELLS_PER_POINT * len(flat), _DENSE_CELLS)
    if np.prod(shape, dtype=np.float64) <= most:
        is_occupied = np.zeros(int(np.prod(shape)), dtype=bool)
        is_occupied[flat] = True
        occupied = np.flatnonzero(is_occupied)
        number = np.empty(len(is_occupied), dtype=np.int32)
        number[occupied] = np.arange(len(occupied), dtype=np.int32)
        ids: IntArray = number.take(flat)
    else:
        occupied, ids = np.unique(flat, return_inverse=True)
    return ids, np.stack(np.unravel_index(occupied, shape)) + lower[:, None]


def _flattened(keys: IntArray, lower: IntArray, shape: tuple[int, ...]) -> IntArray:
    flat: IntArray = (keys[0] - lower[0]) * shape[1] + (keys[1] - lower[1])
    flat *= shape[2]
    flat += keys[2] - lower[2]
    return flat


def _neighbour_pairs(cells: IntArray) -> tuple[IntArray, IntArray]:
    """Ordered pairs of cells that touch by face, edge or corner, by second cell."""
    # A rim of one cell keeps offsets from wrapping round to the other side.
    lower = cells.min(axis=1) - 1
    shape = tuple(int(size) for size in cells.max(axis=1) - lower + 2)
    flat = _flattened(cells, lower, shape)
    steps = [(i * shape[1] + j) * shape[2] + k for i, j, k in _NEIGHBOURHOOD]
    table = np.empty((len(steps), len(flat)), dtype=np.int32)
    if np.prod(shape, dtype=np.float64) <= _DENSE_CELLS:
        # Zeros cost memory only where they are touched: numbers count from 1.
        number = np.zeros(int(np.prod(shape)), dtype=np.int32)
        number[flat] = np.arange(1, len(flat) + 1, dtype=np.int32)
        for row, step in zip(table, steps, strict=True):
            # Within the rim nothing is out of range; to clip is faster than to check.
            np.take(number, flat + step, out=row, mode="clip")
        table -= 1
    else:
        for row, step in zip(table, steps, strict=True):
            shifted = flat + step
            place = np.minimum(np.searchsorted(flat, shifted), len(flat) - 1)
            row[:] = np.where(flat[place] == shifted, place, -1)
    by_cell = np.ascontiguousarray(table.T).ravel()
    found = np.flatnonzero(by_cell >= 0)
    # Indices of the machine's own width spare conversions later.
    return by_cell.take(found).astype(np.intp), found // len(steps)


def _completed_normals(
    normals: FloatArray, sources: IntArray, targets: IntArray
) -> FloatArray:
    """Scale normals to unit length; cells without any ask their neighbours in turn."""
    length = np.sqrt(np.einsum("ij,ij->i", normals, normals))
    unknown = length < 1e-6
    normals /= np.where(unknown, 1.0, length)[:, None]
    normals[unknown] = 0.0
    asking = np.flatnonzero(unknown[targets])
    sources, targets = sources[asking], targets[asking]
    for _ in range(_NORMAL_REACH):
        asks = unknown[targets] & ~unknown[sources]
        if not asks.any():
            break
        asked, asker = sources[asks], targets[asks]
        for i in range(3):
            normals[:, i] += np.bincount(asker, normals[asked, i], len(normals))
        answered = np.unique(asker)
        length = np.linalg.norm(normals[answered], axis=1)
        is_clear = length > 1e-6
        answered = answered[is_clear]
        normals[answered] /= length[is_clear, None]
        unknown[answered] = False
    normals[unknown] = np.nan
    return normals
