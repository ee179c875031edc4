"""From a cloud to its objects: take ground and surroundings away, divide the rest."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    as_floats,
    frozen,
    require_finite,
)
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp.errors import ConfigError, InputError, ShapeError
from debrisgrasp.geometry import Bounds, PointCloud, by_place

from .assembly import assembled
from .ground import GroundConfig
from .lccp import LccpConfig, lccp
from .marked import checked_mark, with_mark
from .segmentation import PatchGraph, Segmentation
from .singulation import SingulationConfig, singulate
from .surroundings import SurroundingsConfig
from .survey import surveyed

__all__ = ["SegmentationConfig", "segment_cloud"]


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentationConfig:
    """How a cloud is divided into objects."""

    ground: GroundConfig = field(default_factory=GroundConfig)
    surroundings: SurroundingsConfig = field(default_factory=SurroundingsConfig)
    method: SingulationConfig | LccpConfig = field(default_factory=SingulationConfig)
    """The settings of the method that divides what stands on the ground; their type
    chooses it."""
    fallback: LccpConfig = field(
        default_factory=lambda: LccpConfig(extended_convexity=1)
    )
    """What divides clouds that singulation can't: unorganised ones, and images of no
    pinhole camera."""
    min_points: int = 60
    """Objects with fewer points are specks of noise and get label 0."""

    def __post_init__(self) -> None:
        if self.min_points < 0:
            raise ConfigError("min_points", got=self.min_points, expected="0 or more")


@checked
def segment_cloud(
    cloud: PointCloud,
    config: SegmentationConfig | None = None,
    *,
    region: Bounds | None = None,
    is_cropped: bool = False,
    colors: FloatArray | None = None,
    of_interest: BoolArray | None = None,
) -> Segmentation:
    """Divide a cloud into objects.

    Parameters
    ----------
    cloud
        In the base frame: z up, ground at z = 0. At least one point, all finite. Of an
        unorganised cloud, points in one place count once: merged scans repeat many.
    config
        None takes the defaults, which suit debris at 1 to 4 m.
    region
        Region in which removal of the ground is judged, base frame; None takes the
        ground plan of what stands on it. See `GroundConfig.max_removed_share`.
    is_cropped
        Whether the cloud was cut to a region before; the ground then stays.
    colors
        One colour in [0, 1] per point, shape (n, 3), if the method weighs them.
    of_interest
        Points that a detector or a person marked as one object, shape (n,); singulation
        keeps them together.

    Raises
    ------
    ShapeError
        If ``colors`` or ``of_interest`` are not one for each point.
    InputError
        If the cloud is empty, has points that are not finite, or is in another frame,
        or a colour is outside [0, 1].

    Examples
    --------
    >>> import numpy as np
    >>> from debrisgrasp.geometry import PointCloud
    >>> x, y = np.meshgrid(np.linspace(0, 0.2, 41), np.linspace(0, 0.1, 21))
    >>> top = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 0.3)])
    >>> up = np.broadcast_to([0.0, 0.0, 1.0], top.shape)
    >>> board = PointCloud(points=top, normals=up, viewpoint=np.array([0, 0, 1.5]))
    >>> result = segment_cloud(board)
    >>> len(result.segments), result.ground.status
    (1, 'skipped')
    """
    config = config or SegmentationConfig()
    cloud.require_frame("base")
    if not len(cloud):
        raise InputError("cloud", got="no points", expected="at least one")
    require_finite(cloud.points, "points")
    if colors is not None:
        colors = _checked_colors(colors, len(cloud))
    if of_interest is not None:
        of_interest = checked_mark(of_interest, len(cloud))
    canonical = _canonical_order(cloud)
    if canonical is None:
        return _segmented(
            cloud,
            config,
            region=region,
            is_cropped=is_cropped,
            colors=colors,
            of_interest=of_interest,
        )
    order, first = canonical
    if of_interest is not None:
        of_interest = np.bincount(first[of_interest], minlength=len(first)) > 0
    result = _segmented(
        cloud.selected(order),
        config,
        region=region,
        is_cropped=is_cropped,
        colors=None if colors is None else colors[order],
        of_interest=None if of_interest is None else of_interest[order],
    )

    def restored(values: IntArray | None, name: str) -> IntArray:
        if values is None:
            raise AssertionError("all points were judged")
        own = np.empty(len(cloud), dtype=values.dtype)
        own[order] = values
        return frozen(own[first], name, (None,), values.dtype)

    return replace(
        result,
        ground=replace(result.ground, kinds=restored(result.ground.kinds, "kinds")),
        labels=restored(result.labels, "labels"),
        patches=restored(result.patches, "patches"),
    )


def _checked_colors(colors: ArrayLike, n: int) -> FloatArray:
    """Colours as an array (n, 3) of numbers in [0, 1]."""
    array = as_floats(colors, "colors", (3,))
    if array.shape != (n, 3):
        raise ShapeError("colors", got=array.shape, expected=f"one per point, {(n, 3)}")
    if not ((array >= 0.0) & (array <= 1.0)).all():
        raise InputError(
            "colors",
            got=f"{array.min():g} to {array.max():g}",
            expected="0 to 1",
            mend="Divide colours of 8 bits by 255.",
        )
    return array


def _canonical_order(cloud: PointCloud) -> tuple[IntArray, IntArray] | None:
    """Order of the points that depends on themselves only; None if they are in it.

    Sums are rounded differently in another order, which is enough to turn a tie.

    Returns
    -------
    order, first
        Indices of the points, of those in one place only the first, shape (m,); and the
        point among them that answers for each, shape (n,).
    """
    if cloud.pixels is not None:
        if (np.diff(cloud.pixels) > 0).all():
            return None
        return np.argsort(cloud.pixels, kind="stable"), np.arange(len(cloud))
    order, first = by_place(cloud.points)
    return order[first[order] == order], first


def _segmented(
    cloud: PointCloud,
    config: SegmentationConfig,
    *,
    region: Bounds | None,
    is_cropped: bool,
    colors: FloatArray | None,
    of_interest: BoolArray | None,
) -> Segmentation:
    standing, report = surveyed(
        cloud, config.ground, config.surroundings, region=region, is_cropped=is_cropped
    )
    graph, method = _divided(cloud, standing, config, colors, of_interest)
    result = assembled(
        cloud.points,
        standing,
        graph,
        report,
        min_points=config.min_points,
        method=method,
    )
    return with_mark(result, of_interest)


def _divided(
    cloud: PointCloud,
    standing: BoolArray,
    config: SegmentationConfig,
    colors: FloatArray | None,
    of_interest: BoolArray | None,
) -> tuple[PatchGraph | None, Literal["singulation", "lccp"]]:
    """Apply a method to the standing points, and name it."""
    method = config.method
    if isinstance(method, SingulationConfig):
        if not standing.any():
            return None, "singulation"
        graph = singulate(
            cloud, standing, method, colors=colors, of_interest=of_interest
        )
        if graph is not None:
            return graph, "singulation"
        method = config.fallback
    if not standing.any():
        return None, "lccp"
    # Most organised clouds lose points here; the others need not be copied.
    chosen = cloud if standing.all() else cloud.selected(standing)
    return lccp(chosen, method, None if colors is None else colors[standing]), "lccp"
