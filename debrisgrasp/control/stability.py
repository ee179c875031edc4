r"""How compliant the hand may be before it swings against what it touches.

The loop through contact stiffness k, deflection gain, filter, delay and arm is

.. math:: L(z) = k \lambda\, H(z) A(z) z^{-d}, \quad H = a / (1 - (1 - a) z^{-1})

with A a second-order arm behind a zero-order hold. A faster filter lowers the bound:
its lag is what keeps the loop slow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import pi, sqrt
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import (
    FloatArray,
    as_floats,
    require_finite,
    require_metres,
    require_range,
)
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import so3

from .filters import WrenchFilter

__all__ = [
    "BESIDE",
    "ArmResponse",
    "Contact",
    "StabilityBound",
    "StabilityVerdict",
    "contact_gain",
]

_MAX_SENSITIVITY = 2.0
_ROUNDING = 1e-9
"""A compliance that rounding leaves below zero [m/N]."""
BESIDE = 0.1
"""So far from its origin a hand touches something with its edges and fingers [m]."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class ArmResponse:
    """How an arm follows its commands; the defaults are for one never measured."""

    frequency: float = 4.0
    """Natural frequency f_n [Hz]; a stiffer arm allows more compliance."""
    damping: float = 0.5
    """Damping ratio."""
    delay: int = 5
    """Periods between measurement and command, and command and motion."""

    def __post_init__(self) -> None:
        require_range("ArmResponse.frequency [Hz]", self.frequency, 0.1, 200.0)
        require_range("ArmResponse.damping", self.damping, 0.05, 0.99)
        require_range("ArmResponse.delay [periods]", self.delay, 0, 100)

    def held(self, period: float) -> tuple[float, float, float, float]:
        """Zero-order-hold equivalent: b1, b2 of the numerator, a1, a2 below it."""
        wn, zeta = 2.0 * pi * self.frequency, self.damping
        wd = wn * sqrt(1.0 - zeta * zeta)
        decay = float(np.exp(-zeta * wn * period))
        c, s = float(np.cos(wd * period)), float(np.sin(wd * period)) * zeta * wn / wd
        return (
            1.0 - decay * (c + s),
            decay * decay + decay * (s - c),
            -2.0 * decay * c,
            decay * decay,
        )


@dataclass(frozen=True, eq=False)
class StabilityBound:
    """Largest products of stiffness and compliance for one filter and one arm."""

    arm: ArmResponse
    filter: WrenchFilter

    def _loop(self, w: FloatArray, lag: float = 0.0) -> FloatArray:
        """Filter, arm and delay at angular frequencies w [rad/s]."""
        period, a = self.filter.period, self.filter.alpha
        z = np.exp(1j * w * period)
        if lag:
            s, wn = 1j * w, 2.0 * pi * self.arm.frequency
            arm = wn**2 / (s * s + 2.0 * self.arm.damping * wn * s + wn**2) * z**-lag
        else:
            b1, b2, a1, a2 = self.arm.held(period)
            arm = (b1 * z + b2) / (z * z + a1 * z + a2)
        return np.asarray(a / (1.0 - (1.0 - a) / z) * arm * z**-self.arm.delay)

    def _crossing(self, phase: float, lag: float = 0.0) -> float:
        """First angular frequency at which the loop's phase falls to a value [rad]."""
        nyquist = pi / self.filter.period
        w = np.linspace(1e-4, 0.999, 4000) * nyquist
        angle = np.unwrap(np.angle(self._loop(w, lag)))
        below = np.flatnonzero(angle < phase)
        if len(below) == 0:
            return float(w[-1])
        i = max(int(below[0]), 1)

        def gap(x: float) -> float:
            value = complex(self._loop(np.array([x]), lag)[0])
            return float(np.angle(value * np.exp(-1j * phase)))

        return _root(gap, w[i - 1], w[i], 1e-10)

    @cached_property
    def crossover(self) -> float:
        """Frequency f_pc [Hz] at which contact would begin to swing.

        The hand is passive only below it.
        """
        return self._crossing(-pi) / (2.0 * pi)

    @cached_property
    def gain_max(self) -> float:
        """Stiffness times compliance at which the loop oscillates without end."""
        w = np.array([2.0 * pi * self.crossover])
        return float(1.0 / np.abs(self._loop(w))[0])

    @cached_property
    def gain_safe(self) -> float:
        """Stiffness times compliance with the largest sensitivity at 2: enforced."""
        w = 2.0 * pi * self.crossover * np.linspace(0.02, 3.0, 6000)
        loop = self._loop(w)

        def excess(gain: float) -> float:
            return float(1.0 / np.abs(1.0 + gain * loop).min()) - _MAX_SENSITIVITY

        return _root(excess, 1e-9, 0.999 * self.gain_max, 1e-9)

    @cached_property
    def mass_gain_max(self) -> float:
        """Compliance times rigidly held mass at which it oscillates [m kg/N]."""
        # The force of a mass is felt while the arm moves, between two commands: the
        # hold counts as half a period of delay.
        w = self._crossing(-2.0 * pi, 0.5)
        return float(1.0 / (w * w * np.abs(self._loop(np.array([w]), 0.5))[0]))

    def verdict(
        self, gain: float, contact: Contact, mass_gain: float | None = None
    ) -> StabilityVerdict:
        """Judge a compliance against what the hand may touch.

        Parameters
        ----------
        gain
            `contact_gain` of the compliance [m/N].
        mass_gain
            The same where the held mass has its centre [m/N]; None: ``gain``.

        Raises
        ------
        ConfigError
            If one is no number, or below zero, of which every bound would be kept; if
            the contact is none.
        """
        if not isinstance(contact, Contact):
            raise ConfigError(
                "contact",
                got=repr(contact),
                expected="a Contact",
                mend="Contact(stiffness=3e4), for instance.",
            )
        mass_gain = gain if mass_gain is None else mass_gain
        for name, value in (("gain [m/N]", gain), ("mass_gain [m/N]", mass_gain)):
            is_number = isinstance(value, Real)
            if not is_number or value < -_ROUNDING:
                raise ConfigError(
                    name,
                    got=f"{value:g}" if is_number else repr(value),
                    expected="0 or more",
                    mend="`contact_gain` of a compliance is.",
                )
        stiffness = contact.effective_stiffness
        product, safe = stiffness * gain, self.gain_safe
        where = (
            f", up to {BESIDE:g} m beside the hand," if contact.lever is None else ""
        )
        numbers = (
            f"compliance {gain:.3g} m/N at the contact{where} times stiffness "
            f"{stiffness:.3g} N/m is {product:.3g}"
        )
        refusals, warnings = [], []
        # Written so that NaN is refused.
        if not product <= safe:
            refusals.append(
                f"{numbers}, above the bound {safe:.3g} (oscillation at "
                f"{self.gain_max:.3g}); stay at or below {safe / stiffness:.3g} m/N, "
                "or show by measurement that contact or arm is better"
            )
        elif product > 0.5 * safe:
            warnings.append(f"{numbers}, over half the bound {safe:.3g}")
        held = mass_gain * contact.mass
        if not held <= 0.5 * self.mass_gain_max:
            refusals.append(
                f"compliance times held mass {contact.mass:g} kg is {held:.3g}, above "
                f"half of {self.mass_gain_max:.3g} m kg/N, where it oscillates"
            )
        return StabilityVerdict(product, safe, tuple(refusals), tuple(warnings))


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """What the hand, or what it holds, is expected to touch."""

    stiffness: float | None = None
    """Of what is touched [N/m]; None: unknown, 3e4 is assumed for all together."""
    structure: float | None = None
    """Of arm, wrist and grip in series with it [N/m]; None: rigid."""
    lever: tuple[float, float, float] | None = None
    """From the hand to the point of contact, axes of base [m]; None: unknown, any
    within 0.1 m. A long lever turns a small rotation into a large yielding: it counts
    squared."""
    mass: float = 0.0
    """Held in the hand [kg]."""
    mass_lever: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """From the hand to its centre, axes of base [m]."""

    def __post_init__(self) -> None:
        for name in ("stiffness", "structure"):
            value = getattr(self, name)
            if value is not None:
                require_range(f"Contact.{name} [N/m]", value, 1.0, 1e9)
        require_range("Contact.mass [kg]", self.mass, 0.0, 1e4)
        for name in ("lever", "mass_lever"):
            if (value := getattr(self, name)) is not None:
                require_metres(f"Contact.{name} [m]", value)

    @property
    def effective_stiffness(self) -> float:
        """Contact and structure in series [N/m]."""
        if self.stiffness is None:
            return 3e4
        inverse = 1.0 / self.stiffness
        return 1.0 / (inverse + (1.0 / self.structure if self.structure else 0.0))

    @property
    def levers(self) -> FloatArray:
        """Those at which it may be, axes of base [m], shape (n, 3)."""
        if self.lever is not None:
            return np.array([self.lever])
        return BESIDE * np.concatenate([np.eye(3), -np.eye(3)])


@dataclass(frozen=True, slots=True)
class StabilityVerdict:
    """What the bound says about one compliance and one contact."""

    product: float
    """Stiffness times compliance."""
    bound: float
    """The largest product that is accepted."""
    refusals: tuple[str, ...]
    """Why it must not be used; empty if it may."""
    warnings: tuple[str, ...]


def contact_gain(tensor: ArrayLike, lever: ArrayLike = (0.0, 0.0, 0.0)) -> float:
    """Largest yielding of a contact point for a unit force [m/N]; of several, at worst.

    Parameters
    ----------
    tensor
        Compliance at the hand in the axes of base, shape (6, 6).
    lever
        From the hand to the contact, axes of base [m], shape (..., 3).

    Raises
    ------
    InputError
        If one of these has another shape, or any of the numbers is not finite.
    """
    C = as_floats(tensor, "compliance at the hand", (6, 6))
    r = as_floats(lever, "lever of a contact [m]", (3,))
    require_finite(C, "compliance at the hand")
    require_finite(r, "lever of a contact [m]")
    J = np.concatenate([np.broadcast_to(np.eye(3), (*r.shape, 3)), -so3.hat(r)], -1)
    return float(np.linalg.eigvalsh(J @ C @ np.swapaxes(J, -1, -2)).max())


def _root(
    function: Callable[[float], float], low: float, high: float, tolerance: float
) -> float:
    """Find where a function changes its sign."""
    from scipy.optimize import brentq  # slow to load

    return float(brentq(function, low, high, xtol=tolerance))
