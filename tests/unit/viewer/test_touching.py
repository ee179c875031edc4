"""What a hand would hit, on points that were put where they are hit."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.geometry import SE3, random_rotations
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.viewer import touches

HAND = GripperModel.load("robotiq_3f")
OPEN, CLOSED = 0.12, 0.05


def found(points: np.ndarray, T: SE3 | None = None) -> set[tuple[str, str]]:
    pose = SE3.identity() if T is None else T
    touched = touches(HAND, "basic", OPEN, CLOSED, pose, pose.apply(points))
    return {(touch.part, touch.when) for touch in touched}


def test_a_free_hand_touches_nothing():
    assert not found(np.array([[0.0, 0.0, 0.08], [1.0, 1.0, 1.0]]))


def test_points_in_the_palm_are_hit_by_the_palm():
    assert found(np.array([[0.0, 0.0, -0.05]])) >= {("palm", "at the grasp")}


def test_what_the_palm_passes_is_hit_on_the_way_only():
    behind = min(solid.bounds.lower[2] for solid in HAND.palm) - 0.03
    point = np.array([[0.0, 0.0, behind]])
    assert not {when for _, when in found(point)} & {"at the grasp", "while closing"}
    assert ("palm", "on the way in") in found(point)


@pytest.mark.parametrize(("side", "part"), [(-1, "thumb side"), (1, "pair side")])
def test_fingers_are_told_apart(side, part):
    (pad, *_) = (solid for solid in HAND.finger_solids("basic", OPEN, side)[-1:])
    assert (part, "at the grasp") in found(
        pad.bounds.lower[None] / 2 + pad.bounds.upper / 2
    )


def test_what_the_closing_fingers_sweep_is_found_but_not_what_they_grip(rng):
    def depth(points: np.ndarray, opening: float) -> np.ndarray:
        solids = HAND.finger_solids("basic", opening, -1)
        return -np.min([solid.signed_distance(points) for solid in solids], axis=0)

    points = rng.uniform([-0.08, -0.05, 0.06], [0.0, 0.05, 0.14], (4000, 3))
    last = CLOSED + 0.016
    is_swept = (depth(points, last) > 0.006) & (depth(points, OPEN) < -0.01)
    is_gripped = np.abs(points[:, 0]) < 0.015
    assert found(points[is_swept]) == {("thumb side", "while closing")}
    assert not found(points[is_gripped])


def test_figures_don_t_depend_on_where_the_hand_is(rng):
    T = SE3.from_parts(random_rotations(1, rng=rng)[0], rng.normal(size=3))
    points = rng.uniform(-0.15, 0.15, (400, 3))
    here = touches(HAND, "basic", OPEN, CLOSED, SE3.identity(), points)
    there = touches(HAND, "basic", OPEN, CLOSED, T, T.apply(points))
    assert [str(touch) for touch in here] == [str(touch) for touch in there]
    for a, b in zip(here, there, strict=True):
        assert set(a.points) == set(b.points)
        inside = b.solid.signed_distance(T.apply(points[b.points]))
        assert np.allclose(inside.min(), -b.depth)
