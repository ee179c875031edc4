"""Clouds as PCD files of the Point Cloud Library: ascii, binary, binary_compressed."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from debrisgrasp.errors import CaptureError

from ._fields import CaptureFields, finite_vector, is_count, read_bytes
from ._table import binary_table, positions, text_table

__all__ = ["read_pcd"]

_LONGEST_HEADER = 65536
_TYPES = {
    **{("F", "4"): "<f4", ("F", "8"): "<f8"},
    **{
        (kind, str(size)): f"<{kind.lower()}{size}"
        for kind in "IU"
        for size in (1, 2, 4, 8)
    },
}


def read_pcd(path: Path) -> CaptureFields:
    """Read the points; the sensor's position is the first half of ``VIEWPOINT``.

    An organised cloud is read as an unorganised one.
    """
    content = read_bytes(path)
    header, body = _split(content)
    layout = _layout(header)
    n_points = _point_count(header)
    match header["DATA"]:
        case ["ascii"]:
            table = text_table(body, layout, n_points)
        case ["binary"]:
            table = binary_table(body, layout, n_points)
        case ["binary_compressed"]:
            table = _compressed_table(body, layout, n_points)
        case other:
            raise CaptureError(
                "DATA of the PCD header",
                got=" ".join(other),
                expected="ascii, binary or binary_compressed",
            )
    result: CaptureFields = {"points": positions(table)}
    viewpoint = header.get("VIEWPOINT")
    if viewpoint is not None:
        result["viewpoint"] = finite_vector(viewpoint, "VIEWPOINT")[:3]
    return result


def _split(content: bytes) -> tuple[dict[str, list[str]], bytes]:
    """Words of each header line by its first word, and what follows the header."""
    header: dict[str, list[str]] = {}
    start = 0
    while start < min(len(content), _LONGEST_HEADER) and "DATA" not in header:
        end = content.find(b"\n", start)
        end = len(content) if end < 0 else end
        words = content[start:end].decode("latin-1").split()
        if words and not words[0].startswith("#"):
            header[words[0]] = words[1:]
        start = end + 1
    missing = [key for key in ("FIELDS", "SIZE", "TYPE", "DATA") if key not in header]
    if missing:
        raise CaptureError(
            "PCD header",
            got="no line " + ", ".join(missing),
            expected="FIELDS, SIZE, TYPE and DATA",
        )
    return header, content[start:]


def _layout(header: dict[str, list[str]]) -> np.dtype[Any]:
    names, sizes, kinds = header["FIELDS"], header["SIZE"], header["TYPE"]
    counts = header.get("COUNT", ["1"] * len(names))
    fields: list[tuple[str, str, tuple[int, ...]]] = []
    try:
        for index, (name, size, kind, count) in enumerate(
            zip(names, sizes, kinds, counts, strict=True)
        ):
            # Padding fields all have the name "_".
            unique = f"_{index}" if name == "_" else name
            # What NumPy refuses below: a field of nothing takes no place in the data.
            shape = () if count == "1" else (int(count) or -1,)
            fields.append((unique, _TYPES[kind, size], shape))
        return np.dtype(fields)
    except (KeyError, ValueError) as error:
        raise CaptureError(
            "PCD header",
            got=f"FIELDS {names}, SIZE {sizes}, TYPE {kinds}, COUNT {counts}",
            expected="one known type, size and count for each field",
        ) from error


def _point_count(header: dict[str, list[str]]) -> int:
    words = header.get("POINTS")
    if words is None:
        words = header.get("WIDTH", []) + header.get("HEIGHT", [])
    if not words or not all(map(is_count, words)):
        raise CaptureError(
            "PCD header", got=f"POINTS {words}", expected="a number of points"
        )
    count = 1
    for word in words:
        count *= int(word)
    return count


def _compressed_table(
    body: bytes, layout: np.dtype[Any], n_points: int
) -> NDArray[Any]:
    """Unpack a block that holds one field after the other, LZF-compressed."""
    if len(body) < 8:
        raise CaptureError("data", got="no sizes", expected="two sizes, then a block")
    packed_size, size = struct.unpack_from("<II", body)
    if size != n_points * layout.itemsize or len(body) < 8 + packed_size:
        raise CaptureError(
            "data",
            got=f"{len(body) - 8} of {packed_size} bytes that unpack to {size}",
            expected=f"all, for {n_points} points of {layout.itemsize} bytes",
            mend="The file is cut short, or its header is wrong.",
        )
    block = _lzf_unpacked(body[8 : 8 + packed_size], size)
    table = np.empty(n_points, dtype=layout)
    start = 0
    for name in layout.names or ():
        column = np.frombuffer(block, layout[name], count=n_points, offset=start)
        table[name] = column
        start += n_points * layout[name].itemsize
    return table


def _lzf_unpacked(packed: bytes, size: int) -> bytearray:
    """Undo LZF: runs of literal bytes, and copies of what came shortly before.

    The loop runs over tokens, each of up to 264 bytes, not over points.
    """
    out = bytearray()
    position, end = 0, len(packed)
    try:
        while position < end and len(out) <= size:
            token = packed[position]
            position += 1
            if token < 32:
                out += packed[position : position + token + 1]
                position += token + 1
                continue
            length = token >> 5
            if length == 7:
                length += packed[position]
                position += 1
            length += 2
            distance = ((token & 31) << 8) + packed[position] + 1
            position += 1
            start = len(out) - distance
            if start < 0:
                break
            # A copy may reach into what it is writing; then it repeats itself.
            piece = out[start : start + length]
            out += (piece * (length // len(piece) + 1))[:length]
    except IndexError:
        pass  # a token was cut off: the size below is wrong then
    if len(out) != size:
        raise CaptureError(
            "compressed data",
            got=f"{len(out)} bytes",
            expected=f"{size} bytes",
            mend="The file is damaged; save it again.",
        )
    return out
