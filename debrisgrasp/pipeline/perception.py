"""What one capture says about the scene, worked out once and used by many plans."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray
from debrisgrasp._stopwatch import Stopwatch
from debrisgrasp._workers import beside
from debrisgrasp.errors import ShapeError
from debrisgrasp.geometry import (
    DepthSight,
    LineOfSight,
    PanoramicSight,
    PointCloud,
    voxel_downsample,
)
from debrisgrasp.io import Capture, measured, point_colors
from debrisgrasp.motion import MotionSpace, UnknownSpace
from debrisgrasp.planning import GraspScene, ObstacleMap, SceneConfig
from debrisgrasp.segmentation import (
    Candidate,
    Segmentation,
    SegmentationConfig,
    SelectionPolicy,
    ordered,
    segment_cloud,
    with_mark,
)

from .notes import ground_notes, mask_notes, part_notes
from .targets import Target, whole_of, with_crumbs

__all__ = ["Perception", "motion_space", "segmented"]

_KEPT_SCENES = 3
"""Scenes of so many objects are remembered; each takes about 20 MB."""


@dataclass(eq=False, kw_only=True)
class Perception:
    """Cloud, objects, obstacles and scenes of one capture.

    Planning again on the same perception, with another seed, object or deadline,
    repeats nothing of it.
    """

    capture: Capture
    cloud: PointCloud
    """Every measured point, base frame."""
    sight: LineOfSight
    """Tells free from unknown space."""
    segmentation: Segmentation
    is_marked: BoolArray | None
    """Which points a mask of the capture marks, shape (n,); None without a mask."""
    scene_config: SceneConfig
    workers: int
    """See `PipelineConfig.workers`."""
    _order: tuple[SelectionPolicy, tuple[Candidate, ...]] | None = None
    _scenes: dict[tuple[object, ...], GraspScene] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<Perception of {self.capture.name}: {self.segmentation!r}>"

    @classmethod
    def of(
        cls,
        capture: Capture,
        segmentation: SegmentationConfig,
        scene: SceneConfig,
        watch: Stopwatch,
        workers: int,
        given: Segmentation | None = None,
    ) -> Perception:
        """Look at a capture; ``given`` stands for a segmentation by the settings.

        Raises
        ------
        CaptureError
            If the capture has no pose.
        ShapeError
            If the given segmentation is of another number of points.
        """
        with watch.stage("cloud"):
            cloud = capture.cloud()
            sight = _sight(capture, cloud)
        with watch.stage("segmentation"):
            marked = _marked(capture)
            if given is None:
                found = segmented(capture, cloud, segmentation)
            elif len(given.labels) == len(cloud):
                found = with_mark(given, marked)
            else:
                raise ShapeError(
                    "segmentation",
                    got=f"{len(given.labels)} points",
                    expected=f"the {len(cloud)} that were measured",
                )
        return cls(
            capture=capture,
            cloud=cloud,
            sight=sight,
            segmentation=found,
            is_marked=marked,
            scene_config=scene,
            workers=workers,
        )

    def with_scenes(self, config: SceneConfig) -> Perception:
        """Return what was seen, with scenes by these settings."""
        if config == self.scene_config:
            return self
        return replace(self, scene_config=config, _scenes={})

    @cached_property
    def obstacles(self) -> ObstacleMap:
        """Everything in the way of an arm."""
        return ObstacleMap.build(self._thin_cloud, self.sight, self.ground_plane)

    @property
    def ground_plane(self) -> FloatArray | None:
        """Plane of the ground (4,), where there was evidence for one."""
        ground = self.segmentation.ground
        return ground.plane if ground.status == "removed" else None

    def order(self, policy: SelectionPolicy) -> tuple[Candidate, ...]:
        """Order the objects, anew only for another policy."""
        if self._order is None or self._order[0] is not policy:
            # Whatever comes first, planning on it asks for the obstacles.
            with beside(lambda: self.obstacles, workers=self.workers):
                self._order = policy, ordered(policy, self.segmentation, self.cloud)
        return self._order[1]

    def scene(self, target: Target) -> GraspScene:
        """Scene of a target, built when it is first asked for."""
        is_object = target.is_object
        box = target.region.lower.tobytes() + target.region.upper.tobytes()
        key = (box, hash(np.packbits(is_object).tobytes()))
        if key not in self._scenes:
            while len(self._scenes) >= _KEPT_SCENES:
                del self._scenes[next(iter(self._scenes))]
            self._scenes[key] = GraspScene.build(
                self._thin_cloud,
                is_object[self._thinned],
                target.region,
                self.sight,
                self.scene_config,
                ground_plane=self.ground_plane,
                belongs=self._belongs(target),
                workers=self.workers,
            )
        return self._scenes[key]

    def _belongs(self, target: Target) -> FloatArray:
        """How likely each point that planning sees is of one object with a target."""
        if not target.label or self.is_marked is not None:
            _, whole = self.chosen_and_whole(target)
            return whole[self._thinned].astype(np.float64)
        belonging = self.segmentation.belonging(target.label)
        found: FloatArray = belonging[self.segmentation.labels[self._thinned]]
        return found

    def notes(self, chosen: Target | None) -> tuple[str, ...]:
        """Say what to know of pose, ground and mask, and of a chosen target."""
        notes = ground_notes(self.segmentation.ground)
        notes += mask_notes(self.is_marked, self.segmentation)
        if chosen is not None:
            notes += part_notes(*self.chosen_and_whole(chosen), self.is_marked)
        return notes

    def chosen_and_whole(self, target: Target) -> tuple[BoolArray, BoolArray]:
        """Which points a mask or a region chooses, and which are lifted with them.

        Returns
        -------
        is_chosen, whole
            Shapes (n,).
        """
        is_chosen = target.is_object & target.region.contains(self.cloud.points)
        return is_chosen, whole_of(self.segmentation, target.label, is_chosen)

    def lifted_with(self, target: Target | None) -> BoolArray:
        """Which points are lifted where a target is gripped, shape (n,); None: none."""
        labels = self.segmentation.labels
        if target is None:
            return np.zeros(len(labels), dtype=bool)
        if target.label and self.is_marked is None:
            is_own: BoolArray = labels == target.label
        else:
            is_own = self.chosen_and_whole(target)[1]
        return with_crumbs(self.cloud.points, labels, is_own, self.ground_plane)

    @cached_property
    def _thin_cloud(self) -> PointCloud:
        """Those points."""
        return self.cloud.selected(self._thinned)

    @cached_property
    def _thinned(self) -> IntArray:
        """One point for each object in each cell: what planner and obstacles need."""
        group = self.segmentation.labels.astype(np.int64)
        if self.is_marked is not None:
            group = 2 * group + self.is_marked
        # Numbers of one or two bytes are sorted by counting.
        dtype = np.min_scalar_type(int(group.max(initial=0)))
        order = np.argsort(group.astype(dtype), kind="stable")
        parts = np.split(order, np.flatnonzero(np.diff(group[order])) + 1)
        spacing, points = self.scene_config.spacing, self.cloud.points
        # Taking rows is several times as fast as indexing.
        kept = [
            part[voxel_downsample(points.take(part, axis=0), spacing)] for part in parts
        ]
        return np.sort(np.concatenate(kept))


def segmented(
    capture: Capture, cloud: PointCloud, config: SegmentationConfig | None = None
) -> Segmentation:
    """Divide the cloud of a capture into objects, heeding its colours and its mask.

    Whoever speaks of an object by its label has to divide it like this.
    """
    return segment_cloud(
        cloud, config, colors=point_colors(capture), of_interest=_marked(capture)
    )


def _marked(capture: Capture) -> BoolArray | None:
    """Which points of the cloud the mask of a capture marks, (n,); None without one."""
    return None if capture.mask is None else capture.mask[measured(capture)]


def motion_space(
    capture: Capture,
    cloud: PointCloud,
    segmentation: Segmentation,
    unknown: UnknownSpace = UnknownSpace.HIDDEN,
) -> MotionSpace:
    """Obstacles of an arm: what a capture shows, and what it hides."""
    ground = segmentation.ground
    plane = ground.plane if ground.status == "removed" else None
    return MotionSpace.build(cloud, _sight(capture, cloud), plane, unknown=unknown)


def _sight(capture: Capture, cloud: PointCloud) -> LineOfSight:
    """Lines of sight of an image, or of a bare cloud."""
    depth, camera, pose = capture.depth, capture.intrinsics, capture.T_base_camera
    if depth is None or camera is None or pose is None:
        return PanoramicSight.from_cloud(cloud)
    return DepthSight(depth.astype(np.float32), camera, pose)
