"""A hand on an arm whose URDF ends at the flange."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3, Box, Capsule, Cylinder, Sphere, so3
from debrisgrasp.kinematics import ArmCollision, RobotModel, with_hand
from debrisgrasp.kinematics.urdf import UrdfJoint

from .robots import row_robot

TURNED = SE3.exp(np.array([0.01, 0.02, 0.1, 0.3, -0.4, 0.5]))
HAND = (
    Box(np.array([0.05, 0.04, 0.03]), SE3.from_parts(p=[0.0, 0.0, -0.03])),
    Capsule(0.01, 0.1, TURNED),
    Cylinder(0.01, 0.1, SE3.from_parts(p=[0.05, 0.0, 0.1])),
    Sphere(0.02, np.array([0.0, 0.0, 0.2])),
)


@pytest.fixture
def bare(tmp_path: Path) -> RobotModel:
    """A row of six joints that ends at a flange without any solid in front of it."""
    block = '<geometry><box size="0.05 0.05 0.05"/></geometry>'
    path = row_robot(
        tmp_path,
        f'<collision><origin xyz="0 0 -0.1"/>{block}</collision>',
        frames={"palm": {"parent": "link6", "position": [0.0, 0.0, 0.05]}},
        tip="palm",
        gripper="jaw",
        limits={"acceleration": 1.0, "force": 100.0, "torque": 20.0},
    )
    return RobotModel.load(path)


def test_a_hand_that_the_urdf_lacks_stands_at_the_palm(bare: RobotModel) -> None:
    robot = with_hand(bare, "one", HAND)
    moved = {"joint2": 0.4, "joint5": -0.3}
    found = [s for link, s in robot.links_solids(moved) if link == "jaw of one"]
    T_base_palm = bare.link_poses(moved)["palm"]
    expected = [solid.moved(T_base_palm) for solid in HAND]
    points = T_base_palm.apply(np.random.default_rng(0).normal(0.0, 0.1, (200, 3)))
    for solid, wanted in zip(found, expected, strict=True):
        np.testing.assert_allclose(
            solid.signed_distance(points), wanted.signed_distance(points), atol=1e-9
        )
    assert len(bare.links_solids()) + len(HAND) == len(robot.links_solids())


def test_it_is_the_hand_of_the_arm_in_tests_for_collision(bare: RobotModel) -> None:
    body = ArmCollision.fit(with_hand(bare, "one", HAND), "one").body
    assert sum(part.is_hand and part.link == "jaw of one" for part in body.parts) == 4


def test_a_hand_mounted_before_is_replaced(bare: RobotModel) -> None:
    robot = with_hand(with_hand(bare, "one", HAND), "one", HAND[:2])
    assert len(robot.tree.shapes["jaw of one"]) == 2


def test_a_hand_of_the_urdf_stays(roman: RobotModel) -> None:
    assert with_hand(roman, "right", HAND) is roman


@pytest.mark.parametrize(("z", "roll"), [(-0.1, 0.0), (0.1, 3.14)])
def test_a_palm_behind_the_flange_is_refused(
    bare: RobotModel, z: float, roll: float
) -> None:
    T = SE3.from_parts(so3.from_rpy(np.array([roll, 0.0, 0.0])), [0.0, 0.0, z])
    palm = UrdfJoint.fixed("link6", "palm", T)
    tree = replace(bare.tree, joints={**bare.tree.joints, palm.name: palm})
    with pytest.raises(ConfigError, match=r"palm, 0\.100 m behind link6.*sign"):
        with_hand(replace(bare, tree=tree), "one", HAND)
