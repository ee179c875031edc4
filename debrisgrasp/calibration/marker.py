"""Finds a lit or coloured marker in an RGB-D image, or says why it is not there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from debrisgrasp._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    as_floats,
    finite,
    require_metres,
    require_range,
)
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import InputError, ShapeError
from debrisgrasp.geometry import Intrinsics

from .picture import checked_picture

__all__ = ["MarkerConfig", "MarkerFound", "MarkerMissing", "find_marker"]

_FEWEST_PIXELS = 4
_FEWEST_DEPTHS = 8
_MOST_SPOTS = 8
_SPREAD = 1.4826
"""Standard deviation of a normal sample over its median absolute deviation."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerConfig:
    """What the marker looks like. The defaults are for a blue power LED."""

    color: tuple[float, float, float] = (0.1, 0.3, 1.0)
    """Red, green and blue of its light, any scale."""
    diameter: float = 0.02
    """Of the bright spot, glow included [m]."""
    search_radius: float = 0.08
    """How far from where it is expected it may be [m]: the error of the old
    calibration and of the kinematics."""
    min_contrast: float = 30.0
    """Least brightness above its surroundings, of 255."""
    min_peak: float = 200.0
    """Least brightness of its brightest pixel, of 255; a painted marker, which does
    not shine, needs a lower one."""
    noise_factor: float = 7.0
    """Least brightness in standard deviations of the surroundings."""
    max_elongation: float = 2.2
    """Length over width; a longer spot is an edge or a reflection."""
    max_depth_gap: float = 0.12
    """How far its depth may be from where it is expected [m]."""

    def __post_init__(self) -> None:
        require_range("diameter", self.diameter, 1e-3, 0.3)
        require_range("search_radius", self.search_radius, 0.5 * self.diameter, 1.0)
        require_range("min_contrast", self.min_contrast, 1.0, 255.0)
        require_range("min_peak", self.min_peak, 1.0, 255.0)
        require_range("noise_factor", self.noise_factor, 0.0, 1e3)
        require_range("max_elongation", self.max_elongation, 1.0, 1e3)
        require_range("max_depth_gap", self.max_depth_gap, 0.0, 10.0)
        if min(self.color) < 0 or max(self.color) <= min(self.color):
            raise InputError(
                "color of the marker",
                got=self.color,
                expected="three numbers of 0 or more that differ",
            )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MarkerFound:
    """A marker, and where it is."""

    pixel: FloatArray
    """Centre (u, v) in pixels, shape (2,)."""
    point_camera: FloatArray
    """Position, optical frame [m], shape (3,)."""
    contrast: float
    """Brightness above the surroundings, of 255."""
    n_depths: int
    """Depth measurements around it that its depth is the median of."""
    depth_sigma: float
    """Standard deviation of that median [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerMissing:
    """No marker, and why."""

    reason: str


def find_marker(
    rgb: NDArray[np.uint8],
    depth: ArrayLike,
    intrinsics: Intrinsics,
    expected_camera: ArrayLike,
    *,
    rgb_off: NDArray[np.uint8] | None = None,
    config: MarkerConfig | None = None,
) -> MarkerFound | MarkerMissing:
    """Find a marker near where kinematics expects it.

    With a second picture taken while the LED is off, what got brighter in its colour is
    looked at; without one, what has its colour. The depth at an LED is missing or
    wrong, so it is the median over a ring around the spot, of the foremost surface
    there near the expected depth, its slope taken off.

    Parameters
    ----------
    rgb
        Picture with the LED on, uint8, shape (height, width, 3).
    depth
        Depth registered to it [m], shape (height, width); 0 or NaN for nothing.
    intrinsics
        Camera of both.
    expected_camera
        Where the marker should be, optical frame [m], shape (3,).
    rgb_off
        Picture of the same scene with the LED off.
    config
        What the marker looks like.

    Raises
    ------
    ShapeError, InputError
        If the images don't fit the camera or are of another type, or the expected
        place is behind it or can only be millimetres.
    """
    config = config or MarkerConfig()
    expected = finite(expected_camera, "expected place of the marker", (3,))
    require_metres("expected place of the marker", expected)
    if expected[2] <= 0.05:
        raise InputError(
            "expected place of the marker",
            got=expected.tolist(),
            expected="a point in front of the camera, z > 0.05 m",
        )
    depths = as_floats(depth, "depth", ())
    shape = (intrinsics.height, intrinsics.width)
    if depths.shape != shape:
        raise ShapeError("shape of depth", got=depths.shape, expected=str(shape))
    rgb = checked_picture(rgb, "rgb", (*shape, 3))
    if rgb_off is not None:
        rgb_off = checked_picture(rgb_off, "rgb_off", (*shape, 3))
    window = _window(expected, intrinsics, config)
    if window is None:
        return MarkerMissing(reason="it is expected outside the picture")
    rows, columns, radius = window
    on = rgb[rows, columns]
    color = np.array(config.color)
    if rgb_off is None:
        light, above = _by_color(on, color, radius)
        floor = 0.7
        # What touches the spot may have its colour, but does not shine.
        above = np.where(light > floor * config.min_peak, above, 0.0)
    else:
        floor = 0.0
        light = above = _by_difference(on, rgb_off[rows, columns], color)
    spot = _spot(light, above, on, radius, floor, config)
    if isinstance(spot, str):
        return MarkerMissing(reason=spot)
    center, size, contrast = spot
    pixel = center + np.array([columns.start, rows.start])
    offsets, ring = _ring(depths, pixel, size)
    chosen = _surface(ring, float(expected[2]), config.max_depth_gap)
    if isinstance(chosen, str):
        return MarkerMissing(reason=chosen)
    z, depth_sigma = _depth_at_center(offsets[chosen], ring[chosen])
    k = intrinsics
    point = np.array([(pixel[0] - k.cx) / k.fx, (pixel[1] - k.cy) / k.fy, 1.0]) * z
    return MarkerFound(
        pixel=pixel,
        point_camera=point,
        contrast=contrast,
        n_depths=len(chosen),
        depth_sigma=depth_sigma,
    )


def _window(
    expected: FloatArray, intrinsics: Intrinsics, config: MarkerConfig
) -> tuple[slice, slice, float] | None:
    """Part of the picture to search, and the radius of the spot there [pixels]."""
    uv, z = intrinsics.project(expected)
    reach = config.search_radius * intrinsics.fx / float(z)
    low = np.maximum(np.floor(uv - reach).astype(int), 0)
    size = (intrinsics.width, intrinsics.height)
    high = np.minimum(np.ceil(uv + reach).astype(int) + 1, size)
    if (high - low < 8).any():
        return None
    radius = 0.5 * config.diameter * intrinsics.fx / float(z)
    return slice(low[1], high[1]), slice(low[0], high[0]), max(radius, 1.0)


def _by_difference(
    on: NDArray[np.uint8], off: NDArray[np.uint8], color: FloatArray
) -> FloatArray:
    """How much of the marker's light each pixel gained, of 255."""
    gained = (on.astype(np.float64) - off) @ (color / color.sum())
    return np.asarray(gained - np.median(gained))


def _by_color(
    picture: NDArray[np.uint8], color: FloatArray, radius: float
) -> tuple[FloatArray, FloatArray]:
    """Light of the marker's colour, and how far it stands out as a small spot."""
    light = picture @ (color / color.sum())
    # Colour without brightness: grey surfaces give nothing, however light.
    hue = color - color.mean()
    signal = picture @ (hue / hue[hue > 0].sum())
    # A bright LED saturates to white in its middle, a hole in hue that is closed here.
    width = 2 * round(radius) + 1
    closed = ndimage.grey_closing(signal, size=(width, width))
    # What is wider than the marker, such as a painted surface, is taken off.
    wide = 2 * width + 5
    ground = ndimage.grey_opening(closed, size=(wide, wide))
    return np.asarray(light), np.asarray(closed - ground)


def _spot(
    light: FloatArray,
    above: FloatArray,
    picture: NDArray[np.uint8],
    radius: float,
    floor: float,
    config: MarkerConfig,
) -> tuple[FloatArray, float, float] | str:
    """Centre (u, v), radius and contrast of the one bright spot, or what is wrong."""
    # From neighbour to neighbour: the scene's own structure is no noise.
    steps = np.abs(np.diff(above, axis=1))
    noise = _SPREAD * float(np.median(steps)) / np.sqrt(2.0)
    limit = max(config.min_contrast, config.noise_factor * noise)
    labels, n = ndimage.label(above > limit, structure=np.ones((3, 3)))
    if not n:
        return (
            f"nothing shines there: at most {above.max():.0f} above the surroundings, "
            f"{limit:.0f} needed"
        )
    mask = _chosen(labels, np.maximum(above, 0.0), picture, radius, config)
    if isinstance(mask, str):
        return mask
    # The tails below the limit count too; without them the centre leans to one side.
    near = ndimage.binary_dilation(mask, iterations=3)
    around = ndimage.binary_dilation(near, iterations=2) & ~near
    ground = float(np.median(light[around])) if around.any() else 0.0
    ground += max(2.0 * noise, floor * (float(light[mask].max()) - ground))
    weights = np.where(near, np.maximum(light - ground, 0.0), 0.0)
    v, u = np.indices(light.shape)
    center = np.array([(weights * u).sum(), (weights * v).sum()])
    center /= max(float(weights.sum()), 1e-9)
    middle = np.array(ndimage.center_of_mass(mask))[::-1]
    size = float(np.sqrt(mask.sum() / np.pi))
    if np.linalg.norm(center - middle) > max(0.6, 0.25 * size):
        return "the spot is lopsided: partly hidden, or not a marker"
    return center, size, float(above[mask].max())


def _chosen(
    labels: IntArray,
    above: FloatArray,
    picture: NDArray[np.uint8],
    radius: float,
    config: MarkerConfig,
) -> BoolArray | str:
    """Pixels of the one spot that may be the marker, or why there is none."""
    numbers = np.arange(1, int(labels.max()) + 1)
    flux = np.asarray(ndimage.sum_labels(above, labels, numbers))
    order = np.argsort(-flux)[:_MOST_SPOTS]
    masks = [np.asarray(labels == numbers[i]) for i in order]
    faults = [_fault(mask, picture, radius, config) for mask in masks]
    sound = [k for k, fault in enumerate(faults) if not fault]
    if not sound:
        return faults[0]
    best = flux[order[sound[0]]]
    if len(sound) > 1 and flux[order[sound[1]]] > 0.3 * best:
        return "two spots look alike: a reflection, or something of the same colour"
    return masks[sound[0]]


def _fault(
    mask: BoolArray, picture: NDArray[np.uint8], radius: float, config: MarkerConfig
) -> str:
    """Say why a spot is not the marker; empty if it may be."""
    v, u = np.nonzero(mask)
    if len(v) < _FEWEST_PIXELS:
        return f"the only spot has {len(v)} pixels, {_FEWEST_PIXELS} needed"
    largest = np.pi * (2.0 * radius + 1.5) ** 2
    if len(v) > largest:
        return f"the spot has {len(v)} pixels, a marker at most {largest:.0f}"
    height, width = mask.shape
    if min(v.min(), u.min()) == 0 or v.max() == height - 1 or u.max() == width - 1:
        return "the spot reaches the border of where it was searched"
    spread = np.linalg.eigvalsh(np.cov(np.stack([u, v])) + np.eye(2) / 12.0)
    elongation = float(np.sqrt(spread[1] / spread[0]))
    if elongation > config.max_elongation:
        return f"the spot is {elongation:.1f} times as long as wide"
    peak = int(picture[mask].max())
    if peak < config.min_peak:
        return f"its brightest pixel has {peak}, a light {config.min_peak:.0f}"
    return ""


def _ring(
    depth: FloatArray, pixel: FloatArray, size: float
) -> tuple[FloatArray, FloatArray]:
    """Depths measured around a spot, ascending, and where: (n, 2) pixels from it."""
    inner, outer = size + 1.5, size + 1.5 + max(4.0, 1.2 * size)
    low = np.maximum(np.floor(pixel - outer).astype(int), 0)
    high = np.ceil(pixel + outer).astype(int) + 1
    part = depth[low[1] : high[1], low[0] : high[0]]
    v, u = np.indices(part.shape)
    offsets = np.stack([u + low[0] - pixel[0], v + low[1] - pixel[1]], axis=-1)
    away = np.hypot(offsets[..., 0], offsets[..., 1])
    is_there = (away >= inner) & (away <= outer) & np.isfinite(part) & (part > 0.0)
    values, offsets = part[is_there], offsets[is_there]
    order = np.argsort(values, kind="stable")
    return offsets[order], values[order]


def _surface(ring: FloatArray, expected: float, max_gap: float) -> IntArray | str:
    """Which depths belong to the marker's seat, or what is wrong with them."""
    n = len(ring)
    if n < _FEWEST_DEPTHS:
        return f"{n} depths around it, {_FEWEST_DEPTHS} needed"
    # A jump of depth divides the ring into surfaces, such as hand and background.
    starts = np.flatnonzero(np.diff(ring) > 0.012 * expected) + 1
    surfaces = [
        rows
        for rows in np.split(np.arange(n), starts)
        if len(rows) >= max(_FEWEST_DEPTHS, 0.25 * n)
    ]
    if not surfaces:
        return "the depths around it don't form a surface"
    gaps = [float(np.median(ring[rows])) - expected for rows in surfaces]
    near = [r for r, gap in zip(surfaces, gaps, strict=True) if abs(gap) <= max_gap]
    if not near:
        gap = min(gaps, key=abs)
        return (
            f"what shines is {abs(gap):.2f} m {'behind' if gap > 0 else 'before'} "
            "where the marker should be"
        )
    # The marker's seat is all around it, and before whatever is seen beyond its edge.
    around = [rows for rows in near if len(rows) >= 0.35 * n]
    return around[0] if around else max(near, key=len)


def _depth_at_center(offsets: FloatArray, depths: FloatArray) -> tuple[float, float]:
    """Depth of a surface where it is not measured, and its standard deviation [m].

    The median, with the slope taken off first: an edge may leave a part of the ring
    only, on one side of the centre.
    """
    middle = float(np.median(depths))
    inverse = 1.0 / depths
    # One over depth is linear in the picture of a plane.
    columns = np.column_stack([np.ones(len(depths)), offsets])
    for _ in range(2):
        plane, *_ = np.linalg.lstsq(columns, inverse, rcond=None)
        gaps = np.abs(inverse - columns @ plane)
        is_fine = gaps <= 3.0 * _SPREAD * max(float(np.median(gaps)), 1e-9)
        columns, inverse, offsets = columns[is_fine], inverse[is_fine], offsets[is_fine]
    level = inverse - offsets @ plane[1:]
    z = 1.0 / float(np.median(level))
    spread = _SPREAD * float(np.median(np.abs(level - 1.0 / z))) * z * z
    sigma = 1.2533 * spread / np.sqrt(len(level))
    # Edges that fly off can tilt a plane as no seat is tilted.
    return (z, sigma) if abs(z - middle) < 0.03 * middle else (middle, sigma)
