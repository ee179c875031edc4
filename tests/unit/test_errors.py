"""Messages stay readable whatever arrives."""

from __future__ import annotations

import pickle

import pytest

from debrisgrasp.errors import (
    DriverError,
    FrameMismatchError,
    InputError,
    MissingExtraError,
    OutputError,
    UnknownNameError,
)


def test_a_message_names_value_limit_and_mend():
    error = InputError("depth", got="-1 m", expected="0 m or more", mend="Flip it.")
    assert str(error) == "depth: got -1 m, expected 0 m or more. Flip it."
    assert isinstance(error, ValueError)


def test_a_huge_value_is_cut_short_in_the_message_but_kept_as_a_fact():
    error = InputError("field", got="x" * 100_000, expected="a number")
    assert len(str(error)) < 600
    assert "100000 characters" in str(error)
    assert len(error.got) == 100_000


def test_an_unknown_name_lists_the_known_and_guesses():
    error = UnknownNameError("gripper", "robotiq_3d", ["robotiq_3f", "camhand"])
    assert "camhand" in str(error)
    assert "Did you mean 'robotiq_3f'?" in str(error)


def test_of_many_known_names_only_the_nearest_are_shown():
    known = [f"cylinder_{size:03d}" for size in range(0, 400, 10)]
    error = UnknownNameError("prototype", "cylindr_080", known)
    assert "cylinder_080" in str(error)
    assert "40 names" in str(error)
    assert len(str(error)) < 250
    assert len(error.known) == 40


def test_of_many_known_names_those_that_hold_the_word_are_shown():
    known = [f"link_{number}" for number in range(40)] + ["right_robotiq_led_frame"]
    said = str(UnknownNameError("fiducial", "led", known))
    assert "41 names, such as right_robotiq_led_frame." in said
    assert "link_0" in str(UnknownNameError("fiducial", "", known))


def test_of_a_place_that_cannot_be_the_beginning_is_told():
    assert len(str(OutputError("/tmp/" + 5000 * "x", "File name too long"))) < 600


def test_a_command_that_lists_the_known_names_is_named():
    error = UnknownNameError("fault", "foo", ["slip"], listed_by="x --faults list")
    assert "`x --faults list` lists them" in str(error)


@pytest.mark.parametrize(
    "error",
    [
        InputError("depth", got=[-1.0], expected="0 m or more", mend="Flip it."),
        UnknownNameError("fault", "foo", ["slip"], listed_by="x --faults list"),
        FrameMismatchError("cloud", expected_frame="base", got_frame="camera"),
        DriverError("arm", "no answer", mend="Look at its cable."),
        OutputError("plan.json", "disk full"),
        MissingExtraError("the viewer", "viz"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_an_error_comes_whole_out_of_another_process(error):
    other = pickle.loads(pickle.dumps(error))
    assert type(other) is type(error)
    assert str(other) == str(error)
    assert vars(other) == vars(error)
