"""A field that is missing: which one may be meant, and which are there."""

from __future__ import annotations

import pytest

from debrisgrasp._fields import Fields
from debrisgrasp.errors import ConfigError, InputError


def complaint(missing: str, **content: float) -> str:
    with pytest.raises(ConfigError) as caught:
        Fields(content, "a.yaml").raw(missing)
    return str(caught.value)


def test_a_missing_field_may_be_misspelt():
    said = complaint("width", widht=0.05, opening=0.09)
    assert "Did you mean 'width' where it says 'widht'" in said
    assert "widht, opening" in said


def test_another_field_is_not_taken_for_a_misspelt_one():
    assert "Did you mean" not in complaint("rail_height", rail_length=0.3)


def test_a_field_that_was_asked_for_is_not_misspelt():
    fields = Fields({"width": 0.05}, "a.yaml")
    fields.raw("width")
    with pytest.raises(ConfigError) as caught:
        fields.raw("widths")
    assert "Did you mean" not in str(caught.value)


@pytest.mark.parametrize("text", ["65 mm", "6.5cm", "6,5 cm", "90°"])
def test_a_number_with_its_unit_is_told_of(text):
    with pytest.raises(ConfigError, match="without its unit"):
        Fields({"width": text}, "a.yaml").number("width", 0.0, 1.0)


def test_decimals_after_a_comma_are_told_of():
    with pytest.raises(ConfigError, match=r"0\.5, not 0,5"):
        Fields({"speed": "0,5"}, "a.yaml").number("speed", 0.0, 1.0)
    fields = Fields({"speed": 0, 5: None}, "a.yaml")  # as YAML has {speed: 0,5}
    fields.number("speed", 0.0, 1.0)
    with pytest.raises(InputError, match=r"0\.5, not 0,5"):
        fields.finish()


@pytest.mark.parametrize("value", [True, 12, 48.0])
def test_what_yaml_takes_for_a_value_is_no_text(value: object) -> None:
    with pytest.raises(ConfigError, match=r"expected text\. .*in quotes"):
        Fields({"name": value}, "hand.yaml").text("name")


@pytest.mark.parametrize("name", [True, 12, "", " "])
def test_what_yaml_takes_for_a_value_is_no_name(name: object) -> None:
    with pytest.raises(ConfigError, match=r"expected a name\. .*in quotes"):
        Fields({name: {}}, "hand.yaml", "preshapes").names()
