"""Dividing an organised cloud of debris into objects."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from debrisgrasp._arrays import BoolArray, IntArray
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import PointCloud
from debrisgrasp.segmentation.segmentation import PatchGraph

from .assemblies import AssemblyConfig, crossed_strips, parallel_strips
from .camera import InverseDepthImage, inverse_depth_image
from .completion import CompletionConfig, continued_planes
from .enclosure import EnclosureConfig, enclosed, lined
from .frames import FrameConfig, framed_bars
from .joining import Borders, joined, patch_borders
from .pieces import shapes_of
from .planes import PlanarPatches, planar_patches
from .regions import Crossings, linked
from .tapers import TaperConfig, tapered_ends

__all__ = ["SingulationConfig", "singulate"]

_FOCAL = 600.0
"""Focal length [pixels] for which steps between pixels are given."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SingulationConfig:
    """How planar patches are found, and what joins them to objects."""

    block: int = 4
    """Edge of the blocks that patches grow from [pixels]; larger is faster and loses
    thin bars."""
    max_gap: float = 0.011
    """Largest step of 1/z between neighbouring pixels that touch [1/m]: 2.5 cm at
    1.5 m, for 600 pixels of focal length; coarser images get as much more as their
    pixels are larger. Larger bridges more noise and more gaps between objects."""
    max_board_gap: float = 0.03
    """The same for boards that are nailed on each other [1/m]."""
    max_increase: float = 14.0
    """Growth of the squared error, in variances, up to which patches merge to a plane;
    larger makes fewer, coarser patches."""
    sweeps: int = 3
    """Rounds in which pixels at borders choose their patch."""
    min_patch: int = 40
    """Pixels of the smallest patch; smaller ones go to their neighbours."""
    max_step: float = 0.02
    """Step between two planes along their border up to which they join [m]."""
    max_concavity: float = float(np.deg2rad(24))
    """Angle up to which a concave border joins [rad]: the inside of a pipe is made of
    such borders; larger also joins things that lie flat on each other."""
    min_contact: float = 0.35
    """Least length of a border that joins, in roots of the smaller area; larger keeps
    things apart that touch at a corner."""
    completion: CompletionConfig = field(default_factory=CompletionConfig)
    frames: FrameConfig = field(default_factory=FrameConfig)
    assemblies: AssemblyConfig = field(default_factory=AssemblyConfig)
    tapers: TaperConfig = field(default_factory=TaperConfig)
    enclosure: EnclosureConfig = field(default_factory=EnclosureConfig)

    def __post_init__(self) -> None:
        if self.block < 2:
            raise ConfigError("block", got=self.block, expected="2 pixels or more")
        for name in ("max_gap", "max_board_gap", "max_increase", "max_step"):
            if not 0 < getattr(self, name) < np.inf:
                raise ConfigError(name, got=getattr(self, name), expected="above 0")
        for name in ("sweeps", "min_patch", "min_contact", "max_concavity"):
            if not 0 <= getattr(self, name) < np.inf:
                raise ConfigError(name, got=getattr(self, name), expected="0 or more")


def singulate(
    cloud: PointCloud, is_candidate: BoolArray, config: SingulationConfig
) -> PatchGraph | None:
    """Divide the candidate points of an organised cloud.

    Planar patches are joined to convex pieces by their borders, then pieces to objects
    by rules about what is hidden (`completion`), built (`frames`, `assemblies`,
    `tapers`) or hollow (`enclosure`). The rules look at the same pieces, so their order
    doesn't matter; only insides are sought last, when what surrounds them is complete.

    Parameters
    ----------
    cloud
        With its ground, which tells what can be seen through a gap; z up.
    is_candidate
        Points to divide, at least one, shape (n,).

    Returns
    -------
    PatchGraph or None
        Over the candidate points; None if the cloud is not a pinhole image.
    """
    image = inverse_depth_image(cloud)
    if image is None or cloud.pixels is None:
        return None
    pixels = cloud.pixels[is_candidate]
    mask = np.zeros(image.values.shape, dtype=bool)
    mask.ravel()[pixels] = True
    coarseness = max(1.0, _FOCAL / image.focal)
    max_gap = coarseness * config.max_gap
    patches = planar_patches(
        image,
        mask,
        block=config.block,
        max_step=max_gap,
        max_increase=config.max_increase,
        sweeps=config.sweeps,
        min_pixels=config.min_patch,
    )
    crossings = Crossings.of(image.values, patches.labels)
    borders = patch_borders(image, patches, crossings.touching(max_gap))
    piece = joined(
        patches,
        borders,
        max_step=config.max_step,
        max_concavity=config.max_concavity,
        min_contact=config.min_contact,
        min_pixels=config.min_patch,
    )
    objects = _completed(image, patches, crossings, borders, piece, config, coarseness)
    return PatchGraph(
        point_patch=patches.labels.ravel()[pixels],
        patch_object=objects,
        edges=borders.edges,
        is_convex=(borders.opening >= 0) | (borders.angle < config.max_concavity),
        contact_length=borders.length * borders.depth / image.focal,
        rise=borders.rise,
    )


def _completed(
    image: InverseDepthImage,
    patches: PlanarPatches,
    crossings: Crossings,
    borders: Borders,
    piece: IntArray,
    config: SingulationConfig,
    coarseness: float,
) -> IntArray:
    """Object of each patch, after joining pieces by all rules, shape (p,)."""
    n_pieces = int(piece.max()) + 1
    own = np.append(piece, -1)[patches.labels]
    patch_shapes = shapes_of(image, patches.labels, len(patches))
    shapes = shapes_of(image, own, n_pieces)
    outlines = crossings.merged(piece)
    touching = outlines.touching(coarseness * config.max_gap)
    boards = patch_borders(
        image, patches, crossings.touching(coarseness * config.max_board_gap)
    )
    built = config.assemblies
    links = [
        continued_planes(image, patches, piece, patch_shapes, config.completion),
        framed_bars(image, shapes, outlines, touching, config.frames),
        piece[crossed_strips(boards, boards.edges, patch_shapes, built)],
        crossed_strips(boards, piece[boards.edges], shapes, built),
        piece[parallel_strips(patches, patch_shapes, built)],
        tapered_ends(
            borders,
            piece[borders.edges],
            patches.moments[:, 0],
            shapes,
            touching,
            config.tapers,
        ),
        lined(patches, borders, piece, crossings, config.enclosure),
    ]
    objects = linked(np.concatenate(links), n_pieces)[piece]
    # Twice: what was inside may itself surround something.
    for _ in range(2):
        size = np.bincount(objects, patches.moments[:, 0]).astype(np.float64)
        inside = enclosed(
            crossings.merged(objects), size, patches.noise, config.enclosure
        )
        objects = linked(inside, len(size))[objects]
    return objects
