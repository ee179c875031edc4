"""The named scenes of Bowkett et al. (2022), to be let down in their order."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from debrisgrasp._checked import checked
from debrisgrasp.errors import UnknownNameError
from debrisgrasp.geometry import SE3, so3

from .body import Body
from .kinds import make_body
from .world import World

__all__ = ["SCENES", "named_scene"]

_TRUSS = {"length": 0.9, "depth": 0.2, "radius": 0.014, "bays": 4.0}
_BLOCK = {"length": 0.39, "width": 0.19, "height": 0.19, "wall": 0.032}


@checked
def named_scene(name: str) -> World:
    """Build a scene by its name.

    Parameters
    ----------
    name
        One of `SCENES`.

    Raises
    ------
    UnknownNameError
        If there is no such scene.
    """
    if name not in SCENES:
        raise UnknownNameError("scene", name, SCENES)
    return World(SCENES[name](), name=name)


def _wood_on_truss() -> tuple[Body, ...]:
    """Stack two pieces of lumber simply on a truss that lies on the floor."""
    return (
        _body("truss_ladder", _TRUSS, 2.5, (1.15, 0.0)),
        _lumber("lumber_2x4_1", 0.7, (0.98, 0.03), yaw=1.5),
        _lumber("lumber_2x4_2", 0.8, (1.3, -0.05), yaw=1.9),
    )


def _block_on_wood() -> tuple[Body, ...]:
    """Lean a cinder block on lumber that lies on a truss (Figure 7).

    The lumber is nearest to the robot, but bears the block.
    """
    return (
        _body("truss_ladder", _TRUSS, 2.5, (1.25, 0.0), yaw=np.pi / 2),
        _lumber("lumber_2x4", 0.9, (1.16, 0.02), yaw=0.2),
        _body("cinder_block", _BLOCK, 7.0, (1.32, 0.2), pitch=-0.5, yaw=1.7),
    )


def _handle() -> tuple[Body, ...]:
    """Put a crate with a handle beside lumber."""
    sizes = {
        "length": 0.36, "width": 0.26, "height": 0.2, "wall": 0.012, "rise": 0.12,
        "grip": 0.014,
    }  # fmt: skip
    return (
        _body("crate_handle", sizes, 2.5, (1.1, 0.0), yaw=0.6),
        _lumber("lumber_2x4", 0.7, (1.4, 0.25), yaw=1.2),
    )


def _hedgehog() -> tuple[Body, ...]:
    """Put a hedgehog barrier in the way."""
    sizes = {"length": 0.65, "flange": 0.065, "wall": 0.01}
    return (_body("hedgehog", sizes, 6.0, (1.2, 0.0), yaw=0.4),)


SCENES: Mapping[str, Callable[[], tuple[Body, ...]]] = {
    "wood_on_truss": _wood_on_truss,
    "block_on_wood": _block_on_wood,
    "crate_with_handle": _handle,
    "hedgehog": _hedgehog,
}
"""Scenes by name: bodies where they are let down, in this order."""


def _body(
    kind: str,
    sizes: Mapping[str, float],
    mass: float,
    at: tuple[float, float],
    *,
    pitch: float = 0.0,
    yaw: float = 0.0,
    name: str | None = None,
) -> Body:
    turn = so3.from_rpy(np.array([0.0, pitch, yaw]))
    body = make_body(kind, sizes, mass, name=name)
    return body.at(SE3.from_parts(turn, [*at, 0.0]))


def _lumber(name: str, length: float, at: tuple[float, float], *, yaw: float) -> Body:
    sizes = {"length": length, "width": 0.089, "height": 0.038}
    return _body("lumber_2x4", sizes, 1.9 * length, at, yaw=yaw, name=name)
