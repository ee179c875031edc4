"""Bodies that overlap when they are let down: out of each other, and not elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from debrisgrasp.geometry import SE3, so3
from debrisgrasp.robot import FakeConfig
from debrisgrasp.robot.rubble import Rubble
from debrisgrasp.robot.shapes import BodyShape
from debrisgrasp.worlds import World, make_body
from tests.unit.robot.rigs import beam


def ladder(name: str, at: tuple[float, float, float], turn=(0.0, 0.0, 0.0)):
    """Much that is thin, with room between."""
    sizes = {"length": 0.7, "depth": 0.2, "radius": 0.012, "bays": 4}
    body = make_body("truss_ladder", sizes, 3.0, name=name)
    return body.at(SE3.from_parts(so3.exp(np.array(turn)), at))


def overlap(rubble: Rubble, body: int, others) -> float:
    shape = rubble.shapes[body]
    return max(
        max(other.deepest(shape.points)[0], shape.deepest(other.points)[0])
        for other in others
    )


def test_a_body_that_was_pressed_into_another_comes_out_of_it():
    low, high = beam("low", 3.0, (1, 0, 0.0445)), beam("high", 3.0, (1, 0.01, 0.125))
    rubble = Rubble(World((low, high)), FakeConfig())
    assert overlap(rubble, 1, rubble.shapes[:1]) == pytest.approx(8.5e-3, abs=1e-4)
    rubble.settle({1}, ())
    assert overlap(rubble, 1, rubble.shapes[:1]) < 1e-3
    assert rubble.shapes[1].p == pytest.approx([1, 0.01, 0.1335], abs=2e-3)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(-0.05, 0.05), min_size=6, max_size=6),
    st.lists(st.floats(-0.6, 0.6), min_size=6, max_size=6),
)
def test_what_is_pressed_into_several_things_is_not_thrown_about(shifts, turns):
    """It lay still between them, and a hand is one of them."""
    middle = ladder("middle", (1.0, 0.0, 0.5))
    beside = ladder("beside", (1.0, 0.02 + shifts[0], 0.5 + shifts[1]), turns[:3])
    hand = ladder("hand", (1.0 + shifts[2], shifts[3], 0.5 + shifts[4]), turns[3:])
    rubble = Rubble(World((middle, beside)), FakeConfig())
    others = [rubble.shapes[1], BodyShape(hand)]
    start, before = rubble.shapes[0].p.copy(), overlap(rubble, 0, others)
    rubble.push_out(0, (), [hand])
    way = float(np.linalg.norm(rubble.shapes[0].p - start))
    assert way <= 2.0 * max(before, 0.0) + 1e-9
    assert overlap(rubble, 0, others) <= max(before, 2e-4) + 1e-9


def test_what_lies_on_a_body_and_on_that_rides_on_it():
    """What leans on something else, too, with half of its weight."""
    bars = [
        beam("lowest", 1.0, (1, 0, 0.0445)),
        beam("one end", 1.0, (0.8, 0, 0.1335), yaw=np.pi / 2),
        beam("other end", 1.0, (1.2, 0, 0.1335), yaw=np.pi / 2),
        beam("over both", 1.0, (1, 0, 0.2225)),
        beam("prop", 1.0, (0.6, 0, 0.2225), yaw=np.pi / 2),
        beam("highest", 1.0, (0.8, 0, 0.3115)),
    ]
    rubble = Rubble(World(tuple(bars)), FakeConfig())
    assert rubble.riders(0) == {1: 1.0, 2: 1.0, 3: 1.0, 5: 0.5}
    assert rubble.riders(1) == {3: 0.5, 5: 0.25}
    assert rubble.riders(3) == rubble.riders(4) == {5: 0.5}
    assert rubble.riders(5) == {}
