"""An arm in physics: what its drives are told, and where its joints really are."""

from __future__ import annotations

from collections.abc import Sequence

from debrisgrasp._arrays import Rng
from debrisgrasp.control import LoadModel
from debrisgrasp.control._rigid import Wrench
from debrisgrasp.robot import FakeConfig
from debrisgrasp.robot.drives import Timeline
from debrisgrasp.robot.fake_arm import FakeArm, FakeForceSensor

__all__ = ["SimArm", "SimForceSensor"]

_PAUSE = 3
"""Ticks without a command after which the next one may begin anew."""
_SAME = 1e-9
"""[rad or m]."""


class SimArm(FakeArm):
    """Joints that follow as far as physics lets them; `debrisgrasp.robot.Arm`.

    Commands are taken, refused and held as `FakeArm` does; what comes of them within
    the limits is what the servo of the joints is to follow. What is read is measured.
    """

    _measured: tuple[float, ...] | None = None

    @property
    def q(self) -> tuple[float, ...]:
        """Measured posture [rad or m]; where it starts until there is one."""
        return super().q if self._measured is None else self._measured

    def command(self, q: Sequence[float]) -> None:
        """Go there as `FakeArm` does.

        Whoever begins anew begins with the posture that was measured, or where its
        limits are if weight keeps a joint a little beyond them: that an arm that stands
        is not quite where it was sent is no jump of the command.
        """
        refusal, values = self._checked(q)
        if self._is_engaged and not refusal:
            sent, tick = self._commanded, self._timeline.tick
            ranges = zip(self.q, self._ranges, strict=True)
            here = tuple([min(max(x, low), high) for x, (low, high) in ranges])
            off = _gap(values, here)
            may_be_new = sent is None or off < _SAME or tick - sent[0] >= _PAUSE
            if sent is None:
                self._commanded = tick - 1, here, (0.0,) * len(here)
            elif may_be_new and off < _gap(values, sent[1]):
                self._commanded = sent[0], here, sent[2]
        super().command(q)

    def measure(self, q: tuple[float, ...]) -> None:
        """Take note of where the joints are, d values."""
        self._measured = q


class SimForceSensor(FakeForceSensor):
    """Feels contact, weight and inertia; fulfils `debrisgrasp.robot.ForceSensor`."""

    def __init__(
        self,
        arm: SimArm,
        loads: LoadModel,
        timeline: Timeline,
        config: FakeConfig,
        rng: Rng,
    ) -> None:
        super().__init__(arm, loads, timeline, config, rng)
        self._known_bias: list[float] = loads.bias.tolist()

    def feel(self, wrench_ft: Sequence[float]) -> Wrench:
        """Take what acts on the hand, its weight included, frame of the sensor.

        Returns the load at the hand, without that weight, in the axes of the hand.
        """
        loads, R = self._loads, self._arm.pose()[0]
        raw = [
            loads.wrench_sign * (a + b)
            for a, b in zip(wrench_ft, self._known_bias, strict=True)
        ]
        self.load_ee = loads.load_ee(raw, R)
        return self.load_ee


def _gap(q: Sequence[float], other: Sequence[float]) -> float:
    """Farthest that a joint is between two postures [rad or m]."""
    return max(abs(a - b) for a, b in zip(q, other, strict=True))
