"""The points of a measured prototype, as a PLY file beside its YAML."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._unreadable import why_not_there
from debrisgrasp.errors import ConfigError, InputError

from .surface_shape import SurfaceShape

__all__ = ["read_surface", "surface_bytes"]

_COLUMNS = ("x", "y", "z", "nx", "ny", "nz")
_KINDS = {
    **{"float": "f4", "float32": "f4", "double": "f8", "float64": "f8"},
    **{"uchar": "u1", "uint8": "u1", "char": "i1", "int8": "i1"},
    **{"short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2"},
    **{"int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4"},
}
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}


def surface_bytes(shape: SurfaceShape) -> bytes:
    """Content of the PLY file that `read_surface` reads back, to single precision."""
    lines = ["ply", "format binary_little_endian 1.0"]
    lines += ["comment metres, outward normals", f"element vertex {len(shape.points)}"]
    lines += [f"property float {name}" for name in _COLUMNS]
    table = np.hstack([shape.points, shape.normals]).astype("<f4")
    return "\n".join([*lines, "end_header", ""]).encode() + table.tobytes()


def read_surface(path: str | os.PathLike[str], sides: str) -> SurfaceShape:
    """Read points with normals [m] from a PLY file.

    Raises
    ------
    ConfigError
        If it can't be read, has no normals, or holds something that isn't a surface in
        metres.
    """
    why = why_not_there(Path(path), "file")  # a device has no end
    if why:
        raise ConfigError(str(path), got=why, expected="a readable file")
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        reason = error.strerror or str(error)
        raise ConfigError(str(path), got=reason, expected="a readable file") from error
    try:
        table = _table(content, str(path))
    except (ValueError, OverflowError, UnicodeDecodeError) as error:
        if isinstance(error, InputError):
            raise
        raise ConfigError(
            str(path), got=str(error), expected="a PLY file of points with normals"
        ) from error
    normals = table[:, 3:]
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    try:
        return SurfaceShape(
            table[:, :3], normals / np.where(length > 0, length, np.nan), sides
        )
    except InputError as error:
        raise ConfigError.about(f"{path}: {error.what}", error) from error


def _table(content: bytes, name: str) -> FloatArray:
    """Positions and normals of the vertices, shape (n, 6)."""
    head, mark, body = content.partition(b"end_header")
    if not head.startswith(b"ply") or not mark:
        raise ConfigError(
            name, got="no 'ply' ... 'end_header'", expected="a PLY header"
        )
    body = body[body.find(b"\n") + 1 :]
    encoding, n, layout, element = "", 0, [], ""
    for words in (line.split() for line in head.decode("latin-1").splitlines()):
        match words:
            case ["format", encoding, _]:
                pass
            case ["element", element, count]:
                n = int(count) if element == "vertex" else n
            case ["property", kind, column] if element == "vertex" and kind in _KINDS:
                layout.append((column, _KINDS[kind]))
    columns = [column for column, _ in layout]
    missing = [column for column in _COLUMNS if column not in columns]
    if missing or encoding not in _ORDERS:
        raise ConfigError(
            name,
            got=f"format {encoding or 'none'}, vertices of {', '.join(columns)}",
            expected="vertices of x, y, z, nx, ny, nz",
            mend="Compute normals that point outwards, and export them too.",
        )
    if encoding == "ascii":
        rows = [line.split() for line in body.decode("latin-1").splitlines() if line]
        table = np.array([row[: len(columns)] for row in rows[:n]], dtype=np.float64)
        table = table.reshape(-1, len(columns))
    else:
        order = _ORDERS[encoding]
        kinds = np.dtype([(column, order + kind) for column, kind in layout])
        raw = np.frombuffer(body, dtype=kinds, count=n)
        table = np.column_stack([raw[column] for column in columns]).astype(np.float64)
    if len(table) != n:
        raise ConfigError(name, got=f"{len(table)} vertices", expected=f"{n} vertices")
    chosen: FloatArray = table[:, [columns.index(column) for column in _COLUMNS]]
    return chosen
