"""Let a pile come to rest under gravity, and read who bears on whom."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import InputError
from debrisgrasp.worlds import Body, World, corners_around

from ._mujoco import mujoco
from .model import Physics, build_model, pose_of

__all__ = ["Contact", "SettleConfig", "Settled", "let_fall", "settle"]

_CALM = 30.0
"""Drag under which the forces at rest are read [1/s]."""
_PARKED = 30.0
"""Height at which bodies wait that are not let down yet [m]."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class SettleConfig:
    """How bodies are let down, and when they are at rest."""

    physics: Physics = Physics()
    clearance: float = 0.01
    """A body is let go within this height above what is beneath it [m]."""
    interval: float = 0.5
    """Time from one body to the next [s]."""
    max_time: float = 8.0
    """Longest time after the last body [s]."""
    rest_motion: float = 0.001
    """Motion of any point of a body within ``rest_time`` that is none [m]."""
    rest_time: float = 0.3
    """How long nothing may move [s]."""
    drag: float = 1.5
    """Resistance of the air over mass [1/s]; it calms, and acts on nothing at rest."""

    def __post_init__(self) -> None:
        require_range("clearance", self.clearance, 1e-4)
        require_range("interval", self.interval, 0.0)
        require_range("drag", self.drag, 0.0)
        require_range("max_time", self.max_time, 0.0)
        require_range("rest_motion", self.rest_motion, 1e-6)
        require_range("rest_time", self.rest_time, self.physics.time_step)


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """A place where two bodies touch."""

    a: int
    """Position of one body in the world; -1 is the ground."""
    b: int
    """Position of the other, larger than ``a``."""
    point: FloatArray
    """Base frame [m], shape (3,)."""
    normal: FloatArray
    """From a to b, base frame, shape (3,)."""
    force: FloatArray
    """Force of a on b with its friction, base frame [N], shape (3,)."""

    @property
    def normal_force(self) -> float:
        """Pressure [N]."""
        return float(self.force @ self.normal)


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """A world after gravity has acted."""

    world: World
    contacts: tuple[Contact, ...]
    is_at_rest: bool
    """Whether nothing moved at the end."""
    time: float
    """Simulated time [s]."""

    @property
    def loads(self) -> FloatArray:
        """Vertical force [N] that i bears on j: shape (n + 1, n + 1), index 0 ground.

        Entry (i, j) is how much of i's weight and load j carries; the entry (j, i) is
        its negative. The sum over j is the weight of i, at rest.
        """
        n = len(self.world.bodies) + 1
        loads = np.zeros((n, n))
        for contact in self.contacts:
            loads[contact.b + 1, contact.a + 1] += contact.force[2]
            loads[contact.a + 1, contact.b + 1] -= contact.force[2]
        return loads

    def bearers(self, name: str, *, least: float = 0.5) -> dict[str, float]:
        """Who carries a body, and with how many newtons (at least ``least``)."""
        row = self.loads[self.world.index(name) + 1]
        names = ("ground", *self.world.names)
        return {names[j]: float(row[j]) for j in np.flatnonzero(row >= least)}


def settle(world: World, config: SettleConfig | None = None) -> Settled:
    """Let gravity act on bodies from where they are until they rest.

    Parameters
    ----------
    world
        Bodies that don't overlap.
    config
        When bodies are at rest.

    Raises
    ------
    InputError
        If the simulation diverges.
    MissingExtraError
        If MuJoCo is not installed.
    """
    config = config or SettleConfig()
    return _Run(world, config, n_released=len(world.bodies)).finished()


def let_fall(world: World, config: SettleConfig | None = None) -> Settled:
    """Lower bodies one after another, let them go, and wait until all rest.

    Parameters
    ----------
    world
        What there is, for instance from `generate_pile`. The heights of the bodies are
        of no account: each is lowered from above to the first touch, in their order.
    config
        How bodies are lowered, and when they are at rest.

    Raises
    ------
    InputError
        If the simulation diverges.
    MissingExtraError
        If MuJoCo is not installed.
    """
    config = config or SettleConfig()
    run = _Run(world, config, n_released=0)
    for index in range(len(world.bodies)):
        run.lower(index)
        run.advance(config.interval)
    return run.finished()


class _Run:
    """One simulation; lives inside one call only."""

    def __init__(self, world: World, config: SettleConfig, *, n_released: int) -> None:
        self.mj, self.config, self.world = mujoco(), config, world
        self.model: Any = build_model(world, config.physics)
        self.data: Any = self.mj.MjData(self.model)
        self._set_drag(config.drag)
        self.reach = np.array([_reach(body) for body in world.bodies])
        self.floor = float(world.ground.heights.min())
        self.top = float(world.ground.heights.max())
        self.n_released = n_released
        self.start = self.data.qpos.copy().reshape(-1, 7)
        self._park()

    def finished(self) -> Settled:
        """Wait until all rest, and read the result."""
        is_at_rest = self.until_rest()
        kinds = self.mj.mjtWarning
        bad = (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC)
        if any(self.data.warning[kind].number for kind in bad):
            # The engine has started over by then: its poses mean nothing.
            raise InputError(
                "simulation",
                got="one that diverged",
                expected="finite motion",
                mend="Keep bodies from overlapping, or take a smaller time_step.",
            )
        poses = [pose_of(self.data, i) for i in range(len(self.world.bodies))]
        placed = self.world.placed(poses)
        return Settled(placed, self.contacts(), is_at_rest, float(self.data.time))

    @property
    def _q(self) -> FloatArray:
        return np.asarray(self.data.qpos).reshape(-1, 7)

    def _set_drag(self, drag: float) -> None:
        damping = self.model.dof_damping.reshape(-1, 6)
        damping[:, :3] = drag * self.model.body_mass[1:, None]
        damping[:, 3:] = drag * self.model.body_inertia[1:]

    def _park(self) -> None:
        waiting = np.arange(self.n_released, len(self.start))
        self._q[waiting] = self.start[waiting]
        self._q[waiting, 0] += 10.0 * waiting
        self._q[waiting, 2] = _PARKED
        np.asarray(self.data.qvel).reshape(-1, 6)[waiting] = 0.0

    def _touches(self, index: int) -> bool:
        self.mj.mj_kinematics(self.model, self.data)
        self.mj.mj_collision(self.model, self.data)
        return any(
            index in (a, b) and contact.dist < 0.0 for a, b, contact in self._pairs()
        )

    def _pairs(self) -> list[tuple[int, int, Any]]:
        """Positions of the two bodies of each contact, and the contact."""
        owner = self.model.geom_bodyid
        return [
            (int(owner[c.geom1]) - 1, int(owner[c.geom2]) - 1, c)
            for c in (self.data.contact[i] for i in range(self.data.ncon))
        ]

    def lower(self, index: int) -> None:
        """Put a body just above what is beneath it and let it go."""
        self.n_released = index + 1
        q = self._q[index]
        q[:] = self.start[index]
        below = self._q[:index, 2] + self.reach[:index]
        q[2] = max(below.max(initial=0.0), self.top) + self.reach[index]
        floor = self.floor - self.reach[index]
        while not self._touches(index) and q[2] > floor:
            q[2] -= 0.03
        while self._touches(index):
            q[2] += self.config.clearance

    def advance(self, duration: float) -> None:
        """Let time pass."""
        for _ in range(round(duration / self.config.physics.time_step)):
            self.mj.mj_step(self.model, self.data)
            if self.n_released < len(self.start):
                self._park()

    def until_rest(self) -> bool:
        """Let time pass until nothing moves; False if it still does at the end."""
        config = self.config
        is_at_rest = False
        for _ in range(int(np.ceil(config.max_time / config.rest_time))):
            before = self._q.copy()
            self.advance(config.rest_time)
            turn = np.abs((before[:, 3:] * self._q[:, 3:]).sum(axis=1))
            angle = 2.0 * np.arccos(np.minimum(turn, 1.0))
            shift = np.linalg.norm(self._q[:, :3] - before[:, :3], axis=1)
            if (shift + self.reach * angle).max() < config.rest_motion:
                is_at_rest = True
                break
        # Bodies that rest on edges chatter by micrometres; thick air makes the forces
        # those of equilibrium.
        self._set_drag(_CALM)
        self.advance(config.rest_time)
        self.mj.mj_forward(self.model, self.data)
        return is_at_rest

    def contacts(self) -> tuple[Contact, ...]:
        """Contacts that press, with their forces."""
        found = []
        wrench = np.zeros(6)
        for number, (a, b, contact) in enumerate(self._pairs()):
            self.mj.mj_contactForce(self.model, self.data, number, wrench)
            if wrench[0] <= 0.0:
                continue
            frame = contact.frame.reshape(3, 3)
            sign = 1.0 if a < b else -1.0
            found.append(
                Contact(
                    a=min(a, b),
                    b=max(a, b),
                    point=contact.pos.copy(),
                    normal=sign * frame[0],
                    force=sign * (wrench[:3] @ frame),
                )
            )
        return tuple(found)


def _reach(body: Body) -> float:
    """Distance of the farthest point of a body from the origin of its frame [m]."""
    corners = np.concatenate([corners_around(part) for part in body.parts])
    return float(np.linalg.norm(corners, axis=1).max())
