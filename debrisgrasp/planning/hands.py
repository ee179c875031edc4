"""The preshaped hand of every prototype, packed so that all are checked at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import Float32Array, FloatArray, IntArray
from debrisgrasp.errors import ConfigError
from debrisgrasp.prototypes import GraspPrototype, GripperModel, PrototypeLibrary

from .hand_space import PackedSpaces, SpaceOfHand

__all__ = ["SPHERE_RADIUS", "PackedHands"]

SPHERE_RADIUS = 0.03
"""Largest sphere of the cover of a hand [m]: wider ones are fewer and stand out more
over flat sides."""


@dataclass(frozen=True, slots=True, eq=False)
class PackedHands:
    """Hands at their open preshape, one for each of p prototypes, in the palm frame."""

    centers: Float32Array
    """Spheres that cover the hand [m], shape (p, 3, s)."""
    radii: Float32Array
    """Their radii [m], shape (p, s); minus infinity where a hand has fewer."""
    parts: IntArray
    """Which part each sphere belongs to: 0 the palm, 1 the thumb side, 2 the side of
    the finger pair, -1 none; shape (p, s)."""
    ends: Float32Array
    """Far end and middle of every link of the fingers [m], shape (p, 3, e)."""
    space_index: IntArray
    """Which of ``spaces`` each prototype's hand has, shape (p,)."""
    spaces: PackedSpaces
    """One for each combination of hand, preshape, opening and width."""
    grip_points: FloatArray
    """Middle of the space between the fingers [m], shape (p, 3)."""
    slack: FloatArray
    """Least distance between the open fingers and the prototype [m], shape (p,)."""

    @classmethod
    def pack(
        cls, library: PrototypeLibrary, *, approach: float, tolerance: float
    ) -> PackedHands:
        """Collect the hand of each prototype of a dictionary.

        Raises
        ------
        ConfigError
            If a prototype's shape lies inside its own open hand.
        """
        hand_of = [
            (library.grippers[p.gripper], p.preshape, p.opening) for p in library
        ]
        keys = list(zip(hand_of, (p.width for p in library), strict=True))
        hands, unique = list(dict.fromkeys(hand_of)), list(dict.fromkeys(keys))
        # Hands of one opening differ in what they sweep while they close.
        opened = {
            hand: SpaceOfHand.of(*hand, approach=approach, tolerance=tolerance)
            for hand in hands
        }
        spaces = PackedSpaces.pack(
            opened[hand].closed(*hand, width, tolerance=tolerance)
            for hand, width in unique
        )
        covers = [_cover(*hand) for hand in hands]
        ends = [_ends(*hand) for hand in hands]
        grips = [
            gripper.closing_region(preshape, opening).T_frame_solid.p
            for gripper, preshape, opening in hands
        ]
        index = np.array([hands.index(hand) for hand in hand_of])
        most = max(len(part) for _, _, part in covers)
        centers = np.zeros((len(hands), 3, most), np.float32)
        radii = np.full((len(hands), most), -np.inf, np.float32)
        parts = np.full((len(hands), most), -1, np.int8)
        for i, (center, radius, part) in enumerate(covers):
            n = len(part)
            centers[i, :, :n], radii[i, :n], parts[i, :n] = center.T, radius, part
        return cls(
            centers=centers[index],
            radii=radii[index],
            parts=parts[index],
            ends=_padded(ends)[index],
            space_index=np.array([unique.index(key) for key in keys]),
            spaces=spaces,
            grip_points=np.array(grips)[index],
            slack=np.array([_slack(p, library.grippers[p.gripper]) for p in library]),
        )


def _ends(gripper: GripperModel, preshape: str, opening: float) -> FloatArray:
    """Far end along the palm's axis, and middle, of every link of fingers (3, e)."""
    found = []
    for solid in gripper.finger_solids(preshape, opening):
        corners = solid.mesh()[0]
        end = corners[corners[:, 2] > corners[:, 2].max() - _BLUNT].mean(axis=0)
        found += [end, corners.mean(axis=0)]
    return np.array(found).T


def _padded(rows: list[FloatArray]) -> Float32Array:
    """Places (3, e) of all hands; the first of one again where it has fewer."""
    most = max(row.shape[1] for row in rows)
    return np.array(
        [np.pad(row, ((0, 0), (most - row.shape[1], 0)), mode="edge") for row in rows],
        dtype=np.float32,
    )


_BLUNT = 0.004
"""Corners no farther back than this belong to the end of a link [m]."""


def _slack(prototype: GraspPrototype, gripper: GripperModel) -> float:
    """Least distance between the open fingers of a hand and what it grips [m]."""
    fingers = gripper.finger_solids(prototype.preshape, prototype.opening)
    gaps = [float(s.signed_distance(prototype.points).min()) for s in fingers]
    slack = min(gaps, default=0.0)
    palm = [float(s.signed_distance(prototype.points).min()) for s in gripper.palm]
    depth = -min([slack, *palm])
    if depth > _INTO_ITSELF:
        raise ConfigError(
            f"prototype {prototype.name}",
            got=f"a shape that reaches {1e3 * depth:.0f} mm into its own open hand",
            expected=f"at most {1e3 * _INTO_ITSELF:.0f} mm",
            mend="Move the shape or open wider: `debrisgrasp prototype check` tells "
            "where.",
        )
    return slack


_INTO_ITSELF = 0.01
"""A grasp is not possible where the surface to be gripped lies deeper in the hand [m];
less may be what a camera added to it."""


def _cover(
    gripper: GripperModel, preshape: str, opening: float
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Centres (s, 3), radii (s,) and parts (s,) of the spheres that cover a hand."""
    parts = (
        gripper.palm,
        gripper.finger_solids(preshape, opening, side=-1),
        gripper.finger_solids(preshape, opening, side=1),
    )
    covers = [
        (*solid.sphere_cover(SPHERE_RADIUS), part)
        for part, solids in enumerate(parts)
        for solid in solids
    ]
    centers, radii, part = zip(*covers, strict=True)
    counts = [len(radius) for radius in radii]
    return np.concatenate(centers), np.concatenate(radii), np.repeat(part, counts)
