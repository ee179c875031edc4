"""Accept or refuse a calibration by the error that it predicts, and say what helps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from debrisgrasp._arrays import BoolArray, FloatArray, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3, Bounds, so3

from .uncertainty import BEFORE_CAMERA, WORKSPACE, WorkspaceError

__all__ = ["CalibrationConfig", "Decision", "Evidence", "Finding", "decide"]

_LOOKS_UP = np.deg2rad(30.0)
"""No camera that looks at a workspace on the ground is turned up farther."""
_FLAT = 0.01
"""Places nearer to one plane than this [m] don't tell a fit from its mirror image."""
_LITTLE_TURNED = np.deg2rad(10.0)
"""Turns of a wrist that tell the place of a fiducial from that of the camera badly."""
_FEWEST_TO_BE_FLAT = 3
"""So many places or fewer lie in one plane always."""
_OUT_OF_PLANE = (
    "Add looks at least 0.1 m out of that plane, and check the sign of each coordinate"
)


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationConfig:
    """Limits of acceptance, and what models assume beforehand."""

    max_rms: float = 0.004
    """Largest predicted error over the workspace, root mean square [m]."""
    max_worst: float = 0.008
    """Largest predicted error at its worst corner [m]."""
    min_lever: float = 0.08
    """Least spread of the places about their worst axis [m]; below it the predicted
    error rests on the noise being exactly as stated."""
    min_places: int = 5
    """Fewest places that differ, for a camera whose mount is free."""
    min_places_known: int = 3
    """Fewest places if the mount is known from an earlier calibration."""
    min_places_fiducial: int = 8
    """Fewest places if the fiducial's place on its link is fitted too."""
    distinct: float = 0.02
    """Distance at which two places count as different [m]."""
    significance: float = 1e-3
    """How often noise alone may fail a test of chi-square: of a model, or of one
    observation among the others."""
    offset_sigma: float = 0.05
    """How far a joint of the head may have slipped [rad]."""
    fiducial_sigma: float = 0.02
    """How far the fiducial may sit from where the model has it [m]."""
    max_shift: float = 0.3
    """Farther from its nominal place no camera is by drift [m]."""
    max_turn: float = 0.35
    """Farther from its nominal attitude no camera is by drift [rad]."""
    workspace: Bounds | None = None
    """Where the predicted error is evaluated: in the base frame; in the camera frame of
    a camera that an arm carries. None: `WORKSPACE` or `BEFORE_CAMERA`."""

    def __post_init__(self) -> None:
        for name in ("max_rms", "max_worst", "offset_sigma", "fiducial_sigma"):
            require_range(name, getattr(self, name), 1e-6, 1.0)
        require_range("significance", self.significance, 1e-9, 0.2)
        require_range("min_lever", self.min_lever, 0.0, 1.0)
        require_range("min_places_known", self.min_places_known, 1)
        require_range("distinct", self.distinct, 1e-6, 1.0)
        require_range("max_shift", self.max_shift, 0.0, 10.0)
        require_range("max_turn", self.max_turn, 0.0, np.pi)
        if min(self.min_places, self.min_places_fiducial) < 4:
            raise ConfigError(
                "min_places, min_places_fiducial",
                got=(self.min_places, self.min_places_fiducial),
                expected="4 or more: three points fit whatever their error",
            )

    def workspace_of(self, link: str | None) -> Bounds:
        """Where the error of a camera counts that a link carries, or none (None)."""
        usual = WORKSPACE if link is None else BEFORE_CAMERA
        return self.workspace or usual

    def spared(self, n: int) -> int:
        """How many of n observations may be wrong picks."""
        return max(1, n // 4) if n >= 4 else 0


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that speaks against a calibration."""

    problem: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.problem}. {self.remedy}"


@dataclass(frozen=True, slots=True)
class Decision:
    """Whether to work with a calibration."""

    accepted: bool
    findings: tuple[Finding, ...]
    """Why not; empty if accepted."""
    notes: tuple[str, ...]
    """What is worth knowing in either case."""

    def __str__(self) -> str:
        if self.accepted:
            return "accepted"
        return "refused: " + "; ".join(f.problem for f in self.findings)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Evidence:
    """What a decision is made from."""

    names: tuple[str, ...]
    is_used: BoolArray
    places: FloatArray
    """Fiducial positions, base frame [m], shape (n, 3); in the camera frame of a camera
    that an arm carries."""
    link: str | None
    """The link that carries it; None for a camera that no arm carries."""
    turn: float
    """How far the used looks turn about the axis about which they do least [rad]."""
    has_prior: bool
    fiducial: FloatArray | None
    """Shift of the fiducial on its link [m], shape (3,); None if it was not fitted."""
    p_value: float
    noise_ratio: float
    """Size of the residuals in units of what the stated noise leaves."""
    error: WorkspaceError
    lever: float
    rmse: float
    T_base_camera: SE3
    nominal: SE3 | None


def decide(evidence: Evidence, config: CalibrationConfig) -> Decision:
    """Judge a calibration; the residual alone never passes or fails it."""
    findings = (
        *_too_few(evidence, config),
        *_too_uncertain(evidence, config),
        *_unexplained(evidence, config),
        *_below_ground(evidence),
        *_far_off(evidence, config),
        *_fiducial_elsewhere(evidence, config),
    )
    return Decision(not findings, findings, tuple(_notes(evidence, config)))


def _too_few(evidence: Evidence, config: CalibrationConfig) -> Iterator[Finding]:
    n, n_used = len(evidence.is_used), int(evidence.is_used.sum())
    if n - n_used > config.spared(n):
        dropped = [evidence.names[i] for i in np.flatnonzero(~evidence.is_used)]
        yield Finding(
            f"{n - n_used} of {n} observations don't agree with the others "
            f"({', '.join(dropped)})",
            "Look at those picks; if they are right, something moves that should not: "
            "a loose camera, a loose fiducial, a joint read late",
        )
    wanted = config.min_places
    if evidence.has_prior:
        wanted = config.min_places_known
    elif evidence.fiducial is not None:
        wanted = config.min_places_fiducial
    found = n_distinct(evidence.places[evidence.is_used], config.distinct)
    if found < wanted:
        yield Finding(
            f"{found} different places agree, {wanted} are needed",
            f"Measure {wanted - found} more: `debrisgrasp calibrate choose` says where",
        )


def _too_uncertain(evidence: Evidence, config: CalibrationConfig) -> Iterator[Finding]:
    more = "Add places: `debrisgrasp calibrate choose` says where and how many"
    if not evidence.has_prior and evidence.lever < config.min_lever:
        yield Finding(
            f"the places lie within {1e3 * evidence.lever:.1f} mm of a line "
            f"({1e3 * config.min_lever:.0f} mm needed): clustered or in a row",
            "Spread them over the workspace, in depth and height too. " + more
            if evidence.link is None
            else "Have the fiducial all over the picture, near and far. " + more,
        )
    error = evidence.error
    if error.rms > config.max_rms:
        yield Finding(
            f"predicted error {1e3 * error.rms:.1f} mm over the workspace exceeds "
            f"{1e3 * config.max_rms:g} mm",
            more,
        )
    if error.worst > config.max_worst:
        x, y, z = error.worst_at
        yield Finding(
            f"predicted error {1e3 * error.worst:.1f} mm at the corner "
            f"({x:.2f}, {y:.2f}, {z:.2f})"
            + ("" if evidence.link is None else " of the camera frame")
            + f" exceeds {1e3 * config.max_worst:g} mm",
            more,
        )
    is_vague = error.rms > config.max_rms or error.worst > config.max_worst
    if is_vague and evidence.link is not None and evidence.turn < _LITTLE_TURNED:
        yield Finding(
            f"{evidence.link} is turned by {np.rad2deg(evidence.turn):.0f} deg only "
            "about the axis about which the looks turn it least: the place of the "
            "fiducial can't be told from that of the camera",
            "Turn the wrist by 20 deg or more about two axes between the looks",
        )


def _unexplained(evidence: Evidence, config: CalibrationConfig) -> Iterator[Finding]:
    if evidence.p_value < config.significance:
        yield Finding(
            f"residuals are {evidence.noise_ratio:.1f} times what the stated noise "
            f"leaves (RMSE {1e3 * evidence.rmse:.1f} mm)",
            "Measure again with everything at rest; if they stay so large, state a "
            "larger sigma: the predicted error grows with it",
        )


def _looking_up(evidence: Evidence) -> Iterator[Finding]:
    elevation = float(np.arcsin(np.clip(evidence.T_base_camera.R[2, 2], -1.0, 1.0)))
    if evidence.nominal is None and elevation > _LOOKS_UP:
        yield Finding(
            f"the camera comes out looking up by {np.rad2deg(elevation):.0f} degrees, "
            "which shows no workspace on the ground",
            "Give `position` in the base frame (x forward, y left, z up), and `point` "
            "in the camera's optical frame (x right, y down, z forward), not in that "
            "of a body, which has x forward",
        )


def _below_ground(evidence: Evidence) -> Iterator[Finding]:
    if evidence.link is not None:
        return  # in the frame of a link z is no height
    height, nominal = float(evidence.T_base_camera.p[2]), evidence.nominal
    # In the frame of a wrist z is no height, and a camera may well sit behind.
    is_below = height < 0.0 and (nominal is None or float(nominal.p[2]) >= 0.0)
    # An upright camera's y axis points down, that of one that looks down is level.
    is_flipped = (
        nominal is None  # else the distance from it tells
        and _is_flat(evidence)
        and float(evidence.T_base_camera.R[2, 1]) > 0.2
    )
    if not is_below and not is_flipped:
        yield from _looking_up(evidence)
        return
    problem = (
        f"the camera comes out {-height:.2f} m below the ground"
        if is_below
        else "the camera comes out upside down"
    )
    if _is_flat(evidence):
        yield Finding(
            f"{problem}, and the places lie in one plane within "
            f"{1e3 * _off_plane(evidence):.1f} mm: one coordinate may be mirrored, "
            "which fits a plane as well",
            _OUT_OF_PLANE,
        )
    else:
        yield Finding(
            problem,
            "Check the axes of both frames (base: z up, 0 at the ground; optical: x "
            "right, y down, z forward)",
        )


def _is_flat(evidence: Evidence) -> bool:
    is_enough = int(evidence.is_used.sum()) > _FEWEST_TO_BE_FLAT
    return is_enough and _off_plane(evidence) < max(_FLAT, 3.0 * evidence.rmse)


def _off_plane(evidence: Evidence) -> float:
    """Root mean square distance of the used places from their best plane [m]."""
    used = evidence.places[evidence.is_used]
    offsets = used - used.mean(axis=0)
    least = np.linalg.eigvalsh(offsets.T @ offsets)[0]
    return float(np.sqrt(max(least, 0.0) / len(used)))


def _far_off(evidence: Evidence, config: CalibrationConfig) -> Iterator[Finding]:
    if evidence.nominal is None:
        return
    shift, turn = _from_nominal(evidence.T_base_camera, evidence.nominal)
    if shift > config.max_shift or turn > config.max_turn:
        yield Finding(
            f"the camera comes out {1e3 * shift:.0f} mm and {np.rad2deg(turn):.0f} deg "
            "from where the model has it",
            (f"{_OUT_OF_PLANE}. " if _is_flat(evidence) else "")
            + "Check the frame of the measured points (optical: x right, y down, z "
            "forward), "
            + (
                "the link that carries the fiducial"
                if evidence.link is None
                else "the fiducial's place in base"
            )
            + ", and the joints' order",
        )


def _fiducial_elsewhere(
    evidence: Evidence, config: CalibrationConfig
) -> Iterator[Finding]:
    """Tell of a place on the ground that pulls the fit where it should not."""
    if evidence.link is None or evidence.fiducial is None:
        return
    sigma = config.fiducial_sigma
    if (
        evidence.fiducial @ evidence.fiducial
        > chdtri(3, config.significance) * sigma**2
    ):
        yield Finding(
            f"{_stands(evidence.fiducial)}, which was to be right within "
            f"{1e3 * sigma:g} mm",
            "Measure its place in base again (x forward, y left, z up), or state a "
            "larger `fiducial_sigma`",
        )


def _stands(shift: FloatArray) -> str:
    x, y, z = 1e3 * shift
    return (
        f"the fiducial stands {1e3 * np.linalg.norm(shift):.0f} mm from where it was "
        f"said to be, by ({x:.0f}, {y:.0f}, {z:.0f}) mm in base"
    )


def _notes(evidence: Evidence, config: CalibrationConfig) -> Iterator[str]:
    n, n_used = len(evidence.is_used), int(evidence.is_used.sum())
    if 0 < n - n_used <= config.spared(n):
        dropped = [evidence.names[i] for i in np.flatnonzero(~evidence.is_used)]
        yield f"left out as a wrong pick: {', '.join(dropped)}"
    if evidence.fiducial is not None and evidence.link is not None:
        if not any(_fiducial_elsewhere(evidence, config)):
            yield _stands(evidence.fiducial)
    elif evidence.fiducial is not None:
        shift = float(np.linalg.norm(evidence.fiducial))
        x, y, z = 1e3 * evidence.fiducial
        doubt = "; is it on the link that was named?"
        yield (
            f"the fiducial sits {1e3 * shift:.0f} mm from where the model has it, by "
            f"({x:.0f}, {y:.0f}, {z:.0f}) mm on its link"
            + (doubt if shift > 2.0 * config.fiducial_sigma else "")
        )
    if 1.0 - evidence.p_value < config.significance:
        yield (
            f"residuals are only {evidence.noise_ratio:.2f} times what the stated "
            "noise leaves: sigma is stated too large, or the looks are not independent"
        )
    if _is_flat(evidence):
        yield (
            "the places lie in one plane: a mirrored coordinate would not show; a look "
            "out of that plane would show it"
        )
    if evidence.nominal is not None:
        shift, turn = _from_nominal(evidence.T_base_camera, evidence.nominal)
        yield (
            f"the camera is {1e3 * shift:.1f} mm and {np.rad2deg(turn):.2f} deg from "
            "where it was thought to be"
        )


def n_distinct(places: FloatArray, distance: float) -> int:
    """How many places (n, 3) are left if near ones count once."""
    left, found = places, 0
    while len(left):
        left = left[np.linalg.norm(left - left[0], axis=1) > distance]
        found += 1
    return found


def _from_nominal(T_base_camera: SE3, nominal: SE3) -> tuple[float, float]:
    shift = float(np.linalg.norm(T_base_camera.p - nominal.p))
    turn = float(np.linalg.norm(so3.log(nominal.R.T @ T_base_camera.R)))
    return shift, turn
