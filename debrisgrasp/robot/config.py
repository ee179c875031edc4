"""How the robot in memory behaves, and how wrong its devices are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from debrisgrasp._arrays import require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp.control.loads import MOST_NOISE
from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.geometry import SE3, Intrinsics
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.worlds import RestConfig, StereoNoise

__all__ = ["FakeConfig"]

_D435 = Intrinsics(fx=168.6, fy=168.6, cx=159.5, cy=89.5, width=320, height=180)
"""The depth imager of a D435 (87 by 56 degrees) at a quarter of its resolution."""
_USUAL_NOISE = (0.3, 0.01)


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class FakeConfig:
    """Settings of a `FakeRobot`; the defaults are those of a robot in good order."""

    period: float = 0.004
    """In which the world advances [s]."""
    watchdog: float = 0.1
    """Without a command for so long an arm holds by itself [s]."""
    engage_time: float = 0.02
    """From asking the drives to follow until they do [s]."""
    start: Mapping[str, str | Mapping[str, float]] = field(default_factory=dict)
    """Where arms begin: a posture by its name, or joint values by theirs [rad or m].
    Arms not named are ``idle``."""

    intrinsics: Intrinsics = _D435
    noise: StereoNoise | None = StereoNoise()
    """Errors of the depth; None: exact."""
    sees_itself: bool = True
    """Whether arms and hands are in the picture."""
    calibration_error: SE3 = field(default_factory=SE3.identity)
    """``T_nominal_camera``: where the camera is, seen from where it should be."""
    max_depth: float = 6.0
    """[m]."""

    bias: tuple[float, ...] = (4.0, -2.0, 7.0, 0.1, -0.05, 0.05)
    """Reading of a wrist sensor without any force [N, N m]; the `LoadModel` knows."""
    drift: tuple[float, float] = (1.0, 0.05)
    """How fast the bias drifts from there, in a direction drawn once [N/h, N m/h]."""
    sensor_noise: tuple[float, float] = _USUAL_NOISE
    """Standard deviations [N, N m]; the `LoadModel` knows, as far as it may be told."""
    sensor_lag: float = 0.012
    """Time constant of the wrist sensor and what carries it [s]."""
    wrench_sign: float = 1.0
    """-1: the driver reports what the hand exerts."""
    sensor_range: tuple[float, float] = (660.0, 60.0)
    """Each axis ends there [N, N m]."""

    stiffness: float = 3e4
    """Of a contact at a hand whose arm stands: that of the surfaces, and the bending of
    the arm, in series [N/m]."""
    contact_stiffness: float = 1e5
    """Of the surfaces alone, as fingers feel it that press against each other [N/m]."""
    turn_stiffness: float = 1e4
    """Of an arm against a turn of its hand: far beside that a contact is felt softer
    [N m/rad]."""
    friction: float = 0.6
    """Between bodies, ground and fingers."""
    finger_speed: float = 0.1
    """At which a pad moves [m/s]."""
    is_initialised: bool = False
    """Whether the hands begin with their zero found."""
    initialise_time: float = 0.5
    """[s]."""

    head_speed: float = 1.0
    """Of pan and tilt, if the model gives no less [rad/s]."""
    base_speed: tuple[float, float] = (0.5, 0.6)
    """Largest speed and rate of the base [m/s, rad/s]."""
    base_acceleration: tuple[float, float] = (0.5, 1.0)
    """[m/s^2, rad/s^2]."""
    base_watchdog: float = 0.5
    """Without a command for so long the base stands by itself [s]."""

    rest: RestConfig = RestConfig(pitch=0.04, step=0.01, max_steps=200)
    """How bodies come to rest that lost their support."""
    removed_beyond: float = 0.3
    """A body put down at least so far from where it began counts as removed [m]."""

    def __post_init__(self) -> None:
        require_range("FakeConfig.period", self.period, 1e-4, 0.1)
        times = ("watchdog", "engage_time", "initialise_time", "sensor_lag")
        for name in (*times, "base_watchdog"):
            require_range(f"FakeConfig.{name}", getattr(self, name), 0.0, 60.0)
        for name in ("max_depth", "finger_speed", "head_speed"):
            require_range(f"FakeConfig.{name}", getattr(self, name), 1e-6, 1e9)
        require_range("FakeConfig.contact_stiffness", self.contact_stiffness, 1.0, 1e7)
        require_range("FakeConfig.turn_stiffness", self.turn_stiffness, 1.0, 1e9)
        most = 0.999 * self.contact_stiffness
        require_range("FakeConfig.stiffness", self.stiffness, 0.1, most)
        require_range("FakeConfig.friction", self.friction, 0.0, 10.0)
        require_range("FakeConfig.removed_beyond", self.removed_beyond, 0.0, 1e3)
        if self.wrench_sign not in (1.0, -1.0):
            raise ConfigError(
                "FakeConfig.wrench_sign", got=self.wrench_sign, expected="1 or -1"
            )
        pairs = ("drift", "sensor_noise", "sensor_range", "base_speed")
        for name in (*pairs, "base_acceleration", "bias"):
            values = getattr(self, name)
            n = 6 if name == "bias" else 2
            if len(values) != n:
                raise ConfigError(
                    f"FakeConfig.{name}", got=values, expected=f"{n} numbers"
                )
            for value in values:
                least = -1e4 if name == "bias" else 0.0
                require_range(f"FakeConfig.{name}", value, least, 1e4)

    def start_of(self, model: RobotModel, arm: str) -> Mapping[str, float]:
        """Return where joints of an arm begin [rad or m]; the others are at zero.

        Raises
        ------
        UnknownNameError
            If an arm, a posture or a joint in `start` is not the robot's.
        """
        for name in self.start:
            model.arm(name)
        start = self.start.get(arm, model.arm(arm).idle)
        if isinstance(start, str):
            return model.posture(arm, start)
        joints = model.chain(arm).joint_names
        for name in start:
            if name not in joints:
                raise UnknownNameError(f"joint of arm {arm} to start at", name, joints)
        return start

    @property
    def stated_noise(self) -> tuple[float, float]:
        """What a `LoadModel` says of the noise of a wrist sensor [N, N m].

        It is the usual one, or more, as far as that may be said.
        """
        force, torque = np.clip(self.sensor_noise, _USUAL_NOISE, MOST_NOISE).tolist()
        return force, torque

    def stiffness_at(self, lever: float) -> float:
        """Of a contact so far beside a hand whose arm stands [m], in N/m."""
        return 1.0 / (1.0 / self.stiffness + lever**2 / self.turn_stiffness)

    @property
    def arm_stiffness(self) -> float:
        """Of an arm at its hand [N/m]."""
        return 1.0 / (1.0 / self.stiffness - 1.0 / self.contact_stiffness)
