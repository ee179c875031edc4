"""Motions on disk: what was written comes back, and no other is taken for it."""

from __future__ import annotations

import json

import pytest
from numpy.testing import assert_array_equal

from debrisgrasp.errors import ConfigError
from debrisgrasp.io.motion_json import load_motion, motion_to_dict, save_motion
from debrisgrasp.kinematics import Trajectory

REACH = Trajectory(
    joint_names=("shoulder", "elbow"),
    times=[0.0, 1.0, 2.5],
    q=[[0.0, 0.0], [0.1, 1 / 3], [0.2, 0.7]],
    dq=[[0.0, 0.0], [0.1, 0.2], [0.0, 0.0]],
    limits_hash="abc",
)


@pytest.fixture
def content():
    return motion_to_dict(
        {"reach": REACH, "lift": REACH}, robot="r", arm="a", index=1, passed_over=()
    )


def test_motions_that_were_read_are_written_as_the_same_bytes(content, tmp_path):
    first, again = tmp_path / "motion.json", tmp_path / "again.json"
    save_motion(content, first)
    stored = load_motion(first)
    assert (stored.arm, stored.rank, list(stored.trajectories)) == (
        "a",
        2,
        ["reach", "lift"],
    )
    assert_array_equal(stored.trajectories["lift"].times, REACH.times)
    save_motion(
        motion_to_dict(
            stored.trajectories, robot="r", arm="a", index=1, passed_over=()
        ),
        again,
    )
    assert again.read_bytes() == first.read_bytes()


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("grasp", 0, "a place in the plan from 1"),
        ("grasp", True, "a place in the plan from 1"),
        ("arm", None, "a name"),
    ],
)
def test_a_place_or_an_arm_that_is_none_is_refused(
    content, tmp_path, key, value, message
):
    path = tmp_path / "motion.json"
    path.write_text(json.dumps(content | {key: value}))
    with pytest.raises(ConfigError, match=message):
        load_motion(path)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("name", "lift", "motions.*each once"),
        ("joints", "ab", "joints of a motion.*a list"),
        ("joints", ["elbow", "elbow"], "joints of a motion.*each once"),
    ],
)
def test_names_that_are_there_twice_are_refused(content, tmp_path, key, value, message):
    path = tmp_path / "motion.json"
    content["motions"][0][key] = value
    path.write_text(json.dumps(content))
    with pytest.raises(ConfigError, match=message):
        load_motion(path)
