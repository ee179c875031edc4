"""Hands: their solids in the palm frame for every preshape and opening."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._files import data_path, is_yaml, last_changed, yaml_files
from debrisgrasp.errors import ConfigError, InputError, UnknownNameError
from debrisgrasp.geometry import SE3, lattice
from debrisgrasp.geometry.solids import Box, Solid, SphereSet

from .hand_file import read_hand
from .hand_kinematics import Finger, Preshape

__all__ = [
    "FURTHER_HANDS",
    "GripperModel",
    "known_grippers",
    "load_grippers",
    "require_hands",
    "with_shipped",
]

_STEP = 1e-3
"""Spacing along the closing axis of places that may be in a finger [m] ..."""
_ACROSS = np.linspace(0.1, 0.9, 5)
"""... and where they are across it, as shares of its width."""
_OUT = 0.01
"""A palm that stands out of its frame by more than this is in the objects [m]."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GripperModel:
    """One hand; everything it returns is in its palm frame ``hand``.

    Origin on the palm face, +z out of the palm (approach), +x the closing axis from the
    thumb side to the side of the finger pair, y across the fingers.
    """

    name: str
    description: str
    mass: float
    """[kg]."""
    max_force: float
    """Largest force of all fingers of one side together, at the pads [N]."""
    palm: tuple[Solid, ...]
    """Solids that do not move."""
    fingers: tuple[Finger, ...]
    preshapes: Mapping[str, Preshape]

    def __repr__(self) -> str:
        return f"<GripperModel {self.name}: preshapes {', '.join(self.preshapes)}>"

    @classmethod
    def load(cls, name_or_path: str | os.PathLike[str]) -> GripperModel:
        """Read a shipped hand by its name, or any hand from its YAML file.

        Raises
        ------
        UnknownNameError
            If no hand of that name is shipped; it lists those that are.
        ConfigError
            If the file is malformed; it names file, field and range.
        """
        path = Path(name_or_path)
        if is_yaml(path):
            return cls(**read_hand(path))
        known = known_grippers()
        if str(name_or_path) not in known:
            raise UnknownNameError("gripper", str(name_or_path), known)
        path = data_path("grippers", f"{name_or_path}.yaml")
        return _shipped(path, last_changed(path))

    def preshape(self, name: str) -> Preshape:
        """Preshape of that name; an unknown one raises `UnknownNameError`."""
        if name not in self.preshapes:
            raise UnknownNameError(f"preshape of {self.name}", name, self.preshapes)
        return self.preshapes[name]

    @property
    def opening_range(self) -> tuple[float, float]:
        """Distances between the pads that every preshape reaches [m]."""
        low = max(float(shape.openings[-1]) for shape in self.preshapes.values())
        high = min(float(shape.openings[0]) for shape in self.preshapes.values())
        return max(low, 0.0), high

    @property
    def palm_doubt(self) -> str:
        """What speaks against the palm frame, in words; empty if nothing does.

        The palm ends where that frame is, the pads are in front of it, and the fingers
        of both sides close on its middle.
        """
        out = max((float(solid.bounds.upper[2]) for solid in self.palm), default=0.0)
        ahead = max(
            float(self.pad_positions(name, shape.widest)[:, 2].max())
            for name, shape in self.preshapes.items()
        )
        found = [f"all pads lie {-1e3 * ahead:.0f} mm behind"] if ahead < 0.0 else []
        if out > _OUT:
            found.append(f"the palm reaches {1e3 * out:.0f} mm in front of")
        beside = max(map(self._beside, self.preshapes), key=abs)
        if abs(beside) > _OUT:
            found.append(f"the fingers close {1e3 * abs(beside):.0f} mm beside")
        if not found:
            return ""
        return (
            f"{' and '.join(found)} the palm frame of {self.name}: is that turned, or "
            "elsewhere? Its origin lies on the palm face, midway between the pads, z "
            "points out of the palm"
        )

    def opening_to_command(self, preshape: str, opening: float) -> float:
        """Return the closing command at which the pads are ``opening`` [m] apart.

        Raises
        ------
        InputError
            If the preshape doesn't open so far, or close so far.
        """
        shape = self.preshape(preshape)
        low, high = shape.narrowest, shape.widest
        # Half a micrometre lets the ends of the range survive a round trip.
        if not low - 5e-7 <= opening <= high + 5e-7:
            raise InputError(
                f"opening of {self.name}, preshape {preshape}",
                got=f"{opening:g} m",
                expected=f"{low:g} to {high:.4g} m",
            )
        return float(np.interp(-opening, -shape.openings, shape.commands))

    def command_to_opening(self, preshape: str, command: float) -> float:
        """Distance between the pads [m] at a command; negative when they cross.

        A driver's readings become openings by it, so it never raises for a number: one
        beyond the commands of the preshape, as sensors overshoot, counts as the nearest
        of them, and NaN, as they fail, stays NaN.
        """
        shape = self.preshape(preshape)
        return float(np.interp(command, shape.commands, shape.openings))

    def joint_values(self, preshape: str, opening: float) -> dict[str, float]:
        """Value of every joint, named ``<finger>_<joint>`` [rad or m]."""
        values = self._values(preshape, opening)
        return {
            name: value
            for finger in self.fingers
            for name, value in finger.joint_values(values).items()
        }

    def solids(self, preshape: str, opening: float) -> tuple[Solid, ...]:
        """Palm and fingers with the pads ``opening`` [m] apart."""
        return self.palm + self.finger_solids(preshape, opening)

    def finger_solids(
        self, preshape: str, opening: float, side: int | None = None
    ) -> tuple[Solid, ...]:
        """Solids of the fingers, or of those on one side: -1 thumb, +1 pair."""
        placed = _placed(self, preshape, opening)
        return tuple(
            solid
            for finger, solids in zip(self.fingers, placed, strict=True)
            if side in (None, finger.side)
            for solid in solids
        )

    def sphere_cover(
        self, preshape: str, opening: float, max_radius: float = 0.02
    ) -> SphereSet:
        """Spheres that contain palm and fingers.

        Returns
        -------
        centers, radii
            Shapes (s, 3) and (s,) [m].
        """
        return _cover(self.solids(preshape, opening), max_radius)

    def pad_positions(self, preshape: str, opening: float) -> FloatArray:
        """Where the pads are [m], shape (fingers, 3), in the order of `fingers`."""
        poses = _link_poses(self, preshape, opening)
        pads = zip(self.fingers, poses, strict=True)
        return np.stack([links[-1].apply(finger.pad) for finger, links in pads])

    def link_poses(
        self, preshape: str, openings: FloatArray
    ) -> tuple[tuple[SE3, ...], ...]:
        """Poses (k,) of the links of each finger, in hand, at openings (k,) [m]."""
        commands = [self.opening_to_command(preshape, opening) for opening in openings]
        values = self.preshape(preshape).values(np.array(commands))
        return tuple(finger.link_poses(values) for finger in self.fingers)

    def fingertip_reach(self, preshape: str, opening: float) -> float:
        """How far the fingers stand out in front of the palm [m]."""
        solids = self.finger_solids(preshape, opening)
        return max(float(solid.bounds.upper[2]) for solid in solids)

    def inner_faces(
        self, preshape: str, opening: float, heights: FloatArray
    ) -> FloatArray:
        """How far from the middle the inner face of each side is.

        Parameters
        ----------
        heights
            Over the palm [m], shape (n,).

        Returns
        -------
        FloatArray
            To 1 mm [m], thumb side first, shape (2, n); infinite where a side has no
            finger.

        Raises
        ------
        UnknownNameError
            If there is no such preshape.
        """
        inner = np.full((2, len(heights)), np.inf)
        for faces, side in zip(inner, (-1, 1), strict=True):
            for solid in self.finger_solids(preshape, opening, side):
                bounds = solid.bounds
                low, high = bounds.lower, bounds.upper
                is_level = (heights > low[2] - _STEP) & (heights < high[2] + _STEP)
                x = np.arange(low[0], high[0] + _STEP, _STEP)
                y = low[1] + (high - low)[1] * _ACROSS
                points = lattice(x, y, heights[is_level])
                depth = solid.signed_distance(points.reshape(-1, 3))
                depth = depth.reshape(points.shape[:-1])
                is_in = depth.min(axis=1) < 0.5 * _STEP
                ends = np.where(is_in, side * x[:, None], np.inf).min(axis=0)
                faces[is_level] = np.minimum(faces[is_level], ends)
        return inner

    def closing_region(self, preshape: str, opening: float) -> Box:
        """Volume between the fingers, from the palm to their tips.

        An object is only gripped if some of it lies in here: within the reach of the
        fingers along z, between the pads along x, and as far across as the outermost
        fingers stand.
        """
        placed = _placed(self, preshape, opening)
        last_links = [solid for solids in placed for solid in solids[-1:]]
        reach = self.fingertip_reach(preshape, opening)
        lower = min(float(solid.bounds.lower[1]) for solid in last_links)
        upper = max(float(solid.bounds.upper[1]) for solid in last_links)
        half = np.array([opening / 2, (upper - lower) / 2, reach / 2])
        center = SE3.from_parts(None, [0.0, (upper + lower) / 2, reach / 2])
        return Box(np.maximum(half, 1e-4), center)

    def _beside(self, preshape: str) -> float:
        """Middle of the half closed pads, along x of the palm frame [m]."""
        pads = self.pad_positions(preshape, sum(self.preshape(preshape).widths) / 2)
        sides = np.array([finger.side for finger in self.fingers])
        middles = [pads[sides == side, 0].mean() for side in np.unique(sides)]
        return float(np.mean(middles)) if len(middles) == 2 else 0.0

    def _values(self, preshape: str, opening: float) -> dict[str, float]:
        command = self.opening_to_command(preshape, opening)
        return self.preshape(preshape).values(command)


@lru_cache(maxsize=8)
def _shipped(path: Path, _changed: object) -> GripperModel:
    """Hand of a shipped file: one object for all who ask, for much is derived of it."""
    return GripperModel(**read_hand(path))


@lru_cache(maxsize=256)
def _link_poses(
    gripper: GripperModel, preshape: str, opening: float
) -> tuple[tuple[SE3, ...], ...]:
    """Links of each finger; the same few openings are asked for again and again."""
    values = gripper._values(preshape, opening)
    return tuple(finger.link_poses(values) for finger in gripper.fingers)


@lru_cache(maxsize=256)
def _placed(
    gripper: GripperModel, preshape: str, opening: float
) -> tuple[tuple[Solid, ...], ...]:
    """Solids of each finger."""
    poses = _link_poses(gripper, preshape, opening)
    fingers = zip(gripper.fingers, poses, strict=True)
    return tuple(finger.placed(links) for finger, links in fingers)


FURTHER_HANDS = (
    "The folder of your own hands is given as --grippers, grippers=, or in a site."
)
"""How a hand that does not ship is made known."""


def load_grippers(
    folder: str | os.PathLike[str] | None = None,
) -> dict[str, GripperModel]:
    """Load the shipped hands, and those of a folder of YAML files if one is given.

    Raises
    ------
    ConfigError
        If there is no file in it, one is malformed, or a name is taken already.
    """
    hands = {name: GripperModel.load(name) for name in known_grippers()}
    if folder is None:
        return hands
    files = yaml_files(folder, "hands")
    if not files:
        raise ConfigError(
            f"{folder}", got="no .yaml file in it", expected="one file per hand"
        )
    for path in files:
        hand = GripperModel.load(path)
        if hand.name in hands:
            raise ConfigError(
                f"{path}, field name",
                got=repr(hand.name),
                expected="a name that no other hand has, of the folder or shipped",
            )
        hands[hand.name] = hand
    return hands


def require_hands(grippers: object) -> None:
    """Raise `InputError` unless these are hands by name; what else would go unseen."""
    hands = grippers.values() if isinstance(grippers, Mapping) else [None]
    if not all(isinstance(hand, GripperModel) for hand in hands):
        got = [type(hand).__name__ for hand in hands if hand is not None]
        raise InputError(
            "grippers",
            got=" and ".join(got) or type(grippers).__name__,
            expected="hands by name",
            mend="load_grippers(folder) of debrisgrasp.prototypes reads a folder.",
        )


def with_shipped(
    grippers: Mapping[str, GripperModel] | None = None,
) -> dict[str, GripperModel]:
    """Return the shipped hands and others by name, which go before shipped ones."""
    require_hands({} if grippers is None else grippers)
    return {**load_grippers(), **(grippers or {})}


def known_grippers() -> tuple[str, ...]:
    """Names of the hands that ship with the package."""
    return tuple(sorted(path.stem for path in data_path("grippers").glob("*.yaml")))


def _cover(solids: tuple[Solid, ...], max_radius: float) -> SphereSet:
    covers = [solid.sphere_cover(max_radius) for solid in solids]
    return (
        np.concatenate([centers for centers, _ in covers]),
        np.concatenate([radii for _, radii in covers]),
    )
