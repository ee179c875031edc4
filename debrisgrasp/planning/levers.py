"""How hands hold torque: the levers of what touches the object."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.prototypes import GripperModel, PrototypeLibrary

from .mass import LoadConfig

__all__ = ["GripLevers"]

_PARALLEL = 0.7
"""Cosine from which on two axes count as one."""


@dataclass(frozen=True, slots=True, eq=False)
class GripLevers:
    """Where the pads of p closed hands are, and how they hold torque."""

    middle: FloatArray
    """Middle between the pads [m], palm frame, shape (p, 3)."""
    lever: FloatArray
    """Lever of the contacts about x, y and z of the palm frame [m], shape (p, 3)."""
    width: FloatArray
    """Of what is between the pads [m], shape (p,)."""
    max_force: FloatArray
    """Largest force at the fingers [N], shape (p,)."""

    @classmethod
    def of(
        cls, hands: list[tuple[GripperModel, str, float]], config: LoadConfig
    ) -> GripLevers:
        """Collect hands, each at a preshape, closed to a width [m].

        Torque about the closing axis twists the contacts; that about y and z is held
        by the pads of one side, and by the palm, pressing unevenly.
        """
        middle, lever, force = [], [], []
        for gripper, preshape, width in hands:
            pads = gripper.pad_positions(preshape, width)
            sides = np.array([finger.side for finger in gripper.fingers])
            grip = np.mean([pads[sides == side].mean(axis=0) for side in (-1, 1)], 0)
            span = float(np.ptp(pads[:, 1])) / 2
            depth = max(float(grip[2]), 0.0)
            middle.append([0.0, grip[1], grip[2]])
            patch = config.patch
            lever.append([0.67 * patch + span / 2, patch + depth / 2, patch + span])
            force.append(gripper.max_force)
        widths = np.array([width for _, _, width in hands])
        return cls(np.array(middle), np.array(lever), widths, np.array(force))

    @classmethod
    def on(cls, library: PrototypeLibrary, config: LoadConfig) -> GripLevers:
        """Collect the hands of prototypes, closed on them.

        What is round rolls between the pads: there only friction holds torque about
        its axis, at the lever of its radius.
        """
        levers = cls.of(
            [(library.grippers[p.gripper], p.preshape, p.width) for p in library],
            config,
        )
        held = levers.lever.copy()
        for own, prototype in zip(held, library, strict=True):
            spin = prototype.symmetry.spin
            if spin is not None:
                is_axis = np.abs(spin.direction) > _PARALLEL
                rolls = config.expected_friction * prototype.width
                own[is_axis] = np.minimum(own[is_axis], rolls)
        return replace(levers, lever=held)
