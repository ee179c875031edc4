"""The picture of a motion: postures from light to dark."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from debrisgrasp.errors import DebrisGraspError, InputError
from debrisgrasp.kinematics import RobotModel, Trajectory
from debrisgrasp.viz.motion import MotionTrack, motion_png
from debrisgrasp.viz.page import Page
from tests.unit.kinematics.robots import JointText, row_robot

ROUND = (
    '<collision><geometry><cylinder radius="0.05" length="0.2"/></geometry></collision>'
)


def track_of(robot: RobotModel, arm: str) -> MotionTrack:
    """Motion of all joints to 0.7."""
    limits = robot.limits(arm).planner
    d = limits.n_joints
    turned = Trajectory(
        joint_names=limits.joint_names,
        times=np.array([0.0, 4.0]),
        q=np.array([np.zeros(d), np.full(d, 0.7)]),
        dq=np.zeros((2, d)),
        limits_hash=limits.hash,
    )
    return MotionTrack(label=arm, trajectories=[turned], limits=limits)


def drawn(folder: Path, monkeypatch, joint: JointText | None = None) -> Page:
    """Picture of a motion of six joints in a row to 0.7."""
    robot = RobotModel.load(row_robot(folder, ROUND, joint=joint))
    pages: list[Page] = []
    monkeypatch.setattr(Page, "write", lambda page, _: pages.append(page))
    track = track_of(robot, "one")
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


@pytest.mark.parametrize(
    ("n_tracks", "of", "arm"),
    [(0, "left", "left"), (3, "left", "left"), (1, "left", "right")],
)
def test_what_would_be_another_motion_than_asked_for_is_not_drawn(
    tmp_path: Path, n_tracks: int, of: str, arm: str
) -> None:
    robot = RobotModel.load("roman")
    tracks = [track_of(robot, of)] * n_tracks
    with pytest.raises(InputError, match=f"one or two of .*{arm}_arm_joint1"):
        motion_png(tmp_path / "motion.png", "a turn", robot, arm, tracks)


@pytest.mark.parametrize(
    "wrong",
    [{"robot": "roman"}, {"tracks": None}, {"n_postures": 0}, {"cloud": np.eye(3)}],
    ids=lambda wrong: next(iter(wrong)),
)
def test_no_motion_and_no_robot_are_refused_in_words(tmp_path: Path, wrong) -> None:
    robot = RobotModel.load("roman")
    right = {"robot": robot, "arm": "left", "tracks": [track_of(robot, "left")]}
    with pytest.raises(DebrisGraspError, match=next(iter(wrong))):
        motion_png(tmp_path / "motion.png", "a turn", **{**right, **wrong})


def test_a_track_has_pieces_of_the_joints_of_its_limits() -> None:
    robot = RobotModel.load("roman")
    left, right = track_of(robot, "left"), track_of(robot, "right")
    for pieces in ((), left.trajectories):
        with pytest.raises(InputError, match=r"trajectories of a track.*right_arm"):
            MotionTrack(label="", trajectories=pieces, limits=right.limits)
