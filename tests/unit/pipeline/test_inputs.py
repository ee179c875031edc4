"""What a pipeline refuses before it works."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from debrisgrasp.errors import ChoiceError, ConfigError, InputError, UnknownNameError
from debrisgrasp.io import data_path
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.pipeline.inputs import library_of, require_limits, with_hands
from debrisgrasp.prototypes import load_grippers


@pytest.mark.parametrize("mass", [0.0, -1.0, 5e-4, 2e4, float("nan"), float("inf")])
def test_no_mass_in_another_unit_is_taken(mass):
    with pytest.raises(ConfigError, match=r"0\.001 to 10000 kg"):
        require_limits(0, None, mass)


@pytest.mark.parametrize("mass", [None, 1e-3, 8, 1e4])
def test_masses_of_debris_are_taken(mass):
    require_limits(0, None, mass)


def library_for(hand: str, prototypes=None):
    arm = SimpleNamespace(gripper=hand)
    return library_of((arm,), None, prototypes=prototypes, known=load_grippers())


def test_a_hand_that_is_not_known_is_named_and_where_hands_are_given():
    with pytest.raises(ChoiceError, match=r"for my_jaw.*'my_jaw' is known.*--grippers"):
        library_for("my_jaw")


def test_a_hand_without_prototypes_is_named_and_how_they_are_made(tmp_path):
    shipped = data_path("prototypes") / "cylinder_060_tip.yaml"
    (tmp_path / shipped.name).write_bytes(shipped.read_bytes())
    with pytest.raises(ChoiceError, match=r"for camhand.*adapt --gripper camhand"):
        library_for("camhand", tmp_path)


def test_a_prototype_of_an_unknown_hand_says_where_hands_are_given(tmp_path):
    shipped = (data_path("prototypes") / "cylinder_060_tip.yaml").read_text()
    (tmp_path / "mine.yaml").write_text(shipped.replace("robotiq_3f", "my_jaw"))
    with pytest.raises(UnknownNameError, match=r"'my_jaw'.*--grippers"):
        library_for("camhand", tmp_path)


@pytest.mark.parametrize("hands", ["my_hands", [load_grippers()["camhand"]], None])
def test_hands_that_are_none_by_name_are_not_left_out(hands):
    """As the path of their folder, in which no hand's name was found."""
    with pytest.raises(InputError, match=r"expected hands by name.*load_grippers"):
        with_hands(RobotModel.load("roman"), hands)
