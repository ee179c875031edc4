"""PLY and PCD clouds in all their encodings, whole and damaged."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

from debrisgrasp.errors import CaptureError
from debrisgrasp.io import Capture

VIEW = (0.1, -0.2, 2.5)


def ply(points, encoding, *, view=VIEW, kind="float", extra=""):
    order = ">" if "big" in encoding else "<"
    comment = "" if view is None else "comment viewpoint {} {} {}\n".format(*view)
    header = (
        f"ply\nformat {encoding} 1.0\n{comment}element vertex {len(points)}\n"
        f"property {kind} x\nproperty {kind} y\nproperty {kind} z\n"
        f"property uchar red\nproperty uchar green\nproperty uchar blue\n{extra}"
        "end_header\n"
    )
    layout = [(axis, order + ("f8" if kind == "double" else "f4")) for axis in "xyz"]
    layout += [(color, "u1") for color in ("red", "green", "blue")]
    table = np.zeros(len(points), dtype=layout)
    for index, axis in enumerate("xyz"):
        table[axis] = points[:, index]
    table["red"] = np.arange(len(points)) % 256
    if encoding == "ascii":
        rows = (" ".join(repr(value) for value in row) for row in table.tolist())
        return (header + "\n".join(rows) + "\n").encode()
    return header.encode() + table.tobytes()


def lzf_packed(data: bytes) -> bytes:
    """Greedy LZF with literals and back references, some of which overlap."""
    out, place, literals = bytearray(), 0, bytearray()

    def flush():
        for start in range(0, len(literals), 32):
            run = literals[start : start + 32]
            out.append(len(run) - 1)
            out.extend(run)
        literals.clear()

    while place < len(data):
        low = max(0, place - 8192)
        start = data.rfind(data[place : place + 3], low, place + 2)
        length = 0
        if low <= start < place and place + 3 <= len(data):
            while (
                place + length < len(data)
                and length < 264
                and data[start + length] == data[place + length]
            ):
                length += 1
        if length < 3:
            literals.append(data[place])
            place += 1
            continue
        flush()
        distance = place - start - 1
        if length < 9:
            out.append(((length - 2) << 5) | (distance >> 8))
        else:
            out.extend([(7 << 5) | (distance >> 8), length - 9])
        out.append(distance & 255)
        place += length
    flush()
    return bytes(out)


def pcd(points, data, *, view=VIEW, fields="x y z _ intensity"):
    n = len(points)
    layout = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("pad", "u1", 4)]
    layout += [("intensity", "<f4")]
    table = np.zeros(n, dtype=layout)
    for index, axis in enumerate("xyz"):
        table[axis] = points[:, index]
    header = (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS {fields}\nSIZE 4 4 4 1 4\nTYPE F F F U F\n"
        f"COUNT 1 1 1 4 1\nWIDTH {n}\nHEIGHT 1\n"
        + ("" if view is None else "VIEWPOINT {} {} {} 1 0 0 0\n".format(*view))
        + f"POINTS {n}\nDATA {data}\n"
    ).encode()
    if data == "ascii":
        rows = (f"{x!r} {y!r} {z!r} 0 0 0 0 nan" for x, y, z in points.tolist())
        return header + "\n".join(rows).encode()
    if data == "binary":
        return header + table.tobytes()
    columns = b"".join(table[name].tobytes() for name in table.dtype.names)
    packed = lzf_packed(columns)
    return header + struct.pack("<II", len(packed), len(columns)) + packed


def written(tmp_path, suffix, content):
    path = tmp_path / f"cloud.{suffix}"
    path.write_bytes(content)
    return path


PLY_ENCODINGS = ("ascii", "binary_little_endian", "binary_big_endian")
_ONE_OF_NONE = b"SIZE 4 4 4 1 4\nTYPE F F F U F\nCOUNT 1 1 1 0 2"
"""As many bytes for a point as before, where one of the fields has none."""
PCD_ENCODINGS = ("ascii", "binary", "binary_compressed")


@pytest.mark.parametrize("kind", ["float", "double"])
@pytest.mark.parametrize("encoding", PLY_ENCODINGS)
def test_ply_gives_points_colours_and_viewpoint(tmp_path, points, encoding, kind):
    path = written(tmp_path, "ply", ply(points, encoding, kind=kind))
    capture = Capture.load(path)
    assert_array_equal(capture.points, points)
    assert_allclose(capture.viewpoint, VIEW)
    assert_array_equal(capture.rgb[:, 0], np.arange(len(points)) % 256)


@pytest.mark.parametrize("encoding", PCD_ENCODINGS)
def test_pcd_gives_points_and_viewpoint(tmp_path, points, encoding):
    capture = Capture.load(written(tmp_path, "pcd", pcd(points, encoding)))
    assert_array_equal(capture.points, points)
    assert_allclose(capture.viewpoint, VIEW)


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_ply_written_by_another_library_is_read(tmp_path, points, encoding):
    path = tmp_path / "cloud.ply"
    trimesh.PointCloud(points).export(path, encoding=encoding)
    capture = Capture.load(path, viewpoint=VIEW)
    assert_allclose(capture.points, points, atol=1e-6)


def test_a_comment_may_speak_of_the_end_of_the_header(tmp_path, points):
    extra = "comment faces would be before end_header\n"
    path = written(tmp_path, "ply", ply(points, "ascii", extra=extra))
    assert_array_equal(Capture.load(path).points, points)


def test_faces_after_the_vertices_are_ignored(tmp_path, points):
    faces = "element face 1\nproperty list uchar int vertex_indices\n"
    content = ply(points, "ascii", extra=faces) + b"3 0 1 2\n"
    assert len(Capture.load(written(tmp_path, "ply", content)).points) == len(points)


@pytest.mark.parametrize("suffix", ["ply", "pcd"])
def test_comments_and_blank_lines_among_the_rows_are_no_points(
    tmp_path, points, suffix, recwarn
):
    content = {"ply": ply, "pcd": pcd}[suffix](points, "ascii")
    *head, last = content.rstrip().split(b"\n")
    odd = b"\n".join([*head, b"", b"# the last one:", last + b" # there", b"x"])
    path = written(tmp_path, suffix, odd)
    assert_array_equal(Capture.load(path).points, points)
    assert not recwarn.list


@pytest.mark.parametrize("suffix", ["ply", "pcd"])
def test_a_viewpoint_is_needed_and_may_be_given(tmp_path, points, suffix):
    write = {"ply": ply, "pcd": pcd}[suffix]
    path = written(tmp_path, suffix, write(points, "ascii", view=None))
    with pytest.raises(CaptureError, match="viewpoint"):
        Capture.load(path)
    assert_allclose(Capture.load(path, viewpoint=(1, 2, 3)).viewpoint, (1, 2, 3))


def test_missing_points_of_an_organised_cloud_are_left_out(tmp_path, points):
    points[::7] = np.nan
    capture = Capture.load(written(tmp_path, "pcd", pcd(points, "binary")))
    assert np.isnan(capture.points[::7]).all()
    assert len(capture.points) == len(points)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.9, 0.999])
@pytest.mark.parametrize(
    ("suffix", "encoding"),
    [*(("ply", e) for e in PLY_ENCODINGS), *(("pcd", e) for e in PCD_ENCODINGS)],
)
def test_truncated_files_are_refused(tmp_path, points, suffix, encoding, share):
    content = {"ply": ply, "pcd": pcd}[suffix](points, encoding)
    if encoding == "ascii":
        content = content.rstrip(b"\n").rsplit(b" ", 1)[0] if share > 0.99 else content
    size = (
        len(content)
        if encoding == "ascii" and share > 0.99
        else int(share * len(content))
    )
    path = written(tmp_path, suffix, content[:size])
    with pytest.raises(CaptureError, match=f"cloud.{suffix}"):
        Capture.load(path)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"ply\n", b"plz\n"),
        (b"format ascii 1.0\n", b""),
        (b"format ascii", b"format xml"),
        (b"element vertex", b"element face"),
        (b"element vertex 300", b"element vertex many"),
        (b"element vertex 300", b"element vertex " + 5000 * b"3"),
        (b"property float x\n", b"property float y\n"),
        (b"property float x\n", b"property float q\n"),
        (b"property float x\n", b"property int x\n"),
        (b"property float x\n", b"property quad x\n"),
        (b"property float x\n", b"property list uchar float x\n"),
        (b"comment viewpoint 0.1", b"comment viewpoint left"),
        (b"comment viewpoint 0.1", b"comment viewpoint nan"),
        (b"comment viewpoint 0.1", b"comment viewpoint"),
        (b"end_header", b"end"),
        (b"end_header\n", b"end_header\nabc "),
    ],
)
def test_malformed_ply_is_refused(tmp_path, points, old, new):
    content = ply(points, "ascii")
    assert old in content
    path = written(tmp_path, "ply", content.replace(old, new, 1))
    with pytest.raises(CaptureError, match=r"cloud\.ply"):
        Capture.load(path)


@pytest.mark.parametrize("encoding", PCD_ENCODINGS)
@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"FIELDS x y z", b"FIELDS a b c"),
        (b"FIELDS x y z", b"FIELDS x y y"),
        (b"FIELDS x y z", b"FIELDS x y"),
        (b"SIZE 4 4 4", b"SIZE 3 4 4"),
        (b"SIZE 4 4 4 1 4\n", b""),
        (b"TYPE F F F", b"TYPE Q F F"),
        (b"TYPE F F F", b"TYPE I I I"),
        (b"COUNT 1 1 1 4", b"COUNT 1 1 1 x"),
        (b"SIZE 4 4 4 1 4\nTYPE F F F U F\nCOUNT 1 1 1 4 1", _ONE_OF_NONE),
        (b"COUNT 1 1 1 4", b"COUNT 1 1 2 4"),
        (b"POINTS 300", b"POINTS few"),
        (b"POINTS 300", b"POINTS " + 5000 * b"3"),
        (b"POINTS 300", b"POINTS 400"),
        (b"VIEWPOINT 0.1", b"VIEWPOINT x"),
        (b"VIEWPOINT 0.1 -0.2 2.5 1 0 0 0", b"VIEWPOINT 1 2"),
        (b"DATA ", b"DATA un"),
    ],
)
def test_malformed_pcd_is_refused(tmp_path, points, encoding, old, new):
    content = pcd(points, encoding)
    assert old in content
    path = written(tmp_path, "pcd", content.replace(old, new, 1))
    with pytest.raises(CaptureError, match=r"cloud\.pcd"):
        Capture.load(path)


def test_damaged_compression_is_refused_or_gives_as_many_points(tmp_path, points, rng):
    content = pcd(points, "binary_compressed")
    start = content.index(b"DATA")
    for place in rng.integers(start, len(content), 60):
        damaged = bytearray(content)
        damaged[place] ^= 0x55
        try:
            capture = Capture.load(written(tmp_path, "pcd", bytes(damaged)))
        except CaptureError:
            continue
        assert capture.points.shape == points.shape


@pytest.mark.parametrize("suffix", ["ply", "pcd"])
def test_files_without_points_are_refused(tmp_path, suffix):
    write = {"ply": ply, "pcd": pcd}[suffix]
    path = written(tmp_path, suffix, write(np.empty((0, 3)), "ascii"))
    with pytest.raises(CaptureError, match="at least 3"):
        Capture.load(path)
