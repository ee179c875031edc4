from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from debrisgrasp.geometry import SE3, Box, Solid, random_rotations
from debrisgrasp.kinematics import ArmCollision
from debrisgrasp.kinematics.scene_cover import SceneCover, scene_clearance

from .example_robots import UR10, loaded_or_skip
from .test_spheres import solids

STANDS_OUT = 0.0101
"""How far the finer spheres stand out, and what rounding adds [m]."""


def clearance(
    solid: Solid, T: SE3, distance: Callable[[np.ndarray], np.ndarray]
) -> float:
    cover = SceneCover(segment=1, is_hand=False, solids=[solid], max_radius=0.08)
    return float(scene_clearance([cover], [(T.R[None], T.p[None])], distance)[0])


def posed(seed: int) -> SE3:
    rng = np.random.default_rng(seed)
    return SE3.from_parts(random_rotations(1, rng=rng)[0], rng.normal(size=3))


@settings(max_examples=25)
@given(solids(), st.integers(0, 1000), st.floats(0.0, 0.15))
def test_no_point_is_nearer_than_the_clearance_tells(
    solid: Solid, seed: int, apart: float
) -> None:
    rng, T = np.random.default_rng(seed), posed(seed)
    vertices, _ = solid.mesh()
    way = rng.normal(size=3)
    point = vertices[rng.integers(len(vertices))] + apart * way / np.linalg.norm(way)
    found = clearance(solid, T, lambda p: np.linalg.norm(p - T.apply(point), axis=-1))
    assert found <= max(float(solid.signed_distance(point)), 0.0) + 1e-6


@given(solids(), st.integers(0, 1000), st.floats(0.0, 1.0))
def test_a_point_inside_is_a_contact(solid: Solid, seed: int, share: float) -> None:
    T = posed(seed)
    bounds, vertices = solid.bounds, solid.mesh()[0]
    point = share * vertices[0] + (1.0 - share) * 0.5 * (bounds.lower + bounds.upper)
    if solid.signed_distance(point) > -1e-6:
        return
    assert (
        clearance(solid, T, lambda p: np.linalg.norm(p - T.apply(point), axis=-1))
        <= 0.0
    )


@given(st.integers(0, 1000), st.floats(0.0, 0.019))
def test_just_over_the_floor_it_is_told_to_a_centimetre(
    seed: int, height: float
) -> None:
    box, T = Box(np.array([0.06, 0.08, 0.15])), posed(seed)
    lowest = T.apply(box.mesh()[0])[:, 2].min()
    found = clearance(box, T, lambda p: p[..., 2] - lowest + height)
    assert height - STANDS_OUT <= found <= height + 1e-6


def test_an_arm_on_a_table_does_not_touch_it(tmp_path: Path) -> None:
    # Shoulder and upper arm are 2 to 3 cm over the face that it is screwed on to.
    ur5 = replace(UR10, urdf=UR10.urdf.replace("ur10", "ur5"))
    robot = loaded_or_skip(ur5, tmp_path)
    (arm,) = robot.arms
    collision = ArmCollision.fit(robot, arm)
    q = collision.body.chain.vector(robot.posture(arm, robot.arm(arm).present))
    lowest = min(
        solid.mesh()[0][:, 2].min()
        for link, solid in robot.links_solids(collision.body.chain.named(q))
        if link != "base_link"
    )
    found = float(collision.scene_clearance(q, lambda points: points[..., 2]))
    assert 0.01 < found <= lowest
