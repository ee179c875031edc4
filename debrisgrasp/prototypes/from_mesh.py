"""Surfaces from mesh files."""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp._unreadable import PULL, is_pointer
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.geometry.sampling import fibonacci_sphere

from .surface_shape import SurfaceShape

__all__ = ["MESH_FORMS", "surface_from_mesh"]

MESH_FORMS = (".stl", ".obj", ".ply")

_LONGEST, _SHORTEST = 2.0, 0.01
"""Sizes of an object [m] beyond which its mesh is in other units."""
_ROUNDING = 1e-4
"""Share by which a size in single precision may be beyond them."""
_SAMPLES = 2e5
"""Samples per square metre, thinned afterwards."""
_FEWEST, _MOST = 20_000, 400_000
_N_VIEWS = 100
_VIEWED = 40_000
_AHEAD = 0.6
"""Cosine within which a view counts: along the surface, rays slip past borders."""
_INWARDS = 0.02
"""Share of the area that may be seen from behind alone: at borders of coarse meshes."""


def surface_from_mesh(
    path: str | os.PathLike[str], *, scale: float = 1.0
) -> SurfaceShape:
    """Sample the outside of a mesh, what a camera could see from somewhere.

    Parameters
    ----------
    path
        STL, OBJ or PLY; its faces wound so that normals point outwards. Where they
        aren't and the mesh is closed, that is mended; of an open one it is refused.
    scale
        What one unit of the file is in metres: 0.001 for millimetres.

    Returns
    -------
    SurfaceShape
        In the frame of the mesh, scaled.

    Raises
    ------
    ConfigError
        If the file isn't a mesh, its size can't be that of an object in metres, or
        some of its faces look inwards.
    """
    if not np.isfinite(scale) or scale <= 0:
        raise ConfigError("scale of the mesh", got=scale, expected="a number above 0")
    mesh = _loaded(Path(path))
    size = scale * float(np.ptp(mesh.vertices, axis=0).max())
    if not _SHORTEST * (1 - _ROUNDING) <= size <= _LONGEST * (1 + _ROUNDING):
        raise ConfigError(
            f"size of {path}",
            got=f"{size:.4g} m" + (f" at scale {scale:g}" if scale != 1.0 else ""),
            expected=f"{_SHORTEST:g} to {_LONGEST:g} m",
            mend="If the file is in millimetres, give the scale 0.001 (--scale 0.001); "
            "of what is longer, cut out the part around the grip."
            if size > _LONGEST
            else "If the file is in other units, give their length as scale.",
        )
    mesh.apply_scale(scale)
    points, normals = _sampled(mesh)
    try:
        is_outside = _is_seen(points, normals)
        inwards = float(np.mean(_is_seen(points, -normals) & ~is_outside))
        if inwards > _INWARDS:
            raise ConfigError(
                f"faces of {path}",
                got=f"{100 * inwards:.0f}% of their area seen from behind alone",
                expected="faces wound so that their normals point outwards",
                mend="Recalculate the normals in a mesh editor, or close the mesh.",
            )
        return SurfaceShape.thinned(points[is_outside], normals[is_outside], "all")
    except InputError as error:
        raise ConfigError.about(f"{path}: {error.what}", error) from error


def _loaded(path: Path) -> Any:
    if path.suffix.lower() not in MESH_FORMS:
        raise ConfigError(
            "mesh", got=str(path), expected="a file that ends in .stl, .obj or .ply"
        )
    if not path.is_file():
        raise ConfigError(str(path), got="no such file", expected="a mesh")
    if is_pointer(path):
        got = "a pointer of Git LFS"
        raise ConfigError(str(path), got=got, expected="the mesh itself", mend=PULL)
    trimesh = import_module("trimesh")  # slow to load
    try:
        # Unprocessed: else vertices that are not finite go, and their faces with them.
        mesh = trimesh.load(path, force="mesh", process=False)
        n_faces = len(mesh.faces)
    except Exception as error:
        raise ConfigError(
            str(path),
            got=f"nothing that can be read ({str(error) or type(error).__name__})",
            expected=f"a whole {path.suffix} mesh",
        ) from error
    if not n_faces or not np.isfinite(mesh.vertices).all():
        raise ConfigError(
            str(path),
            got=f"{n_faces} faces" if not n_faces else "vertices that are not finite",
            expected="a mesh with faces and finite vertices",
            mend="Is the file whole? A cloud of points, which has no faces, is "
            "recorded from a capture instead: `debrisgrasp prototype record`.",
        )
    mesh.process()
    if mesh.is_watertight:
        mesh.fix_normals()
    return mesh


def _sampled(mesh: Any) -> tuple[FloatArray, FloatArray]:
    """Points spread evenly over the faces, with the normals of the faces."""
    areas = np.asarray(mesh.area_faces)
    # Rounded: cut off, float noise would decide between two lattices.
    n = round(float(np.clip(areas.sum() * _SAMPLES, _FEWEST, _MOST)))
    # A lattice along the faces instead of chance: equal files give equal prototypes.
    place = (np.arange(n) + 0.5) / n * areas.sum()
    face = np.minimum(np.searchsorted(np.cumsum(areas), place), len(areas) - 1)
    # From 0.5 on: the first point at 0 would be a corner, on the verge of any grid.
    index = np.arange(n) + 0.5
    u = np.sqrt((index * 0.7548776662466927) % 1.0)[:, None]
    v = ((index * 0.5698402909980532) % 1.0)[:, None]
    a, b, c = (np.asarray(mesh.triangles)[face, corner] for corner in range(3))
    points: FloatArray = (1 - u) * a + u * (1 - v) * b + u * v * c
    normals: FloatArray = np.asarray(mesh.face_normals)[face]
    return points, normals


def _is_seen(points: FloatArray, normals: FloatArray) -> BoolArray:
    """Which points are seen from at least one direction, shape (n,)."""
    step = max(1, len(points) // _VIEWED)
    thinned = SurfaceShape.thinned(points[::step], normals[::step], "all")
    seen = np.zeros(len(points), dtype=bool)
    for direction in fibonacci_sphere(_N_VIEWS):
        left = np.flatnonzero(~seen & (normals @ direction > _AHEAD))
        seen[left] = ~thinned.body.blocks(points[left], direction[None])[0]
    return seen
