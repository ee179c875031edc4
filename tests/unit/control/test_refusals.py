"""What moves an arm, on paper too, refuses what is none of its parts."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.control import (
    ArmResponse,
    CartesianServo,
    LegPlanner,
    preview,
    rehearse,
)
from debrisgrasp.errors import InputError

from .rigs import CHAIN, PERIOD, READY, ROMAN, Rig


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


FAMILY = ROMAN.limits("right", CHAIN)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Rig(limits=FAMILY), "limits: got LimitFamily, .*controller to move"),
        (lambda: Rig(compliance=np.eye(6)), "compliance: got ndarray, .*diagonal"),
        (lambda: Rig(guard=3.0), "guard: got 3.0"),
        (lambda: CartesianServo(CHAIN, FAMILY, PERIOD), "limits: got LimitFamily"),
        (lambda: LegPlanner(CHAIN, FAMILY), "limits: got LimitFamily"),
        (
            lambda: preview(np.eye(6), CHAIN.fk(READY), bound=Rig().controller.bound),
            "compliance: got ndarray",
        ),
    ],
)
def test_what_moves_an_arm_by_something_else_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
