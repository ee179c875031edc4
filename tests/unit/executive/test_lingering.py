"""What an empty hand pushes along on its way."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.executive.drive import Drive
from debrisgrasp.executive.lingering import Lingering
from debrisgrasp.executive.moves import planned
from debrisgrasp.executive.obstacles import space_of
from debrisgrasp.motion import UnknownSpace
from debrisgrasp.robot.fake_arm import FakeForceSensor
from tests.unit.executive.rigs import before_a_brick

PERIOD = 0.004


def load(force):
    return (0.0, force, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("first", "force", "seconds", "is_met"),
    [
        (0.0, 30.0, 0.2, True),
        (0.0, 30.0, 0.1, False),  # a knock
        (0.0, 15.0, 9.0, False),
        (25.0, 30.0, 9.0, False),  # it leaned on something from the start
        (25.0, 40.0, 0.2, True),
    ],
)
def test_a_push_that_lingers_is_a_touch(first, force, seconds, is_met):
    lingering = Lingering(load(first), PERIOD)
    found = [lingering.is_met(load(force)) for _ in range(round(seconds / PERIOD))]
    assert found[-1] is is_met


def test_knocks_do_not_add_up():
    lingering = Lingering(load(0.0), PERIOD)
    forces = [30.0] * 20 + [0.0]
    assert not any(lingering.is_met(load(f)) for f in forces * 20)


def test_an_empty_hand_is_slow_where_it_pushes_something_along(pipeline, monkeypatch):
    fake, task = before_a_brick(pipeline)
    context = task.context
    limb, drive = context.limbs["right"], Drive(context, "right")
    limb.baseline_time = 1e-3
    away = context.posture(limb)
    away[0] += 0.8
    space = space_of(context, unknown=UnknownSpace.IGNORED)
    trajectory = planned(context, limb, away, space).trajectory
    begun, period = context.now(), context.settings.period
    read, turned = FakeForceSensor.read, []

    def slides(sensor):
        """Something resists from one second on."""
        reading = read(sensor)
        turned.append((context.now() - begun, context.posture(limb)[0]))
        grown = 35.0 * np.clip((context.now() - begun - 1.0) / 0.5, 0.0, 1.0)
        push = np.eye(6)[1]
        return reading._replace(wrench_ft=np.asarray(reading.wrench_ft) + grown * push)

    monkeypatch.setattr(FakeForceSensor, "read", slides)
    assert drive.follow(trajectory) is None
    np.testing.assert_allclose(context.posture(limb), away, atol=2e-3)
    time, angle = np.array(turned).T
    time, rows = np.unique(np.round(time / period).astype(int), return_index=True)
    speed = np.abs(np.diff(angle[rows]) / (np.diff(time) * period))
    fastest = np.abs(trajectory.dq[:, 0]).max()
    is_early = time[1:] * period < 1.4
    assert speed[is_early].max() > 0.5 * fastest
    assert speed[time[1:] * period > 1.8].max() < 0.35 * fastest
    assert fake.truth().violations == ()
