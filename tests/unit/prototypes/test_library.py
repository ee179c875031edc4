"""The dictionary: what ships, files that are refused, saving and packing."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from errno import ENOSPC
from pathlib import Path

import numpy as np
import pytest

from debrisgrasp import _files
from debrisgrasp._files import data_path
from debrisgrasp.errors import (
    ConfigError,
    DebrisGraspError,
    InputError,
    OutputError,
    UnknownNameError,
)
from debrisgrasp.prototypes import (
    GripperModel,
    PrototypeLibrary,
    prototype_of_shape,
    write_new_prototype,
)
from debrisgrasp.prototypes import gripper as gripper_module
from debrisgrasp.prototypes import library as library_module

SOUND = """\
name: pipe
gripper: robotiq_3f
preshape: basic
width: 0.05
shape: {type: cylinder, diameter: 0.05, length: 0.14, position: [0, 0, 0.1]}
"""


@pytest.fixture(scope="module")
def library() -> PrototypeLibrary:
    return PrototypeLibrary.load()


def load_text(folder: Path, text: str) -> PrototypeLibrary:
    (folder / "pipe.yaml").write_text(text)
    return PrototypeLibrary.load(folder)


def test_shipped_dictionary_covers_the_widths_of_both_hands(
    library: PrototypeLibrary,
) -> None:
    for name, low, high in (("robotiq_3f", 0.02, 0.13), ("camhand", 0.08, 0.17)):
        widths = np.sort(
            [p.width for p in library.select(gripper=name, kind="generic")]
        )
        assert widths[0] <= low
        assert widths[-1] >= high
        assert np.diff(widths).max() <= 0.04
    assert len(library.select(gripper="robotiq_3f")) >= 20
    assert len(library.select(gripper="camhand")) >= 8
    assert len(library.select(kind="object-specific")) >= 1


def test_all_prototypes_have_one_density_and_unit_normals(
    library: PrototypeLibrary,
) -> None:
    for prototype in library:
        patches = prototype.definition.shape.patches()
        area = sum(patch.area for patch in patches)
        # Points where two parts of a handle overlap are inside, and so not sampled.
        slack = 0.12 if prototype.kind == "object-specific" else 0.02
        assert len(prototype.points) == pytest.approx(1e4 * area, rel=slack, abs=3)
        assert np.allclose(np.linalg.norm(prototype.normals, axis=1), 1)


def test_symmetric_poses_show_the_same_surface(library: PrototypeLibrary) -> None:
    bar = library["bar_2x4_flat_tip"]
    turned = bar.symmetry.elements()[1].apply(bar.points)
    gap = np.linalg.norm(turned[:, None] - bar.points, axis=-1).min(axis=1)
    assert gap.max() < 0.012


def test_thin_prototypes_show_more_than_one_plane(library: PrototypeLibrary) -> None:
    for prototype in library:
        if prototype.definition.shape.__class__.__name__ != "CylinderShape":
            normals = np.unique(prototype.normals.round(3), axis=0)
            assert len(normals) >= 3, prototype.name


@pytest.mark.parametrize("text", ["", "a pipe"])
def test_a_description_or_none_comes_back_as_it_was(tmp_path: Path, text: str) -> None:
    shape = {"type": "cylinder", "diameter": 0.05, "length": 0.14}
    gripper = GripperModel.load("robotiq_3f")
    pipe = prototype_of_shape("pipe", shape, gripper, "basic", description=text)
    assert pipe.description == text
    write_new_prototype(pipe, tmp_path / "pipe.yaml", force=False)
    assert PrototypeLibrary.load(tmp_path)["pipe"].definition.description == text


def test_saved_dictionary_loads_back_the_same(
    library: PrototypeLibrary, tmp_path: Path
) -> None:
    library.save(tmp_path / "new")
    again = PrototypeLibrary.load(tmp_path / "new")
    assert again.names == library.names
    for ours, theirs in zip(library, again, strict=True):
        assert np.allclose(ours.points, theirs.points, atol=1e-9)
        assert (ours.width, ours.opening, ours.kind) == (
            theirs.width,
            theirs.opening,
            theirs.kind,
        )
        assert ours.definition.tags == theirs.definition.tags
        assert ours.definition.description == theirs.definition.description


@pytest.mark.parametrize(
    "rpy", [(20, -40, 170), (90, 90, 0), (0, -90, 30), (0.001, 0, -2e-4)]
)
def test_turned_shapes_are_saved_with_their_turn(
    tmp_path: Path, rpy: tuple[float, float, float]
) -> None:
    turned = SOUND.replace("length: 0.14", f"length: 0.14, rpy_deg: {list(rpy)}")
    library = load_text(tmp_path, turned)
    library.save(tmp_path / "new")
    again = PrototypeLibrary.load(tmp_path / "new")
    assert np.allclose(library["pipe"].points, again["pipe"].points, atol=1e-6)


@pytest.mark.parametrize("rpy", [(0.785, 0, 0), (3.14, 0.26, -1.71), (0, -1.57, 0.3)])
def test_radians_where_degrees_are_due_are_refused(
    tmp_path: Path, rpy: tuple[float, float, float]
) -> None:
    turned = SOUND.replace("length: 0.14", f"length: 0.14, rpy_deg: {list(rpy)}")
    with pytest.raises(ConfigError, match="say rpy instead"):
        load_text(tmp_path, turned)


def test_packed_arrays_hold_every_point_once(library: PrototypeLibrary) -> None:
    chosen = library.select(names=["handle_025", "cylinder_020_tip", "bar_4x4"])
    packed = chosen.packed()
    for row, prototype in enumerate(chosen):
        mask = packed.mask[row]
        assert np.array_equal(packed.points[row][mask], prototype.points)
        assert np.array_equal(packed.normals[row][mask], prototype.normals)
    assert packed.points.shape[1] == max(len(p.points) for p in chosen)


def test_opening_defaults_to_the_width_with_clearance_up_to_the_hands_limit(
    tmp_path: Path,
) -> None:
    assert load_text(tmp_path, SOUND)["pipe"].opening == pytest.approx(0.09)
    wide = SOUND.replace("width: 0.05", "width: 0.14")
    assert load_text(tmp_path, wide)["pipe"].opening == pytest.approx(0.1555, abs=1e-4)


def test_visibility_is_in_the_palm_frame(library: PrototypeLibrary) -> None:
    post = library["post_080_end"]
    view = post.visible.directions[:, 2].argmin()
    from_palm = post.visible.is_visible[view]
    assert post.points[from_palm][:, 2].max() < post.points[:, 2].min() + 0.01


@pytest.mark.parametrize(
    ("found", "replacement", "message"),
    [
        ("width: 0.05", "width: 50", r"field width.*0.02 to 0.15.*50 mm is 0.05"),
        ("width: 0.05", "width: 0.3", r"pipe.yaml, field width.*0.02 to 0.15"),
        ("width: 0.05", "width: .nan", r"field width.*finite"),
        ("width: 0.05", "width: wide", r"field width.*finite number"),
        ("width: 0.05", "width: true", r"field width.*finite number"),
        ("width: 0.05\n", "", r"field width.*missing.*Present are: name"),
        ("width: 0.05", "width: 0.05\nopening: 0.03", r"field opening.*0.05 to 0.155"),
        (
            "width: 0.05",
            "width: 0.05\nwith: 3",
            r"field in \S*pipe.yaml.*'with'.*opening.*width",
        ),
        ("robotiq_3f", "robotiq_2f", r"gripper.*camhand, robotiq_3f"),
        ("basic", "power", r"preshape.*basic, wide, pinch"),
        ("type: cylinder", "type: cone", r"shape.type.*bar, box, cell, cylinder"),
        ("diameter: 0.05", "diameter: 50", r"shape.diameter.*0.005 to 0.3.*metres"),
        ("diameter: 0.05", "diameter: .inf", r"shape.diameter.*finite"),
        ("diameter: 0.05, ", "", r"shape.diameter.*missing"),
        ("diameter: 0.05", "radius: 0.05, diameter: 0.05", r"'radius'.*diameter"),
        ("[0, 0, 0.1]", "[0, 0, 100]", r"shape.position.*within 1 m.*metres"),
        ("[0, 0, 0.1]", "[0, 0]", r"shape.position.*list of 3"),
        ("[0, 0, 0.1]", "[0, 0, .nan]", r"shape.position.*finite"),
        ("name: pipe", "name: Pipe 1", r"field name.*lower-case"),
        ("name: pipe", "name: pipe\nkind: special", r"kind.*generic, object-specific"),
        ("name: pipe", "name: pipe\nsymmetry: yes", r"symmetry.*expected text"),
        ("name: pipe", "name: pipe\ntags: pipe", r"tags.*list of words"),
        ("name: pipe", "name: [pipe", r"line 2"),
        (SOUND, "- 1\n- 2\n", r"pipe.yaml.*mapping"),
        (SOUND, "", r"pipe.yaml.*mapping"),
    ],
)
def test_bad_files_are_refused_with_file_field_and_range(
    tmp_path: Path, found: str, replacement: str, message: str
) -> None:
    assert found in SOUND
    with pytest.raises(DebrisGraspError, match=f"(?s){message}"):
        load_text(tmp_path, SOUND.replace(found, replacement, 1))


@pytest.mark.parametrize(
    ("field", "misspelt"),
    [
        ("width", "widht"),
        ("opening", "openning"),
        ("shape", "shap"),
        ("diameter", "diametre"),
        ("position", "postion"),
    ],
)
def test_of_a_misspelt_field_the_right_one_and_its_file_are_named(
    tmp_path: Path, field: str, misspelt: str
) -> None:
    sound = SOUND.replace("width: 0.05", "width: 0.05\nopening: 0.09")
    assert f"{field}:" in sound
    with pytest.raises(DebrisGraspError, match=f"Did you mean {field!r}") as caught:
        load_text(tmp_path, re.sub(rf"\b{field}:", f"{misspelt}:", sound))
    assert repr(misspelt) in str(caught.value)
    assert str(tmp_path / "pipe.yaml") in str(caught.value)


def test_what_ships_is_read_again_only_where_it_has_changed(
    library: PrototypeLibrary, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert PrototypeLibrary.load().prototypes is library.prototypes
    assert GripperModel.load("camhand") is library.grippers["camhand"]
    coarser = PrototypeLibrary.load(density=2000.0)
    assert len(coarser.prototypes[0].points) < 0.5 * len(library.prototypes[0].points)
    copy = shutil.copytree(data_path(), tmp_path / "data")
    monkeypatch.setattr(library_module, "data_path", copy.joinpath)
    monkeypatch.setattr(gripper_module, "data_path", copy.joinpath)
    before = PrototypeLibrary.load()
    file = copy / "prototypes" / "bar_4x4.yaml"
    file.write_text(file.read_text().replace("name: bar_4x4", "name: bar_four"))
    after = PrototypeLibrary.load()
    assert "bar_four" in after.names
    assert "bar_four" not in before.names
    file = copy / "grippers" / "camhand.yaml"
    file.write_text(file.read_text().replace("name: camhand", "name: claw_hand"))
    assert GripperModel.load("camhand").name == "claw_hand"


def test_one_dictionary_may_be_added_to_without_the_next(
    library: PrototypeLibrary,
) -> None:
    mine = dict(library.grippers, other=library.grippers["camhand"])
    assert "other" in PrototypeLibrary.load(grippers=mine).grippers
    assert "other" not in PrototypeLibrary.load().grippers


def test_a_name_given_twice_names_both_files(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(SOUND)
    (tmp_path / "b.yaml").write_text(SOUND)
    with pytest.raises(ConfigError, match=r"b\.yaml.*'pipe'.*a\.yaml"):
        PrototypeLibrary.load(tmp_path)


def test_empty_and_missing_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"no \.yaml file"):
        PrototypeLibrary.load(tmp_path)
    with pytest.raises(ConfigError, match="no such file or folder"):
        PrototypeLibrary.load(tmp_path / "nowhere")


def test_an_empty_choice_cannot_be_packed(library: PrototypeLibrary) -> None:
    nothing = library.select(gripper="camhand", kind="object-specific")
    with pytest.raises(ConfigError, match="leaves nothing"):
        nothing.packed()


def test_a_library_has_its_prototypes_and_their_names(
    library: PrototypeLibrary,
) -> None:
    assert "handle_025" in library
    assert library["handle_025"] in library
    assert "handle_026" not in library


def test_one_name_may_be_chosen_without_a_list(library: PrototypeLibrary) -> None:
    assert library.select(names="handle_025").names == ("handle_025",)


def test_unknown_names_list_the_known_ones(library: PrototypeLibrary) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'bar_4x4'"):
        library["bar_4x5"]
    with pytest.raises(UnknownNameError, match="camhand, robotiq_3f"):
        library.select(gripper="hook")
    with pytest.raises(UnknownNameError, match="generic, object-specific"):
        library.select(kind="special")
    with pytest.raises(UnknownNameError, match="unknown prototype"):
        library.select(names=["sphere"])


def test_a_folder_that_cannot_be_made_is_an_output_error(
    library: PrototypeLibrary, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("kept")
    with pytest.raises(OutputError):
        library.save(tmp_path / "file")
    assert (tmp_path / "file").read_text() == "kept"


def test_a_new_folder_comes_whole_or_not_at_all(
    library: PrototypeLibrary, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = []

    def full_after_one(path: Path, data: str, *, like: Path) -> None:
        if written:
            raise OSError(ENOSPC, "no space left on the disk")
        written.append(like.name)
        path.write_text(data)

    monkeypatch.setattr(_files, "_write_new", full_after_one)
    with pytest.raises(OutputError, match=r"write .*new: no space left"):
        library.save(tmp_path / "deep" / "new")
    assert len(written) == 1
    assert list((tmp_path / "deep").iterdir()) == []
    first = tmp_path / f"{next(iter(library)).name}.yaml"
    first.write_text("of somebody")
    written.clear()
    with pytest.raises(OutputError, match=r"no space left"):
        library.save(tmp_path)
    assert written == [first.name]
    assert first.read_text() == "of somebody"
    assert {path.name for path in tmp_path.iterdir()} == {"deep", first.name}


def test_prototypes_of_one_name_are_refused_from_python_too(library):
    first, second, *_ = library
    with pytest.raises(ConfigError, match=f"'{first.name}' 2 times"):
        PrototypeLibrary((first, second, first), library.grippers)
    definitions = [first.definition, first.definition]
    with pytest.raises(ConfigError, match="each once"):
        PrototypeLibrary.build(definitions, library.grippers)
    assert len(library.select(names=[first.name, first.name])) == 1


@pytest.mark.parametrize("hands", ["my_hands", [GripperModel.load("camhand")]])
def test_hands_of_a_library_come_by_name(hands: object) -> None:
    with pytest.raises(InputError, match=r"expected hands by name.*load_grippers"):
        PrototypeLibrary.load(grippers=hands)  # type: ignore[arg-type]


@pytest.mark.parametrize("density", [0.0, -1.0, np.nan, 1e9])
def test_surfaces_are_sampled_by_a_density_that_can_be(density: float) -> None:
    with pytest.raises(ConfigError, match="points per square metre"):
        PrototypeLibrary.load(density=density)


@pytest.mark.parametrize(
    ("wrong", "error", "words"),
    [
        ({"name": "../mine"}, ConfigError, "name of the prototype: got '../mine'"),
        ({"name": 3}, InputError, "name: got 3"),
        ({"kind": "specific"}, UnknownNameError, "object-specific"),
        ({"width": "0.06"}, InputError, "width: got '0.06'"),
        ({"shape": {"type": "cylinder"}}, InputError, "shape: got dict"),
        ({"T_hand_shape": np.eye(4)}, InputError, r"T_hand_shape.*SE3\.from_matrix"),
        ({"tags": "pipe"}, InputError, "tags: got 'pipe'"),
    ],
    ids=str,
)
def test_a_definition_that_no_file_could_hold_is_refused(wrong, error, words):
    definition = PrototypeLibrary.load()["cylinder_060_tip"].definition
    with pytest.raises(error, match=words):
        replace(definition, **wrong)


@pytest.mark.parametrize(
    "hands", [GripperModel.load("camhand"), [], {"camhand": "camhand"}, None], ids=str
)
def test_a_library_is_not_built_for_what_is_no_hand(library, hands):
    definition = library["cylinder_060_tip"].definition
    with pytest.raises(InputError, match=r"grippers: got .*hands by name"):
        PrototypeLibrary.build([definition], hands)
    with pytest.raises(InputError, match=r"grippers: got .*hands by name"):
        PrototypeLibrary(library.prototypes, hands)


def test_a_library_is_not_built_of_what_is_no_definition(library):
    prototype = library["cylinder_060_tip"]
    with pytest.raises(InputError, match="definitions: got PrototypeDefinition"):
        PrototypeLibrary.build(prototype.definition, library.grippers)
    with pytest.raises(InputError, match="definition: got GraspPrototype"):
        PrototypeLibrary.build([prototype], library.grippers)
