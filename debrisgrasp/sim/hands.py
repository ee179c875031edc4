"""A hand as MuJoCo bodies, made from the same file that the planner reads."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3
from debrisgrasp.prototypes import GripperModel

from .fingers import FingerDrive, HandPhysics, Mechanism, Skin
from .model import numbers, placement

__all__ = ["Grip", "add_hand"]


def add_hand(
    root: ElementTree.Element,
    hand: GripperModel,
    *,
    preshape: str,
    opening: float,
    width: float,
    T_base_hand: SE3,
    physics: HandPhysics,
    time_step: float,
) -> tuple[FingerDrive, ...]:
    """Put a hand on six joints into the tree of a world.

    The joints ``wrist_x`` to ``wrist_yaw`` move it along the axes of base and turn it
    about its own; nothing drives them.

    Parameters
    ----------
    root
        Tree of a world, see `world_tree`; changed in place.
    preshape, opening
        How the fingers stand.
    width
        Distance between the pads at which the grip force is meant [m].
    T_base_hand
        Where the hand is when its six joints are at zero.
    time_step
        Of the integration [s]; a drive is no stiffer than that allows.
    """
    scene = root.find("worldbody")
    assert scene is not None
    palm = _on_wrist(scene, T_base_hand)
    shape = hand.preshape(preshape)
    skin = Skin.on(palm, hand, physics)
    drives = []
    for finger in hand.fingers:
        mechanism = Mechanism(hand, finger, shape, width, physics, time_step)
        mechanism.add(root, palm, skin, hand.opening_to_command(preshape, opening))
        if mechanism.leader is not None:
            drives.append(mechanism.drive(hand.opening_to_command(preshape, opening)))
    return tuple(drives)


class Grip:
    """Closes the fingers of one simulation."""

    def __init__(
        self, model: Any, drives: tuple[FingerDrive, ...], physics: HandPhysics
    ) -> None:
        self._index = np.array([model.actuator(d.name).id for d in drives])
        self._effort = np.array([d.effort for d in drives])
        spans = np.array([d.span for d in drives])
        self._speed = (spans[:, 1] - spans[:, 0]) / physics.closing_time
        windup = physics.break_away * self._effort / [d.stiffness for d in drives]
        self._end = spans[:, 1] + windup
        self._start = np.array([d.start for d in drives])

    def reset(self, data: Any) -> None:
        """Hold the fingers where the approach has them."""
        data.ctrl[self._index] = self._start

    def advance(self, data: Any, share: float, duration: float) -> None:
        """Go on closing with a share of the force; stalled drives hold."""
        is_free = data.actuator_force[self._index] < share * self._effort
        step = np.where(is_free, self._speed * duration, 0.0)
        data.ctrl[self._index] = np.minimum(data.ctrl[self._index] + step, self._end)

    def efforts(self, data: Any) -> FloatArray:
        """Effort of each drive over what it is made for, shape (drives,)."""
        return np.asarray(data.actuator_force[self._index] / self._effort)


def _on_wrist(scene: ElementTree.Element, pose: SE3) -> ElementTree.Element:
    carrier = ElementTree.SubElement(scene, "body", name="wrist", pos=numbers(pose.p))
    ElementTree.SubElement(
        carrier, "inertial", pos="0 0 0", mass="0.5", diaginertia="1e-3 1e-3 1e-3"
    )
    carrier.set("gravcomp", "1")
    palm = ElementTree.SubElement(carrier, "body", name="hand", gravcomp="1")
    palm.set("quat", placement(pose)["quat"])
    axes = ("1 0 0", "0 1 0", "0 0 1")
    # The arm's own inertia as the hand feels it.
    for name, axis in zip(("x", "y", "z"), axes, strict=True):
        ElementTree.SubElement(
            carrier, "joint", name=f"wrist_{name}", type="slide", axis=axis,
            armature="5",
        )  # fmt: skip
    for name, axis in zip(("roll", "pitch", "yaw"), axes, strict=True):
        ElementTree.SubElement(
            palm, "joint", name=f"wrist_{name}", type="hinge", axis=axis,
            armature="0.05",
        )  # fmt: skip
    return palm
