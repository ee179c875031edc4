"""What moves an arm, on paper too, refuses what is none of its parts."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.control import (
    ArmResponse,
    rehearse,
)
from debrisgrasp.errors import InputError

from .rigs import READY, Rig


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"rng": 0}, r"rng: got 0 \(int\), expected a Generator"),
        ({"q_start": READY[:-1]}, "shape of q_start"),
        ({"q_start": READY * np.nan}, "q_start: got .* NaN"),
        ({"world": lambda _: np.zeros(3)}, "wrench of the world"),
        ({"world": lambda _: np.full(6, np.nan)}, "wrench of the world"),
        ({"duration": "long"}, "duration: got 'long'"),
        ({"arm": 8.0}, "arm: got 8.0"),
    ],
)
def test_a_rehearsal_of_what_is_none_is_refused(given, words):
    usual = {
        "q_start": READY,
        "world": lambda _: np.zeros(6),
        "arm": ArmResponse(),
        "rng": np.random.default_rng(0),
    }
    with pytest.raises(InputError, match=words):
        rehearse(Rig().controller, **{**usual, **given})
