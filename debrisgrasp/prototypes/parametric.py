"""Prototypes from a shape and its sizes: the place in the hand is found, not given."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

from debrisgrasp._checked import checked
from debrisgrasp.errors import ConfigError, UnknownNameError

from .gripper import GripperModel
from .in_hand import settled
from .placing import Grip, placed
from .prototype import PrototypeDefinition
from .prototype_file import definition_from

__all__ = ["prototype_of_shape"]


@checked
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
        and ``rpy_deg``. Without ``position`` it goes straight ahead of the palm.
    grip
        How deep between the fingers it goes: near side between the fingertips
        (``tip``), far side level with them (``deep``), or near the palm (``power``).

    Returns
    -------
    PrototypeDefinition
        Where the hand can't go around the shape, where it gets least into it; where no
        other place is without findings, the one with the fewest. `check` tells them.

    Raises
    ------
    InputError
        If an argument is not what its annotation says.
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
        **({"description": description} if description else {}),
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
    return placed(definition, gripper, grip)[0]
