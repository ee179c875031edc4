"""A small scene: a block on the ground, seen by a camera, and a plan to grip it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.geometry import SE3, Bounds, Intrinsics, PointCloud
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.planning import Grasp, GraspPlan, PassedOver
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.segmentation import (
    Candidate,
    GroundReport,
    Segment,
    Segmentation,
    SegmentEdges,
)
from debrisgrasp.viz import Report

HEIGHT, WIDTH = 60, 80


@pytest.fixture(scope="session")
def hand() -> GripperModel:
    return GripperModel.load("robotiq_3f")


@pytest.fixture(scope="session")
def roman() -> RobotModel:
    return RobotModel.load("roman")


def segmentation_of(labels: np.ndarray) -> Segmentation:
    return Segmentation(
        labels=labels,
        segments=tuple(
            Segment(
                label=label,
                n_points=int(np.count_nonzero(labels == label)),
                centroid=np.zeros(3),
                bounds=Bounds(-np.ones(3), np.ones(3)),
                axes=np.eye(3),
                extents=2.0 * np.ones(3),
            )
            for label in range(1, labels.max(initial=0) + 1)
        ),
        edges=SegmentEdges(
            labels=np.zeros((0, 2), dtype=int),
            convexity=np.zeros(0),
            contact_length=np.zeros(0),
            upper=np.zeros(0, dtype=int),
            score=np.zeros(0),
        ),
        patches=labels,
        ground=GroundReport.skipped("no evidence"),
        method="given",
    )


@pytest.fixture
def cloud_and_labels() -> tuple[PointCloud, np.ndarray]:
    """Ground at z = 0, a block 10 cm high (1), and a slab of 5 cm beside it (2)."""
    camera = Intrinsics(fx=80, fy=80, cx=39.5, cy=29.5, width=WIDTH, height=HEIGHT)
    # One metre above (1, 0), looking straight down, image rows towards -x.
    T_base_camera = SE3.from_parts(
        np.array([[0, -1, 0], [-1, 0, 0], [0, 0, -1]]).T, [1.0, 0.0, 1.0]
    )
    labels = np.zeros((HEIGHT, WIDTH), dtype=np.int32)
    labels[20:40, 20:40] = 1
    labels[20:40, 50:60] = 2
    depth = 1.0 - np.array([0.0, 0.1, 0.05])[labels]
    depth[0] = np.nan
    points_cam = camera.deproject(depth)
    is_seen = np.isfinite(depth)
    normals = np.tile([0.0, 0.0, 1.0], (np.count_nonzero(is_seen), 1))
    normals[:WIDTH] = np.nan
    cloud = PointCloud(
        T_base_camera.apply(points_cam[is_seen]),
        normals,
        T_base_camera.p,
        "base",
        np.flatnonzero(is_seen),
        (HEIGHT, WIDTH),
    )
    return cloud, labels[is_seen]


def grasp_at(x: float, score: float, **change: object) -> Grasp:
    """Straight down at (x, 0), the palm 20 cm above the ground."""
    T_base_hand = SE3.from_parts(np.diag([1.0, -1.0, -1.0]), [x, 0.0, 0.2])
    given = {
        "T_base_hand": T_base_hand,
        "T_base_pregrasp": SE3.from_parts(T_base_hand.R, [x, 0.0, 0.32]),
        "gripper": "robotiq_3f",
        "preshape": "basic",
        "opening": 0.12,
        "width": 0.1,
        "prototype": "block_100mm",
        "S": 0.9,
        "C": 1.0,
        "R": 1.0,
        "coverage": 0.9,
        "support": 12,
        "expected": score,
        "score": score,
        "object_label": 1,
    }
    return Grasp(**(given | change))  # type: ignore[arg-type]


@pytest.fixture
def report(
    cloud_and_labels: tuple[PointCloud, np.ndarray], hand: GripperModel
) -> Report:
    cloud, labels = cloud_and_labels
    plan = GraspPlan(
        grasps=(grasp_at(1.0, 0.9), grasp_at(1.05, 0.7, preshape="pinch", opening=0.1)),
        object_label=1,
        region=Bounds(np.array([0.8, -0.2, 0.0]), np.array([1.2, 0.2, 0.2])),
        robot="none",
        seed=7,
        rejections={"the palm would hit something": 30, "the approach is blocked": 10},
        passed_over=(PassedOver(2, "too small"),),
    )
    return Report(
        title="block",
        cloud=cloud,
        segmentation=segmentation_of(labels),
        plan=plan,
        grippers={"robotiq_3f": hand},
        order=(Candidate(2, 0.1, "nearest"), Candidate(1, 0.2, "second nearest")),
    )


@pytest.fixture
def empty_report(report: Report) -> Report:
    plan = replace(report.plan, grasps=(), why_empty="every pose would collide")
    return replace(report, plan=plan)


@pytest.fixture
def bare_report(report: Report) -> Report:
    """The same scene as an unorganised cloud without an image."""
    cloud = replace(report.cloud, pixels=None, image_shape=None)
    return replace(report, cloud=cloud)
