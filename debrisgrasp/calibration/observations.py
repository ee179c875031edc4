"""What a calibration is fitted to: places of a fiducial by arm and by camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    frozen,
    require_range,
)
from debrisgrasp._words import counted
from debrisgrasp.errors import ConfigError, InputError, ShapeError
from debrisgrasp.geometry import SE3

from .plausibility import extent, likely_unit

__all__ = [
    "KINEMATIC_SIGMA",
    "MEASUREMENT_SIGMA",
    "Observations",
    "require_in_base",
]

MEASUREMENT_SIGMA = 0.0025
"""Standard deviation of a measured coordinate [m] where nothing better is known: that
of a depth camera at 1.2 m."""
KINEMATIC_SIGMA = 0.001
"""Standard deviation of a coordinate that forward kinematics gives [m]."""
_FARTHEST = 25.0
"""No arm and no depth camera of an arm reaches so far [m]; millimetres begin beyond."""
_MOST_KINEMATIC = 0.1
"""With more than any arm is off [m], every camera would explain the looks."""
_LARGEST = 1e6
"""In no unit a coordinate is more; squares of what is far more overflow."""


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """A fiducial, seen n times: on the arm, or by a camera that the arm carries.

    In the second case (`link` is given) that link takes the place of the base, and the
    base that of the link that carries the fiducial: both here and in what is fitted.

    Raises
    ------
    InputError
        If an array does not fit the others, holds NaN, looks like millimetres, lies
        behind the camera, or repeats a measurement.
    ConfigError
        If `kinematic_sigma` is none of an arm.
    """

    points_base: FloatArray
    """Where forward kinematics has the fiducial [m], shape (n, 3)."""
    points_camera: FloatArray
    """Where the camera sees it, optical frame [m], shape (n, 3)."""
    sigmas: ArrayLike = MEASUREMENT_SIGMA
    """Standard deviation of what the camera measures [m]: one number, one for each
    observation (n,), or one for each coordinate in the camera frame (n, 3)."""
    head: FloatArray | None = None
    """Readings of the joints that carry the camera [rad], shape (n, k)."""
    R_base_wrist: FloatArray | None = None
    """Attitude of the link that carries the fiducial, shape (n, 3, 3); lets its place
    on that link be estimated. Needed with `link`: that of the base in it."""
    names: tuple[str, ...] = ()
    """What to call each observation; numbers from 1 by default."""
    kinematic_sigma: float = KINEMATIC_SIGMA
    """Standard deviation of a coordinate of `points_base` [m], up to 0.1."""
    link: str | None = None
    """Link of the arm that carries the camera, while the fiducial stands still in base;
    None for a camera that no arm carries."""

    def __post_init__(self) -> None:
        base = frozen(self.points_base, self._places, (3,))
        camera = frozen(self.points_camera, "measured points", (3,))
        if base.ndim != 2 or base.shape != camera.shape:
            raise ShapeError(
                "observations",
                got=f"{base.shape} positions and {camera.shape} measured points",
                expected="both (n, 3)",
            )
        n = len(base)
        head = np.zeros((n, 0)) if self.head is None else self.head
        head = frozen(head, "readings of the head", (n, None))
        names = self.names or tuple(str(i) for i in range(1, n + 1))
        if len(names) != n:
            raise ShapeError("names", got=len(names), expected=f"{n}, or none")
        if self.R_base_wrist is not None:
            wrist = frozen(self.R_base_wrist, "attitudes of the wrist", (n, 3, 3))
            SE3.from_matrix(SE3.from_parts(wrist).matrix, "attitudes of the wrist")
            object.__setattr__(self, "R_base_wrist", wrist)
        elif self.link is not None:
            raise ConfigError(
                "R_base_wrist",
                got=f"none, and a camera that link {self.link!r} carries",
                expected=f"the attitude of base in {self.link!r} for each look",
            )
        object.__setattr__(self, "points_base", base)
        object.__setattr__(self, "points_camera", camera)
        object.__setattr__(self, "head", head)
        object.__setattr__(self, "names", tuple(names))
        object.__setattr__(self, "sigmas", _checked_sigmas(self.sigmas, names))
        most = _MOST_KINEMATIC
        require_range("kinematic_sigma [m]", self.kinematic_sigma, 0.0, most)
        _require_usable(self)

    def __repr__(self) -> str:
        words = counted(len(self), "look")
        if self.link is not None:
            words += f" from link {self.link}"
        if k := self.readings.shape[1]:
            words += f", head of {counted(k, 'joint')}"
        return f"<Observations of {words}>"

    def __len__(self) -> int:
        return len(self.points_base)

    @property
    def _places(self) -> str:
        return f"fiducial positions in {self.link or 'base'}"

    @property
    def readings(self) -> FloatArray:
        """Readings of the head, shape (n, k); k = 0 for a camera that stands still."""
        return np.asarray(self.head)

    @property
    def total_sigmas(self) -> FloatArray:
        """Standard deviation of the residuals by axis of the camera, (n, 3) [m]."""
        return np.asarray(np.hypot(np.asarray(self.sigmas), self.kinematic_sigma))

    def selected(self, index: BoolArray | IntArray | Sequence[int]) -> Observations:
        """Keep the observations that a mask (n,) or an array of indices (m,) names."""
        rows = np.arange(len(self))[np.asarray(index)]
        return replace(
            self,
            points_base=self.points_base[rows],
            points_camera=self.points_camera[rows],
            sigmas=np.asarray(self.sigmas)[rows],
            head=self.readings[rows],
            R_base_wrist=None if self.R_base_wrist is None else self.R_base_wrist[rows],
            names=tuple(self.names[i] for i in rows),
        )


def require_in_base(what: str, link: str | None) -> None:
    """Raise `ConfigError` if ``what`` is of a camera that a link of an arm carries."""
    if link is not None:
        raise ConfigError(
            what,
            got=f"one of a camera that link {link!r} carries",
            expected="one of a camera that no arm carries",
            mend="Where it is depends on the joints: T_base_camera = T_base_link @ "
            "T_link_camera. `plan` and `motion` compute it from --joints.",
        )


def _checked_sigmas(sigmas: ArrayLike, names: Sequence[str]) -> FloatArray:
    n = len(names)
    values = np.asarray(sigmas, dtype=np.float64)
    if values.shape == (n,):
        values = values[:, None]
    try:
        spread = np.broadcast_to(values, (n, 3))
    except ValueError as error:
        raise ShapeError(
            "sigmas", got=values.shape, expected=f"(), ({n},) or ({n}, 3)"
        ) from error
    bad = np.flatnonzero(~((spread > 0) & (spread < 1)).all(axis=1))
    if len(bad):
        row = spread[bad[0]]
        numbers = ", ".join(f"{x:g}" for x in (row[:1] if np.ptp(row) == 0 else row))
        more = f" and in {len(bad) - 1} more" if len(bad) > 1 else ""
        raise InputError(
            "sigma",
            got=f"{numbers} in observation {names[bad[0]]}{more}",
            expected="standard deviations above 0 and below 1 m",
            mend="A depth camera at 1.2 m has about 0.0025.",
        )
    return frozen(spread, "sigmas", (3,))


def _require_usable(given: Observations) -> None:
    if not len(given):
        raise InputError("observations", got="none", expected="at least one")
    for what, points in (
        (given._places, given.points_base),
        ("measured points", given.points_camera),
        ("readings of the head", given.readings),
    ):
        bad = np.flatnonzero(~(np.abs(points) <= _LARGEST).all(axis=1))
        if len(bad):
            raise InputError(
                what,
                got=f"NaN or infinity in observation {_listed(given, bad)}"
                if not np.isfinite(points).all()
                else f"{np.abs(points).max():g} in observation {_listed(given, bad)}",
                expected=f"finite numbers, at most {_LARGEST:g}",
                mend="Leave these observations out; depth at the fiducial is often "
                "missing, the median of a ring around it is not.",
            )
    for what, points, others in (
        (given._places, given.points_base, given.points_camera),
        ("measured points", given.points_camera, given.points_base),
    ):
        far = float(np.median(np.linalg.norm(points, axis=1)))
        if far > _FARTHEST:
            unit, name = likely_unit(_times_metres(points, others))
            raise InputError(
                f"median distance of {what}",
                got=f"{far:.4g} m",
                expected=f"at most {_FARTHEST:g} m",
                mend=f"These look like {name}: divide by {unit:g}.",
            )
    behind = np.flatnonzero(given.points_camera[:, 2] <= 0.0)
    if len(behind):
        raise InputError(
            "measured points",
            got=f"z <= 0 in observation {_listed(given, behind)}",
            expected="z > 0, in front of the camera",
            mend="Give them in the optical frame (x right, y down, z forward). Have "
            "the frames been swapped, or is x forward as in a link of a robot?",
        )
    _require_distinct(given)


def _times_metres(points: FloatArray, others: FloatArray) -> float:
    """How many times too large points are, by the others if those are metres."""
    far, near = (float(np.median(np.linalg.norm(p, axis=1))) for p in (points, others))
    if near <= _FARTHEST and extent(points) > 0.0 and extent(others) > 0.0:
        return extent(points) / extent(others)
    # An arm works about a metre away.
    return far


def _require_distinct(given: Observations) -> None:
    rows = np.concatenate([given.points_base, given.points_camera], axis=1)
    _, first, inverse = np.unique(
        rows.round(9), axis=0, return_index=True, return_inverse=True
    )
    earlier = first[inverse.reshape(-1)]
    copies = np.flatnonzero(earlier != np.arange(len(rows)))
    if len(copies):
        pairs = [(given.names[earlier[i]], given.names[i]) for i in copies[:3]]
        words = ", ".join(f"{a} and {b}" for a, b in pairs)
        raise InputError(
            "observations",
            got=f"{len(copies)} that repeat another number for number ({words})",
            expected="each measured anew",
            mend="Leave the copies out: they add nothing and would count twice.",
        )


def _listed(given: Observations, rows: IntArray) -> str:
    names = ", ".join(given.names[i] for i in rows[:5])
    return names + (f" and {len(rows) - 5} more" if len(rows) > 5 else "")
