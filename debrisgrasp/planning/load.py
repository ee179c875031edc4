"""What a grasp has to carry: the wrench at lift, and what holds it.

All loads are proportional to the mass, which is known to about an order of magnitude
(`mass`), unless an operator knows it better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray

from .levers import GripLevers
from .load_forecast import LoadForecast
from .mass import Build, Interval, LoadConfig, ObjectMass

__all__ = ["LoadModel", "Loads"]

_FLOOR = 1e-9
"""Keeps quotients finite; far below every load and limit."""
_THICKEST_WALL = 0.07
"""What is thicker than this is no wall [m]."""
_MOST = 1e3
"""Margins are cut here: the load is nothing to speak of."""


@dataclass(frozen=True, slots=True, eq=False)
class Loads:
    """Loads of k grasps; columns of bounds are least, expected, greatest."""

    mass: FloatArray
    """[kg], shape (3,)."""
    build: Build
    torque: FloatArray
    """About the palm [N m], shape (k, 3)."""
    grip: FloatArray
    """Squeeze needed [N], shape (k, 3)."""
    demand: FloatArray
    """Load over limit, the largest of all limits, shape (k, 3)."""
    limit: np.ndarray
    """Which limit that is, a word for each, shape (k,)."""
    lever: FloatArray
    """[m], shape (k,)."""
    lever_error: float
    tilt: FloatArray
    """[rad], shape (k,)."""
    weight: FloatArray
    """[N], shape (k, 3); more than of the mass where the walls that are gripped are
    thick."""
    wrench: FloatArray
    """Expected wrench on the hand, force and then torque about the palm, palm frame
    [N, N m], shape (k, 6)."""

    @property
    def preference(self) -> FloatArray:
        """Factor in (0, 1] that prefers small loads, shape (k,)."""
        factor: FloatArray = 1.0 / (1.0 + self.demand[:, 1])
        return factor

    @property
    def is_too_heavy(self) -> BoolArray:
        """Which grasps can't hold even the least load, shape (k,)."""
        heavy: BoolArray = self.demand[:, 0] > 1.0
        return heavy

    def limited(self, load: FloatArray, limit: float, name: str) -> Loads:
        """Take one more limit into account: loads (3,) or (k, 3) against it."""
        demand = np.broadcast_to(load / max(limit, _FLOOR), self.demand.shape)
        is_worse = demand[:, 1] > self.demand[:, 1]
        changed = {
            "demand": np.maximum(self.demand, demand),
            "limit": np.where(is_worse, name, self.limit),
        }
        return self._with(changed)

    def __getitem__(self, rows: IntArray | BoolArray) -> Loads:
        """Pick some of the grasps."""
        per_grasp = (
            "torque",
            "grip",
            "demand",
            "limit",
            "lever",
            "tilt",
            "weight",
            "wrench",
        )
        return self._with({name: getattr(self, name)[rows] for name in per_grasp})

    def _with(self, changed: dict[str, np.ndarray]) -> Loads:
        own = {item.name: getattr(self, item.name) for item in fields(self)}
        return Loads(**{**own, **changed})

    def forecast(self, row: int) -> LoadForecast:
        """Record of one grasp."""
        worst, expected, best = _margin(self.demand[row, ::-1])
        return LoadForecast(
            build=self.build.value,
            mass=_ends(self.mass),
            force=_ends(self.weight[row]),
            torque=_ends(self.torque[row]),
            grip=_ends(self.grip[row]),
            lever=float(self.lever[row]),
            lever_error=self.lever_error,
            tilt=float(self.tilt[row]),
            margin=expected,
            margins=(worst, best),
            limit=str(self.limit[row]),
        )


def _ends(bounds: FloatArray) -> Interval:
    return float(bounds[0]), float(bounds[2])


def _margin(demand: FloatArray) -> list[float]:
    found: list[float] = np.minimum(1.0 / np.maximum(demand, _FLOOR), _MOST).tolist()
    return found


class LoadModel:
    """Forecasts the loads of grasps of one object.

    Parameters
    ----------
    objects
        What it may be, see `likely_objects`: what is expected is the mean over them,
        and bounds are those of all.
    """

    def __init__(self, objects: Sequence[ObjectMass], config: LoadConfig) -> None:
        self._config = config
        self._build = objects[0].build
        share = np.array([each.probability for each in objects])
        self._share = share / share.sum()
        self._mass = np.array(
            [(each.mass[0], each.expected_mass, each.mass[1]) for each in objects]
        )
        self._walls = float(self._share @ [each.walls for each in objects])
        self._com = np.array([each.com for each in objects])
        self._com_error = np.array([each.com_error for each in objects])
        self._level_error = np.array([each.level_error for each in objects])
        # Half the axes of the ellipsoid are a standard deviation: variances of y and x,
        # and twice their covariance, as those of the torque per weight (-y, x, 0).
        x, y, _ = 0.5 * np.array([each.spread for each in objects]).swapaxes(0, 1)
        sums = [(y * y).sum(axis=1), -2.0 * (x * y).sum(axis=1), (x * x).sum(axis=1)]
        self._variance = np.stack(sums, axis=1)

    def __call__(
        self, Ts_base_hand: FloatArray, which: IntArray, levers: GripLevers
    ) -> Loads:
        """Forecast what the hands have to hold.

        Parameters
        ----------
        Ts_base_hand
            Palm poses, base frame (z up), shape (k, 4, 4).
        which
            Row of ``levers`` that each pose's hand is, shape (k,).
        levers
            The hands.
        """
        config, weight = self._config, self._mass * self._config.gravity
        R, p = Ts_base_hand[:, :3, :3], Ts_base_hand[:, :3, 3]
        grip = (R @ levers.middle[which][..., None])[..., 0] + p
        down = -R[:, 2]
        # One row for each object, then one for each grasp.
        level = self._apart(p)
        error = self._level_error[:, None]
        reach = np.stack([np.maximum(level - error, 0.0), level, level + error], -1)
        heavier = np.ones((len(p), 3))
        heavier[:, 1] = self._heavier(which, levers)
        torque = heavier * self._over_all(reach * weight[:, None])
        grip_force = _grip_needed(
            down,
            self._moments(R, grip),
            self._variances(R),
            self._com_error[:, None, None],
            levers.lever[which],
            config,
        )
        grip_force = heavier * self._over_all(grip_force * weight[:, None])
        mass = self._over_all(self._mass)
        pull = np.tensordot(self._share * weight[:, 1], self._moments(R, p), axes=1)
        return Loads(
            mass=mass,
            build=self._build,
            torque=torque,
            grip=grip_force,
            demand=grip_force / levers.max_force[which, None],
            limit=np.full(len(p), "grip", dtype=object),
            lever=self._distance(grip),
            lever_error=self._lever_error,
            tilt=np.arccos(np.clip(down[:, 2], -1.0, 1.0)),
            weight=heavier * mass * config.gravity,
            wrench=heavier[:, 1:2]
            * np.concatenate([down * mass[1] * config.gravity, pull], axis=1),
        )

    def _apart(self, points: FloatArray) -> FloatArray:
        """Horizontal distances of middles of mass from points (k, 3) [m], (h, k)."""
        away = self._com[:, None, :2] - points[:, :2]
        found: FloatArray = np.sqrt(away[..., 0] ** 2 + away[..., 1] ** 2)
        return found

    def _moments(self, R: FloatArray, points: FloatArray) -> FloatArray:
        """Torques per weight about points (k, 3), in palm frames R [m], (h, k, 3)."""
        away = self._com[:, None, :2] - points[:, :2]
        # In base it is (-y, x, 0).
        found: FloatArray = away[..., :1] * R[:, 1] - away[..., 1:] * R[:, 0]
        return found

    def _variances(self, R: FloatArray) -> FloatArray:
        """Variances of these torques in palm frames R [m^2], shape (h, k, 3)."""
        x, y = R[:, 0], R[:, 1]
        found: FloatArray = np.tensordot(
            self._variance, np.stack([x * x, x * y, y * y]), axes=1
        )
        return found

    def _over_all(self, bounds: FloatArray) -> FloatArray:
        """Least, expected and greatest (h, ..., 3) of all objects, shape (..., 3)."""
        low, high = bounds[..., 0].min(axis=0), bounds[..., 2].max(axis=0)
        expected = np.tensordot(self._share, bounds[..., 1], axes=1)
        return np.stack([low, expected, high], axis=-1)

    @property
    def _lever_error(self) -> float:
        """How far the middle of mass may be off horizontally, for all objects [m]."""
        apart = np.linalg.norm((self._com - self._share @ self._com)[:, :2], axis=1)
        return float(np.sqrt(self._share @ (apart**2 + self._level_error**2)))

    def expected_demand(
        self,
        Ts_base_hand: FloatArray,
        which: IntArray,
        levers: GripLevers,
        wrists: FloatArray,
    ) -> FloatArray:
        """Load over limit at the mass expected, without the torque of joints, (k,).

        The same as ``demand[:, 1]`` of `Loads`, for the many poses of a search.

        Parameters
        ----------
        wrists
            Largest force [N] and torque [N m] at the wrist of each row of ``levers``,
            shape (p, 2).
        """
        config = self._config
        weight = self._share * self._mass[:, 1] * config.gravity
        R, p = Ts_base_hand[:, :3, :3], Ts_base_hand[:, :3, 3]
        grip = (R @ levers.middle[which][..., None])[..., 0] + p
        turn = np.sqrt(self._moments(R, grip) ** 2 + self._variances(R))
        turn /= levers.lever[which]
        squeeze = weight @ _squeeze(-R[:, 2], turn, config.expected_friction)
        found: FloatArray = np.maximum(
            np.maximum(
                squeeze / levers.max_force[which],
                weight @ self._apart(p) / wrists[which, 1],
            ),
            weight.sum() / wrists[which, 0],
        )
        found *= self._heavier(which, levers)
        return found

    def _heavier(self, which: IntArray, levers: GripLevers) -> FloatArray:
        """How much more than expected it weighs if its walls are as thick, (k,).

        What fits a wall of a hollow object has measured how thick that is.
        """
        width = levers.width  # of a few hands, where a search has thousands of poses
        mass = np.where(width < _THICKEST_WALL, width, 0.0) * self._walls
        expected = float(self._share @ self._mass[:, 1])
        most = max(float(self._mass[:, 2].max()), expected)
        heavier: FloatArray = np.clip(mass, expected, most) / expected
        return heavier[which]

    def distance(
        self, Ts_base_hand: FloatArray, which: IntArray, levers: GripLevers
    ) -> FloatArray:
        """Horizontal distance from the middle of the grip to that of mass [m], (k,).

        What is expected of it, with the error of the middle of mass. The same as
        ``lever`` of `Loads`.
        """
        R, p = Ts_base_hand[:, :2, :3], Ts_base_hand[:, :2, 3]
        grip = (R @ levers.middle[which][..., None])[..., 0] + p
        return self._distance(grip)

    def _distance(self, grip: FloatArray) -> FloatArray:
        """Mean horizontal distance of grips (k, 2) or (k, 3) from it [m], (k,)."""
        error = 0.5 * self._level_error[:, None]
        found: FloatArray = self._share @ np.hypot(self._apart(grip), error)
        return found


def _squeeze(down: FloatArray, turn: FloatArray, friction: float) -> FloatArray:
    """Squeeze per weight that holds it, and turns (..., k, 3) in units of the levers.

    Returns shape (..., k).
    """
    across = np.hypot(down[:, 1], np.maximum(down[:, 2], 0.0))
    held = np.hypot(across, turn[..., 0]) / (2.0 * friction)
    found: FloatArray = held + np.abs(down[:, 0]) + turn[..., 1] + turn[..., 2]
    return found


def _grip_needed(
    down: FloatArray,
    moment: FloatArray,
    variance: FloatArray,
    error: FloatArray,
    lever: FloatArray,
    config: LoadConfig,
) -> FloatArray:
    """Squeeze per weight: least, expected and greatest, shape (h, k, 3).

    Force across the closing axis and torque about it are held by friction, whose limit
    surface is taken as an ellipsoid; the rest by one side pressing harder. The least
    lets the object swing about the closing axis, and fingers reach around it.

    Parameters
    ----------
    down
        Direction of the weight, palm frame, shape (k, 3).
    moment
        Torque per weight about the middle of the grip, palm frame [m], shape
        (h, k, 3).
    variance
        Of the torque [m^2], shape (h, k, 3).
    error
        How far the torque may be off [m], shape (h, 1, 1).
    lever
        See `GripLevers`, shape (k, 3).
    """
    # What presses into the palm needs no grip.
    out = np.maximum(down[:, 2], 0.0)
    along = np.abs(down[:, 0])
    low, high = config.friction
    columns = [
        _squeeze(down, turn / lever, friction)
        for turn, friction in (
            (np.sqrt(moment**2 + variance), config.expected_friction),
            (np.abs(moment) + error, low),
        )
    ]
    turn = np.maximum(np.abs(moment) - error, 0.0) / lever
    held = np.hypot(down[:, 1] / (2.0 * high), out / (2.0 * max(high, 1.0)))
    least = np.maximum(np.maximum(held, along), turn[..., 2])
    return np.stack([least, *columns], axis=-1)
