"""Prototypes that a hand can't hold are found out, shipped ones aren't among them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from debrisgrasp.errors import UnknownNameError
from debrisgrasp.geometry import SE3
from debrisgrasp.geometry.sampling import fibonacci_sphere
from debrisgrasp.prototypes import (
    GraspPrototype,
    GripperModel,
    PrototypeLibrary,
    check,
    prototype_of_shape,
)
from debrisgrasp.prototypes.check import contact_opening
from debrisgrasp.prototypes.shapes import BoxShape

LIBRARY = PrototypeLibrary.load()


def changed(name: str, **fields: object) -> GraspPrototype:
    definition = replace(LIBRARY[name].definition, **fields)
    return GraspPrototype.build(definition, fibonacci_sphere(8))


def moved(name: str, *shift: float) -> GraspPrototype:
    T = LIBRARY[name].definition.T_hand_shape
    return changed(name, T_hand_shape=SE3.from_parts(None, shift) @ T)


def problems(prototype: GraspPrototype) -> str:
    findings = check(prototype, LIBRARY.grippers[prototype.gripper])
    return "\n".join(map(str, findings))


@pytest.mark.parametrize("name", LIBRARY.names)
def test_shipped_prototypes_have_no_findings(name: str) -> None:
    assert problems(LIBRARY[name]) == ""


def test_a_shape_in_the_palm_is_found() -> None:
    assert "reaches 20 mm into the shape" in problems(
        moved("cylinder_090_power", 0, 0, 0.045 - 0.02 - 0.07)
    )


def test_a_hand_wholly_inside_the_shape_is_found() -> None:
    block = BoxShape(width=0.3, length=0.6, height=0.3)
    inside = changed("cylinder_090_power", shape=block, T_hand_shape=SE3.identity())
    assert "into the shape" in problems(inside)


def test_a_shape_beyond_the_fingers_is_found() -> None:
    found = problems(moved("cylinder_040_tip", 0, 0, 0.1))
    assert "fingers of the thumb side close past the shape" in found
    assert "fingers of the pair side close past the shape" in found


def test_a_shape_off_the_middle_is_found() -> None:
    assert "off the middle" in problems(moved("cylinder_040_tip", 0.015, 0, 0))


def test_a_width_that_does_not_fit_the_shape_is_found() -> None:
    found = problems(changed("cylinder_060_tip", width=0.04))
    assert "come to rest at 6" in found
    assert "the width says 40 mm" in found


def test_a_width_outside_the_preshape_is_found() -> None:
    assert "outside the 0.02 to 0.15 m" in problems(
        changed("cylinder_040_tip", width=0.01)
    )


def test_an_opening_without_clearance_is_found() -> None:
    assert "leaves less than 10 mm" in problems(
        changed("cylinder_040_tip", opening=0.045)
    )


def test_fingers_meet_a_bar_between_the_pads_at_its_width() -> None:
    prototype = LIBRARY["bar_2x4_flat_tip"]
    gripper = LIBRARY.grippers["robotiq_3f"]
    contacts = [contact_opening(prototype, gripper, side) for side in (-1, 1)]
    assert np.allclose(contacts, 0.089, atol=0.003)


def test_a_pipe_thicker_than_the_hand_opens_slides_off():
    hand = GripperModel.load("robotiq_3f")
    shape = {"type": "cylinder", "diameter": 0.19, "length": 0.14, "ends": "open"}
    shape["position"] = [0.0, 0.0, 0.18]
    definition = prototype_of_shape("thick", shape, hand, "basic")
    found = check(GraspPrototype.build(definition, fibonacci_sphere(1)), hand)
    assert any("slants" in str(finding) for finding in found)
    thin = prototype_of_shape("thin", shape | {"diameter": 0.1}, hand, "basic")
    found = check(GraspPrototype.build(thin, fibonacci_sphere(1)), hand)
    assert not any("slants" in str(finding) for finding in found)


def test_fingers_that_never_meet_close_as_far_as_they_go(tmp_path):
    path = Path(__file__).parents[3] / "examples/grippers/jaw_140.yaml"
    text = path.read_text().replace("[0, 0.07]", "[0, 0.04]")
    (tmp_path / "jaw.yaml").write_text(text.replace("[0.005,", "[0.065,"))
    hand = GripperModel.load(tmp_path / "jaw.yaml")
    assert hand.preshape("parallel").narrowest == pytest.approx(0.06)
    shape = {"type": "bar", "width": 0.07, "height": 0.03, "length": 0.14}
    shape["position"] = [0.0, 0.0, 0.3]
    beyond = prototype_of_shape("beyond", shape, hand, "parallel")
    found = check(GraspPrototype.build(beyond, fibonacci_sphere(1)), hand)
    assert "thumb side close past the shape" in "\n".join(map(str, found))


def test_a_grip_of_another_name_is_refused():
    hand = GripperModel.load("robotiq_3f")
    shape = {"type": "cylinder", "diameter": 0.06, "length": 0.14, "ends": "open"}
    with pytest.raises(UnknownNameError, match="tip, deep, power"):
        prototype_of_shape("rod", shape, hand, "basic", grip="palm")
