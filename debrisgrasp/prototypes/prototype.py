"""Grasp prototypes: a piece of surface as a hand holds it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from debrisgrasp._arrays import BoolArray, FloatArray, frozen
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp.errors import ConfigError, ShapeError, UnknownNameError
from debrisgrasp.geometry import SE3, Bounds

from .shapes import Shape
from .surfaces import sample
from .symmetry import Symmetry
from .visibility import VisibilityTable, visible_points

__all__ = [
    "DEFAULT_DENSITY",
    "KINDS",
    "GraspPrototype",
    "PackedPrototypes",
    "PrototypeDefinition",
    "require_name",
]

DEFAULT_DENSITY = 1e4
"""Points per square metre of surface: one per square centimetre."""

KINDS = ("generic", "object-specific")
_NAME = re.compile(r"[a-z0-9][a-z0-9_]*")


def require_name(name: str, where: str) -> str:
    """Return a name that files may have; any other raises `ConfigError`."""
    if not _NAME.fullmatch(name):
        raise ConfigError(
            where,
            got=repr(name),
            expected="lower-case letters, digits and underscores",
        )
    return name


@checked_fields
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PrototypeDefinition:
    """What a file says about a prototype."""

    name: str
    gripper: str
    """Name of the hand that it is for."""
    preshape: str
    width: float
    """Distance between the finger pads when closed on the shape [m]."""
    opening: float
    """Distance between the finger pads during the approach [m]."""
    shape: Shape
    T_hand_shape: SE3
    """Where the shape is in the palm frame when the fingers close."""
    kind: str = "generic"
    """``generic``, or ``object-specific``: only tried where an object is marked."""
    has_shape_symmetry: bool = True
    """Whether the symmetries of the shape lead to useful grasps."""
    tags: tuple[str, ...] = ()
    description: str = ""

    def __post_init__(self) -> None:
        require_name(self.name, "name of the prototype")
        if self.kind not in KINDS:
            raise UnknownNameError("kind of prototype", self.kind, KINDS)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GraspPrototype:
    """A definition with its surface sampled; all in the palm frame ``hand``."""

    definition: PrototypeDefinition
    points: FloatArray
    """Surface around the grip [m], shape (m, 3)."""
    normals: FloatArray
    """Outward unit normals, shape (m, 3)."""
    visible: VisibilityTable
    """What a camera sees of the points from each side."""
    symmetry: Symmetry
    """Motions of the palm frame that leave the shape as it is."""

    def __post_init__(self) -> None:
        for name in ("points", "normals"):
            object.__setattr__(self, name, frozen(getattr(self, name), name, (3,)))
        if self.points.ndim != 2 or self.points.shape != self.normals.shape:
            raise ShapeError(
                "points and normals",
                got=f"{self.points.shape} and {self.normals.shape}",
                expected="both (m, 3)",
            )

    def __repr__(self) -> str:
        words = f"{self.name} for {self.gripper}, preshape {self.preshape}"
        return f"<GraspPrototype {words}: {len(self.points)} points>"

    @classmethod
    @checked
    def build(
        cls,
        definition: PrototypeDefinition,
        directions: FloatArray,
        density: float = DEFAULT_DENSITY,
    ) -> GraspPrototype:
        """Sample the shape of a definition and find out what is seen of it.

        Parameters
        ----------
        directions
            Unit vectors towards the camera in the palm frame, shape (d, 3).
        density
            Points per square metre, the same for all prototypes of a dictionary.
        """
        shape, T_hand_shape = definition.shape, definition.T_hand_shape
        parts = shape.parts()
        points, normals = sample(shape.patches(), parts, density)
        seen = visible_points(
            points, normals, parts, T_hand_shape.inverse().rotate(directions)
        )
        symmetry = shape.symmetry() if definition.has_shape_symmetry else Symmetry()
        return cls(
            definition=definition,
            points=T_hand_shape.apply(points),
            normals=T_hand_shape.rotate(normals),
            visible=VisibilityTable(directions, seen),
            symmetry=symmetry.moved(T_hand_shape),
        )

    @property
    def name(self) -> str:
        """Name by which files and plans call it."""
        return self.definition.name

    @property
    def gripper(self) -> str:
        """Name of the hand that it is for."""
        return self.definition.gripper

    @property
    def preshape(self) -> str:
        """How the fingers stand during the approach."""
        return self.definition.preshape

    @property
    def width(self) -> float:
        """Distance between the finger pads when closed on the shape [m]."""
        return self.definition.width

    @property
    def opening(self) -> float:
        """Distance between the finger pads during the approach [m]."""
        return self.definition.opening

    @property
    def kind(self) -> str:
        """``generic`` or ``object-specific``."""
        return self.definition.kind

    @property
    def bounds(self) -> Bounds:
        """Box around the points."""
        return Bounds.around(self.points)


@dataclass(frozen=True, slots=True, eq=False)
class PackedPrototypes:
    """A dictionary in arrays, padded to its largest prototype, for batched search."""

    prototypes: Sequence[GraspPrototype]
    """The p prototypes, in the order of the arrays."""
    points: FloatArray
    """[m], palm frame, shape (p, m, 3); zero where ``mask`` is false."""
    normals: FloatArray
    """Shape (p, m, 3); zero where ``mask`` is false."""
    mask: BoolArray
    """Which entries are points, shape (p, m)."""
    directions: FloatArray
    """Directions of view shared by all, shape (d, 3)."""
