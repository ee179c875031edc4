"""From where something was put down back to rest."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from debrisgrasp.control import LegOutcome
from debrisgrasp.errors import DriverError
from debrisgrasp.executive import moves, releasing, resting
from debrisgrasp.executive.context import Context
from debrisgrasp.executive.drive import Drive
from debrisgrasp.executive.moves import planned
from debrisgrasp.executive.obstacles import room_for, space_of
from debrisgrasp.executive.resting import to_rest
from debrisgrasp.executive.result import Done, FaultFound, LegEnd
from debrisgrasp.executive.states import State
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.motion import MotionSpace, UnknownSpace
from tests.unit.executive.rigs import before_a_brick, gripped_below, look


def test_a_hand_that_was_cleared_up_is_not_drawn_back_once_more(pipeline, monkeypatch):
    _, task = before_a_brick(pipeline)
    context, drawn = task.context, []
    context.cycle.motion = SimpleNamespace(arm="right")
    monkeypatch.setattr(releasing, "back_out", lambda _, arm: drawn.append(arm))
    monkeypatch.setattr(releasing, "put_away", lambda *_: None)
    for is_in_pile, expected in (("right", ["right"]), (None, ["right"])):
        context.is_in_pile = is_in_pile
        assert isinstance(releasing.retreat(context), Done)
        assert drawn == expected


def test_a_camera_that_fails_keeps_no_arm_from_going_to_rest(pipeline, monkeypatch):
    _, task = before_a_brick(pipeline)
    context, rested = task.context, []

    def fails(*_):
        raise DriverError("camera", "no answer")

    monkeypatch.setattr(resting, "looked_after", fails)
    monkeypatch.setattr(resting, "to_rest", lambda _, arm: rested.append(arm))
    assert resting.put_away(context, "right", np.array([0.5, -0.8, 0.2])) is None
    assert rested == ["right"]


def test_an_arm_remembers_its_way_until_it_is_back_at_rest(pipeline):
    _, task = before_a_brick(pipeline)
    context = task.context
    limb, drive = context.limbs["right"], Drive(context, "right")
    q = context.posture(limb)
    away = q.copy()
    away[0] += 0.8
    space = space_of(context, unknown=UnknownSpace.IGNORED)
    assert drive.follow(planned(context, limb, away, space).trajectory) is None
    trail = np.array(limb.trail)
    assert len(trail) >= 4
    np.testing.assert_allclose(trail[0], q, atol=1e-3)
    gaps = np.abs(trail[:, None] - trail).max(axis=-1) + np.eye(len(trail))
    assert gaps.min() > 0.1
    assert to_rest(context, "right") is None
    assert limb.trail == []
    assert np.abs(context.posture(limb) - q).max() < 0.01


@pytest.mark.parametrize(
    ("reached", "is_removed", "is_seen"),
    [(State.LIFT, False, True), (State.LIFT, True, False), (State.CLOSE, False, False)],
)
def test_where_something_fell_back_a_hand_looks_around_before_it_goes(
    pipeline, monkeypatch, reached, is_removed, is_seen
):
    """A crate that had come loose lay in the elbow on its way to rest."""
    _, task = before_a_brick(pipeline)
    context, looks, reversed_ = task.context, [], []
    limb = context.limbs["right"]
    rest, q = context.posture(limb), context.posture(limb) + 0.1
    monkeypatch.setattr(context, "posture", lambda _: q)
    reach = SimpleNamespace(trajectory=SimpleNamespace(q=np.array([rest, q])))
    context.cycle.motion = SimpleNamespace(arm="right", reach=reach)
    context.cycle.reached.append(reached)
    context.cycle.is_removed = is_removed
    nowhere = FaultFound("unreachable", "as asked", "right")
    monkeypatch.setattr(resting, "looked_around", lambda *_: looks.append(True))
    monkeypatch.setattr(resting, "reversed_motion", lambda _: reversed_.append(True))
    monkeypatch.setattr(resting, "_way_to", lambda *_: nowhere)
    monkeypatch.setattr(resting, "_back", lambda *_: None)
    assert to_rest(context, "right") is (nowhere if is_seen else None)
    assert bool(looks) is is_seen
    assert bool(reversed_) is not is_seen


@pytest.mark.parametrize("unfolds", [True, False])
def test_an_arm_that_was_pushed_onto_itself_goes_back_to_where_it_was_free(
    pipeline, monkeypatch, unfolds
):
    """By its joints, or where they would fold it more, as its hand came."""
    fake, task = before_a_brick(pipeline)
    context, folded = task.context, []
    limb, drive = context.limbs["right"], Drive(context, "right")
    begin = limb.pose(context.posture(limb)).p
    assert drive.leg((0.0, 0.0, 0.1), speed=0.05).outcome is LegOutcome.DONE

    def is_folded(limb, q):
        folded.append(np.linalg.norm(limb.pose(q).p - begin) > 0.05)
        return folded[-1]

    monkeypatch.setattr(resting, "is_folded", is_folded)
    straight, ways = resting.straight, []

    def noted(drive, way, *_, **more):
        ways.append(way)
        return straight(drive, way, *_, **more)

    follow, goals = Drive.follow, []

    def noted_too(drive, trajectory, **more):
        goals.append(trajectory.q[-1])
        return follow(drive, trajectory, **more)

    monkeypatch.setattr(resting, "straight", noted)
    monkeypatch.setattr(Drive, "follow", noted_too)
    monkeypatch.setattr(resting, "unfolds", lambda *_: unfolds)
    assert to_rest(context, "right") is None
    assert folded[0]
    assert not any(folded[-1:])
    assert len(ways) == (not unfolds)
    if unfolds:
        assert np.linalg.norm(limb.pose(goals[0]).p - begin) < 0.051
    else:
        assert -0.105 < ways[0][2] < -0.045
    assert fake.truth().violations == ()


@pytest.mark.parametrize(("deep", "is_found"), [(0.01, True), (0.3, False)])
def test_a_hand_that_stands_on_the_ground_finds_a_way_off_it(
    pipeline, monkeypatch, deep, is_found
):
    _, task = before_a_brick(pipeline)
    context = task.context
    limb = context.limbs["right"]
    goal, limits = context.posture(limb), limb.limits.planner
    turns = np.random.default_rng(0).uniform(-1.2, 1.2, (300, len(goal)))
    others = np.clip(goal + turns, limits.lower, limits.upper)
    low = others[np.argsort([limb.pose(row).p[2] for row in others])]

    def over(height):
        plane = np.array([0.0, 0.0, 1.0, -height])
        return MotionSpace(measured=None, unknown=None, ground_plane=plane)

    q = next(row for row in low if limb.planner.stands_free(row, over(-2.0)))
    monkeypatch.setattr(Context, "posture", lambda *_: q)
    heights = np.arange(-2.0, 1.0, 0.005)
    lowest = next(h for h in heights if not limb.planner.stands_free(q, over(h)))
    free = over(lowest - 0.05)
    assert resting._way_off_ground(context, limb, goal, free) is None
    found = resting._way_off_ground(context, limb, goal, over(lowest + deep))
    assert (found is not None) is is_found
    if found is not None:
        np.testing.assert_allclose(found.trajectory.q[-1], goal, atol=1e-3)
        quick = planned(context, limb, goal, over(lowest - 0.05))
        assert found.trajectory.duration > 2.0 * quick.trajectory.duration


def test_at_last_nothing_but_what_was_seen_is_in_the_way(pipeline):
    _, task = before_a_brick(pipeline)
    context = task.context
    look(context)
    limb = context.limbs["right"]
    hand = limb.pose(context.posture(limb)).p
    around = np.random.default_rng(0).normal(size=(4000, 3))
    shell = hand + 0.4 * around / np.linalg.norm(around, axis=1, keepdims=True)
    goal = context.posture(limb)
    goal[0] += 1.2
    context.memory.dropped[:] = [shell]
    for with_guesses in (True, False):
        space = space_of(
            context, unknown=UnknownSpace.IGNORED, with_guesses=with_guesses
        )
        assert limb.planner.stands_free(goal, space) is not with_guesses
    context.memory.settled[:], context.memory.dropped[:] = [shell], []
    space = space_of(context, unknown=UnknownSpace.IGNORED, with_guesses=False)
    assert not limb.planner.stands_free(goal, space)


def test_what_came_into_the_way_since_does_not_trap_an_arm(pipeline):
    _, task = before_a_brick(pipeline)
    context = task.context
    look(context)
    limb = context.limbs["right"]
    q = context.posture(limb)
    away = q.copy()
    away[0] += 0.8
    space = space_of(context, unknown=UnknownSpace.IGNORED)
    way = planned(context, limb, away, space).trajectory
    assert Drive(context, "right").follow(way) is None
    hand = limb.pose(context.posture(limb)).p
    around = np.random.default_rng(0).normal(size=(4000, 3))
    shell = hand + 0.25 * around / np.linalg.norm(around, axis=1, keepdims=True)
    context.memory.settled[:] = [shell]
    seen = space_of(
        context,
        unknown=UnknownSpace.IGNORED,
        stands=(limb.planner, context.posture(limb)),
    )
    assert isinstance(planned(context, limb, q, seen), FaultFound)
    assert to_rest(context, "right") is None
    assert np.abs(context.posture(limb) - q).max() < 0.01


def test_after_a_touch_a_pressed_hand_gives_way_and_goes_back_slowly(
    pipeline, monkeypatch
):
    _, task = before_a_brick(pipeline)
    context = task.context
    limb, drive = context.limbs["right"], Drive(context, "right")
    away = context.posture(limb)
    away[0] += 0.4
    space = space_of(context, unknown=UnknownSpace.IGNORED)
    assert drive.follow(planned(context, limb, away, space).trajectory) is None
    touch = FaultFound("plan_collision", "it touched something", "right")
    paces, eased = [], []

    def follow(*_, pace, **__):
        paces.append(pace)
        return touch

    monkeypatch.setattr(Drive, "follow", follow)
    monkeypatch.setattr(resting, "relieve", lambda _, __, tight: eased.append(tight))
    assert to_rest(context, "right") is touch
    assert to_rest(context, "right") is touch
    assert paces[0] == 1.0
    assert 0.0 < paces[1] <= 0.3
    assert len(eased) == 2
    assert max(eased) < 0.5


def test_what_leans_on_an_arm_does_not_hold_it(pipeline):
    _, task = before_a_brick(pipeline)
    context = task.context
    look(context)
    limbs = context.limbs.values()
    ignored, hidden = UnknownSpace.IGNORED, UnknownSpace.HIDDEN
    free = room_for(context, limbs, unknown=hidden).measured_points
    np.testing.assert_array_equal(
        free, space_of(context, unknown=hidden).measured_points
    )
    grid = np.linspace(-0.1, 0.1, 21)
    plate = np.stack(np.meshgrid(grid, grid, [0.0]), axis=-1).reshape(-1, 3)
    for limb in limbs:
        q = context.posture(limb)
        context.memory.settled[:] = [limb.pose(q).p + plate]
        space = space_of(context, unknown=ignored)
        assert not limb.planner.stands_free(q, space)
        cleared = room_for(context, limbs, unknown=ignored)
        assert limb.planner.stands_free(q, cleared)
        # Elsewhere all of it stays.
        left = cleared.measured_points
        assert len(space.measured_points) - len(plate) <= len(left)
        assert len(left) < len(space.measured_points)


def test_what_was_put_down_is_in_the_way_wherever_the_base_stands(pipeline):
    _, task = before_a_brick(pipeline)
    context = task.context
    look(context)
    limb = context.limbs["right"]
    hand = limb.pose(context.posture(limb)).p
    wall = hand + np.random.default_rng(0).uniform(-0.1, 0.1, (4000, 3))
    T_now_before = SE3.from_parts(so3.from_rpy(np.array([0.0, 0.0, 0.6])), [0.5, 0, 0])
    context.memory.dropped[:] = [T_now_before.inverse().apply(wall)]
    context.stands_elsewhere(T_now_before)
    np.testing.assert_allclose(context.memory.dropped[0], wall, atol=1e-9)
    space = space_of(context, unknown=UnknownSpace.HIDDEN)
    assert not limb.planner.stands_free(context.posture(limb), space)
    assert context.last_seen is None


def test_the_way_to_a_grasp_is_no_way_back_where_the_base_has_moved(
    pipeline, monkeypatch
):
    _, task = before_a_brick(pipeline)
    context = task.context
    limb = context.limbs["right"]
    rest = context.posture(limb).copy()
    away = rest.copy()
    away[0] += 0.3
    space = space_of(context, unknown=UnknownSpace.IGNORED)
    reach = planned(context, limb, away, space)
    assert Drive(context, "right").follow(reach.trajectory) is None
    context.cycle.motion = SimpleNamespace(arm="right", reach=reach)
    context.dragged, asked = SE3.identity(), []
    plain = resting._way_to

    def way_to(*args):
        asked.append(args)
        return plain(*args)

    monkeypatch.setattr(resting, "_way_to", way_to)
    assert to_rest(context, "right") is None
    assert len(asked) == 1


@pytest.mark.parametrize(
    ("reached", "far"), [([], 0.03), ([State.LIFT], 0.12)], ids=["stopped", "carried"]
)
def test_a_hand_that_carried_something_away_is_drawn_out_as_far_as_it_went_in(
    pipeline, monkeypatch, reached, far
):
    """What it put down elsewhere is still around it."""
    _, task = before_a_brick(pipeline)
    context, gone = task.context, []
    limb = context.limbs["right"]
    T, back = gripped_below(context, "right", 0.09), SE3.from_parts(p=[0, 0, -0.12])
    # So far back it would be out where it gripped.
    grasp = context.cycle.motion.grasp
    grasp.T_base_hand = T @ SE3.from_parts(p=[0, 0, 0.09])
    grasp.T_base_pregrasp = grasp.T_base_hand @ back
    context.cycle.reached.extend(reached)

    def straight(_drive, way, *_, **__):
        gone.append(way)
        return LegEnd(LegOutcome.DONE, 1.0, float(np.linalg.norm(way)))

    monkeypatch.setattr(moves, "straight", straight)
    assert moves.back_out(context, "right") is None
    R = limb.pose(context.posture(limb)).R
    np.testing.assert_allclose(gone, [-far * R[:, 2]], atol=1e-3)


@pytest.mark.parametrize(
    ("push", "ways"),
    [
        ((30.0, 0.0, 0.0), [(0.05, 0.0, 0.0)]),
        ((9.0, 0.0, 0.0), []),
        ((np.nan,) * 3, []),
    ],
    ids=["pushed", "free", "no numbers"],
)
def test_a_hand_is_drawn_off_what_it_touched_before_a_way_is_planned(
    pipeline, monkeypatch, push, ways
):
    _, task = before_a_brick(pipeline)
    gone = []
    monkeypatch.setattr(
        resting, "straight", lambda _, way, *__, **___: gone.append(way)
    )
    assert resting._drawn_off(Drive(task.context, "right"), np.array(push)) is None
    np.testing.assert_allclose(gone, np.reshape(ways, (-1, 3)).tolist())


@pytest.mark.parametrize("outcome", [LegOutcome.DONE, LegOutcome.CONTACT])
def test_a_hand_that_rises_into_something_goes_off_it_again(
    pipeline, monkeypatch, outcome
):
    _, task = before_a_brick(pipeline)
    context, gone = task.context, []
    limb, drive = context.limbs["right"], Drive(context, "right")
    down = limb.pose(context.posture(limb)).R.T @ np.array([0.0, 0.0, -41.0])

    def straight(_drive, way, *_, **__):
        gone.append(np.asarray(way))
        drive.load = (*down.tolist(), 0.0, 0.0, 0.0)
        return LegEnd(outcome if len(gone) == 1 else LegOutcome.DONE, 0.5, 0.12)

    monkeypatch.setattr(resting, "straight", straight)
    monkeypatch.setattr(Drive, "weighed", lambda self: self.load)
    assert resting._risen(drive) is None
    ways = [(0.0, 0.0, 0.12), (0.0, 0.0, -0.05)]
    is_met = outcome is LegOutcome.CONTACT
    np.testing.assert_allclose(gone, ways[: 1 + is_met], atol=1e-9)
    assert len(context.memory.felt) == is_met
