"""Surface normals of a depth image that respect edges and follow the sensor's noise.

All fits are made in inverse depth: there a plane is a linear function of the pixel
coordinates, and the noise of a stereo camera is the same everywhere. Each cell of a few
pixels starts from its direct neighbours and then refits its plane to ever larger
windows, taking only what agrees with the plane so far. So a window reaches far across a
face, and stops at depth jumps and at creases.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import Float32Array, FloatArray, IntArray, as_floats, bounded

from .camera import Intrinsics

__all__ = ["Facets", "depth_facets", "depth_normals"]

_CELLS_ACROSS = 320
"""Pixels are averaged into cells so that about this many span the image: noise of a
stereo camera is correlated over two or three pixels, so finer cells only cost time."""
_MAX_INCIDENCE = math.radians(84.0)
"""Steepest view of a surface [rad]: a step in depth beyond it is a jump from one
surface to another. Larger bridges more jumps, smaller loses grazing surfaces."""
_NOISE_MULTIPLE = 3.0
"""Cells within this many standard deviations of a plane belong to it. Larger rounds
creases, smaller averages over less of a face."""
_WINDOW_RADII = (3, 5)
"""Half widths of the growing windows [cells]; the last gives about 3 degrees at 1.5 m
for a noise of 1.8 mm / m^2."""
_DENSE_RADIUS = 4
"""Of wider windows every second cell is taken, as of a chessboard: the noise of cells
side by side is nearly the same."""
_MISSING = np.float32(-1e6)
"""Stands for 'no measurement' in a fit: it agrees with no plane."""
_ONE_THREAD = 200_000
"""Multiplications up to which BLAS does a product in one thread."""
_CHUNK_ROWS = 40
"""Rows of cells fitted at once: with fewer the calls cost more than the work, with many
it leaves the processor's cache."""
_MIN_SUPPORT = 5
"""Cells that must agree before a plane is believed; three fit any plane exactly."""
_MIN_SPREAD = 0.05
"""Determinant of the covariance of the agreeing cells' coordinates [cells^4] below
which they lie on one line and leave the plane free to turn about it."""


@dataclass(frozen=True, slots=True, eq=False)
class Facets:
    """Normals of a depth image, each once for all the pixels that share it."""

    normals: FloatArray
    """Unit normals in the camera frame, the last one NaN, shape (m, 3)."""
    of_pixels: IntArray
    """Which of them each pixel has, shape (height, width)."""


def depth_normals(depth: FloatArray, intrinsics: Intrinsics) -> FloatArray:
    """Estimate unit normals of a depth image, towards the camera.

    Parameters
    ----------
    depth
        Metres along the optical axis, shape (height, width); NaN where nothing was
        measured.
    intrinsics
        Camera of the image.

    Returns
    -------
    FloatArray
        Normals in the camera frame, shape (height, width, 3); NaN where nothing was
        measured and where too few neighbours share a surface.
    """
    facets = depth_facets(depth, intrinsics)
    return facets.normals.take(facets.of_pixels, axis=0)


def depth_facets(depth: FloatArray, intrinsics: Intrinsics) -> Facets:
    """Estimate normals (m, 3) as `depth_normals` does, and which of them pixels have.

    So they can be turned before they are spread over the pixels.
    """
    depth = as_floats(depth, "depth", (intrinsics.height, intrinsics.width))
    cell = max(1, round(intrinsics.width / _CELLS_ACROSS))
    pixels = _padded_inverse(depth, cell)
    step_limit = math.tan(_MAX_INCIDENCE) * cell / intrinsics.fx
    grid = _nearest_surface(pixels, cell, step_limit)
    noise = _noise(grid)
    jump = np.fmax(step_limit * grid, 4.0 * noise)

    planes = np.stack([grid, np.zeros_like(grid), np.zeros_like(grid)])
    planes = _refitted(grid, planes, jump, radius=1)
    for radius in _WINDOW_RADII:
        agree = np.full_like(grid, _NOISE_MULTIPLE * noise)
        larger = _refitted(grid, planes, agree, radius)
        planes = np.where(np.isfinite(larger[0]), larger, planes)

    normals = _plane_normals(planes, cell, intrinsics).reshape(-1, 3)
    of_pixels = _best_fits(pixels, planes, cell, jump)
    return Facets(
        np.concatenate([normals, np.full((1, 3), np.nan)]),
        of_pixels[: intrinsics.height, : intrinsics.width],
    )


def _padded_inverse(depth: FloatArray, cell: int) -> Float32Array:
    """Inverse depth [1/m], padded by NaN to whole cells."""
    rows, columns = (-(-size // cell) * cell for size in depth.shape)
    inverse = np.full((rows, columns), np.nan, dtype=np.float32)
    inverse[: depth.shape[0], : depth.shape[1]] = 1.0 / depth
    return inverse


def _nearest_surface(
    pixels: Float32Array, cell: int, step_limit: float
) -> Float32Array:
    """Mean inverse depth of the nearest surface in each cell; NaN if it is empty.

    Where a cell straddles a jump the far side is left out, since the near side is
    sharp and the far side is what it hides.
    """
    corners = [pixels[i::cell, j::cell] for i in range(cell) for j in range(cell)]
    nearest = corners[0]
    for corner in corners[1:]:
        nearest = np.fmax(nearest, corner)
    lowest = nearest * np.float32(1.0 - step_limit)
    total = np.zeros_like(nearest)
    count = np.zeros_like(nearest)
    for corner in corners:
        belongs = corner >= lowest
        total += np.where(belongs, corner, np.float32(0.0))
        count += belongs
    return np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0)


def _noise(grid: Float32Array) -> float:
    """Estimate the standard deviation of a cell [1/m].

    Second differences, two cells apart, vanish on planes; the median of their size
    ignores edges and curves.
    """
    bends = np.concatenate(
        [
            (image[4:] - 2.0 * image[2:-2] + image[:-4]).ravel()
            for image in (grid[:, ::2], grid.T[:, ::2])
        ]
    )
    bends = np.abs(bends[np.isfinite(bends)])
    finite = grid[np.isfinite(grid)]
    # Rounding of the depth values, which hides in a median when it is exactly regular.
    floor = 2e-4 * float(np.median(finite)) if finite.size else 1.0
    if not bends.size:
        return floor
    # 0.6745 is the median of a half-normal sample; sqrt(6) the gain of (1, -2, 1).
    return max(float(np.median(bends)) / (0.6745 * math.sqrt(6.0)), floor)


def _refitted(
    grid: Float32Array, planes: Float32Array, tolerance: Float32Array, radius: int
) -> Float32Array:
    """Fit each cell's plane again, to the cells of a window that agree with it.

    Parameters
    ----------
    grid
        Inverse depth of each cell [1/m], shape (h, w).
    planes
        Value at the cell and rise per cell to the right and downwards, (3, h, w).
    tolerance
        How far a cell may be from the plane to agree with it [1/m], shape (h, w).
    radius
        Half width of the round window [cells].

    Returns
    -------
    Float32Array
        Planes, shape (3, h, w); NaN where too few cells agree.
    """
    around = np.pad(
        np.where(np.isnan(grid), _MISSING, grid), radius, constant_values=_MISSING
    )
    fitted = np.empty_like(planes)
    for start in range(0, len(grid), _CHUNK_ROWS):
        rows = slice(start, start + _CHUNK_ROWS)
        fitted[:, rows] = _refitted_rows(
            around[start : start + _CHUNK_ROWS + 2 * radius],
            planes[:, rows],
            tolerance[rows],
            radius,
        )
    return fitted


def _refitted_rows(
    around: Float32Array,
    planes: Float32Array,
    tolerance: Float32Array,
    radius: int,
) -> Float32Array:
    """Fit a few rows; ``around`` has ``radius`` more cells on every side."""
    value, rise_right, rise_down = planes
    height, width = value.shape
    stride = 1 if radius <= _DENSE_RADIUS else 2
    offsets = _round_window(radius, stride)
    rise = np.float32(stride) * rise_right
    agrees = np.empty((len(offsets), height, width), dtype=np.float32)
    residuals = np.empty_like(agrees)
    miss = np.empty_like(value)
    is_near = np.empty(value.shape, dtype=np.bool_)
    previous = None
    for agree, residual, (down, right) in zip(agrees, residuals, offsets, strict=True):
        if down != previous:
            expected = value + np.float32(down) * rise_down
            expected += np.float32(right) * rise_right
            previous = down
        else:
            expected += rise
        top, left = radius + down, radius + right
        cells = around[top : top + height, left : left + width]
        np.subtract(cells, expected, out=residual)
        np.less_equal(np.abs(residual, out=miss), tolerance, out=is_near)
        agree[:] = is_near
        residual *= agree
    return planes + _least_squares(np.array(offsets), agrees, residuals)


def _round_window(radius: int, stride: int) -> list[tuple[int, int]]:
    """Offsets (down, right) of a disc, row by row; of 3x3 cells for radius 1."""
    reach = range(-radius, radius + 1)
    limit = max(radius * (radius + 1), 2)
    disc = [(i, j) for i in reach for j in reach if i * i + j * j <= limit]
    return [cell for cell in disc if sum(cell) % stride == 0]


def _least_squares(
    offsets: IntArray, weights: Float32Array, residuals: Float32Array
) -> Float32Array:
    """Planes (value, rise right, rise down) through weighted residuals.

    Parameters
    ----------
    offsets
        Cells (down, right) of the window, shape (o, 2).
    weights, residuals
        For each of them one image, shape (o, h, w); residuals are weighted already.

    Returns
    -------
    Float32Array
        Shape (3, h, w); NaN where the weights leave the plane undetermined.
    """
    y, x = offsets.T.astype(np.float32)
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    n, *moments = _weighed(basis, weights)
    n_safe = np.maximum(n, np.float32(1.0))
    mx, my, mxx, mxy, myy = (moment / n_safe for moment in moments)
    mr, mxr, myr = _weighed(basis[:3], residuals) / n_safe
    cxx, cxy, cyy = mxx - mx * mx, mxy - mx * my, myy - my * my
    cxr, cyr = mxr - mx * mr, myr - my * mr
    determinant = cxx * cyy - cxy * cxy
    is_determined = (n >= _MIN_SUPPORT) & (determinant > _MIN_SPREAD)
    determinant = np.where(is_determined, determinant, np.float32(np.nan))
    a = (cxr * cyy - cyr * cxy) / determinant
    b = (cyr * cxx - cxr * cxy) / determinant
    planes: Float32Array = np.stack([mr - a * mx - b * my, a, b])
    return planes


def _weighed(basis: Float32Array, images: Float32Array) -> Float32Array:
    """Sum images (o, h, w) with weights (b, o), shape (b, h, w)."""
    flat = images.reshape(len(images), -1)
    sums = np.empty((len(basis), flat.shape[1]), dtype=np.float32)
    # In parts: one large product would start threads, which cost more than they save.
    step = max(1, _ONE_THREAD // basis.size)
    for first in range(0, flat.shape[1], step):
        some = slice(first, first + step)
        np.matmul(basis, flat[:, some], out=sums[:, some])
    return sums.reshape(len(basis), *images.shape[1:])


def _plane_normals(
    planes: Float32Array, cell: int, intrinsics: Intrinsics
) -> FloatArray:
    """Turn planes into unit normals in the camera frame, shape (h, w, 3)."""
    value, rise_right, rise_down = planes.astype(np.float64)
    height, width = value.shape
    middle = (cell - 1) / 2
    x = (np.arange(width) * cell + middle - intrinsics.cx) / intrinsics.fx
    y = (np.arange(height) * cell + middle - intrinsics.cy) / intrinsics.fy
    slope_x = rise_right * (intrinsics.fx / cell)
    slope_y = rise_down * (intrinsics.fy / cell)
    # The plane n . X = c is n . (x, y, 1) / c in inverse depth.
    normals = np.empty((height, width, 3))
    normals[..., 0] = -slope_x
    normals[..., 1] = -slope_y
    normals[..., 2] = slope_x * x + slope_y * y[:, None] - value
    normals /= np.sqrt(np.einsum("hwi,hwi->hw", normals, normals))[..., None]
    return normals


def _best_fits(
    pixels: Float32Array, planes: Float32Array, cell: int, tolerance: Float32Array
) -> IntArray:
    """Give each pixel its cell, or a neighbour of it that fits better, (rows, columns).

    A pixel that no plane near it explains (the far side of a jump, or a stray pixel
    between two surfaces) gets the number of cells.
    """
    fits = np.empty(pixels.shape, dtype=np.bool_)
    for i in range(cell):
        for j in range(cell):
            miss = np.abs(pixels[i::cell, j::cell] - planes[0])
            np.less_equal(miss, tolerance, out=fits[i::cell, j::cell])
    height, width = planes.shape[1:]
    own = np.arange(height * width, dtype=np.int32).reshape(height, width)
    best_fit = np.repeat(np.repeat(own, cell, 0), cell, 1)
    best_fit[~fits] = own.size
    v, u = np.nonzero(~fits & np.isfinite(pixels))
    measured = pixels[v, u]
    least, chosen = tolerance[v // cell, u // cell], np.full(len(v), own.size)
    flat_planes = planes.reshape(3, -1)
    for down in (-1, 0, 1):
        row = bounded(v // cell + down, 0, height - 1)
        step_down = (v - (cell - 1) / 2) / cell - row
        for right in (-1, 0, 1):
            column = bounded(u // cell + right, 0, width - 1)
            step_right = (u - (cell - 1) / 2) / cell - column
            around = row * width + column
            value, rise_right, rise_down = flat_planes.take(around, axis=1)
            expected = value + rise_right * step_right + rise_down * step_down
            miss = np.abs(measured - expected)
            is_better = miss <= least
            least = np.where(is_better, miss, least)
            chosen = np.where(is_better, around, chosen)
    best_fit[v, u] = chosen
    return best_fit
