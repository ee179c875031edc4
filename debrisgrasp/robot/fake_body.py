"""Head, base and camera of a robot in memory."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import copysign, cos, isfinite, sin

import numpy as np

from debrisgrasp._arrays import FloatArray, Rng
from debrisgrasp.geometry import SE3, Solid, so3
from debrisgrasp.worlds import World, body_around, render

from .config import FakeConfig
from .drives import Timeline, Violation
from .interface import DepthFrame, JointReading

__all__ = ["FakeBase", "FakeDepthCamera", "FakeHead"]

_ARRIVED = 1e-6


class FakeHead:
    """Pan and tilt at constant speed; fulfils `debrisgrasp.robot.Head`."""

    def __init__(
        self,
        bounds: Mapping[str, tuple[float, float, float]],
        q_start: Sequence[float],
        timeline: Timeline,
        violations: list[Violation],
    ) -> None:
        self._bounds, self._timeline = dict(bounds), timeline
        self._violations = violations
        self._q = [float(value) for value in q_start]
        self._goal = list(self._q)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Joints, in the order of all readings and commands."""
        return tuple(self._bounds)

    @property
    def is_still(self) -> bool:
        """Whether it has arrived."""
        return self._q == self._goal

    def read(self) -> JointReading:
        """Where it is."""
        return JointReading(self._timeline.now, tuple(self._q))

    def move_to(self, q: Sequence[float]) -> None:
        """Begin to turn there; what it can't reach is refused."""
        values = [float(value) for value in q]
        is_within = len(values) == len(self._q) and all(
            low - _ARRIVED <= value <= high + _ARRIVED
            for value, (low, high, _) in zip(values, self._bounds.values(), strict=True)
        )
        if not is_within:
            message = f"sent to {values}, beyond its limits"
            self._violations.append(Violation(self._timeline.now, "head", message))
            return
        self._goal = values

    def advance(self) -> None:
        """Turn for one period."""
        if self.is_still:
            return
        period = self._timeline.period
        for i, (_, _, speed) in enumerate(self._bounds.values()):
            left = self._goal[i] - self._q[i]
            most = speed * period
            done = abs(left) <= most
            self._q[i] = self._goal[i] if done else self._q[i] + copysign(most, left)


class FakeBase:
    """A base that drives on a plane; fulfils `debrisgrasp.robot.Base`."""

    def __init__(
        self, timeline: Timeline, config: FakeConfig, violations: list[Violation]
    ) -> None:
        self._timeline, self._config = timeline, config
        self._violations = violations
        self._goal = (0.0, 0.0)
        self._told = 0.0
        self._speed = (0.0, 0.0)
        self._place = (0.0, 0.0, 0.0)
        self.T_odom_base = SE3.identity()

    @property
    def is_still(self) -> bool:
        """Whether it stands and is to stand."""
        return self._speed == self._goal == (0.0, 0.0)

    def read(self) -> SE3:
        """Pose of the base in its odometry's frame, ``T_odom_base``."""
        return self.T_odom_base

    def drive(self, forward: float, turn: float) -> None:
        """Go on at this speed [m/s] and rate [rad/s] for a while, within the limits."""
        if not (isfinite(forward) and isfinite(turn)):
            message = f"sent at {forward} m/s, {turn} rad/s"
            self._violations.append(Violation(self._timeline.now, "base", message))
            self.stop()
            return
        most = self._config.base_speed
        kept = tuple(
            min(max(float(value), -limit), limit)
            for value, limit in zip((forward, turn), most, strict=True)
        )
        if kept != (forward, turn):
            message = f"sent at {forward:g} m/s, {turn:g} rad/s, more than {most}"
            self._violations.append(Violation(self._timeline.now, "base", message))
        self._goal, self._told = (kept[0], kept[1]), self._timeline.now

    def stop(self) -> None:
        """Come to a stand."""
        self._goal = (0.0, 0.0)

    def advance(self) -> None:
        """Drive for one period."""
        if self.is_still:
            return
        if self._timeline.now - self._told > self._config.base_watchdog:
            self.stop()
        dt = self._timeline.period
        gains = [a * dt for a in self._config.base_acceleration]
        v, w = (
            now + min(max(goal - now, -gain), gain)
            for now, goal, gain in zip(self._speed, self._goal, gains, strict=True)
        )
        self._speed = (v, w)
        x, y, yaw = self._place
        heading = yaw + 0.5 * w * dt
        self._place = (
            x + v * dt * cos(heading),
            y + v * dt * sin(heading),
            yaw + w * dt,
        )
        x, y, yaw = self._place
        turn = so3.exp(np.array([0.0, 0.0, yaw]))
        self.T_odom_base = SE3.from_parts(turn, [x, y, 0.0])


class FakeDepthCamera:
    """Renders the present world; fulfils `debrisgrasp.robot.DepthCamera`.

    Parameters
    ----------
    frame
        Name of the optical frame.
    view
        Gives the world, and the camera's true pose and the robot's solids in it.
    """

    def __init__(
        self,
        frame: str,
        view: Callable[[], tuple[World, SE3, list[Solid]]],
        timeline: Timeline,
        config: FakeConfig,
        rng: Rng,
    ) -> None:
        self._frame, self._view, self._timeline = frame, view, timeline
        self._config, self._rng = config, rng

    def capture(self) -> DepthFrame:
        """Take an image of the present world; dark if a body is over the lens."""
        config = self._config
        world, pose, solids = self._view()
        if body_around(world, pose.p) is not None:
            size = config.intrinsics.height, config.intrinsics.width
            return self._frame_of(np.zeros(size), np.zeros((*size, 3), np.uint8))
        picture = render(
            world, config.intrinsics, pose, extra=solids, max_depth=config.max_depth
        )
        depth = picture.depth
        if config.noise is not None:
            depth = config.noise.noisy(depth, config.intrinsics, rng=self._rng).depth
        return self._frame_of(depth, picture.rgb)

    def _frame_of(self, depth: FloatArray, rgb: np.ndarray) -> DepthFrame:
        return DepthFrame(
            time=self._timeline.now,
            depth=depth,
            intrinsics=self._config.intrinsics,
            rgb=rgb,
            frame=self._frame,
        )
