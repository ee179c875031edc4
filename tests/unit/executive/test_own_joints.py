"""Two arms of a task are two: each has joints and a tip of its own."""

from __future__ import annotations

from dataclasses import replace

import pytest

from debrisgrasp.errors import InputError
from debrisgrasp.executive import require_own_joints
from debrisgrasp.kinematics import RobotModel


@pytest.fixture(scope="module")
def roman():
    return RobotModel.load("roman")


def test_arms_that_share_what_carries_them_are_two(roman):
    assert set(roman.arm("left").joints) & set(roman.arm("right").joints)
    require_own_joints(roman, ["left", "right"])


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({}, "tip of the left arm of roman: got those of the twin arm"),
        ({"tip": "left_camhand_palm_link"}, "joints of the left arm"),
        ({"tip": "left_camhand_palm_link", "joints": ("left_arm_joint1",)}, "--arm"),
    ],
)
def test_one_arm_under_two_names_is_refused_unless_one_is_taken(roman, changes, word):
    twin = replace(roman.arm("left"), name="twin", **changes)
    both = replace(roman, arms={**roman.arms, "twin": twin})
    with pytest.raises(InputError, match=word):
        require_own_joints(both, ["left", "right", "twin"])
    require_own_joints(both, ["right", "twin"])
