"""The camera's picture with the segments laid over it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray
from debrisgrasp.geometry import PointCloud
from debrisgrasp.segmentation import PointKind, SegmentEdges

from .colors import (
    BACKGROUND_COLOR,
    CHOSEN_COLOR,
    INK,
    KIND_COLORS,
    label_colors,
    mixed,
)
from .raster import Splats, render
from .report import Image
from .scene import point_spacing, thinned
from .view import View
from .words import DOUBTFUL

__all__ = [
    "DOUBT_COLOR",
    "DOUBT_KEY",
    "LabelImage",
    "label_anchors",
    "label_image",
    "painted",
]

DOUBT_COLOR = (1.0, 0.85, 0.1)
"""Borders at which two segments may be one object."""
DOUBT_KEY = (
    ("?: may be several objects", INK),
    ("yellow dashes: may be one object", tuple(mixed(DOUBT_COLOR, (0, 0, 0), 0.35))),
)
"""What the marks of doubt mean, and the colours of these words."""

_NOT_MEASURED = np.array([0.13, 0.15, 0.18])
_STRIPE = 12
"""Distance of the stripes over surroundings [pixels]."""
_BRIDGE = 3
"""Pixels without measurement that a border may span on either side."""
_DASH = 9
"""Length of a dash of a doubtful border [pixels]."""
_SMALLEST = 60
"""Pixels of an object below which it gets no label."""
_RENDERED_SIZE = (960, 720)
_RENDERED_POINTS = 250_000


@dataclass(frozen=True, slots=True, eq=False)
class LabelImage:
    """A picture, and which object each of its pixels shows."""

    base: FloatArray
    """Red, green, blue in [0, 1], shape (H, W, 3)."""
    labels: IntArray
    """Labels, shape (H, W); 0 is not an object."""
    from_camera: bool
    """False if it was rendered from a cloud without an image."""
    kinds: IntArray | None = None
    """`PointKind` of the pixels, shape (H, W), to mark what was taken away."""


def label_image(
    cloud: PointCloud,
    labels: IntArray,
    capture: Image | None,
    kinds: IntArray | None = None,
) -> LabelImage:
    """Picture of the scene as the sensor saw it.

    The colour image if there is one, else the depth image as shaded relief; a cloud
    without pixels is rendered from its viewpoint.

    Parameters
    ----------
    cloud, labels
        Points and their labels, shape (n,).
    capture
        Where they came from; None if there is no image of it.
    kinds
        `PointKind` of each point, shape (n,), to mark what was taken away.
    """
    if kinds is None:
        kinds = np.zeros(len(cloud), dtype=np.uint8)
    if cloud.pixels is None or cloud.image_shape is None:
        return _rendered(cloud, labels, kinds)
    height, width = cloud.image_shape
    flat = np.zeros(height * width, dtype=np.int64)
    flat[cloud.pixels] = labels
    flat_kinds = np.zeros(height * width, dtype=np.uint8)
    flat_kinds[cloud.pixels] = kinds
    rgb = None if capture is None else capture.rgb
    if rgb is not None and rgb.shape[:2] == (height, width):
        base = np.asarray(rgb, dtype=np.float64)[..., :3] / 255.0
    else:
        base = _relief(cloud, (height, width))
    return LabelImage(
        base,
        flat.reshape(height, width),
        from_camera=True,
        kinds=flat_kinds.reshape(height, width),
    )


def _relief(cloud: PointCloud, shape: tuple[int, int]) -> FloatArray:
    """Depth as brightness, near is bright, modelled by the slope of the surface."""
    ray = cloud.points - cloud.viewpoint
    distance = np.linalg.norm(ray, axis=1)
    facing = -(cloud.normals * ray).sum(axis=1) / np.maximum(distance, 1e-9)
    sky = 0.5 + 0.5 * np.nan_to_num(cloud.normals[:, 2], nan=0.0)
    near, far = np.percentile(distance, [2, 98]) if len(distance) else (0.0, 1.0)
    depth = np.clip((distance - near) / max(far - near, 1e-6), 0.0, 1.0)
    tone = (0.35 + 0.4 * np.nan_to_num(facing, nan=0.6) + 0.25 * sky) * (
        1 - 0.45 * depth
    )
    out = np.broadcast_to(_NOT_MEASURED, (shape[0] * shape[1], 3)).copy()
    out[cloud.pixels] = np.clip(tone, 0.0, 1.0)[:, None]
    return out.reshape(*shape, 3)


def _rendered(cloud: PointCloud, labels: IntArray, kinds: IntArray) -> LabelImage:
    """View from the sensor's place towards the objects."""
    index = thinned(cloud, _RENDERED_POINTS, np.flatnonzero(labels > 0))
    points, seen = cloud.points[index], labels[index]
    focus = points[seen > 0] if np.any(seen > 0) else points
    focus = np.clip(focus, *np.percentile(focus, [1, 99], axis=0))
    direction = focus.mean(axis=0) - cloud.viewpoint
    if np.linalg.norm(direction) < 1e-6:
        direction = np.array([1.0, 0.0, -0.5])
    view = View.fitted(focus, direction, _RENDERED_SIZE, margin=1.15)
    grey = np.full((len(points), 3), 0.82)
    splats = Splats(points, grey, point_spacing(points), cloud.normals[index])
    picture = render(view, [splats], background=np.array(BACKGROUND_COLOR))
    shown = np.where(picture.sources >= 0, seen[picture.sources], 0)
    marked = np.where(picture.sources >= 0, kinds[index][picture.sources], 0)
    return LabelImage(picture.colors, shown, from_camera=False, kinds=marked)


def painted(
    image: LabelImage,
    chosen: int = 0,
    edges: SegmentEdges | None = None,
    *,
    strength: float = 0.5,
) -> FloatArray:
    """Lay the segments over the picture in translucent colours with borders.

    Parameters
    ----------
    image
        The picture and the labels of its pixels.
    chosen
        Label of the object to outline; 0 for none.
    edges
        Where segments touch, to mark borders in doubt; None marks none.
    strength
        Share of the colour of a segment against the picture under it.

    Returns
    -------
    FloatArray
        Red, green, blue in [0, 1], shape (H, W, 3).
    """
    out = _hatched(image)
    is_object = image.labels > 0
    colors = label_colors(image.labels[is_object], chosen)
    # The picture keeps its light and dark, so that the shapes stay readable.
    light = image.base[is_object].mean(axis=-1, keepdims=True)
    out[is_object] = mixed(
        image.base[is_object], colors * (0.55 + 0.6 * light), strength
    )
    border = _border(image.labels) & is_object
    out[border] = mixed(label_colors(image.labels[border], chosen), 1.0, 0.35)
    if chosen > 0:
        body = ndimage.binary_closing(image.labels == chosen, iterations=1)
        rim = ndimage.binary_dilation(body, iterations=3) & ~body
        halo = ndimage.binary_dilation(body, iterations=5) & ~body & ~rim
        out[halo] = 1.0
        out[rim] = CHOSEN_COLOR
    if edges is not None:
        out[_doubtful_borders(image, edges)] = DOUBT_COLOR
    return np.clip(out, 0.0, 1.0)


def _hatched(image: LabelImage) -> FloatArray:
    """Picture with ground in a flat tint, and what else was taken away in stripes."""
    out = image.base.copy()
    if image.kinds is None:
        return out
    for kind, color in KIND_COLORS.items():
        chosen = image.kinds == kind
        if kind is not PointKind.GROUND:
            row, column = np.indices(chosen.shape, sparse=True)
            stripe = (row + column) % _STRIPE < _STRIPE // 2
            out[chosen] = mixed(out[chosen], color, 0.25)
            chosen = chosen & stripe
        out[chosen] = mixed(out[chosen], color, 0.35)
    return out


def _border(labels: IntArray) -> BoolArray:
    """Pixels with a neighbour of another label below or to the right."""
    edge = np.zeros(labels.shape, dtype=np.bool_)
    edge[:-1] |= labels[:-1] != labels[1:]
    edge[:, :-1] |= labels[:, :-1] != labels[:, 1:]
    return edge


def _doubtful_borders(image: LabelImage, edges: SegmentEdges) -> BoolArray:
    """Pixels of dashed lines along the borders of what may be one object."""
    n = int(image.labels.max(initial=0)) + 1
    doubtful = np.zeros((n, n), dtype=np.bool_)
    pairs = edges.labels[(edges.score >= DOUBTFUL) & (edges.labels < n).all(axis=1)]
    doubtful[pairs[:, 0], pairs[:, 1]] = doubtful[pairs[:, 1], pairs[:, 0]] = True
    marked = np.zeros(image.labels.shape, dtype=np.bool_)
    for axis in (0, 1):
        labels, line = np.moveaxis(image.labels, axis, 0), np.moveaxis(marked, axis, 0)
        meets = doubtful[labels[: -2 * _BRIDGE], labels[2 * _BRIDGE :]]
        line[_BRIDGE:-_BRIDGE] |= meets
    # Thinned to the middle of the band, so that all borders are equally wide.
    depth = ndimage.distance_transform_edt(marked)
    core = marked & (depth >= ndimage.maximum_filter(depth, 3) - 0.5)
    wide = ndimage.binary_dilation(core, iterations=1)
    height, width = image.labels.shape
    row, column = np.arange(height)[:, None] // _DASH, np.arange(width) // _DASH
    dash: BoolArray = wide & ((row + column) % 2 == 0)
    return dash


def label_anchors(labels: IntArray) -> dict[int, tuple[float, float]]:
    """Where to write the label of each object: pixel (u, v) farthest from its border.

    In the label image (H, W); small ones get none, for it would hide them.
    """
    anchors = {}
    for label, box in enumerate(ndimage.find_objects(labels.astype(np.int32)), start=1):
        if box is None:
            continue
        mask = labels[box] == label
        if np.count_nonzero(mask) < _SMALLEST:
            continue
        depth = ndimage.distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1]
        row, column = np.unravel_index(np.argmax(depth), mask.shape)
        anchors[label] = (float(box[1].start + column), float(box[0].start + row))
    return anchors
