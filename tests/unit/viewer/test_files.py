"""What the viewer reads from files, which takes no browser."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp import api
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3
from debrisgrasp.io import Capture, data_path
from debrisgrasp.io.motion_json import motion_to_dict, save_motion
from debrisgrasp.io.plan_json import save_plan
from debrisgrasp.kinematics import RobotModel, Trajectory
from debrisgrasp.planning import GraspPlan
from debrisgrasp.viewer import content_of
from tests.grasps import grasp_at


@pytest.fixture(scope="module")
def capture() -> Capture:
    return Capture.load(data_path("captures", "pile.npz"))


@pytest.fixture(scope="module")
def marked(capture) -> Capture:
    """The capture with a mask, which changes the labels of its objects."""
    both = replace(capture, mask=np.isin(capture.labels, (2, 3)))
    assert (api.segment(both).labels != api.segment(capture).labels).any()
    return both


@pytest.fixture
def saved(tmp_path):
    """A plan of two grasps, and motions to the second."""
    chain = RobotModel.load("roman").chain("right")
    q = chain.sampled(1, rng=np.random.default_rng(0))[0]
    here = replace(grasp_at(chain.fk(q)), arm="right")
    beside = replace(here, T_base_hand=SE3.from_parts(p=[0, 0, 0.1]) @ here.T_base_hand)
    plan = GraspPlan(
        grasps=(beside, here), object_label=1, region=None, robot="roman", seed=0
    )
    approach = Trajectory(
        joint_names=tuple(chain.joint_names),
        times=[0.0],
        q=[q],
        dq=[0 * q],
        limits_hash="",
    )
    save_plan(plan, tmp_path / "grasps.json")

    def save(index: int, arm: str) -> None:
        content = motion_to_dict(
            {"approach": approach}, robot="roman", arm=arm, index=index, passed_over=()
        )
        save_motion(content, tmp_path / "motion.json")

    return save


def test_motions_to_a_grasp_of_the_plan_are_read(saved, capture, tmp_path):
    saved(1, "right")
    opened = content_of(
        tmp_path / "grasps.json", capture=capture, motion=tmp_path / "motion.json"
    )
    assert (opened.motion_grasp, opened.motion_arm) == (1, "right")


@pytest.mark.parametrize(("index", "arm"), [(0, "right"), (2, "right"), (1, "left")])
def test_motions_to_another_grasp_are_refused(saved, capture, tmp_path, index, arm):
    saved(index, arm)
    with pytest.raises(ConfigError, match=rf"not end at grasp {index + 1} of the plan"):
        content_of(
            tmp_path / "grasps.json", capture=capture, motion=tmp_path / "motion.json"
        )


def test_a_plan_for_a_robot_from_a_file_asks_for_that_file(saved, capture, tmp_path):
    saved(1, "right")
    path = tmp_path / "grasps.json"
    path.write_text(path.read_text().replace('"roman"', '"mine"'))
    with pytest.raises(ConfigError, match=r"the file of mine, for which .*--robot"):
        content_of(path, capture=capture)
    with pytest.raises(ConfigError, match=r"got roman, expected mine, for which"):
        content_of(path, capture=capture, robot="roman")
    assert content_of(path, capture=capture, robot="none").robot is None


def test_labels_are_those_of_the_plan_also_under_a_mask(saved, marked, tmp_path):
    saved(1, "right")
    labels = api.segment(marked).labels
    shown = content_of(tmp_path / "grasps.json", capture=marked)
    np.testing.assert_array_equal(shown.segmentation.labels, labels)
    marked.save(tmp_path / "marked.npz")
    shown = content_of(tmp_path / "marked.npz")
    np.testing.assert_array_equal(shown.segmentation.labels, labels)


def test_a_plan_of_another_capture_is_told_if_its_object_is_not_there(
    saved, capture, tmp_path
):
    saved(1, "right")
    path = tmp_path / "grasps.json"
    path.write_text(path.read_text().replace('"object": 1', '"object": 99'))
    with pytest.raises(ConfigError, match=r"without object 99, expected the one that"):
        content_of(path, capture=capture)


def test_motions_alone_are_told_where_they_are_shown(saved, tmp_path):
    saved(1, "right")
    with pytest.raises(ConfigError, match=r"motion/2.*beside a plan.*--motion"):
        content_of(tmp_path / "motion.json")
