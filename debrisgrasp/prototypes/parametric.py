"""Prototypes from a shape and its sizes: the place in the hand is found, not given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.geometry import SE3, fibonacci_sphere

from .check import PENETRATION_TOLERANCE, check, depth_in
from .gripper import GripperModel
from .hand_poses import settled
from .prototype import GraspPrototype, PrototypeDefinition
from .prototype_file import definition_from

__all__ = ["Grip", "prototype_of_shape"]

Grip = Literal["tip", "power"]
"""Between the fingertips, or against the palm."""

_STEP = 0.005
"""Between two places that are tried [m]."""


def prototype_of_shape(
    name: str,
    shape: Mapping[str, Any],
    gripper: GripperModel,
    preshape: str,
    *,
    grip: Grip = "tip",
    kind: str = "generic",
    tags: tuple[str, ...] = (),
    description: str = "",
) -> PrototypeDefinition:
    """Place a shape in a hand, and let the fingers close on it.

    Parameters
    ----------
    shape
        As in a prototype's file: ``type``, its lengths [m], and perhaps ``position``
        and ``rpy_deg``. Without ``position`` the shape goes between the pads (``tip``),
        or as near to the palm as the hand allows (``power``), straight ahead.

    Returns
    -------
    PrototypeDefinition
        Where the hand can't go around the shape, where it gets least into it; where no
        other place is without findings, the one with the fewest. `check` tells them.

    Raises
    ------
    ConfigError, UnknownNameError
        As a file of this content would.
    """
    if grip not in get_args(Grip):
        raise UnknownNameError("grip", grip, get_args(Grip))
    low, high = gripper.preshape(preshape).widths
    content = {
        "name": name,
        "gripper": gripper.name,
        "preshape": preshape,
        "width": (low + high) / 2,
        "shape": dict(shape),
        "kind": kind,
        "tags": list(tags),
        "description": description or "-",
    }
    if shape.get("type") == "surface":
        raise ConfigError(
            "shape.type",
            got="surface",
            expected="a shape with sizes",
            mend="Points come from `prototype record` or `prototype from-mesh`.",
        )
    source = Path(f"{name}.yaml")
    definition = definition_from(content, {gripper.name: gripper}, source)
    if "position" in shape:
        return settled(definition, gripper)
    best, fewest = None, np.inf
    for z in _heights(definition, gripper, grip):
        T = SE3.from_parts(definition.T_hand_shape.R, [0.0, 0.0, round(float(z), 3)])
        placed = settled(replace(definition, T_hand_shape=T), gripper)
        n = len(check(_built(placed), gripper))
        if n < fewest:
            best, fewest = placed, n
        if n == 0:
            break
    assert best is not None
    return best


def _heights(
    definition: PrototypeDefinition, gripper: GripperModel, grip: Grip
) -> FloatArray:
    """Distances from the palm [m] at which the wide open hand goes around the shape.

    The best come first; where there is none, the one at which it gets in least deep.
    """
    preshape = gripper.preshape(definition.preshape)
    middle = sum(preshape.widths) / 2
    reach = gripper.fingertip_reach(preshape.name, middle)
    start = SE3.from_parts(definition.T_hand_shape.R)
    widest = float(preshape.openings[0])
    wide = _built(replace(definition, T_hand_shape=start, opening=widest))
    nearest = float(wide.points[:, 2].min())
    heights = np.arange(0.0, reach - nearest + _STEP, _STEP)
    # Whether the shape is farther out, or the hand farther back, is the same.
    hand = gripper.solids(preshape.name, widest)
    back = [SE3.from_parts(p=(0.0, 0.0, -z)) for z in heights]
    depths = np.array(
        [depth_in(wide, [s.moved(T) for s in hand], wide.points)[0] for T in back]
    )
    is_free = depths <= PENETRATION_TOLERANCE
    if not is_free.any():
        return heights[[np.argmin(depths)]]
    heights = heights[is_free]
    if grip == "power":
        return heights
    pads = gripper.pad_positions(preshape.name, middle)[:, 2].mean()
    return heights[np.argsort(np.abs(heights - pads), kind="stable")]


def _built(definition: PrototypeDefinition) -> GraspPrototype:
    return GraspPrototype.build(definition, fibonacci_sphere(1))
