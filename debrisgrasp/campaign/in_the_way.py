"""What stood in the way of a run, and what of it does in the end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.executive import TaskSettings
from debrisgrasp.robot import FakeTruth
from debrisgrasp.worlds import Body, World

__all__ = ["Account", "account", "box_around", "is_in_the_way", "to_remove"]


@dataclass(frozen=True, slots=True, eq=False)
class Account:
    """Bodies that were in the way at the start, and that a robot could remove."""

    gone: tuple[Body, ...]
    """Those that are in nobody's way in the end, wherever they came to lie."""
    kept: tuple[Body, ...]
    """Those that still are, however far they were carried."""


def account(truth: FakeTruth, settings: TaskSettings) -> Account:
    """Hold the end of a run against its start.

    What is heavier than may be carried is left out. Bodies that an injected fault put
    elsewhere count as if they had been there at the start: no robot moved them.
    """
    ends = {body.name: body for body in truth.world.bodies}
    counted = to_remove(truth.begun, settings)
    kept = {body.name for body in counted if is_in_the_way(ends[body.name], settings)}
    return Account(
        gone=tuple(body for body in counted if body.name not in kept),
        kept=tuple(body for body in counted if body.name in kept),
    )


def to_remove(world: World, settings: TaskSettings) -> tuple[Body, ...]:
    """Bodies that are in the way, and light enough to be carried."""
    return tuple(
        body
        for body in world.bodies
        if body.mass <= settings.max_mass and is_in_the_way(body, settings)
    )


def is_in_the_way(body: Body, settings: TaskSettings) -> bool:
    """Whether a body stands in the workspace, higher than what may be driven over."""
    _, high = box_around(body)
    middle = body.T_base_body.apply(body.center_of_mass)
    return bool(settings.bounds.contains(middle) and high[2] > settings.drive_over)


def box_around(body: Body) -> tuple[FloatArray, FloatArray]:
    """Lower and upper corner around the solids of a body, base frame [m]."""
    corners = [solid.bounds for solid in body.solids]
    return (
        np.min([box.lower for box in corners], axis=0),
        np.max([box.upper for box in corners], axis=0),
    )
