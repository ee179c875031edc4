"""Who touches whom: hands, links of arms, bodies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from debrisgrasp.prototypes import GripperModel
from debrisgrasp.sim._mujoco import mujoco

__all__ = ["Contacts", "HandTouch"]

_PRESSED = 0.5
"""A finger that presses with less does not hold [N]."""


@dataclass(slots=True)
class HandTouch:
    """What one hand touches."""

    pressure: dict[tuple[int, int], float] = field(default_factory=dict)
    """Force by body and side of the hand: -1 thumb, +1 pair, 0 palm [N]."""
    depth: float = 0.0
    """Deepest interpenetration with a body [m]."""

    @property
    def held(self) -> int | None:
        """Body that fingers of both sides press; of several, the one pressed most."""
        pressed = {k: f for k, f in self.pressure.items() if f > _PRESSED}
        both = [b for b, side in pressed if side == -1 and (b, 1) in pressed]
        return max(both, key=lambda b: pressed[b, -1] + pressed[b, 1], default=None)


class Contacts:
    """Reads the contacts of a compiled model.

    Parameters
    ----------
    model
        Whose first bodies are those of the world.
    n_bodies
        How many these are.
    links
        Names of MuJoCo's bodies of each arm's links, by arm.
    hands
        By arm.
    """

    def __init__(
        self,
        model: Any,
        n_bodies: int,
        links: Mapping[str, list[str]],
        hands: Mapping[str, GripperModel],
    ) -> None:
        self._model, self._n = model, n_bodies
        self._arms = tuple(hands)
        # Of every geometry: body of the world, or -1; arm, or -1; side, or 9 for links.
        owner = model.geom_bodyid
        arm, side = np.full(model.nbody, -1), np.full(model.nbody, 9)
        for number, name in enumerate(self._arms):
            for link in links[name]:
                arm[model.body(link).id] = number
            palm = model.body(f"{name}/hand").id
            arm[palm], side[palm] = number, 0
            for finger in hands[name].fingers:
                for k in range(len(finger.links)):
                    index = model.body(f"{name}/{finger.name}/{k}").id
                    arm[index], side[index] = number, finger.side
        self._body = owner - 1
        self._arm, self._side = arm[owner], side[owner]

    def inside_robot(self, data: Any) -> tuple[float, int, str] | None:
        """Tell which body of the world is deepest in the robot.

        Returns
        -------
        depth, body, link
            How deep [m], the place of the body, and MuJoCo's name of what it is in;
            None if none touches the robot.
        """
        pairs, gaps = data.contact.geom[: data.ncon], data.contact.dist[: data.ncon]
        body = self._body[pairs]
        meets = (body.min(axis=1) >= 0) & (body.min(axis=1) < self._n)
        meets &= body.max(axis=1) >= self._n
        if not meets.any():
            return None
        at = int(np.flatnonzero(meets)[gaps[meets].argmin()])
        own, link = sorted(body[at].tolist())
        return -float(gaps[at]), own, self._model.body(link + 1).name

    def read(
        self, data: Any
    ) -> tuple[dict[str, HandTouch], dict[tuple[str, int], float]]:
        """Tell what each hand touches, and how deep links are in bodies [m]."""
        touches = {name: HandTouch() for name in self._arms}
        scrapes: dict[tuple[str, int], float] = {}
        pairs, gaps = data.contact.geom[: data.ncon], data.contact.dist[: data.ncon]
        is_robot = self._arm[pairs] >= 0
        found = np.flatnonzero(is_robot.any(axis=1) & (gaps < 0.0))
        wrench = np.zeros(6)
        for number in found.tolist():
            own = 0 if is_robot[number, 0] else 1
            mine, other = pairs[number, own], pairs[number, 1 - own]
            body = int(self._body[other])
            if body >= self._n:
                continue
            arm, side = self._arms[self._arm[mine]], int(self._side[mine])
            depth = -float(gaps[number])
            if side == 9:
                if body >= 0:
                    scrapes[arm, body] = max(depth, scrapes.get((arm, body), 0.0))
                continue
            mujoco().mj_contactForce(self._model, data, number, wrench)
            if wrench[0] <= 0.0 or body < 0:
                continue
            touch = touches[arm]
            touch.depth = max(touch.depth, depth)
            key = body, side
            touch.pressure[key] = touch.pressure.get(key, 0.0) + float(wrench[0])
        return touches, scrapes
