"""Fingers that open: pressed, or with nobody to tell how hard."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.control import GripCommand
from debrisgrasp.executive.drive import Drive
from debrisgrasp.executive.fingers import loosen, open_hand
from tests.unit.executive.rigs import before_a_brick


class Deaf:
    """A sensor that gives no number after some readings, and numbers again later."""

    def __init__(self, sensor, after, times):
        self.sensor, self.after, self.times = sensor, after, times
        self.n_read = 0

    def read(self):
        self.n_read += 1
        reading = self.sensor.read()
        if not self.after <= self.n_read - 1 < self.after + self.times:
            return reading
        return reading._replace(wrench_ft=np.full(6, np.nan))


def opened(drive):
    return open_hand(drive, drive.limb.first_preshape, 0.1)


@pytest.mark.parametrize("opens", [lambda drive: loosen(drive, 0.15), opened])
@pytest.mark.parametrize(("times", "is_fault"), [(1, False), (99, True)])
def test_fingers_do_not_go_on_where_the_sensor_gives_no_number(
    pipeline, opens, times, is_fault
):
    fake, task = before_a_brick(pipeline)
    limb = task.context.limbs["right"]
    gripper = limb.limb.gripper
    gripper.command(GripCommand((0.02,) * len(gripper.read().openings), 10.0))
    task.context.wait(3.0)
    sensor = Deaf(limb.limb.sensor, 2, times)
    limb.limb = replace(limb.limb, sensor=sensor)
    begun = task.context.now()
    fault = opens(Drive(task.context, "right"))
    assert (fault is not None) is is_fault
    if fault is not None:
        assert fault.fault == "wrench_nan"
        assert task.context.now() - begun < 0.3
        assert fake.arms["right"].is_stopped
        before = limb.limb.gripper.read().openings
        task.context.wait(0.5)
        assert limb.limb.gripper.read().openings == pytest.approx(before, abs=2e-3)
