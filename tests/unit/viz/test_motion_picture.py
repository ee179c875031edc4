"""The picture of a motion: postures from light to dark."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from debrisgrasp.kinematics import RobotModel, Trajectory
from debrisgrasp.viz.motion import MotionTrack, motion_png
from debrisgrasp.viz.page import Page
from tests.unit.kinematics.robots import JointText, row_robot

ROUND = (
    '<collision><geometry><cylinder radius="0.05" length="0.2"/></geometry></collision>'
)


def drawn(folder: Path, monkeypatch, joint: JointText | None = None) -> Page:
    """Picture of a motion of six joints in a row to 0.7."""
    robot = RobotModel.load(row_robot(folder, ROUND, joint=joint))
    limits = robot.limits("one").planner
    turned = Trajectory(
        joint_names=limits.joint_names,
        times=np.array([0.0, 4.0]),
        q=np.array([np.zeros(6), np.full(6, 0.7)]),
        dq=np.zeros((2, 6)),
        limits_hash=limits.hash,
    )
    pages: list[Page] = []
    monkeypatch.setattr(Page, "write", lambda page, _: pages.append(page))
    track = MotionTrack(label="one", trajectories=[turned], limits=limits)
    motion_png(folder / "motion.png", "a turn", robot, "one", [track])
    return pages[0]


@pytest.mark.parametrize(("kind", "unit"), [("revolute", "rad"), ("prismatic", "m")])
def test_the_axis_of_a_posture_has_the_unit_of_its_joints(
    tmp_path: Path, monkeypatch, kind: str, unit: str
) -> None:
    page = drawn(tmp_path, monkeypatch, JointText(kind))
    assert unit in [axes.get_ylabel() for axes in page.figure.axes]


def test_a_link_that_turns_about_its_own_axis_has_one_colour(
    tmp_path: Path, monkeypatch
) -> None:
    page = drawn(tmp_path, monkeypatch)
    pictures = [axes.images[0].get_array() for axes in page.figure.axes[:2]]
    for picture in pictures:
        red, _, blue = np.moveaxis(np.asarray(picture), -1, 0)
        share = red / np.maximum(blue, 1e-3)
        last, first = share < 0.2, (share > 0.5) & (share < 0.8)
        assert first.sum() < 0.1 * last.sum()  # facets stand out at the rims
