"""Contact on paper: an arm with lag and delay, and something that it touches.

Settings can be tried here before a robot has them. The examples do, and so do the tests
of the stability bound.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray, Rng, finite, require_range
from debrisgrasp._checked import checked
from debrisgrasp.geometry import SE3

from ._rigid import parts, six
from .controller import LegController
from .filters import WrenchFilter
from .leg_state import Command, LegOutcome
from .readings import Reading
from .stability import ArmResponse

__all__ = ["LaggingArm", "PressResult", "Rehearsal", "press", "rehearse"]


class LaggingArm:
    """Joints that follow their commands late and softly.

    Each answers as a second-order system behind a zero-order hold, after the delay. Has
    a state; for simulation only.
    """

    def __init__(self, arm: ArmResponse, period: float, start: ArrayLike) -> None:
        require_range("period [s]", period, 1e-4, 0.1)
        self._coefficients = arm.held(period)
        self._start = np.array(start, dtype=np.float64)
        still = np.zeros_like(self._start)
        self._waiting = [still] * (arm.delay + 1)
        self._u, self._y = still, (still, still)

    def step(self, command: ArrayLike) -> FloatArray:
        """Take a commanded posture (d,); return the one reached a period later."""
        b1, b2, a1, a2 = self._coefficients
        shift = np.asarray(command, dtype=np.float64) - self._start
        self._waiting = [*self._waiting[1:], shift]
        u, (y1, y2) = self._waiting[0], self._y
        y = b1 * u + b2 * self._u - a1 * y1 - a2 * y2
        self._u, self._y = u, (y, y1)
        return np.asarray(self._start + y)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Rehearsal:
    """A leg as it went on paper."""

    time: FloatArray
    """[s], shape (n,)."""
    load: FloatArray
    """True load at the hand, in its axes [N, N m], shape (n, 6)."""
    deflection: FloatArray
    """Commanded deflection [m, rad], axes of base, shape (n, 6)."""
    position: FloatArray
    """Of the hand in base [m], shape (n, 3)."""
    last: Command

    @property
    def ending(self) -> str:
        """How it ended, in words."""
        words = self.last.stop.message if self.last.stop else self.last.outcome.value
        return f"{words}, after {100 * self.last.share:.0f} % of the way"


@checked
def rehearse(
    controller: LegController,
    q_start: ArrayLike,
    world: Callable[[SE3], FloatArray],
    *,
    arm: ArmResponse,
    rng: Rng,
    duration: float = 10.0,
    settle: float = 1.0,
) -> Rehearsal:
    """Run one leg against a simulated world.

    Parameters
    ----------
    q_start
        Where the arm stands, shape (d,).
    world
        Wrench on the hand for its pose: axes of base, moments about the hand, (6,).
    arm
        How the joints follow.
    rng
        For the noise of the sensor: 0.3 N and 0.01 N m.
    duration, settle
        At most, and how long to go on after the leg has ended [s].

    Raises
    ------
    InputError
        If the controller refuses to engage; the message says why. If an argument is
        none that it can be, or the world gives no wrench.
    """
    period = controller.config.period
    require_range("duration of a rehearsal [s]", duration, period, 1e5)
    chain, loads = controller.chain, controller.loads
    q = finite(q_start, "q_start", (chain.n_joints,))
    joints = LaggingArm(arm, period, q)
    noise = np.repeat([0.3, 0.01], 3)
    rows: list[tuple[float, FloatArray, FloatArray, FloatArray]] = []

    def reading(tick: int) -> tuple[Reading, FloatArray, SE3]:
        T = chain.fk(q)
        base = six(world(T), "wrench of the world")
        load = np.concatenate([T.R.T @ base[:3], T.R.T @ base[3:]])
        raw = loads.reading(load, parts(T)[0]) + noise * rng.standard_normal(6)
        now = tick * period
        return Reading(now, q, raw, now), load, T

    state = controller.engage(reading(0)[0]).require()
    ended = 0
    for tick in range(1, int(duration / period) + 1):
        measured, load, T = reading(tick)
        state, command = controller.step(state, measured)
        rows.append((measured.time, load, np.array(command.deflection), T.p))
        q = joints.step(command.q)
        ended += command.outcome is not LegOutcome.RUNNING
        if ended * period >= settle:
            break
    time, loads_, deflections, positions = zip(*rows, strict=True)
    return Rehearsal(
        time=np.array(time),
        load=np.array(loads_),
        deflection=np.array(deflections),
        position=np.array(positions),
        last=command,
    )


@dataclass(frozen=True, slots=True, eq=False)
class PressResult:
    """A hand that was pressed onto something."""

    time: FloatArray
    """[s], shape (n,)."""
    force: FloatArray
    """[N], shape (n,)."""
    is_calm: bool
    """Whether the force came to rest."""


@checked
def press(
    compliance: float,
    stiffness: float,
    arm: ArmResponse,
    smoothing: WrenchFilter,
    *,
    speed: float = 0.05,
    depth: float = 0.01,
    duration: float = 20.0,
) -> PressResult:
    """Press a yielding hand onto a one-sided spring, and see whether it settles.

    Parameters
    ----------
    compliance
        [m/N].
    stiffness
        Of the spring [N/m]; it only pushes.
    speed, depth
        With which, and how far beyond the surface, the hand is sent [m/s], [m].
    duration
        [s]; what has not touched by then is not calm.

    Raises
    ------
    ConfigError
        If a number is none that an arm, or a spring, can have.
    """
    for name, value, least, most in (
        ("compliance [m/N]", compliance, 0.0, 1.0),
        ("stiffness [N/m]", stiffness, 1e-3, 1e9),
        ("speed [m/s]", speed, 1e-6, 10.0),
        ("depth [m]", depth, 1e-6, 1.0),
        ("duration [s]", duration, 10.0 * smoothing.period, 600.0),
    ):
        require_range(name, value, least, most)
    period, a = smoothing.period, smoothing.alpha
    b1, b2, a1, a2 = arm.held(period)
    n = int(np.ceil(duration / period))
    nominal = np.minimum(speed * period * np.arange(n), depth).tolist()
    force = [0.0] * n
    waiting = [0.0] * (arm.delay + 1)
    u1 = y1 = y2 = filtered = 0.0
    for k in range(n):
        u = waiting[k % len(waiting)]
        y = b1 * u + b2 * u1 - a1 * y1 - a2 * y2
        u1, y1, y2 = u, y, y1
        pushed = stiffness * y if y > 0.0 else 0.0
        force[k] = pushed
        filtered += a * (pushed - filtered)
        waiting[k % len(waiting)] = nominal[k] - compliance * filtered
    values = np.array(force)
    tail = values[-n // 5 :]
    is_calm = bool(np.isfinite(values).all() and np.ptp(tail) < 0.05 * tail.mean())
    return PressResult(np.asarray(period * np.arange(n)), values, is_calm)
