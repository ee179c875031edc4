"""A small z-buffer: points and triangles to a shaded picture, in NumPy alone.

Plotting libraries sort whole triangles by depth, which draws a hand that encloses an
object wrongly. Here every pixel keeps what is nearest to the eye.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.geometry import SE3

from .view import View

__all__ = ["Mesh", "Picture", "Splats", "render"]

_FRAGMENTS_PER_CHUNK = 2_000_000
"""Bounds the memory of one step to some 100 MB."""
_LARGEST_SPLAT = 1.0 / 45.0
"""As a share of the picture's width; a lone point in front of the eye must not cover
the scene."""


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles of one colour, wound so that their normals point outwards."""

    vertices: FloatArray
    """Positions [m], shape (v, 3)."""
    faces: IntArray
    """Vertex indices, shape (f, 3)."""
    color: tuple[float, float, float] = (0.6, 0.6, 0.6)

    def moved(self, T_a_own: SE3) -> Mesh:
        """Express the same mesh in frame a."""
        return Mesh(T_a_own.apply(self.vertices), self.faces, self.color)


@dataclass(frozen=True, slots=True, eq=False)
class Splats:
    """Points drawn as small discs that face the eye."""

    points: FloatArray
    """Positions [m], shape (n, 3)."""
    colors: FloatArray
    """Red, green, blue in [0, 1], shape (n, 3)."""
    sizes: FloatArray
    """Diameter of each disc [m], shape (n,)."""
    normals: FloatArray | None = None
    """Unit normals for the shading, shape (n, 3), NaN allowed; None: drawn unshaded."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """What `render` drew."""

    colors: FloatArray
    """Red, green, blue in [0, 1], shape (height, width, 3)."""
    nearness: FloatArray
    """One over depth [1/m], shape (height, width); 0 where there is nothing."""
    sources: IntArray
    """Index of the splat seen in each pixel, shape (height, width); -1 where it is
    something else."""


class _Canvas:
    """The buffers of one rendering; lives inside `render` only."""

    def __init__(self, view: View) -> None:
        self.view = view
        self.shape = (view.intrinsics.height, view.intrinsics.width)
        n = self.shape[0] * self.shape[1]
        self.nearness = np.zeros(n, dtype=np.float32)
        self.sources = np.full(n, -1, dtype=np.int32)
        self.palette: list[FloatArray] = []
        self.n_sources = 0

    def register(self, colors: FloatArray) -> int:
        """Take the colours of new sources (n, 3); return the number of the first."""
        first = self.n_sources
        self.palette.append(colors)
        self.n_sources += len(colors)
        return first

    def merge(self, pixel: IntArray, nearness: FloatArray, source: IntArray) -> None:
        """Keep those fragments that are nearer than what each pixel holds."""
        nearness = nearness.astype(np.float32)
        is_nearer = np.flatnonzero(nearness > self.nearness[pixel])
        pixel, nearness = pixel[is_nearer], nearness[is_nearer]
        np.maximum.at(self.nearness, pixel, nearness)
        wins = np.flatnonzero(nearness == self.nearness[pixel])
        self.sources[pixel[wins]] = source[is_nearer[wins]]

    def colors(self, background: FloatArray) -> FloatArray:
        """Colours of what each pixel holds, shape (height, width, 3)."""
        # The last row of the palette is the background, which is source number -1.
        palette = np.concatenate([*self.palette, background[None]])
        return palette[self.sources].reshape(*self.shape, 3)

    def add_splats(self, splats: Splats) -> None:
        """Draw discs that face the eye."""
        uv, depth = self.view.project(splats.points)
        near = self.view.intrinsics.fx * splats.sizes / np.maximum(depth, 1e-6)
        largest = max(3, round(_LARGEST_SPLAT * self.shape[1]))
        extent = np.clip(np.rint(near), 1, largest).astype(int)
        colors = splats.colors
        if splats.normals is not None:
            colors = colors * _shade(splats.normals, self.view)[:, None]
        first = self.register(colors)
        limit = np.array([self.shape[1], self.shape[0]]) + largest
        is_seen = ((uv > -largest) & (uv < limit)).all(axis=1)
        for side in np.unique(extent[is_seen]):
            chosen = np.flatnonzero(is_seen & (extent == side))
            n_parts = 1 + len(chosen) * int(side) ** 2 // _FRAGMENTS_PER_CHUNK
            for index in np.array_split(chosen, n_parts):
                pixel, which = self._disc(uv[index], int(side))
                index = index[which]
                self.merge(pixel, 1.0 / depth[index], index + first)

    def _disc(self, uv: FloatArray, side: int) -> tuple[IntArray, IntArray]:
        """Pixels of discs of diameter ``side``, and to which disc each belongs."""
        reach = (side - 1) / 2.0
        offsets = np.stack(np.divmod(np.arange(side * side), side), axis=1)
        radius = np.hypot(*(offsets - reach).T)
        offsets = offsets[radius <= reach + 0.5]
        corner = np.rint(uv - reach).astype(int)
        row = corner[:, 1, None] + offsets[:, 0]
        column = corner[:, 0, None] + offsets[:, 1]
        is_inside = (column >= 0) & (column < self.shape[1])
        is_inside &= (row >= 0) & (row < self.shape[0])
        which, _ = np.nonzero(is_inside)
        return (row * self.shape[1] + column)[is_inside], which

    def add_mesh(self, mesh: Mesh) -> None:
        """Draw the triangles that face the eye; the others lie behind them."""
        corners = mesh.vertices[mesh.faces]
        edges = corners[:, 1:] - corners[:, :1]
        normals = np.cross(edges[:, 0], edges[:, 1])
        length = np.linalg.norm(normals, axis=1)
        towards = ((self.view.T_base_eye.p - corners[:, 0]) * normals).sum(axis=1)
        uv, depth = self.view.project(corners)
        is_drawn = (length > 0) & (towards > 0) & (depth.min(axis=1) > 1e-3)
        is_drawn[is_drawn] &= np.abs(_doubled_area(uv[is_drawn])) > 1e-9
        uv, nearness = uv[is_drawn], 1.0 / depth[is_drawn]
        shade = _shade(normals[is_drawn] / length[is_drawn, None], self.view)
        first = self.register(np.asarray(mesh.color) * shade[:, None])

        weights = _barycentric(uv)
        face, row, column, counts = self._spans(uv, weights)
        n_parts = 1 + int(counts.sum()) // _FRAGMENTS_PER_CHUNK
        for part in np.array_split(np.arange(len(face)), n_parts):
            span = np.repeat(part, counts[part])
            ends = np.cumsum(counts[part])
            step = np.arange(len(span)) - np.repeat(ends - counts[part], counts[part])
            x, y, owner = column[span] + step, row[span], face[span]
            # One over depth is linear in the picture; depth itself is not.
            plane = (weights * nearness[..., None]).sum(axis=1)[owner]
            value = plane[:, 0] * x + plane[:, 1] * y + plane[:, 2]
            self.merge(y * self.shape[1] + x, value, owner + first)

    def _spans(
        self, uv: FloatArray, weights: FloatArray
    ) -> tuple[IntArray, IntArray, IntArray, IntArray]:
        """Rows of pixels inside each triangle: face, row, first column, and count."""
        bottom = self.shape[0] - 1
        low = np.clip(np.ceil(uv[..., 1].min(axis=1)), 0, bottom + 1).astype(int)
        high = np.clip(np.floor(uv[..., 1].max(axis=1)), -1, bottom).astype(int)
        n_rows = np.maximum(high - low + 1, 0)
        face = np.repeat(np.arange(len(uv)), n_rows)
        ends = np.cumsum(n_rows)
        row = low[face] + np.arange(len(face)) - np.repeat(ends - n_rows, n_rows)
        slope = weights[face, :, 0]
        rest = weights[face, :, 1] * row[:, None] + weights[face, :, 2]
        bound = -rest / np.where(slope == 0.0, 1.0, slope)
        left = np.where(slope > 0.0, bound, -np.inf).max(axis=1)
        right = np.where(slope < 0.0, bound, np.inf).min(axis=1)
        left[((slope == 0.0) & (rest < 0.0)).any(axis=1)] = np.inf
        last = self.shape[1] - 1
        first = np.clip(np.ceil(left), 0, last + 1).astype(int)
        counts = np.clip(np.floor(right), -1, last).astype(int) - first + 1
        keep = counts > 0
        return face[keep], row[keep], first[keep], counts[keep]


def _barycentric(uv: FloatArray) -> FloatArray:
    """Coefficients (f, 3, 3) of (x, y, 1) in the weights of the three corners."""
    a, b, c = uv[:, 0], uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    area = _doubled_area(uv)[:, None]
    slope_b = np.stack([c[:, 1], -c[:, 0]], axis=1) / area
    slope_c = np.stack([-b[:, 1], b[:, 0]], axis=1) / area
    slopes = np.stack([-slope_b - slope_c, slope_b, slope_c], axis=1)
    offsets = np.array([[1.0], [0.0], [0.0]]) - slopes @ a[..., None]
    return np.concatenate([slopes, offsets], axis=2)


def _doubled_area(uv: FloatArray) -> FloatArray:
    """Twice the signed area of triangles (f, 3, 2), shape (f,)."""
    b, c = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    return np.asarray(b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])


def _shade(normals: FloatArray, view: View) -> FloatArray:
    """Brightness of surfaces: sky above, one lamp over the eye's left shoulder."""
    lamp = view.T_base_eye.rotate(np.array([-0.45, -0.65, -0.6]))
    lamp = lamp / np.linalg.norm(lamp)
    with_default = np.nan_to_num(normals, nan=0.0)
    sky = 0.5 + 0.5 * with_default[..., 2]
    shade = 0.50 + 0.18 * sky + 0.40 * np.maximum(with_default @ lamp, 0.0)
    return np.where(np.isfinite(normals).all(axis=-1), shade, 0.85)


def _edge_darkening(nearness: FloatArray, radius: int) -> FloatArray:
    """Darken what lies just behind a nearer edge, so that shapes stand off."""
    depth = np.log(1.0 / np.maximum(nearness, 1e-6))
    total = np.zeros_like(depth)
    padded = np.pad(depth, radius, mode="edge")
    height, width = depth.shape
    steps = [(0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1)]
    for dy, dx in steps:
        y, x = radius + dy * radius, radius + dx * radius
        neighbor = padded[y : y + height, x : x + width]
        total += np.clip(depth - neighbor - 0.004, 0.0, 0.05)
    return np.exp(-3.2 * total)


def render(
    view: View,
    splats: Sequence[Splats] = (),
    meshes: Sequence[Mesh] = (),
    *,
    background: FloatArray,
    oversampling: int = 2,
) -> Picture:
    """Draw points and triangles with correct occlusion.

    Parameters
    ----------
    view
        The eye; its intrinsics give the size of the picture.
    splats, meshes
        What to draw, base frame. Splats are numbered through in the order given.
    background
        Colour of empty pixels, shape (3,).
    oversampling
        Pixels are averages over this many squared; 1 is quick and jagged.
    """
    fine = view.scaled(oversampling)
    canvas = _Canvas(fine)
    for group in splats:
        canvas.add_splats(group)
    n_splats = canvas.n_sources
    for mesh in meshes:
        canvas.add_mesh(mesh)
    nearness = canvas.nearness.reshape(canvas.shape).astype(np.float64)
    # What is empty lies infinitely far, behind everything, but takes no shadow.
    shading = np.where(nearness > 0.0, _edge_darkening(nearness, oversampling), 1.0)
    colors = np.clip(canvas.colors(background) * shading[..., None], 0.0, 1.0)
    sources = canvas.sources.reshape(canvas.shape)[::oversampling, ::oversampling]
    height, width = view.intrinsics.height, view.intrinsics.width
    blocks = colors.reshape(height, oversampling, width, oversampling, 3)
    # The first subpixel stands for the pixel in the buffers that can't be averaged.
    return Picture(
        colors=blocks.mean(axis=(1, 3)),
        nearness=nearness[::oversampling, ::oversampling],
        sources=np.where(sources < n_splats, sources, -1),
    )
