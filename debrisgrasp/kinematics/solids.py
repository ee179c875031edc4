"""Solids of a link's collision geometry."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from debrisgrasp._arrays import FloatArray, require_metres
from debrisgrasp._unreadable import PULL, is_pointer, why_not_there
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.geometry import SE3, Box, Capsule, Cylinder, Solid, Sphere

from .hull import Hull
from .packages import PACKAGE_SCHEME, package_folders
from .urdf import UrdfShape

__all__ = ["solids_of_shape"]

_MEND = (
    "Put the mesh there, or give the link collision primitives; a KinematicChain alone "
    "needs no meshes."
)


def solids_of_shape(shape: UrdfShape, link: str, folder: Path) -> tuple[Solid, ...]:
    """Solids that contain a collision geometry, in the link's frame.

    Primitives are taken as they are; every connected piece of a mesh
    is replaced by its convex hull.

    Parameters
    ----------
    shape
        The geometry.
    link
        Name of its link, for messages.
    folder
        Folder of the URDF, against which relative mesh files are looked up.

    Raises
    ------
    ConfigError
        If a mesh file can't be found or read.
    """
    size, T = shape.size, shape.T_link_shape
    if shape.kind == "box":
        return (Box(0.5 * np.array(size), T),)
    if shape.kind == "sphere":
        return (Sphere(size[0], T.p),)
    if shape.kind == "cylinder":
        return (Cylinder(size[0], size[1], T),)
    if shape.kind == "capsule":
        return (Capsule(size[0], size[1], T),)
    return _mesh_hulls(shape, link, folder)


@lru_cache(maxsize=1024)
def _mesh_hulls(shape: UrdfShape, link: str, folder: Path) -> tuple[Solid, ...]:
    """Convex hull of every connected piece of a mesh."""
    import trimesh  # slow to load, and only robots with meshes need it

    path = _mesh_path(shape.file, folder)
    if nothing := why_not_there(path, "file"):
        raise ConfigError(
            f"collision mesh of link {link!r}",
            got=f"{shape.file}: {nothing} ({path})",
            expected="a readable mesh file",
            mend=_MEND,
        )
    if is_pointer(path):
        raise ConfigError(
            f"collision mesh of link {link!r}",
            got=f"a pointer of Git LFS at {path}",
            expected="the mesh itself",
            mend=PULL,
        )
    try:
        mesh = trimesh.load(path, force="mesh")
        pieces = [
            np.asarray(piece.vertices) * np.array(shape.size)
            for piece in mesh.split(only_watertight=False)
        ]
        if not pieces:
            raise ValueError("no triangles")
    except Exception as error:  # loaders raise whatever they please
        raise ConfigError(
            f"collision mesh of link {link!r}",
            got=f"{path}, that can't be read ({str(error) or type(error).__name__})",
            expected="a readable mesh file",
            mend=_MEND,
        ) from error
    for points in pieces:
        require_metres(f"{shape.file} times its scale, of link {link!r}", points)
    return tuple(_hull(points, shape.T_link_shape) for points in pieces)


def _hull(points: FloatArray, T_link_mesh: SE3) -> Solid:
    """Hull of points, or their box if they lie in a plane."""
    try:
        return Hull(points, T_link_mesh)
    except InputError:
        lower, upper = points.min(axis=0), points.max(axis=0)
        center = SE3.from_parts(p=0.5 * (lower + upper))
        half = np.maximum(0.5 * (upper - lower), 1e-4)
        return Box(half, T_link_mesh @ center)


def _mesh_path(file: str, folder: Path) -> Path:
    if file.startswith(PACKAGE_SCHEME):
        # package://NAME/meshes/a.stl: look for NAME, then for what follows, upwards.
        inside = file.removeprefix(PACKAGE_SCHEME)
        below = inside.partition("/")[2]
        for parent in (folder, *folder.parents):
            for candidate in (parent / inside, parent / below):
                if candidate.is_file():
                    return candidate
        elsewhere = (root / inside for root in package_folders())
        return next(filter(Path.is_file, elsewhere), folder / inside)
    return folder / file.removeprefix("file://")
