"""What a compliance means, before the robot moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._checked import checked
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import DeflectionLimits

from ._rigid import parts
from .compliance import Compliance
from .filters import WrenchFilter
from .stability import (
    BESIDE,
    Contact,
    StabilityBound,
    StabilityVerdict,
    contact_gain,
)

__all__ = ["Preview", "preview"]

_AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Preview:
    """An operator's settings as motions of the hand."""

    compliance: Compliance
    T_base_ee: SE3
    """Where the hand is."""
    R_base_task: FloatArray
    """Axes of the task frame, shape (3, 3)."""
    pivot: FloatArray
    """Its origin seen from the hand, axes of base [m], shape (3,)."""
    force: float
    """Of the pushes shown [N]."""
    torque: float
    """Of the turns shown [N m]."""
    limits: DeflectionLimits
    pushed: FloatArray
    """Deflection of the hand (v, omega) for a push at it along x, y and z of the task
    frame, axes of base [m, rad], clamped, shape (3, 6)."""
    turned: FloatArray
    """The same for a turn about the axes of the task frame, shape (3, 6)."""
    lines: tuple[str, ...]
    """In plain words."""
    verdict: StabilityVerdict
    """Whether a contact would stay calm."""

    @property
    def text(self) -> str:
        """All lines as one text."""
        return "\n".join(self.lines)


@checked
def preview(
    compliance: Compliance,
    T_base_ee: SE3,
    *,
    bound: StabilityBound,
    contact: Contact | None = None,
    limits: DeflectionLimits | None = None,
    force: float = 30.0,
    torque: float = 5.0,
) -> Preview:
    """Say in words and numbers what the hand will do when it is pushed.

    Parameters
    ----------
    T_base_ee
        Pose of the hand for which to say it.
    bound
        Of the arm and filter that will be used; `LegController.bound`.
    contact
        What may be touched; None: the defaults.
    force, torque
        Of the examples [N], [N m].
    """
    limits, contact = limits or DeflectionLimits(), contact or Contact()
    R, p = (np.array(part) for part in compliance.frame.placed(*parts(T_base_ee)))
    axes = R.reshape(3, 3).T
    pushed = np.array(
        [_moved(compliance, T_base_ee, limits, force * axis, 0) for axis in axes]
    )
    turned = np.array(
        [_moved(compliance, T_base_ee, limits, torque * axis, 3) for axis in axes]
    )
    tensor = compliance.tensor_at_hand(T_base_ee)
    gain = contact_gain(tensor, contact.levers)
    held = contact_gain(tensor, contact.mass_lever)
    verdict = bound.verdict(gain, contact, held)
    lines = [_place(p, axes)]
    lines += [
        f"{force:g} N along {name} {_words(row, limits)}."
        for name, row in zip(_AXES, pushed, strict=True)
    ]
    lines += [
        f"{torque:g} N m about {name} {_words(row, limits)}."
        for name, row in zip(_AXES, turned, strict=True)
    ]
    settling = bound.filter.settling_time()
    lines.append(
        f"It has yielded to 95 % after {settling:.1f} s, and never faster than "
        f"{1000 * limits.translation_rate:.0f} mm/s or "
        f"{np.rad2deg(limits.rotation_rate):.0f} degrees/s."
    )
    lines.append(
        f"Forces below {compliance.dead_band_force:g} N and torques below "
        f"{compliance.dead_band_torque:g} N m don't move it."
    )
    at_origin = contact_gain(tensor) if contact.lever is None else gain
    lines.append(_calm(verdict, (at_origin, gain), bound.filter, contact))
    return Preview(
        compliance=compliance,
        T_base_ee=T_base_ee,
        R_base_task=axes.T,
        pivot=p,
        force=force,
        torque=torque,
        limits=limits,
        pushed=pushed,
        turned=turned,
        lines=tuple(lines),
        verdict=verdict,
    )


def _moved(
    compliance: Compliance,
    T_base_ee: SE3,
    limits: DeflectionLimits,
    vector: FloatArray,
    at: int,
) -> FloatArray:
    wrench = np.zeros(6)
    wrench[at : at + 3] = vector
    here = parts(T_base_ee)
    shortened = compliance.without_dead_band(tuple(wrench.tolist()))
    twist = np.array(
        compliance.deflection(
            shortened, here, here, (limits.translation, limits.rotation)
        )
    )
    gap, angle = float(np.linalg.norm(twist[:3])), float(np.linalg.norm(twist[3:]))
    inside = min(
        1.0, limits.translation / max(gap, 1e-12), limits.rotation / max(angle, 1e-12)
    )
    return np.asarray(inside * twist)


def _place(p: FloatArray, axes: FloatArray) -> str:
    distance = float(np.linalg.norm(p))
    words = "The hand yields about its own origin."
    if distance >= 1e-6:
        x, y, z = 1000 * p
        words = (
            f"The hand yields about a pivot {1000 * distance:.0f} mm away, at "
            f"({x:z.0f}, {y:z.0f}, {z:z.0f}) mm from it in the axes of base."
        )
    if np.allclose(axes, np.eye(3), atol=1e-6):
        return words
    named = (
        f"{name} ({row[0]:.2g}, {row[1]:.2g}, {row[2]:.2g})"
        for name, row in zip(_AXES, axes + 0.0, strict=True)
    )
    return f"{words} Its axes in base: {', '.join(named)}."


def _words(twist: FloatArray, limits: DeflectionLimits) -> str:
    gap, angle = float(np.linalg.norm(twist[:3])), float(np.linalg.norm(twist[3:]))
    pieces = []
    if gap >= 5e-5:
        pieces.append(f"moves the hand {1000 * gap:.3g} mm")
    if angle >= np.deg2rad(0.05):
        pieces.append(f"turns it {np.rad2deg(angle):.2g} degrees")
    if not pieces:
        return "moves nothing"
    words = " and ".join(pieces)
    if gap > 0.999 * limits.translation or angle > 0.999 * limits.rotation:
        words += " (as far as it may)"
    return words


def _number(value: float) -> str:
    """Three digits without an exponent."""
    return f"{float(f'{value:.3g}'):,.0f}"


def _calm(
    verdict: StabilityVerdict,
    gains: tuple[float, float],
    filter_: WrenchFilter,
    contact: Contact,
) -> str:
    if gains[1] <= 0.0:
        return "It is rigid: nothing makes it yield."
    near, beside = (_number(verdict.bound / max(gain, 1e-12)) for gain in gains)
    words = f"Against contacts up to {near} N/m it stays calm"
    if beside != near:
        words += f", {1000 * BESIDE:.0f} mm beside its origin up to {beside} N/m"
    words += f"; {_number(contact.effective_stiffness)} N/m is expected"
    if verdict.refusals:
        words += ": it would swing, and is refused"
    elif verdict.warnings:
        words += ": close"
    return (
        f"{words}. (A time constant of {filter_.tau:.2g} s; a longer one allows more.)"
    )
