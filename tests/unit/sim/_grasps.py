"""A box on a floor and a hand over it, for tests of flying hands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp.geometry import SE3, Box
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.sim import Flight, FlightConfig, fly
from debrisgrasp.worlds import Body, World

TIP = 0.112
"""Height of the palm over the middle of what the pads of the Robotiq hand hold [m]."""


@dataclass(frozen=True)
class Given:
    """A grasp as a flight takes it."""

    T_base_hand: SE3
    T_base_pregrasp: SE3
    preshape: str = "basic"
    opening: float = 0.1
    width: float = 0.06


def downwards(at, *, retreat=0.12, **kwargs) -> Given:
    """Grasp from straight above, closing along x."""
    R = np.diag([1.0, -1.0, -1.0])
    pose = SE3.from_parts(R, at)
    above = SE3.from_parts(R, np.add(at, [0.0, 0.0, retreat]))
    return Given(pose, above, **kwargs)


def box(name, size, mass, at=(0.0, 0.0)) -> Body:
    """Box that stands on the floor."""
    half = np.array(size) / 2
    place = SE3.from_parts(p=[*at, half[2]])
    return Body(name, "box", (Box(half),), mass, place)


def flown(size=(0.06, 0.2, 0.06), mass=2.0, *, aside=(0.0, 0.0), **config) -> Flight:
    """Grip a box with the Robotiq hand, beside its middle."""
    world = World((box("it", size, mass),))
    grasp = downwards([*aside, size[2] / 2 + TIP])
    hand = GripperModel.load("robotiq_3f")
    return fly(world, hand, grasp, intended="it", config=FlightConfig(**config))
