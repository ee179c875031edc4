"""The picture of a motion: postures from light to dark."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from debrisgrasp.kinematics import RobotModel, Trajectory
from debrisgrasp.viz.motion import MotionTrack, motion_png
from debrisgrasp.viz.page import Page
from tests.unit.kinematics.robots import row_robot

ROUND = (
    '<collision><geometry><cylinder radius="0.05" length="0.2"/></geometry></collision>'
)


def test_a_link_that_turns_about_its_own_axis_has_one_colour(
    tmp_path: Path, monkeypatch
) -> None:
    robot = RobotModel.load(row_robot(tmp_path, ROUND))
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
    motion_png(tmp_path / "motion.png", "a turn", robot, "one", [track])
    pictures = [axes.images[0].get_array() for axes in pages[0].figure.axes[:2]]
    for picture in pictures:
        red, _, blue = np.moveaxis(np.asarray(picture), -1, 0)
        share = red / np.maximum(blue, 1e-3)
        last, first = share < 0.2, (share > 0.5) & (share < 0.8)
        assert first.sum() < 0.1 * last.sum()  # facets stand out at the rims
