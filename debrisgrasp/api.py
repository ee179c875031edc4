"""The facade: from a capture to ranked grasps in one call, or step by step."""

from __future__ import annotations

import os

from debrisgrasp.geometry import Bounds
from debrisgrasp.io import Capture
from debrisgrasp.pipeline import (
    DEFAULT_PRIORITY_POINT,
    Pipeline,
    PipelineConfig,
    PlanningResult,
    Progress,
)
from debrisgrasp.segmentation import (
    Candidate,
    PriorityPoint,
    Segmentation,
    SegmentationConfig,
    SelectionPolicy,
    segment_cloud,
)

__all__ = ["plan", "segment", "select"]


def segment(capture: Capture, config: SegmentationConfig | None = None) -> Segmentation:
    """Divide a capture into objects (section 5.1 of the paper).

    Raises
    ------
    CaptureError
        If the capture has no pose in the base frame.
    """
    return segment_cloud(capture.cloud(), config or SegmentationConfig())


def select(
    capture: Capture,
    segmentation: Segmentation,
    policy: SelectionPolicy | None = None,
) -> tuple[Candidate, ...]:
    """Order the objects of a capture, first choice first (Eq. 1)."""
    policy = policy or PriorityPoint.at(*DEFAULT_PRIORITY_POINT)
    return policy.order(segmentation, capture.cloud())


def plan(
    capture: Capture,
    *,
    robot: str = "roman",
    arm: str | None = None,
    gripper: str | None = None,
    prototypes: str | os.PathLike[str] | None = None,
    grippers: str | os.PathLike[str] | None = None,
    policy: SelectionPolicy | None = None,
    region: Bounds | None = None,
    object_label: int | None = None,
    seed: int = 0,
    deadline: float | None = None,
    config: PipelineConfig | None = None,
    progress: Progress | None = None,
) -> PlanningResult:
    """Plan grasps on the easiest object of a capture; see `Pipeline`."""
    pipeline = Pipeline(
        robot=robot,
        arm=arm,
        gripper=gripper,
        prototypes=prototypes,
        grippers=grippers,
        policy=policy,
        config=config,
    )
    return pipeline.plan(
        capture,
        region=region,
        object_label=object_label,
        seed=seed,
        deadline=deadline,
        progress=progress,
    )
