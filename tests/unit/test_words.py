"""Quantities as people read them."""

from __future__ import annotations

import pytest

from debrisgrasp._words import arm_called, in_kilograms


@pytest.mark.parametrize(
    ("masses", "words"),
    [
        ((0.0449,), "0.045 kg"),
        ((0.96,), "0.96 kg"),
        ((1.234,), "1.2 kg"),
        ((331.0,), "330 kg"),
        ((45_678.0,), "46000 kg"),
        ((1.2, 12.4), "1.2 to 12 kg"),
    ],
)
def test_masses_have_two_digits_and_no_power_of_ten(masses, words):
    assert in_kilograms(*masses) == words


def test_an_arm_whose_name_says_so_is_called_by_it_alone():
    called = [arm_called(name) for name in ("right", "arm", "left_arm", "Arm")]
    assert called == ["right arm", "arm", "left_arm", "Arm"]
