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

_SLACK = 1.02
"""A step may exceed the acceleration by rounding."""
_SLOW = 0.05
"""An arm that is sent on more slowly stands [rad/s or m/s]."""


class SimArm(FakeArm):
    """Joints that follow as far as physics lets them; `debrisgrasp.robot.Arm`.

    Commands are taken, refused and held as `FakeArm` does; what comes of them within
    the limits is what the servo of the joints is to follow. What is read is measured.
    """

    _measured: tuple[float, ...] | None = None
    _gaps = (0.0, 0.0, 0.0)

    @property
    def q(self) -> tuple[float, ...]:
        """Measured posture [rad or m]; where it starts until there is one."""
        return super().q if self._measured is None else self._measured

    def _check_rates(
        self, rate: Sequence[float], before: Sequence[float], dt: float
    ) -> None:
        """Take note of jumps, but for those from where it was sent to where it is.

        Whoever begins anew begins with the posture that was measured: that weight kept
        an arm that stands a little from where it was sent is no jump of the command.
        """
        last = self.q if self._commanded is None else self._commanded[1]
        gap = max(abs(a - b) for a, b in zip(last, self.q, strict=True))
        self._gaps = (*self._gaps[1:], gap)
        known = len(self._violations)
        super()._check_rates(rate, before, dt)
        if len(self._violations) == known or max(map(abs, before)) > _SLOW:
            return
        excess = 2.0 * max(self._gaps) / dt
        if all(
            abs(new - old) <= _SLACK * gain * dt + excess
            for new, old, gain in zip(rate, before, self._acceleration, strict=True)
        ):
            del self._violations[known:]

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
