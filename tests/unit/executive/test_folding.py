"""How far an arm can take its hand along a straight way."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.control import CartesianLeg, LegPlanner, LegStatus
from debrisgrasp.executive import folding
from debrisgrasp.executive.folding import free_share
from tests.unit.executive.rigs import before_a_brick

AT_LIMIT = np.array([1.55, 1.41, -1.19, 2.17, -2.13, -2.58, -0.25, -1.78])
"""Of the left arm: the torso can't turn on, and a hand at the drop-off must go back."""


@pytest.fixture
def limb(pipeline):
    return before_a_brick(pipeline)[1].context.limbs["left"]


def test_other_joints_do_what_one_at_its_limit_can_t(limb):
    T = limb.pose(AT_LIMIT)
    back = -0.12 * T.R[:, 2]
    planner = LegPlanner(limb.reach.chain, limb.limits.controller)
    plan = planner.plan(AT_LIMIT, CartesianLeg.along(T, back).goal)
    assert plan.status is LegStatus.JOINT_LIMIT
    assert plan.share < 0.2
    assert free_share(limb, AT_LIMIT, back) == 1.0


def test_they_do_not_where_the_arm_would_fold_onto_the_robot(limb, monkeypatch):
    T = limb.pose(AT_LIMIT)
    back = -0.12 * T.R[:, 2]

    class Alone:
        def contacts(self, _row):
            return ()

        def is_free(self, rows):
            gone = (limb.pose(rows[0]).p - T.p) @ back / 0.12
            return np.array([gone < 0.07])

    monkeypatch.setattr(folding, "_alone", lambda _: Alone())
    assert 0.5 < free_share(limb, AT_LIMIT, back) <= 0.07 / 0.12


def test_no_arm_goes_farther_than_it_is_long(limb):
    assert free_share(limb, AT_LIMIT, np.array([0.0, 2.5, 0.0])) < 0.4
