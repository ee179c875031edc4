"""A new zero for the wrist sensor, taken only where free space is proven.

One pose can't tell contact from bias: 15 N of contact look like a bias of 15 N. In two
poses the bias stays with the sensor while a contact stays with the world.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray, finite, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import InputError

from .loads import MOST_NOISE, LoadModel
from .readings import BiasBound
from .refusals import Refusal, RefusalCause, refusals_of

__all__ = ["BaselineConfig", "BaselineLook", "BaselineVerdict", "judge_baseline"]

_SPENT = 0.1
"""Share of the sensor's range that the bias may use up."""
_MOST = {"noise_force": 10.0, "noise_torque": 1.0, "slack_force": 20.0}
_MOST |= {"slack_torque": 5.0, "angle": float(np.pi)}
"""Looks that may differ by more prove nothing [N, N m], and none turn farther [rad]."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class BaselineConfig:
    """What counts as proof."""

    clearance: float = 0.05
    """Between hand and everything else, ground included [m]."""
    duration: float = 1.0
    """Of each look [s]."""
    noise_force: float = 0.3
    """What looks may differ by for the noise of a usual sensor, one standard deviation
    [N]. That of a noisier one (`LoadModel.sensor_noise`) allows no more, for looks are
    means of many readings."""
    noise_torque: float = 0.01
    """[N m]."""
    angle: float = float(np.deg2rad(45.0))
    """Between the directions of gravity in two of the looks, at least [rad]."""
    slack_force: float = 1.0
    """Added to three standard deviations when looks are compared [N]."""
    slack_torque: float = 0.1
    """[N m]."""

    def __post_init__(self) -> None:
        for name in self.__slots__:
            most = _MOST.get(name, 1e6)
            require_range(f"BaselineConfig.{name}", getattr(self, name), 1e-9, most)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BaselineLook:
    """Readings in one posture, and what is known about it."""

    raw: FloatArray
    """As the sensor gave them [N, N m], shape (n, 6)."""
    R_base_ft: FloatArray
    """Orientation of the sensor, shape (3, 3)."""
    duration: float
    """Time the readings cover [s]."""
    clearance: float
    """Distance from hand to scene and ground [m]."""
    is_open_and_empty: bool
    """What the gripper reports."""
    is_standing: bool
    """Whether all joints stood still."""

    def __post_init__(self) -> None:
        raw = finite(self.raw, "readings of a baseline", (None, 6))
        object.__setattr__(self, "raw", raw)
        R = finite(self.R_base_ft, "orientation of the sensor", (3, 3))
        object.__setattr__(self, "R_base_ft", R)


@dataclass(frozen=True, slots=True, eq=False)
class BaselineVerdict:
    """The new bias, or why there is none."""

    bias: FloatArray | None
    """[N, N m], shape (6,); None if refused."""
    refusals: tuple[Refusal, ...]

    @property
    def is_accepted(self) -> bool:
        """Whether the bias may be used."""
        return self.bias is not None


def judge_baseline(
    looks: Sequence[BaselineLook],
    loads: LoadModel,
    commissioned_bias: FloatArray,
    *,
    age: float,
    drift: BiasBound | None = None,
    config: BaselineConfig | None = None,
) -> BaselineVerdict:
    """Decide whether looks at free space give a new bias.

    Parameters
    ----------
    looks
        At least two, with gravity from different sides.
    loads
        Tool and present bias.
    commissioned_bias
        Bias when the robot was put into service, shape (6,); small accepted steps must
        not add up to a large one.
    age
        Seconds since the present bias was found; it bounds how far it may have moved.

    Raises
    ------
    InputError
        If there are no looks.
    """
    if len(looks) == 0:
        raise InputError("looks for a baseline", got=0, expected="at least two")
    config, drift = config or BaselineConfig(), drift or BiasBound()
    refusals = [one for look in looks for one in _unfit(look, loads, config)]
    unbiased = loads.with_bias(np.zeros(6))
    biases = np.array(
        [unbiased.load_ft(look.raw.mean(axis=0), look.R_base_ft) for look in looks]
    )
    refusals += _disagreement(looks, biases, loads, config)
    bias = biases.mean(axis=0)
    allowed = np.repeat(drift.at(age), 3)
    for what, shift, most in (
        ("jump since the last baseline", bias - loads.bias, allowed),
        (
            "shift since commissioning",
            bias - commissioned_bias,
            _SPENT * np.repeat(loads.sensor_range, 3),
        ),
    ):
        over = np.abs(shift) / most
        if not over.max() <= 1.0:
            i = int(over.argmax())
            unit = "N" if i < 3 else "N m"
            words = f"{what} of {abs(shift[i]):.3g} {unit}, "
            words += f"expected at most {most[i]:.3g}"
            refusals.append(Refusal(RefusalCause.SHIFTED, words))
    if refusals:
        return BaselineVerdict(None, tuple(refusals))
    return BaselineVerdict(bias, ())


def _unfit(
    look: BaselineLook, loads: LoadModel, config: BaselineConfig
) -> list[Refusal]:
    """Why one look proves nothing."""
    words = []
    if not look.is_open_and_empty:
        words.append("the gripper does not report open and empty")
    if not look.is_standing:
        words.append("the arm does not stand still")
    if not look.clearance >= config.clearance:
        words.append(
            f"{1000 * look.clearance:.0f} mm of clearance, "
            f"expected {1000 * config.clearance:.0f}"
        )
    if not look.duration >= config.duration:
        words.append(f"{look.duration:g} s of readings, expected {config.duration:g}")
    scatter = look.raw.std(axis=0)
    noise = np.repeat(loads.sensor_noise, 3)
    if (scatter > 2.0 * noise).any():
        i = int((scatter / noise).argmax())
        words.append(
            f"noise of {scatter[i]:.3g} {'N' if i < 3 else 'N m'}, "
            f"expected at most {2.0 * noise[i]:.3g}: let the driver take the mean of "
            "several readings, or give the noise of the data sheet to "
            f"LoadModel(sensor_noise=...), up to {MOST_NOISE[0]:g} N and "
            f"{MOST_NOISE[1]:g} N m"
        )
    return refusals_of(RefusalCause.NO_PROOF, words)


def _disagreement(
    looks: Sequence[BaselineLook],
    biases: FloatArray,
    loads: LoadModel,
    config: BaselineConfig,
) -> list[Refusal]:
    """Why the looks together prove nothing."""
    down = loads.gravity / np.linalg.norm(loads.gravity)
    felt = np.array([look.R_base_ft.T @ down for look in looks])
    angle = float(np.arccos(np.clip(felt @ felt.T, -1.0, 1.0)).max())
    refusals = []
    if not angle >= config.angle:
        words = (
            f"orientations at most {np.rad2deg(angle):.0f} degrees apart, expected "
            f"{np.rad2deg(config.angle):.0f} or more between two"
        )
        refusals.append(Refusal(RefusalCause.NO_PROOF, words))
    spread = biases.max(axis=0) - biases.min(axis=0)
    sigma = np.repeat([config.noise_force, config.noise_torque], 3)
    slack = np.repeat([config.slack_force, config.slack_torque], 3)
    most = 3.0 * sigma + slack
    if (spread > most).any():
        i = int((spread / most).argmax())
        unit = "N" if i < 3 else "N m"
        words = (
            f"the orientations differ by {spread[i]:.3g} {unit}, expected at most "
            f"{most[i]:.3g}: the hand touches or holds something, the tool is not the "
            "one that was identified, or the sensor is turned otherwise than "
            "LoadModel.T_ee_ft says"
        )
        refusals.append(Refusal(RefusalCause.TOUCHED, words))
    return refusals
