"""Shapes of points: against the analytic shape that the points were sampled from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, InputError, OutputError
from debrisgrasp.geometry import SE3, fibonacci_sphere, so3
from debrisgrasp.prototypes import (
    GraspPrototype,
    PrototypeLibrary,
    SurfaceShape,
    around_grip,
    check,
    coverage,
    duplicates,
    half_turns,
    settled,
    shape_distance,
    surface_from_mesh,
    write_new_prototype,
)
from debrisgrasp.prototypes.surface_file import read_surface, surface_bytes
from debrisgrasp.prototypes.surfaces import sample

LIBRARY = PrototypeLibrary.load()
HAND = LIBRARY.grippers["robotiq_3f"]


def measured(name: str, sides: str = "all") -> SurfaceShape:
    """Points of a shipped shape, in the palm frame."""
    definition = LIBRARY[name].definition
    shape = definition.shape
    points, normals = sample(shape.patches(), shape.parts(), 3e5)
    T = definition.T_hand_shape
    return SurfaceShape.thinned(T.apply(points), T.rotate(normals), sides)


def as_prototype(name: str, sides: str = "all") -> GraspPrototype:
    """The same prototype with points instead of the shape that they come from."""
    definition = replace(
        LIBRARY[name].definition,
        name="measured",
        shape=measured(name, sides),
        T_hand_shape=SE3.identity(),
    )
    return GraspPrototype.build(definition, LIBRARY[name].visible.directions)


@pytest.mark.parametrize("name", ["cylinder_060_tip", "bar_4x4", "handle_032"])
def test_points_are_as_dense_and_as_visible_as_those_of_the_shape(name):
    ours, theirs = as_prototype(name), LIBRARY[name]
    assert len(ours.points) == pytest.approx(len(theirs.points), rel=0.35)
    distance = shape_distance(ours.points, ours.normals, theirs.points, theirs.normals)
    assert distance < 0.0055
    seen = ours.visible.is_visible.mean(axis=1)
    expected = theirs.visible.is_visible.mean(axis=1)
    assert np.abs(seen - expected).mean() < 0.08


def test_the_front_hides_the_back():
    plate = np.stack(np.meshgrid(*[np.linspace(-0.05, 0.05, 21)] * 2), -1).reshape(
        -1, 2
    )
    front = np.column_stack([plate, np.full(len(plate), 0.05)])
    back = np.column_stack([plate, np.zeros(len(plate))])
    up = np.tile([0.0, 0.0, 1.0], (len(plate), 1))
    body = SurfaceShape(np.vstack([front, back]), np.vstack([up, up])).body
    ray = np.array([[0.0, 0.0, 1.0]])
    assert body.blocks(back, ray).all()
    assert not body.blocks(front, ray).any()
    assert not body.blocks(back, -ray).any()


def test_behind_the_surface_is_inside_and_beside_its_border_is_not():
    pipe = measured("cylinder_060_tip")
    half = SurfaceShape(
        pipe.points[pipe.normals[:, 2] < 0], pipe.normals[pipe.normals[:, 2] < 0]
    )
    axis = np.array([0.0, 0.0, 0.1])
    down = np.array([0.0, 0.0, -0.01])
    assert half.body.signed_distance(axis + 2 * down) == pytest.approx(-0.01, abs=2e-3)
    assert half.body.signed_distance(axis + 5 * down) == pytest.approx(0.02, abs=2e-3)
    assert half.body.signed_distance(axis - 8 * down) > 0  # nothing is known


@pytest.mark.parametrize("name", ["cylinder_060_tip", "bar_2x4_flat_tip"])
def test_the_fingers_rest_where_they_rest_on_the_shape(name):
    prototype = as_prototype(name)
    assert not check(prototype, HAND)
    fitted = settled(prototype.definition, HAND)
    assert fitted.width == pytest.approx(LIBRARY[name].width, abs=0.006)
    assert fitted.opening == pytest.approx(fitted.width + 0.04, abs=2e-4)


def test_of_what_one_camera_saw_one_side_is_enough():
    pipe = measured("cylinder_060_tip", "seen")
    # Up to 0 the pair would touch at the border, within the tolerance of `check`.
    on_thumb_side = pipe.points[:, 0] < -0.004
    seen = SurfaceShape(pipe.points[on_thumb_side], pipe.normals[on_thumb_side])
    definition = replace(
        LIBRARY["cylinder_060_tip"].definition, shape=seen, T_hand_shape=SE3.identity()
    )
    found = check(GraspPrototype.build(definition, fibonacci_sphere(1)), HAND)
    assert not found
    whole = replace(definition, shape=replace(seen, sides="all"))
    assert check(GraspPrototype.build(whole, fibonacci_sphere(1)), HAND)


def test_a_shape_in_the_way_of_the_approach_is_found():
    bar = measured("bar_2x2_tip")
    behind = SE3.from_parts(p=(0.05, 0.0, -0.13))  # beside the wrist, behind the palm
    other = bar.moved(behind)
    both = SurfaceShape(
        np.vstack([bar.points, other.points]), np.vstack([bar.normals, other.normals])
    )
    definition = replace(
        LIBRARY["bar_2x2_tip"].definition, shape=both, T_hand_shape=SE3.identity()
    )
    found = check(GraspPrototype.build(definition, fibonacci_sphere(1)), HAND)
    assert any("hand reaches" in str(finding) for finding in found)


def test_prototypes_of_points_are_saved_with_their_points(tmp_path):
    definition = as_prototype("bar_4x4").definition
    files = write_new_prototype(definition, tmp_path / "measured.yaml", force=False)
    assert [file.name for file in files] == ["measured.yaml", "measured.ply"]
    (again,) = PrototypeLibrary.load(tmp_path)
    shape, ours = again.definition.shape, definition.shape
    assert isinstance(shape, SurfaceShape)
    assert isinstance(ours, SurfaceShape)
    assert shape.sides == "all"
    assert np.allclose(shape.points, ours.points, atol=1e-7)
    assert np.allclose(shape.normals, ours.normals, atol=1e-6)
    PrototypeLibrary((again,), LIBRARY.grippers).save(tmp_path / "copy")
    assert (tmp_path / "copy" / "measured.ply").read_bytes() == files[1].read_bytes()


def test_what_exists_is_replaced_only_by_force(tmp_path):
    definition = LIBRARY["bar_4x4"].definition
    path = tmp_path / "bar_4x4.yaml"
    write_new_prototype(definition, path, force=False)
    before = path.read_text()
    with pytest.raises(OutputError, match="--force"):
        write_new_prototype(replace(definition, width=0.1), path, force=False)
    assert path.read_text() == before
    write_new_prototype(replace(definition, width=0.1), path, force=True)
    assert path.read_text() != before


def test_points_stay_as_they_were_if_their_prototype_can_not_be_written(
    tmp_path,
):
    path, points = tmp_path / "measured.yaml", tmp_path / "measured.ply"
    points.write_bytes(b"of somebody")
    path.mkdir()
    with pytest.raises(OutputError, match="it is a folder"):
        write_new_prototype(as_prototype("bar_4x4").definition, path, force=True)
    assert points.read_bytes() == b"of somebody"
    assert len(list(tmp_path.iterdir())) == 2


def test_text_and_big_endian_files_are_read_too(tmp_path):
    shape = measured("cylinder_060_tip")
    header = "ply\nformat {} 1.0\nelement vertex {}\n" + "".join(
        f"property float {name}\n" for name in ("nx", "ny", "nz", "x", "y", "z")
    )
    table = np.hstack([shape.normals, shape.points])
    text = header.format("ascii", len(table)) + "end_header\n"
    text += "\n".join(" ".join(f"{v:.7f}" for v in row) for row in table) + "\n"
    binary = header.format("binary_big_endian", len(table)).encode() + b"end_header\n"
    binary += table.astype(">f4").tobytes()
    for content in (text.encode(), binary):
        (tmp_path / "s.ply").write_bytes(content)
        again = read_surface(tmp_path / "s.ply", "seen")
        assert np.allclose(again.points, shape.points, atol=1e-6)


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda data: data[:-40], "PLY"),
        (lambda data: b"solid" + data, "PLY header"),
        (lambda data: data.replace(b" nx\n", b" a\n"), "outwards"),
        (lambda data: data.replace(b"property float", b"property list"), "normals"),
        (lambda data: data[:200], "PLY"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path, damage, said):
    path = tmp_path / "s.ply"
    path.write_bytes(damage(surface_bytes(measured("cylinder_060_tip"))))
    with pytest.raises(ConfigError, match=said):
        read_surface(path, "seen")


def test_a_file_without_its_points_says_that_they_are_two(tmp_path):
    definition = as_prototype("bar_4x4").definition
    yaml, ply = write_new_prototype(definition, tmp_path / "a.yaml", force=False)
    ply.unlink()
    words = r"a\.yaml, field shape\.file: got measured\.ply, which is not.*both"
    with pytest.raises(ConfigError, match=words):
        PrototypeLibrary.load(yaml.parent)


@pytest.mark.parametrize("place", ["/dev/zero", "absent.ply", "."])
def test_what_is_no_file_is_not_read(place):
    with pytest.raises(ConfigError, match="got no file there, expected a readable"):
        read_surface(place, "seen")


@pytest.mark.parametrize(
    ("points", "normals", "said"),
    [
        (np.zeros((5, 3)), np.eye(3)[[0] * 5], "at least 30"),
        (np.ones((40, 3)) * np.nan, np.eye(3)[[0] * 40], "finite"),
        (
            60.0 * np.random.default_rng(0).random((40, 3)),
            np.eye(3)[[0] * 40],
            "metres",
        ),
        (0.1 * np.random.default_rng(0).random((40, 3)), np.ones((40, 3)), "unit"),
    ],
)
def test_points_that_are_no_surface_are_refused(points, normals, said):
    with pytest.raises(InputError, match=said):
        SurfaceShape(points, normals)


def test_a_copy_is_a_duplicate_and_another_size_is_not():
    copy = as_prototype("bar_2x4_flat_tip")
    (pair,) = duplicates([copy], LIBRARY)
    assert pair.names == ("measured", "bar_2x4_flat_tip")
    assert duplicates(tuple(LIBRARY)) == ()


def test_half_turns_of_points_are_those_of_the_shape():
    for name in ("bar_2x4_flat_tip", "block_web_035"):
        assert half_turns(as_prototype(name)) == half_turns(LIBRARY[name])
    assert half_turns(LIBRARY["rim_bucket"]) == ()


def test_distance_between_surfaces_is_even_and_grows_with_the_shift(rng):
    bar = LIBRARY["bar_4x4"]
    turn = so3.exp(rng.normal(size=3))
    distances = []
    for shift in (0.0, 0.003, 0.01, 0.05):
        other = bar.points + np.array([0.0, 0.0, shift])
        there = shape_distance(bar.points, bar.normals, other, bar.normals)
        back = shape_distance(other, bar.normals, bar.points, bar.normals)
        turned = shape_distance(
            bar.points @ turn.T,
            bar.normals @ turn.T,
            other @ turn.T,
            bar.normals @ turn.T,
        )
        assert there == pytest.approx(back)
        assert there == pytest.approx(turned)
        distances.append(there)
    assert distances[0] == 0.0
    assert np.all(np.diff(distances) > 0)
    assert distances[-1] <= 0.03


def test_gaps_are_the_sizes_that_no_prototype_is_near():
    chosen = LIBRARY.select(names=["cylinder_040_tip", "cylinder_080_tip"])
    found = coverage(chosen, LIBRARY.grippers)
    assert "robotiq_3f, across a round piece: 2, 6, 10 to 15 cm" in found.gaps()
    assert "robotiq_3f, end of a round piece: none at all" in found.gaps()
    row = found.rows.index(("robotiq_3f", "across a round piece"))
    assert found.counts[row, :5].tolist() == [0, 1, 1, 1, 0]
    assert found.in_range[row].sum() == 14  # 2 to 15 cm


@pytest.mark.parametrize("name", ["cylinder_060_tip", "bar_4x4", "post_080_end"])
def test_points_are_sorted_like_the_shape_they_come_from(name):
    found = [
        coverage([p], LIBRARY.grippers) for p in (as_prototype(name), LIBRARY[name])
    ]
    rows = [map_.rows[int(map_.counts.sum(axis=1).argmax())] for map_ in found]
    assert rows[0] == rows[1]


trimesh = pytest.importorskip("trimesh")


def test_a_mesh_becomes_its_outside(tmp_path):
    box = trimesh.creation.box((0.2, 0.1, 0.06))
    hole = trimesh.creation.box((0.15, 0.06, 0.03))
    hole.invert()
    trimesh.util.concatenate([box, hole]).export(tmp_path / "box.stl")
    shape = surface_from_mesh(tmp_path / "box.stl")
    assert np.allclose(np.ptp(shape.points, axis=0), [0.2, 0.1, 0.06], atol=2e-3)
    on_outside = np.isclose(np.abs(shape.points), [0.1, 0.05, 0.03], atol=1e-6)
    assert on_outside.any(axis=1).mean() > 0.95  # next to nothing of the cavity
    assert (np.einsum("ij,ij->i", shape.points, shape.normals) > 0).all()


@pytest.mark.parametrize("wrong", [slice(0, 2), slice(4, 6), slice(0, 10)])
def test_an_open_mesh_with_faces_that_look_inwards_is_refused(tmp_path, wrong):
    box = trimesh.creation.box((0.2, 0.06, 0.05))
    faces = box.faces[:10].copy()
    trimesh.Trimesh(box.vertices, faces).export(tmp_path / "open.stl")
    surface_from_mesh(tmp_path / "open.stl")
    faces[wrong] = faces[wrong, ::-1]
    trimesh.Trimesh(box.vertices, faces).export(tmp_path / "open.stl")
    with pytest.raises(ConfigError, match=r"open\.stl.*from behind.*outwards"):
        surface_from_mesh(tmp_path / "open.stl")


@pytest.mark.parametrize("length", [1.0, 1.5, 2.0])
def test_only_the_part_of_a_long_mesh_around_the_hand_is_kept(tmp_path, length):
    path = tmp_path / "plank.stl"
    trimesh.creation.box((0.04, length, 0.04)).export(path)
    turned = SE3.from_parts(so3.from_rpy(np.array([0.6, 0.0, 0.8])))
    whole = surface_from_mesh(path).moved(turned)
    T_hand = turned @ SE3.from_parts(p=(0.0, 0.0, -0.09))
    kept = around_grip(whole, T_hand, HAND, "basic")
    assert np.ptp(kept.points[:, 1]) < 0.3
    assert np.ptp(kept.points[:, 0]) == pytest.approx(0.04, abs=1e-6)


def test_a_mesh_that_is_too_large_or_too_small_is_told_by_its_file(tmp_path):
    trimesh.creation.box((0.04, 0.04, 2.1)).export(tmp_path / "beam.stl")
    with pytest.raises(ConfigError, match=r"beam\.stl.*2.1 m.*around the grip"):
        surface_from_mesh(tmp_path / "beam.stl")
    trimesh.creation.box((0.01, 0.01, 0.01)).export(tmp_path / "crumb.stl")
    with pytest.raises(ConfigError, match=r"crumb\.stl.*at least 30"):
        surface_from_mesh(tmp_path / "crumb.stl")


def test_a_mesh_in_millimetres_is_refused_until_it_is_scaled(tmp_path):
    trimesh.creation.cylinder(radius=30, height=300).export(tmp_path / "pipe.obj")
    with pytest.raises(ConfigError, match=r"--scale 0\.001"):
        surface_from_mesh(tmp_path / "pipe.obj")
    shape = surface_from_mesh(tmp_path / "pipe.obj", scale=1e-3)
    assert np.ptp(shape.points, axis=0).max() == pytest.approx(0.3, abs=0.005)
    radius = np.linalg.norm(shape.points[:, :2], axis=1).max()
    assert radius == pytest.approx(0.03, abs=1e-3)


def test_a_mesh_with_a_vertex_that_is_nowhere_is_refused(tmp_path):
    box = trimesh.creation.box((0.2, 0.06, 0.05))
    content = box.export(file_type="stl_ascii")
    (tmp_path / "a.stl").write_text(content.replace("vertex -0.1", "vertex nan", 1))
    with pytest.raises(ConfigError, match=r"a\.stl.*not finite"):
        surface_from_mesh(tmp_path / "a.stl")


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.step", b"x", "ends in"),
        ("a.stl", b"solid nothing\nendsolid\n", r"mesh.*file whole"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\n", "mesh"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 3\n", "mesh"),
    ],
)
def test_what_is_no_mesh_is_refused(tmp_path, name, content, said):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ConfigError, match=said):
        surface_from_mesh(tmp_path / name)
    with pytest.raises(ConfigError, match="no such file"):
        surface_from_mesh(tmp_path / "absent.stl")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"path": "mine"}, r"name of a prototype's file: got .*mine.*\.yaml"),
        ({"path": "mine.ply"}, "mine.ply"),
        ({"definition": LIBRARY["bar_4x4"]}, "definition: got GraspPrototype"),
        ({"force": 1}, "force: got 1"),
    ],
    ids=["none", "other", "prototype", "force"],
)
def test_what_no_dictionary_would_read_is_not_written(
    tmp_path, monkeypatch, wrong, words
):
    monkeypatch.chdir(tmp_path)
    definition = LIBRARY["bar_4x4"].definition
    right = {"definition": definition, "path": "mine.yaml", "force": False}
    with pytest.raises(InputError, match=words):
        write_new_prototype(**{**right, **wrong})
    assert not list(tmp_path.iterdir())
