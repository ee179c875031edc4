"""Laws of the search: unbiased steps, bounded scores, distances that can be trusted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from debrisgrasp.geometry import SE3, Bounds, DepthSight, DistanceField, PointCloud, so3
from debrisgrasp.geometry.sight import PanoramicSight
from debrisgrasp.planning.clearance import ClearanceConfig, HandClearance
from debrisgrasp.planning.hands import PackedHands
from debrisgrasp.planning.proposals import LocalMove
from debrisgrasp.planning.scene import GraspScene, SceneConfig
from debrisgrasp.planning.similarity import ShapeSimilarity, SimilarityConfig
from debrisgrasp.planning.surfaces import VisibleSurfaces
from debrisgrasp.prototypes import PrototypeLibrary
from tests.scenes import CAMERA, capture_of, lying_pipe
from tests.strategies import poses

few = settings(max_examples=25)
seeds = st.integers(0, 2**32 - 1)
NAMES = ("cylinder_060_tip", "edge_019", "claw_cylinder_100")


@given(poses, seeds, st.floats(0.0, 1.0))
@few
def test_a_local_step_and_its_reverse_are_equally_likely(T, seed, progress):
    n, move = 4000, LocalMove()
    Ts = np.tile(T.matrix, (n, 1, 1))
    stepped = move.moved(Ts, progress, np.random.default_rng(seed))
    step = stepped[:, :3, 3] - T.p
    turn = so3.log(T.R.T @ stepped[:, :3, :3])
    for sample, (start, end) in ((step, move.position), (turn, move.rotation)):
        sigma = start + (end - start) * progress
        scaled = sample / sigma
        # Five standard errors of the mean, the spread and the skewness of a Gaussian.
        assert np.abs(scaled.mean(axis=0)).max() < 5 / np.sqrt(n)
        assert np.abs(scaled.std(axis=0) - 1).max() < 5 / np.sqrt(2 * n)
        assert np.abs((scaled**3).mean(axis=0)).max() < 5 * np.sqrt(15 / n)
    assert np.array_equal(Ts, np.tile(T.matrix, (n, 1, 1)))


@pytest.fixture(scope="module")
def terms():
    """S and C in a scene with one pipe, for three prototypes of both hands."""
    library = PrototypeLibrary.load().select(names=NAMES)
    capture = capture_of([lying_pipe()])
    cloud = capture.cloud()
    is_object = cloud.points[:, 2] > 0.02
    scene = GraspScene.build(
        cloud,
        is_object,
        Bounds.around(cloud.points[is_object], 0.05),
        DepthSight(capture.depth.astype(np.float32), CAMERA, capture.T_base_camera),
        SceneConfig(),
        ground_plane=np.array([0.0, 0.0, 1.0, 0.0]),
    )
    hands = PackedHands.pack(library, approach=0.12, tolerance=0.004)
    return (
        ShapeSimilarity(
            scene, VisibleSurfaces.pack(library.packed(), 80), SimilarityConfig()
        ),
        HandClearance(scene, hands, ClearanceConfig()),
    )


@given(poses, seeds)
@few
def test_scores_of_any_pose_lie_between_zero_and_one(terms, T, seed):
    similarity, clearance = terms
    rng = np.random.default_rng(seed)
    # Around the pipe, and around a place that may be anywhere.
    near = SE3.from_parts(T.R, [0.9, 0.0, 0.25]) @ SE3.exp(rng.normal(0, 0.2, (32, 6)))
    far = T @ SE3.exp(rng.normal(0, 0.5, (32, 6)))
    Ts = np.concatenate([near.matrix, far.matrix])
    prototype = rng.integers(len(NAMES), size=len(Ts))
    S, coverage = similarity(Ts, prototype)
    C = clearance(Ts, prototype, np.zeros(len(Ts)))
    for score in (S, coverage, C, clearance.unseen(Ts, prototype)):
        assert score.shape == (len(Ts),)
        assert ((score >= 0) & (score <= 1)).all()
    needed = rng.random(len(Ts))
    hasty = clearance(Ts, prototype, needed)
    assert ((hasty == C) | (hasty == 0)).all()
    assert (hasty == C)[needed < C].all()


@given(seeds, st.integers(1, 300), st.floats(0.005, 0.03), st.floats(1.0, 6.9))
@few
def test_the_field_never_understates_a_distance(seed, n, spacing, reach):
    rng = np.random.default_rng(seed)
    centre = rng.uniform(-2, 2, 3)
    points = centre + rng.uniform(-0.2, 0.2, (n, 3)) * rng.random(3)
    cloud = PointCloud(
        points, np.full((n, 3), np.nan), centre + np.array([0.0, 0.0, 2.0])
    )
    truncation = reach * spacing
    field = DistanceField.build(
        cloud,
        Bounds.around(points, 0.05),
        PanoramicSight.from_cloud(cloud),
        spacing=spacing,
        truncation=truncation,
    )
    places = centre + rng.uniform(-0.4, 0.4, (2000, 3))
    true, _ = cKDTree(points).query(places)
    stated = field.distance(places)
    assert (stated >= np.minimum(true, truncation) - 1e-5).all()
    assert (stated <= truncation * (1 + 1e-6)).all()
    # What it overstates stays within the cells that hold the place and the point.
    diagonal = spacing * np.sqrt(3.0)
    inside = Bounds.around(points, 0.05).contains(places)
    is_resolved = inside & (true < truncation - 2 * diagonal)
    assert (stated - true)[is_resolved].max(initial=0.0) <= 2 * diagonal
