"""A rigid piece of debris: convex parts, a mass, and where it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray, require_finite
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, Box, Capsule, Cylinder, Solid, Sphere

from .hull import Hull

__all__ = ["Body", "Part", "as_part", "volume_and_centroid"]

Part = Box | Cylinder | Capsule | Sphere | Hull
"""A convex part of a body, in the frame of the body."""
_HEAVIEST = 1e5
"""A mass beyond this [kg] can only be grams."""


@checked_fields
@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A rigid body made of convex parts of one density.

    Raises
    ------
    InputError
        If it has no part, a mass of nothing or of over 100 t, or a pose that isn't
        finite and rigid.
    """

    name: str
    """Unique in its world."""
    kind: str
    """Name of its `Kind`, or any other word for what it is."""
    parts: tuple[Part, ...]
    """Convex solids in the body frame; together they are the body."""
    mass: float
    """Mass [kg]."""
    T_base_body: SE3 = field(default_factory=SE3.identity)
    """Where the body is."""
    color: tuple[int, int, int] = (150, 150, 150)
    """Red, green, blue of its material, 0 to 255."""
    sizes: Mapping[str, float] = field(default_factory=dict)
    """What its kind was built with, lengths in [m]."""

    def __post_init__(self) -> None:
        if not self.parts:
            raise InputError(
                f"parts of {self.name}", got="none", expected="one convex solid or more"
            )
        if not 0 < self.mass <= _HEAVIEST:
            raise InputError(
                f"mass of {self.name}",
                got=self.mass,
                expected=f"more than 0 and at most {_HEAVIEST:.0f} kg",
            )
        pose = SE3.from_matrix(self.T_base_body.matrix, f"pose of {self.name}")
        object.__setattr__(self, "T_base_body", pose)
        object.__setattr__(self, "sizes", dict(self.sizes))

    @property
    def volume(self) -> float:
        """Sum of the volumes of the parts [m^3]."""
        return float(sum(volume_and_centroid(part)[0] for part in self.parts))

    @property
    def density(self) -> float:
        """Mass over volume [kg/m^3]."""
        return self.mass / self.volume

    @property
    def center_of_mass(self) -> FloatArray:
        """Centre of mass in the body frame [m], shape (3,)."""
        pieces = [volume_and_centroid(part) for part in self.parts]
        volumes = np.array([volume for volume, _ in pieces])
        centroids = np.array([centroid for _, centroid in pieces])
        return np.asarray(volumes @ centroids / volumes.sum())

    @property
    def solids(self) -> tuple[Part, ...]:
        """The parts in the base frame."""
        return tuple(part.moved(self.T_base_body) for part in self.parts)

    def mesh(self) -> tuple[FloatArray, IntArray]:
        """Put together the closed triangle meshes of all parts, in the body frame.

        Returns
        -------
        vertices, faces
            Shapes (v, 3) [m] and (f, 3), outward-wound. Parts that touch keep their
            inner faces; the outside is right.
        """
        meshes = [part.mesh() for part in self.parts]
        starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes[:-1])])
        faces = [f + start for (_, f), start in zip(meshes, starts, strict=True)]
        return np.concatenate([v for v, _ in meshes]), np.concatenate(faces)

    def at(self, T_base_body: SE3) -> Body:
        """Return the same body elsewhere."""
        return replace(self, T_base_body=T_base_body)

    def renamed(self, name: str) -> Body:
        """Return the same body under another name."""
        return replace(self, name=name)

    def recentered(self) -> Body:
        """Return the body with the origin of its frame at its centre of mass."""
        shift = SE3.from_parts(p=-self.center_of_mass)
        return replace(self, parts=tuple(part.moved(shift) for part in self.parts))


def as_part(solid: Solid) -> Part:
    """Return a convex solid as one of the known kinds; of others, the hull."""
    if isinstance(solid, Part):
        return solid
    return Hull.around(solid.mesh()[0])


@checked
def volume_and_centroid(part: Part) -> tuple[float, FloatArray]:
    """Volume [m^3] and centroid [m], shape (3,), of a convex part in its frame."""
    if isinstance(part, Box):
        return 8.0 * float(np.prod(part.half_extents)), part.T_frame_solid.p
    if isinstance(part, Cylinder):
        return np.pi * part.radius**2 * part.length, part.T_frame_solid.p
    if isinstance(part, Capsule):
        round_ends = 4.0 / 3.0 * np.pi * part.radius**3
        straight = np.pi * part.radius**2 * part.length
        return straight + round_ends, part.T_frame_solid.p
    if isinstance(part, Sphere):
        return 4.0 / 3.0 * np.pi * part.radius**3, part.center
    corners = part.vertices[part.faces]
    require_finite(corners, "vertices")
    inside = part.vertices.mean(axis=0)
    spans = corners - inside
    volumes = np.linalg.det(spans) / 6.0
    centroids = inside + spans.sum(axis=1) / 4.0
    return float(volumes.sum()), np.asarray(volumes @ centroids / volumes.sum())
