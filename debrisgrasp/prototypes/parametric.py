"""Prototypes from a shape and its sizes: the place in the hand is found, not given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3, fibonacci_sphere

from .check import check
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
        Where no place is without findings, the one with the fewest; `check` tells them.

    Raises
    ------
    ConfigError, UnknownNameError
        As a file of this content would.
    """
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
    pad = float(gripper.pad_positions(preshape, (low + high) / 2)[:, 2].mean())
    reach = gripper.fingertip_reach(preshape, (low + high) / 2)
    heights = np.arange(0.0, reach + 0.15, _STEP)
    if grip == "tip":
        heights = heights[np.argsort(np.abs(heights - pad), kind="stable")]
    best, fewest = definition, np.inf
    for z in heights:
        T = SE3.from_parts(definition.T_hand_shape.R, [0.0, 0.0, round(float(z), 3)])
        placed = settled(replace(definition, T_hand_shape=T), gripper)
        built = GraspPrototype.build(placed, fibonacci_sphere(1))
        n = len(check(built, gripper))
        if n < fewest:
            best, fewest = placed, n
        if n == 0:
            break
    return best
