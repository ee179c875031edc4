"""A wrist sensor that lies, or that feels what nobody sees."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import pi, sin

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import PostureKinematics
from debrisgrasp.kinematics import KinematicChain

from .interface import Limb, WrenchReading
from .spoiled import OnLine
from .spoiling import Live, Spoiling

__all__ = ["SpoiledSensor"]


_GAP = 0.008
"""From the hand to a wall that was not there [m]."""
_NEAR = 0.1
"""How far walls and what is stuck reach from the hand where they began [m]."""
_STUCK = 5e3
"""Stiffness of what is stuck [N/m]."""


class SpoiledSensor(OnLine):
    """A wrist sensor that lies, or feels what nobody sees."""

    def __init__(
        self, name: str, limb: Limb, chain: KinematicChain, spoiling: Spoiling
    ) -> None:
        super().__init__(name, "wrist sensor", spoiling)
        self._sensor, self._arm, self._loads = limb.sensor, limb.arm, limb.loads
        self._kinematics = PostureKinematics(chain)

    def read(self) -> WrenchReading:
        """Latest measurement, or what passes for it."""
        self.require_answer()
        reading = self._sensor.read()
        for live in self.spoiling.due(("sensor",), self.limb_name):
            live.times += 1
            age = self.spoiling.now() - (live.begins or 0.0)
            if live.fault in _LIES:
                reading = _LIES[live.fault](live, self.limb_name, age, reading)
            else:
                felt = self._felt(live, age)
                wrench = np.asarray(reading.wrench_ft, dtype=np.float64) + felt
                reading = WrenchReading(reading.time, wrench)
        return reading

    def _felt(self, live: Live, age: float) -> FloatArray:
        """Return what a load at the hand adds to the reading, shape (6,)."""
        R, p = self._kinematics.pose([float(value) for value in self._arm.read().q])
        R_base_ee, most = np.reshape(R, (3, 3)), self._arm.limits
        force, torque = np.zeros(3), np.zeros(3)
        if live.fault == "baseline_contact":
            force[0] = live.severity * min(age / 0.2, 1.0)
        elif live.fault == "ratchet":
            force[2] = -live.severity * most.force * min(age / 0.5, 1.0)
        elif live.fault == "too_heavy":
            force[2] = -self._stuck(live, np.array(p), live.severity * most.force)
        elif live.fault == "object_swings":
            torque[1] = live.severity * most.torque * sin(2.0 * pi * age)
        elif live.fault == "oscillation":
            force[0] = live.severity * most.force * sin(12.0 * pi * age)
        else:
            force = self._wall(live, R_base_ee, np.array(p))
        load_ee = np.concatenate([R_base_ee.T @ force, R_base_ee.T @ torque])
        in_ft = self._loads.T_ee_ft.inverse().map_wrench(load_ee)
        return np.asarray(self._loads.wrench_sign * in_ft)

    def _wall(self, live: Live, R: FloatArray, p: FloatArray) -> FloatArray:
        """Force of something that is nearer than it looked, in base, shape (3,)."""
        start, way = live.kept.setdefault(self.limb_name, (p, R[:, 2]))
        ahead = float(way @ (p - start))
        beside = float(np.linalg.norm(p - start - ahead * way))
        depth = ahead - _GAP if beside < _NEAR and ahead < _NEAR else 0.0
        return np.asarray(-live.severity * max(depth, 0.0) * way)

    def _stuck(self, live: Live, p: FloatArray, most: float) -> float:
        """Return the pull of what does not come up with the hand [N]."""
        start = live.kept.setdefault(self.limb_name, p)
        beside = float(np.hypot(*(p - start)[:2]))
        rise = float(p[2] - start[2]) if beside < _NEAR else 0.0
        return min(_STUCK * max(rise, 0.0), most)


def _nan(_: Live, __: str, ___: float, reading: WrenchReading) -> WrenchReading:
    return WrenchReading(reading.time, (float("nan"),) * 6)


def _frozen(live: Live, arm: str, _: float, reading: WrenchReading) -> WrenchReading:
    kept = live.kept.setdefault(arm, tuple(np.asarray(reading.wrench_ft).tolist()))
    return WrenchReading(reading.time, kept)


def _negated(_: Live, __: str, ___: float, reading: WrenchReading) -> WrenchReading:
    return WrenchReading(reading.time, -np.asarray(reading.wrench_ft))


def _biased(live: Live, _: str, age: float, reading: WrenchReading) -> WrenchReading:
    wrench = np.array(reading.wrench_ft, dtype=np.float64)
    share = 1.0 if live.fault == "bias_jump" else min(age / 5.0, 1.0)
    wrench[0] += share * live.severity
    return WrenchReading(reading.time, wrench)


def _pinned(live: Live, _: str, __: float, reading: WrenchReading) -> WrenchReading:
    wrench = np.array(reading.wrench_ft, dtype=np.float64)
    wrench[2] = live.severity
    return WrenchReading(reading.time, wrench)


def _disordered(live: Live, _: str, __: float, reading: WrenchReading) -> WrenchReading:
    late = live.severity * (0.5 + 0.5 * live.rng.random())
    return WrenchReading(reading.time - late, reading.wrench_ft)


_LIES: Mapping[str, Callable[[Live, str, float, WrenchReading], WrenchReading]] = {
    "wrench_nan": _nan,
    "wrench_frozen": _frozen,
    "wrench_sign": _negated,
    "bias_drift": _biased,
    "bias_jump": _biased,
    "sensor_saturated": _pinned,
    "clock_disorder": _disordered,
}
