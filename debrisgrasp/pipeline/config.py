"""Settings of the whole chain."""

from __future__ import annotations

from dataclasses import dataclass, replace

from debrisgrasp._arrays import require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp.planning import PlannerConfig, SuccessModel
from debrisgrasp.segmentation import SegmentationConfig
from debrisgrasp.settings import Settings

__all__ = ["PipelineConfig"]


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class PipelineConfig:
    """Settings of the whole chain; each stage has its own."""

    segmentation: SegmentationConfig = SegmentationConfig()
    planner: PlannerConfig = PlannerConfig()
    region_margin: float = 0.05
    """How far the region V reaches beyond the visible points of the object [m]."""
    max_objects: int = 5
    """How many objects to try before giving up."""
    doubtful: float = 0.9
    """Below this score, objects whose turn is nearly as due are tried too; 0: none."""
    max_further: int = 2
    """How many of them at most, once there is a fair grasp."""
    min_object_points: int = 80
    """Fewer thinned points (one per cell of the planner's grid) than this are a crumb
    of segmentation, not an object to grip."""
    workers: int = 2
    """Threads that prepare a scene side by side; more than two find nothing to do. The
    plan is the same with one."""

    def __post_init__(self) -> None:
        require_range("PipelineConfig.max_objects", self.max_objects, 1)
        require_range("PipelineConfig.region_margin [m]", self.region_margin, 0.0, 1.0)
        require_range("PipelineConfig.doubtful", self.doubtful, 0.0, 1.0)
        require_range("PipelineConfig.max_further", self.max_further, 0)
        require_range("PipelineConfig.workers", self.workers, 1)
        require_range("PipelineConfig.min_object_points", self.min_object_points, 0)

    def at(self, settings: Settings) -> PipelineConfig:
        """Take what a site says of the planner, unless that is said here.

        Raises
        ------
        ConfigError
            If the site's coefficients can't be read or are malformed.
        """
        if settings.success is None or self.planner.success is not None:
            return self
        success = SuccessModel.load(settings.success)
        return replace(self, planner=replace(self.planner, success=success))
