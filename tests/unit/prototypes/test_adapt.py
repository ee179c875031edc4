"""A dictionary for another hand, made of the shapes of others."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from debrisgrasp.errors import ChoiceError, ConfigError, UnknownNameError
from debrisgrasp.geometry import SE3
from debrisgrasp.prototypes import (
    GripperModel,
    PrototypeLibrary,
    SurfaceShape,
    adapt,
    check,
    duplicates,
)
from debrisgrasp.prototypes.shapes import BarShape, CylinderShape

EXAMPLES = Path(__file__).parents[3] / "examples"
JAW = EXAMPLES / "grippers" / "jaw_140.yaml"
SHIPPED = PrototypeLibrary.load()
FEW = SHIPPED.select(names=["bar_4x4", "cylinder_040_tip", "edge_019", "handle_025"])


def jaw_of(folder: Path, stroke: float, length: float, breadth: float) -> GripperModel:
    """Read a parallel jaw of other sizes [m] than those of the example."""
    content = yaml.safe_load(JAW.read_text())
    link = content["chains"]["jaw"][0]
    link["solids"][0]["size"] = [0.016, breadth, length]
    link["solids"][0]["position"] = [-0.008, 0, length / 2]
    link["pad"] = [0, 0, 0.85 * length]
    for finger, side in zip(content["fingers"], (-1, 1), strict=True):
        finger["position"] = [side * stroke / 2, 0, 0]
    shape = content["preshapes"]["parallel"]
    shape["widths"] = [0.005, round(stroke - 0.01, 4)]
    shape["closing"]["slide"] = [0, stroke / 2]
    file = folder / "jaw.yaml"
    file.write_text(yaml.safe_dump(content))
    return GripperModel.load(file)


@pytest.fixture(scope="module")
def made():
    return adapt(SHIPPED, GripperModel.load(JAW))


def test_nothing_speaks_against_what_was_made(made):
    hand = GripperModel.load(JAW)
    assert len(made.library) > 40
    for prototype in made.library:
        assert check(prototype, hand) == ()
        assert re.fullmatch(r"jaw_140_[a-z0-9_]+", prototype.name)
    assert duplicates(made.library.prototypes) == ()


def test_every_shape_is_taken_or_left_out_for_a_reason(made):
    left_out = {finding.prototype: str(finding) for finding in made.left_out}
    assert set(left_out) == {
        "bar_2x6_flat_tip",
        "claw_bar_6x6",
        "claw_block_150",
        "claw_cylinder_140",
        "claw_cylinder_160",
    }
    assert left_out["claw_block_150"].startswith("150 mm thick")
    kinds = {type(prototype.definition.shape) for prototype in made.library}
    assert kinds == {type(prototype.definition.shape) for prototype in SHIPPED}
    specific = made.library.select(kind="object-specific")
    assert len(specific) == len(SHIPPED.select(kind="object-specific"))


def test_fingertips_do_not_reach_past_what_lies_on_the_ground(made):
    hand = GripperModel.load(JAW)
    across = [
        prototype
        for prototype in made.library
        if isinstance(prototype.definition.shape, BarShape | CylinderShape)
        and prototype.bounds.upper[2] - prototype.bounds.lower[2] > 0.035
    ]
    assert len(across) > 20
    for prototype in across:
        reach = hand.fingertip_reach(prototype.preshape, prototype.width)
        assert prototype.bounds.upper[2] > reach


def test_pads_press_on_what_is_thin(made):
    (pad,) = {z for _, _, z in GripperModel.load(JAW).pad_positions("parallel", 0.02)}
    for name in ("jaw_140_bar_089x019", "jaw_140_cylinder_020"):
        bounds = made.library[name].bounds
        assert bounds.lower[2] <= pad - 0.009
        assert bounds.upper[2] >= pad


def test_what_is_thick_is_taken_at_two_depths(made):
    tip, deep = (made.library[f"jaw_140_bar_038x089{end}"] for end in ("", "_deep"))
    assert tip.bounds.lower[2] > deep.bounds.lower[2] + 0.02
    assert tip.width == pytest.approx(0.038, abs=0.003)
    assert deep.width == pytest.approx(0.038, abs=0.003)


def test_pipes_are_cut_to_the_breadth_of_the_hand(made):
    shape = made.library["jaw_140_cylinder_040"].definition.shape
    assert isinstance(shape, CylinderShape)
    assert shape.length == pytest.approx(0.1)
    whole = made.library["jaw_140_box_102x215x065"].definition.shape
    assert whole == SHIPPED["brick_102"].definition.shape


@settings(max_examples=12, deadline=None)
@given(
    stroke=st.floats(0.05, 0.2),
    length=st.floats(0.06, 0.16),
    breadth=st.floats(0.015, 0.06),
)
def test_jaws_of_any_size_get_sound_prototypes(
    tmp_path_factory, stroke, length, breadth
):
    hand = jaw_of(tmp_path_factory.mktemp("hand"), stroke, length, breadth)
    made = adapt(FEW, hand)
    assert len(made.library) + len(made.left_out) >= len(FEW)
    for prototype in made.library:
        assert check(prototype, hand) == ()
        assert prototype.width <= hand.preshape("parallel").widths[1]
    assert "jaw_140_edge_019" in made.library.names


def test_a_saved_dictionary_reads_back(made, tmp_path):
    made.library.save(tmp_path / "own")
    hand = GripperModel.load(JAW)
    again = PrototypeLibrary.load(tmp_path / "own", grippers={hand.name: hand})
    assert sorted(again.names) == sorted(made.library.names)
    for prototype in again:
        known = made.library[prototype.name].definition
        assert prototype.definition.shape == known.shape
        np.testing.assert_allclose(
            prototype.definition.T_hand_shape.matrix,
            known.T_hand_shape.matrix,
            atol=1e-6,
        )


@pytest.mark.parametrize("name", ["手", "Ü-110 (new)", "__", "a long name" * 30])
def test_a_hand_of_any_name_gets_files_that_can_be_read(tmp_path, name):
    hand = replace(GripperModel.load(JAW), name=name)
    adapt(FEW, hand).library.save(tmp_path)
    assert len(PrototypeLibrary.load(tmp_path, grippers={name: hand})) > len(FEW)


def test_what_is_thinner_than_a_hand_takes_is_left_out(tmp_path):
    content = yaml.safe_load(JAW.read_text())
    content["preshapes"]["parallel"]["widths"] = [0.045, 0.13]
    (tmp_path / "jaw.yaml").write_text(yaml.safe_dump(content))
    made = adapt(FEW, GripperModel.load(tmp_path / "jaw.yaml"))
    (bar,) = {prototype.definition.shape for prototype in made.library}
    assert isinstance(bar, BarShape)
    left_out = {finding.prototype: str(finding) for finding in made.left_out}
    assert left_out == {
        name: f"{thickness} mm thick, and preshape parallel takes 45 mm at least"
        for name, thickness in (
            ("cylinder_040_tip", 40),
            ("edge_019", 19),
            ("handle_025", 25),
        )
    }


@pytest.mark.parametrize("widths", [[0.1, 0.13], [0.005, 0.015]])
def test_the_reason_is_that_of_a_preshape_of_the_right_size(tmp_path, widths):
    content = yaml.safe_load(JAW.read_text())
    # Jaws that hardly stand out of the palm take nothing.
    content["chains"]["jaw"][0]["pad"] = [0, 0, 0.001]
    content["chains"]["jaw"][0]["solids"][0].update(
        size=[0.016, 0.026, 0.002], position=[-0.008, 0, 0.001]
    )
    parallel = content["preshapes"]["parallel"]
    content["preshapes"]["second"] = {**parallel, "widths": widths}
    (tmp_path / "jaw.yaml").write_text(yaml.safe_dump(content))
    made = adapt(FEW, GripperModel.load(tmp_path / "jaw.yaml"))
    assert len(made.left_out) == len(FEW)
    assert not any("mm thick" in str(finding) for finding in made.left_out)


def test_fingers_beside_the_middle_of_the_palm_take_the_middle_of_shapes(tmp_path):
    content = yaml.safe_load(JAW.read_text())
    for finger in content["fingers"]:
        finger["position"][1] = 0.05
    (tmp_path / "jaw.yaml").write_text(yaml.safe_dump(content))
    made = adapt(FEW, GripperModel.load(tmp_path / "jaw.yaml")).library
    usual = adapt(FEW, GripperModel.load(JAW)).library
    assert made.names == usual.names
    for prototype in made:
        beside = prototype.definition.T_hand_shape.p
        beside = beside - usual[prototype.name].definition.T_hand_shape.p
        assert beside == pytest.approx([0.0, 0.05, 0.0], abs=2e-3)


def test_one_shape_in_two_prototypes_is_made_once():
    twice = SHIPPED.select(names=["bar_2x4_flat", "bar_2x4_flat_tip"])
    made = adapt(twice, GripperModel.load(JAW))
    assert made.library.names == ("jaw_140_bar_089x038",)


def test_a_shape_that_is_generic_somewhere_is_generic():
    bar = SHIPPED["bar_2x4_flat"].definition
    marked = replace(bar, name="a_marked_bar", kind="object-specific")
    source = PrototypeLibrary.build([marked, bar], SHIPPED.grippers)
    (made,) = adapt(source, GripperModel.load(JAW)).library
    assert made.kind == "generic"


def test_measured_points_are_left_out():
    rng = np.random.default_rng(0)
    points = rng.uniform([-0.02, -0.02, 0.08], [0.02, 0.02, 0.12], (200, 3))
    normals = np.tile([0.0, 0.0, -1.0], (200, 1))
    measured = replace(
        SHIPPED["bar_4x4"].definition,
        name="measured",
        shape=SurfaceShape(points, normals),
        T_hand_shape=SE3.identity(),
    )
    source = PrototypeLibrary.build([measured], SHIPPED.grippers)
    made = adapt(source, GripperModel.load(JAW))
    assert len(made.library) == 0
    assert "record" in str(made.left_out[0])


def test_a_preshape_of_ones_choice_is_used_and_named():
    hand = GripperModel.load("robotiq_3f")
    made = adapt(FEW, hand, preshape="wide").library
    assert {prototype.preshape for prototype in made} == {"wide"}
    assert all(name.startswith("robotiq_3f_wide_") for name in made.names)
    with pytest.raises(UnknownNameError, match="pinch"):
        adapt(FEW, hand, preshape="fist")


def test_no_shapes_are_refused():
    with pytest.raises(ChoiceError, match="at least one"):
        adapt(PrototypeLibrary((), SHIPPED.grippers), GripperModel.load(JAW))


@pytest.mark.parametrize("base", [{"rpy": [3.14159265, 0, 0]}, {"position": [0, 0, 1]}])
def test_a_palm_frame_that_is_elsewhere_is_told_once(tmp_path, base):
    content = yaml.safe_load(JAW.read_text())
    content["base"] = {"position": [0, 0, 0], **base}
    (tmp_path / "jaw.yaml").write_text(yaml.safe_dump(content))
    hand = GripperModel.load(tmp_path / "jaw.yaml")
    with pytest.raises(ConfigError, match=r"base of jaw_140.*palm frame"):
        adapt(FEW, hand)


def test_progress_tells_each_prototype():
    told: list[tuple[str, float]] = []
    adapt(FEW, GripperModel.load(JAW), progress=lambda *step: told.append(step))
    assert [name for name, _ in told] == [*FEW.names, "all shapes"]
    assert [share for _, share in told] == [0.0, 0.25, 0.5, 0.75, 1.0]
