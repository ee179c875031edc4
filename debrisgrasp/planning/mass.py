"""What an object may weigh, and where its middle is, by what was seen of it.

A depth image weighs nothing. What it shows is how much surface there is, how thick the
object can be, and whether one looks into it; with the densities of debris this bounds
the mass to about one order of magnitude.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, require_finite, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp._physics import GRAVITY
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.geometry import hull_volume

__all__ = ["Build", "LoadConfig", "ObjectMass", "SeenSurface", "likely_objects"]

Interval = tuple[float, float]
"""Lower and upper bound."""

_OUTLIERS = 0.02
"""Share of the points at each end of an axis that the extent leaves out."""
_FLOOR = 1e-9
"""Keeps quotients finite; far below every length."""
_MOST_PARTS = 4
"""So many likely parts of an object are told apart, the likeliest first."""
_END = 0.03
"""So much of an axis tells whether it goes on [m]."""
_HIDDEN = 0.1
"""Pieces of debris go on for so long behind what hides them, on average [m]. Half the
ends that seem hidden are ends all the same."""
_SEEN_IN_PART = 2.0
"""So much wider than by its seen surface alone the mass is spread [of the log]."""
_UNLIKELY = 0.1
"""What is less likely than this to be part of an object is left out."""


class Build(Enum):
    """How an object is made, as far as its surface tells."""

    SOLID = "solid"
    """Closed on all sides seen: massive, or a closed shell."""
    HOLLOW = "hollow"
    """One looks into it or through it: vessels, tubes, frames, pallets."""
    SHEET = "sheet"
    """Flat and thin."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class LoadConfig:
    """What debris may weigh, and what fingers hold."""

    density: Interval = (300.0, 2200.0)
    """Mass per volume of massive objects: light wood, and concrete [kg/m^3]."""
    shell: float = 5.0
    """Least mass per seen surface of a closed object, which may be empty [kg/m^2]."""
    walls: Interval = (2.5, 60.0)
    """Mass per seen surface of hollow objects: a plastic crate, and a cinder block
    [kg/m^2]."""
    sheet: Interval = (4.0, 40.0)
    """Mass per seen surface of sheets: plywood, and steel plate [kg/m^2]."""
    wall_density: float = 800.0
    """Mass of hollow objects over seen surface times thickness of the walls [kg/m^3]:
    blocks of concrete are at 900, crates of plastic at 500."""
    thin: float = 0.03
    """Objects are sheets if they are no thicker than this [m]."""
    inward: float = 0.12
    """Objects are hollow if so much of their surface faces their own middle."""
    typical: Interval = (0.5, 8.0)
    """Most pieces weigh this much [kg]: of a wide estimate the likelier part is within;
    what is outside is only less likely."""
    friction: Interval = (0.4, 0.8)
    """Coefficient of friction between pads and object."""
    patch: float = 0.02
    """Half the size of a finger's contact [m]; larger holds more torque."""
    gravity: float = GRAVITY
    """Acceleration of free fall [m/s^2]."""

    def __post_init__(self) -> None:
        for name in ("density", "walls", "sheet", "friction", "typical"):
            low, high = getattr(self, name)
            if not 0 < low <= high < np.inf:
                raise ConfigError(
                    f"LoadConfig.{name}",
                    got=(low, high),
                    expected="0 < least <= greatest",
                )
        for name in ("shell", "wall_density", "inward", "gravity"):
            require_range(f"LoadConfig.{name}", getattr(self, name), 1e-6, 1e6)
        for name in ("thin", "patch"):
            require_range(f"LoadConfig.{name} [m]", getattr(self, name), 1e-6, 1.0)

    @property
    def expected_friction(self) -> float:
        """Geometric mean of the bounds of friction."""
        low, high = self.friction
        return float(np.sqrt(low * high))


@dataclass(frozen=True, slots=True, eq=False)
class SeenSurface:
    """What was seen of an object, and of what may be part of it; one row a cell."""

    points: FloatArray
    """[m], shape (n, 3)."""
    normals: FloatArray
    """Unit vectors, or NaN, shape (n, 3)."""
    belongs: FloatArray
    """Probability that each is part of the object, in [0, 1], shape (n,); 1 for what
    certainly is."""
    goes_on: BoolArray
    """Where the object may go on out of sight: beside something nearer, or where the
    image ends; shape (n,)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ObjectMass:
    """Mass and centre of mass of one object, each with bounds."""

    build: Build
    mass: Interval
    """[kg]."""
    expected_mass: float
    """[kg]; within the bounds."""
    com: FloatArray
    """Estimated centre of mass [m], base frame, shape (3,)."""
    spread: FloatArray
    """How far it may be off: columns are the half axes of an ellipsoid [m], base
    frame, shape (3, 3)."""
    walls: float = 0.0
    """What it weighs for each metre that its walls are thick, as far as seen [kg/m]; 0
    if it has none, or if its mass is known."""
    probability: float = 1.0
    """That the object is this one; see `likely_objects`."""

    @classmethod
    def from_surface(
        cls,
        points: FloatArray,
        normals: FloatArray,
        viewpoint: FloatArray,
        config: LoadConfig,
        *,
        spacing: float,
        mass: float | None = None,
        goes_on: BoolArray | None = None,
    ) -> ObjectMass:
        """Estimate from the visible surface.

        An end that goes on out of sight draws the centre of mass to it.

        Parameters
        ----------
        points, normals
            One for each cell of the surface, shapes (n, 3); normals may be NaN.
        viewpoint
            Where the camera is, shape (3,).
        spacing
            Edge of the cells [m].
        mass
            What it weighs [kg], if that is known.
        goes_on
            See `SeenSurface`; None: nowhere.

        Raises
        ------
        InputError
            If there is no point, a value is not finite, or the mass is not above zero.
        """
        if len(points) == 0:
            raise InputError("points of the object", got=0, expected="at least one")
        require_finite(points, "points of the object")
        if mass is not None and not 0 < mass < np.inf:
            raise InputError("mass of the object [kg]", got=mass, expected="above zero")
        mean = points.mean(axis=0)
        offsets = points - mean
        axes = np.linalg.eigh(offsets.T @ offsets)[1][:, ::-1]
        along = offsets @ axes
        low, high = np.quantile(along, [_OUTLIERS, 1 - _OUTLIERS], axis=0)
        middle, extents = mean + axes @ (low + high) / 2, high - low
        build = _build(points - middle, normals, float(extents[2]), config)
        walls = 0.0
        if mass is not None:
            bounds, expected = (float(mass), float(mass)), float(mass)
        else:
            inside = ((along >= low) & (along <= high)).all(axis=1)
            area = len(points) * spacing**2
            bounds = _mass_bounds(build, points[inside], extents, area, config, spacing)
            if build is Build.HOLLOW:
                walls = config.wall_density * area
            expected = _expected(bounds, config.typical)
            bounds = min(bounds[0], expected), max(bounds[1], expected)
        ends = _hidden_ends(along, low, high, goes_on)
        # The side that was not seen is farther from the camera.
        sight = middle - viewpoint
        sight = sight / max(float(np.linalg.norm(sight)), _FLOOR)
        return cls(
            build=build,
            mass=bounds,
            expected_mass=expected,
            walls=walls,
            com=middle + 0.2 * extents[2] * sight + axes @ (ends[1] - ends[0]) / 2,
            spread=axes
            * np.hypot(np.array([0.15, 0.2, 0.35]) * extents + 0.01, ends.sum(axis=0)),
        )

    @property
    def com_error(self) -> float:
        """How far the centre of mass may be off in the worst direction [m]."""
        return float(np.linalg.norm(self.spread, 2))

    @property
    def level_error(self) -> float:
        """How far it may be off horizontally [m]."""
        return float(np.linalg.norm(self.spread[:2], 2))


def likely_objects(
    surface: SeenSurface,
    viewpoint: FloatArray,
    config: LoadConfig,
    *,
    spacing: float,
    mass: float | None = None,
) -> tuple[ObjectMass, ...]:
    """Estimate what an object may be: alone, or with more and more of its likely parts.

    Segmentation rather divides one object than joins two, and knows how likely it was
    wrong. Parts are taken to go together: what is less likely to belong to the object
    only does if all that is likelier does.

    Parameters
    ----------
    viewpoint, spacing, mass
        See `ObjectMass.from_surface`.

    Returns
    -------
    tuple of ObjectMass
        One at least, the smallest first; their probabilities add up to 1.

    Raises
    ------
    InputError
        As `ObjectMass.from_surface`; and if no point certainly belongs to the object.
    """
    levels = np.unique(surface.belongs)[::-1]
    levels = levels[levels >= _UNLIKELY][: _MOST_PARTS + 1]
    if not len(levels) or levels[0] < 1.0:
        raise InputError(
            "points of the object", got="none that is certain", expected="at least one"
        )
    objects = []
    for level, share in zip(levels, -np.diff(levels, append=0.0), strict=True):
        kept = surface.belongs >= level
        found = ObjectMass.from_surface(
            surface.points[kept],
            surface.normals[kept],
            viewpoint,
            config,
            spacing=spacing,
            mass=mass,
            goes_on=surface.goes_on[kept],
        )
        objects.append(replace(found, probability=float(share)))
    return tuple(objects)


def _hidden_ends(
    along: FloatArray, low: FloatArray, high: FloatArray, goes_on: BoolArray | None
) -> FloatArray:
    """How far the two longer axes go on out of sight at their ends [m].

    Parameters
    ----------
    along
        Points along the axes [m], shape (n, 3).
    low, high
        Where the axes end [m], shape (3,).

    Returns
    -------
    FloatArray
        At the lower and at the upper ends, shape (2, 3).
    """
    ends = np.zeros((2, 3))
    if goes_on is None or not goes_on.any():
        return ends
    for axis in range(2):
        is_low = along[:, axis] < low[axis] + _END
        is_high = along[:, axis] > high[axis] - _END
        ends[:, axis] = goes_on[is_low].mean(), goes_on[is_high].mean()
    return _HIDDEN * ends


def _build(
    offsets: FloatArray, normals: FloatArray, thickness: float, config: LoadConfig
) -> Build:
    """Class of an object by its surface, given relative to its middle (n, 3)."""
    is_known = np.isfinite(normals[:, 0])
    away = np.linalg.norm(offsets[is_known], axis=1)
    facing = (offsets[is_known] * normals[is_known]).sum(axis=1)
    if is_known.any() and np.mean(facing < -0.2 * away) > config.inward:
        return Build.HOLLOW
    return Build.SHEET if thickness <= config.thin else Build.SOLID


def _mass_bounds(
    build: Build,
    points: FloatArray,
    extents: FloatArray,
    area: float,
    config: LoadConfig,
    spacing: float,
) -> Interval:
    """Bounds on the mass [kg] from the extent of the visible surface."""
    size = np.maximum(extents, spacing)
    most = config.density[1] * float(size.prod())
    if build is Build.HOLLOW:
        low, high = config.walls[0] * area, config.walls[1] * area
    elif build is Build.SHEET:
        low, high = config.sheet[0] * area, config.sheet[1] * area
    else:
        # What comes out flat, as in coarse steps of depth, is a cell thick.
        hull = hull_volume(points) or area * spacing
        low = min(config.shell * area, config.density[0] * hull)
        # Of a convex body of which two sides are seen, the hull holds at least half.
        high = config.density[1] * max(2.0 * hull, 0.5 * float(size.prod()))
        return low, max(low, high)
    return min(low, most), max(min(high, most), low)


def _expected(bounds: Interval, typical: Interval) -> float:
    """Middle of the product of two log-normals, given by their bounds.

    Of those of what was seen, others behind or under it are the greater part of the
    error: they are trusted half as far.
    """
    log = np.log([bounds, typical])
    middle, spread = log.mean(axis=1), np.maximum(np.ptp(log, axis=1), _FLOOR)
    weight = (spread * [_SEEN_IN_PART, 1.0]) ** -2.0
    return float(np.exp((weight * middle).sum() / weight.sum()))
