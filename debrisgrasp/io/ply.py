"""Clouds as Stanford PLY files, ASCII or binary."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from debrisgrasp.errors import CaptureError

from ._fields import CaptureFields, finite_vector, is_count, read_bytes
from ._table import binary_table, positions, text_table

__all__ = ["read_ply"]

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4"},
    **{"uint": "u4", "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1"},
    **{"int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float32": "f4", "float64": "f8"},
}
_BYTE_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_LONGEST_HEADER = 65536


@dataclass(frozen=True, slots=True)
class _Header:
    encoding: str
    n_points: int
    layout: np.dtype[Any]
    viewpoint: list[str] | None
    length: int
    """Bytes up to and including the line ``end_header``."""


def read_ply(path: Path) -> CaptureFields:
    """Read the vertices; the sensor's position is in ``comment viewpoint x y z``."""
    content = read_bytes(path)
    header = _read_header(content)
    body = content[header.length :]
    parse = text_table if header.encoding == "ascii" else binary_table
    table = parse(body, header.layout, header.n_points)
    result: CaptureFields = {"points": positions(table)}
    if header.viewpoint is not None:
        result["viewpoint"] = finite_vector(header.viewpoint, "viewpoint")
    colors = ("red", "green", "blue")
    if all(table.dtype.fields and color in table.dtype.fields for color in colors):
        rgb = np.stack([table[color] for color in colors], axis=-1)
        if rgb.dtype == np.uint8:
            result["rgb"] = rgb
    return result


def _read_header(content: bytes) -> _Header:
    mark = content.find(b"\nend_header", 0, _LONGEST_HEADER)
    end = content.find(b"\n", mark + 1)
    if not content.startswith(b"ply") or mark < 0 or end < 0:
        raise _malformed("no 'ply' ... 'end_header'")
    lines = content[:mark].decode("latin-1").splitlines()
    encoding = ""
    viewpoint: list[str] | None = None
    elements: list[tuple[str, int, list[tuple[str, str]]]] = []
    for words in (line.split() for line in lines[1:] if line.strip()):
        match words:
            case ["format", str(encoding), _] if encoding in _BYTE_ORDERS:
                pass
            case ["comment" | "obj_info", "viewpoint", *position]:
                viewpoint = position
            case ["comment" | "obj_info", *_]:
                pass
            case ["element", name, count] if is_count(count):
                elements.append((name, int(count), []))
            case ["property", "list", *_] if elements:
                elements[-1][2].append(("list", "list"))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1][2].append((name, kind))
            case _:
                raise _malformed(" ".join(words)[:80])
    if not encoding:
        raise _malformed("no line 'format'")
    return _Header(
        encoding,
        *_vertex_layout(elements, _BYTE_ORDERS[encoding]),
        viewpoint,
        end + 1,
    )


def _vertex_layout(
    elements: list[tuple[str, int, list[tuple[str, str]]]], byte_order: str
) -> tuple[int, np.dtype[Any]]:
    if not elements or elements[0][0] != "vertex":
        found = ", ".join(name for name, _, _ in elements) or "none"
        raise CaptureError("elements", got=found, expected="'vertex' first")
    _, count, properties = elements[0]
    if any(kind == "list" for _, kind in properties):
        raise CaptureError("vertices", got="a list property", expected="plain numbers")
    names = [name for name, _ in properties]
    if len(set(names)) != len(names):
        raise _malformed("a property twice")
    return count, np.dtype(
        [(name, byte_order + _TYPES[kind]) for name, kind in properties]
    )


def _malformed(got: str) -> CaptureError:
    return CaptureError("PLY header", got=got, expected="a well-formed PLY header")
