"""Where things are put down on the robot in memory, and what of them stands there."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.control import LegOutcome, LegPlanner
from debrisgrasp.executive import dropoff
from debrisgrasp.executive.carrying import _is_beside
from debrisgrasp.executive.drive import Drive
from debrisgrasp.executive.dropoff import (
    _at_rest,
    _is_met,
    _poses,
    drop_postures,
    longer,
    may_lie,
    no_place,
    object_in_hand,
)
from debrisgrasp.executive.obstacles import lying
from debrisgrasp.executive.releasing import verify_release
from debrisgrasp.executive.result import FaultFound, LegEnd
from debrisgrasp.geometry import SE3, so3
from tests.unit.executive.rigs import before_a_brick, holding, look


def test_the_unseen_underside_is_as_far_down_as_the_object_is_wide(pipeline):
    _, task = before_a_brick(pipeline)
    context = task.context
    look(context)
    segments = context.cycle.seen.segmentation.segments
    context.cycle.label = min(
        segments, key=lambda s: np.linalg.norm(s.centroid - [1.3, 0.0, 0.05])
    ).label
    hand = SE3.from_parts(p=[1.3, 0.0, 0.3])
    points = hand.apply(object_in_hand(context, hand, 0.05))
    # A brick 6 cm high: its top was seen, and some of its front.
    assert points[:, 2].max() == pytest.approx(0.06, abs=0.02)
    assert -0.07 < points[:, 2].min() < 0.03


def test_a_hand_that_is_caught_as_it_rises_is_not_free(pipeline, monkeypatch):
    _, task = before_a_brick(pipeline)
    context = task.context
    context.released = holding()
    monkeypatch.setattr(
        Drive, "leg", lambda *_args, **_options: LegEnd(LegOutcome.CONTACT, 0.2, 0.04)
    )
    found = verify_release(context)
    assert isinstance(found, FaultFound)
    assert found.fault == "not_released"
    assert context.held is context.released
    assert context.n_removed == 0


def test_nothing_is_put_down_where_the_arm_rests(pipeline):
    _, task = before_a_brick(pipeline)
    context = task.context
    balls = _at_rest(context, context.limbs["right"])
    points = np.zeros((1, 3))
    poses = SE3(
        np.stack([SE3.from_parts(p=p).matrix for p in (balls[3, :3], [3.0, 0.0, 0.0])])
    )
    assert _is_met(balls, points, poses).tolist() == [True, False]


def test_what_hangs_low_beside_the_way_may_be_put_down_there(pipeline):
    _, task = before_a_brick(pipeline)
    context = task.context
    limb = context.limbs["right"]
    T = limb.pose(context.posture(limb))
    for place, expected in (
        ((0.2, -0.9, 0.1), True),
        ((0.2, -0.9, 0.6), False),  # too high
        ((1.0, 0.0, 0.1), False),  # in the way
        ((0.2, -0.25, 0.15), False),  # over a track
    ):
        point = T.inverse().apply(np.array([place]))
        held = holding(points_hand=point)
        assert _is_beside(context, limb, held) is expected


def test_postures_over_a_drop_off_hold_the_object_over_the_ground_and_are_free(
    pipeline,
):
    _, task = before_a_brick(pipeline)
    context = task.context
    limb = context.limbs["right"]
    q, asked = context.posture(limb), []

    def is_free(rows):
        asked.append(rows)
        return np.full(len(rows), len(asked) > 3)

    points = np.array(np.meshgrid([-0.1, 0.1], [-0.05, 0.05], [0.1, 0.2])).T
    found = drop_postures(context, limb, points.reshape(-1, 3), q, is_free, 2)
    assert len(found) == 2
    assert len(asked) == 4  # some at once
    for row in found:
        where = limb.pose(row).apply(points.reshape(-1, 3))
        assert where[:, 2].min() == pytest.approx(
            context.settings.drop_height, abs=2e-3
        )
        middle = 0.5 * (where.min(axis=0) + where.max(axis=0))[:2]
        assert np.linalg.norm(middle - context.settings.drop_off["right"]) < 0.5


def test_what_has_a_box_with_a_corner_below_it_is_held_higher(pipeline):
    _, task = before_a_brick(pipeline)
    context = task.context
    limb = context.limbs["right"]
    q, s = context.posture(limb), 0.15
    square = np.array([[s, s], [s, -s], [-s, s], [-s, 0.1 - s], [0.1 - s, -s]])
    u, v = np.repeat(square, 2, axis=0).T / np.sqrt(2.0)
    side = np.tile([-0.03, 0.03], 5)
    # On its corner, which is cut off: of a box around it, that is the lowest.
    points = (np.column_stack([u - v, side, u + v]) - [0.0, 0.0, 0.2]) @ limb.pose(q).R

    def is_free(rows):
        Ts = [limb.pose(row) for row in rows]
        lowest = [lying(T, points)[:, 2].min() for T in Ts]
        # As it was lifted: nothing else is free.
        tilts = [np.abs(T.R[2] - limb.pose(q).R[2]).max() for T in Ts]
        return (np.array(lowest) > 0.0) & (np.array(tilts) < 1e-3)

    found = drop_postures(context, limb, points, q, is_free, 2)
    assert len(found) == 2
    for row in found:
        lowest = limb.pose(row).apply(points)[:, 2].min()
        assert lowest > context.settings.drop_height + 0.02


@pytest.mark.parametrize(
    ("leaning", "is_flat"), [((0.1, 0.25, 0.3), True), ((0.2, 0.5, 0.3), False)]
)
def test_what_hangs_on_a_corner_is_put_down_on_a_side(pipeline, leaning, is_flat):
    """Not if it must be turned far for that: it would slip in the hand."""
    _, task = before_a_brick(pipeline)
    context = task.context
    limb = context.limbs["right"]
    q = context.posture(limb)
    board = np.array(np.meshgrid([-0.3, 0.3], [-0.05, 0.05], [-0.2, 0.2])).T
    turned = board.reshape(-1, 3) @ so3.from_rpy(np.array(leaning)).T
    points = (turned - [0.0, 0.0, 0.2]) @ limb.pose(q).R
    found = drop_postures(
        context, limb, points, q, lambda rows: np.ones(len(rows), dtype=bool), 2
    )
    assert len(found) == 2
    for row in found:
        heights = np.sort(limb.pose(row).apply(points)[:, 2])
        assert bool(np.ptp(heights[:4]) < 0.02) is is_flat
        assert heights[4] - heights[3] > 0.3 or not is_flat


def test_no_end_of_something_long_is_laid_onto_the_tracks(pipeline):
    _, task = before_a_brick(pipeline)
    context = task.context
    limb = context.limbs["right"]
    q = context.posture(limb)
    beam = np.array(np.meshgrid(np.linspace(-0.6, 0.6, 25), [-0.05, 0.05], [0.0, 0.1]))
    points = (beam.reshape(3, -1).T - [0.0, 0.0, 0.2]) @ limb.pose(q).R
    found = drop_postures(
        context, limb, points, q, lambda rows: np.ones(len(rows), dtype=bool)
    )
    assert len(found)
    assert all(may_lie(context, limb, points, limb.pose(row)) for row in found)


def test_a_hand_comes_straight_off_what_it_puts_down(pipeline):
    """One that looks back at the robot may be too near the end of what its arm can."""
    _, task = before_a_brick(pipeline)
    context = task.context
    limb = context.limbs["right"]
    q = np.array([0.3, -1.7, -2.99, -0.62, 0.62, -1.03, 1.24, 2.24])
    board = np.array(np.meshgrid([-0.1, 0.1], [-0.3, 0.3], [0.1, 0.3])).T
    found = drop_postures(
        context, limb, board.reshape(-1, 3), q, lambda rows: np.ones(len(rows), bool)
    )
    assert len(found) == 12
    legs = LegPlanner(limb.reach.chain, limb.limits.controller)
    for row in found:
        down = legs.plan(row, SE3.from_parts(p=[0.0, 0.0, -0.12]) @ limb.pose(row))
        assert down.is_done
        off = SE3.from_parts(p=-0.1 * down.reached.R[:, 2]) @ down.reached
        assert legs.plan(down.q[-1], off).is_done


def test_where_the_ground_is_out_of_reach_an_object_falls_from_as_low_as_it_can(
    pipeline, monkeypatch
):
    _, task = before_a_brick(pipeline)
    context = task.context
    limb = context.limbs["right"]
    board = np.array(np.meshgrid([-0.1, 0.1], [-0.3, 0.3], [0.1, 0.3])).T
    shares = {}

    def scripted(_legs, q, _goal):
        known = [(0.5, 1.0), (0.9, 1.0), (1.0, 0.5)]
        return shares.setdefault(tuple(q), known[len(shares) % 3])

    monkeypatch.setattr(dropoff, "_shares", scripted)
    found = drop_postures(
        context,
        limb,
        board.reshape(-1, 3),
        context.posture(limb),
        lambda rows: np.ones(len(rows), dtype=bool),
        8,
    )
    assert [shares[tuple(row)] for row in found] == [(0.9, 1.0)] * 8


def test_nothing_is_laid_onto_a_finger(pipeline):
    _, task = before_a_brick(pipeline)
    context = task.context
    limb = context.limbs["right"]
    q = context.posture(limb)
    leaning = so3.from_rpy(np.array([0.0, 0.3, 0.0]))
    for below, expected in ((0.02, False), (0.3, True)):
        board = np.array(np.meshgrid([0.05, 0.7], [-0.1, 0.1], [-below, 0.02])).T
        points = board.reshape(-1, 3) @ leaning.T @ limb.pose(q).R
        found = drop_postures(
            context, limb, points, q, lambda rows: np.ones(len(rows), dtype=bool), 2
        )
        assert len(found) == 2
        heights = np.sort(limb.pose(found[0]).apply(points)[:, 2])
        assert bool(np.ptp(heights[:4]) < 0.02) is expected


def test_an_object_goes_where_nothing_lies_and_not_into_the_way(pipeline):
    _, task = before_a_brick(pipeline)
    context = task.context
    limb, R = context.limbs["right"], np.eye(3)
    x, y = context.settings.drop_off["right"]
    board = np.array(np.meshgrid([-0.3, 0.3], [-0.05, 0.05], [-0.2, 0.2])).T
    points = board.reshape(-1, 3)
    on_ground = 0.2 + context.settings.drop_height

    def poses():
        goals = _poses(context, limb, points, R)
        where = goals.R @ points.T + goals.p[..., None]
        return goals.p[:, 2] - on_ground, where, len(goals.p)

    raised, where, n = poses()
    assert raised == pytest.approx(np.zeros(n))
    where = np.moveaxis(where, 1, 2)
    is_in_way = context.is_in_way(where).any(axis=1)
    assert 0 < is_in_way.sum() < n
    is_in_way |= context.is_in_way(where.mean(axis=1) * [1.0, 1.0, 0.0], 0.1)
    assert 0 < is_in_way.sum() < n
    assert is_in_way[n - is_in_way.sum() :].all()
    # A box where the first would go: the next one lies beside it, on the ground.
    box = np.array(np.meshgrid([x - 0.1, x + 0.1], [y - 0.1, y + 0.1], [0.3])).T
    context.memory.dropped.append(box.reshape(-1, 3))
    raised, where, n = poses()
    n_low = np.count_nonzero(raised < 1e-6)
    assert n // 4 < n_low < n
    assert raised[: n_low // 2] == pytest.approx(np.zeros(n_low // 2))
    # With things everywhere it goes onto them.
    far = np.arange(-1.5, 1.5, 0.04)
    slab = np.array(np.meshgrid(x + far, y + far, [0.3])).T
    context.memory.dropped[:] = [slab.reshape(-1, 3)]
    raised, _, n = poses()
    assert raised == pytest.approx(np.full(n, 0.3))
    words = no_place(context, limb, points, SE3.identity())
    assert "it is full, 30 cm high" in words
    context.memory.dropped.clear()
    assert "full" not in no_place(context, limb, points, SE3.identity())


def test_what_hangs_low_over_what_was_put_down_may_be_put_down_on_it(pipeline):
    _, task = before_a_brick(pipeline)
    context = task.context
    limb = context.limbs["right"]
    point = (
        limb.pose(context.posture(limb)).inverse().apply(np.array([[0.2, -0.9, 0.6]]))
    )
    held = holding(points_hand=point)
    assert not _is_beside(context, limb, held)
    context.memory.dropped.append(np.array([[0.2, -0.9, 0.5]]))
    assert _is_beside(context, limb, held)


def test_what_was_put_down_stands_in_the_way_with_its_whole_body():
    corners = np.array(np.meshgrid([0, 0.3], [0, 0.1], [0.1, 0.2])).reshape(3, -1).T
    T = SE3.from_parts(p=[1.0, 0.0, 0.5])
    surface = lying(T, corners)
    low, high = T.apply(corners).min(axis=0), T.apply(corners).max(axis=0)
    assert np.all(surface.min(axis=0) < low)
    assert np.all(surface.max(axis=0) > high)
    assert np.all(surface.max(axis=0) < high + 0.03)
    # No link slips between the points.
    inside = np.random.default_rng(0).uniform(low[:2], high[:2], (50, 2))
    on_top = surface[surface[:, 2] > high[2]][:, :2]
    gaps = np.linalg.norm(inside[:, None] - on_top, axis=2).min(axis=1)
    assert gaps.max() < 0.02


@pytest.mark.parametrize(
    ("tilt", "room", "lowest"),
    [(0.3, 0.2, 0.0), (1.4, 0.2, 0.0), (0.3, 0.02, 0.02), (0.3, 2.0, 2.0)],
)
def test_what_stands_on_something_is_longer_than_was_seen(tilt, room, lowest):
    """A pole, upright or nearly level, of which the upper part was seen."""
    rng = np.random.default_rng(1)
    along = rng.uniform([-0.02, -0.02, 0.0], [0.02, 0.02, 0.6], (500, 3))
    turned = along @ so3.exp([tilt, 0.0, 0.0]).T
    seen = turned + np.array([0.5, 0.2, room - turned[:, 2].min()])
    T = SE3.from_parts(so3.exp([0.3, -0.2, 1.0]), [0.1, 0.2, 0.3])
    in_hand = T.inverse().apply(np.concatenate([seen, seen]))
    found = T.apply(longer(in_hand, T, room))
    assert found[:, 2].min() == pytest.approx(lowest, abs=1e-6)
    first, second = np.split(found, 2)
    np.testing.assert_allclose(first[:500], seen, atol=1e-9)
    np.testing.assert_allclose(second[:500], seen, atol=1e-9)
    if lowest == 0.0 and tilt < 1.0:  # it goes on along its axis
        axis = so3.exp([tilt, 0.0, 0.0])[:, 2]
        end = first[first[:, 2] < 0.01].mean(axis=0) - seen.mean(axis=0)
        assert abs(end @ axis) > 0.98 * np.linalg.norm(end)
