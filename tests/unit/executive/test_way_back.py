"""From where something was put down back to rest."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from debrisgrasp.control import GripConfig, GripController
from debrisgrasp.errors import DriverError
from debrisgrasp.executive import carrying as carriage
from debrisgrasp.executive import moves, releasing
from debrisgrasp.executive import recover as recovery
from debrisgrasp.executive.along import Along
from debrisgrasp.executive.choose import _not_in_the_way, _triage
from debrisgrasp.executive.context import Context, Held
from debrisgrasp.executive.drive import Drive
from debrisgrasp.executive.faults import Action
from debrisgrasp.executive.loaded import carrying
from debrisgrasp.executive.moves import planned, to_rest
from debrisgrasp.executive.obstacles import box_around, room_for, space_of
from debrisgrasp.executive.perceive import capture, segment
from debrisgrasp.executive.result import Done, FaultFound
from debrisgrasp.executive.states import State
from debrisgrasp.executive.table import answer_to
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.kinematics import ArmReach
from debrisgrasp.motion import MotionPlanner, MotionSpace, UnknownSpace
from debrisgrasp.pipeline import Pipeline
from tests.unit.executive.test_steps import executive


@pytest.fixture(scope="module")
def pipeline():
    return Pipeline()


def holding():
    grip = GripController(GripConfig(opening=0.1, width=0.05, sides=(-1, 1, 1)))
    state = grip.preshape()
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (50, 3))
    return Held(arm="right", grip=grip, watch=grip, state=state, points_hand=points)


def gripped_below(context, arm, backed):
    """Have a hand stand back from where it gripped by so much; its pose (4, 4)."""
    limb = context.limbs[arm]
    T = limb.pose(context.posture(limb))
    grasp = SimpleNamespace(
        T_base_hand=SE3.from_parts(p=[0.0, 0.0, -backed]) @ T,
        preshape=next(iter(limb.hand.preshapes)),
    )
    context.cycle.motion = SimpleNamespace(arm=arm, grasp=grasp)
    return T


def after_a_look(pipeline):
    _, task = executive(pipeline)
    assert isinstance(capture(task.context), Done)
    assert isinstance(segment(task.context), Done)
    return task.context


def test_what_is_let_go_twice_lies_in_one_place(pipeline, monkeypatch):
    _, task = executive(pipeline)
    context = task.context
    context.state = State.RELEASE
    monkeypatch.setattr(releasing, "_shaken_open", lambda _: None)
    monkeypatch.setattr(releasing, "put_down", lambda *_: None)
    context.held = held = holding()
    for _ in range(2):
        context.cycle.reached.append(State.RELEASE)
        assert isinstance(releasing.release(context), Done)
        context.held = held  # it still hangs in the hand
    assert len(context.dropped) == 1


def test_a_hand_that_was_stopped_on_its_way_back_gives_way_first(pipeline, monkeypatch):
    _, task = executive(pipeline)
    context, eased = task.context, []
    context.is_in_pile = "right"
    monkeypatch.setattr(recovery, "relieve", lambda _, arm: eased.append(arm))
    event = task._event(State.RETREAT, FaultFound("plan_collision", ""), Action.RETRY)
    recovery.recover(context, event, answer_to(State.RETREAT, "plan_collision"))
    assert eased == ["right"]


def test_a_hand_that_was_cleared_up_is_not_drawn_back_once_more(pipeline, monkeypatch):
    _, task = executive(pipeline)
    context, drawn = task.context, []
    context.cycle.motion = SimpleNamespace(arm="right")
    monkeypatch.setattr(releasing, "back_out", lambda _, arm: drawn.append(arm))
    monkeypatch.setattr(releasing, "to_rest", lambda *_: None)
    for is_in_pile, expected in (("right", ["right"]), (None, ["right"])):
        context.is_in_pile = is_in_pile
        assert isinstance(releasing.retreat(context), Done)
        assert drawn == expected


def test_an_arm_remembers_its_way_until_it_is_back_at_rest(pipeline):
    _, task = executive(pipeline)
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


def test_at_last_nothing_but_what_was_seen_is_in_the_way(pipeline):
    context = after_a_look(pipeline)
    limb = context.limbs["right"]
    hand = limb.pose(context.posture(limb)).p
    around = np.random.default_rng(0).normal(size=(4000, 3))
    shell = hand + 0.4 * around / np.linalg.norm(around, axis=1, keepdims=True)
    goal = context.posture(limb)
    goal[0] += 1.2
    context.dropped[:] = [shell]
    for with_guesses in (True, False):
        space = space_of(
            context, unknown=UnknownSpace.IGNORED, with_guesses=with_guesses
        )
        assert limb.planner.stands_free(goal, space) is not with_guesses
    context.lain[:], context.dropped[:] = [shell], []
    space = space_of(context, unknown=UnknownSpace.IGNORED, with_guesses=False)
    assert not limb.planner.stands_free(goal, space)


@pytest.mark.parametrize(
    ("is_highest", "fault", "action"),
    [(True, "unreachable", Action.NEXT), (False, "plan_collision", Action.RETRY)],
)
def test_what_finds_no_way_is_lifted_again_only_if_that_can_be(
    pipeline, monkeypatch, is_highest, fault, action
):
    _, task = executive(pipeline)
    context = task.context
    context.held = holding()
    nowhere = FaultFound("plan_collision", "no way was found", "right")
    monkeypatch.setattr(carriage, "_way", lambda *_: nowhere)
    monkeypatch.setattr(carriage, "_bare_way", lambda *_: nowhere)
    monkeypatch.setattr(carriage, "is_folded", lambda *_: is_highest)
    monkeypatch.setattr(carriage, "free_share", lambda *_: 0.1)
    found = carriage.transport(context)
    assert isinstance(found, FaultFound)
    assert found.fault == fault
    answer = answer_to(State.TRANSPORT, fault)
    assert answer.action is action
    assert answer.is_cleared_up is is_highest


def test_what_came_into_the_way_since_does_not_trap_an_arm(pipeline):
    context = after_a_look(pipeline)
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
    context.lain[:] = [shell]
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
    _, task = executive(pipeline)
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
    monkeypatch.setattr(moves, "relieve", lambda _, __, tight: eased.append(tight))
    assert to_rest(context, "right") is touch
    assert to_rest(context, "right") is touch
    assert paces[0] == 1.0
    assert 0.0 < paces[1] <= 0.3
    assert len(eased) == 2
    assert max(eased) < 0.5


def test_what_leans_on_an_arm_does_not_hold_it(pipeline):
    context = after_a_look(pipeline)
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
        context.lain[:] = [limb.pose(q).p + plate]
        space = space_of(context, unknown=ignored)
        assert not limb.planner.stands_free(q, space)
        cleared = room_for(context, limbs, unknown=ignored)
        assert limb.planner.stands_free(q, cleared)
        # Elsewhere all of it stays.
        left = cleared.measured_points
        assert len(space.measured_points) - len(plate) <= len(left)
        assert len(left) < len(space.measured_points)


@pytest.mark.parametrize("arm", ["right", "left"])
def test_what_is_held_is_a_part_of_the_arm_as_if_its_file_had_it(pipeline, arm):
    _, task = executive(pipeline)
    context, model = task.context, pipeline.robot
    limb, rng = context.limbs[arm], np.random.default_rng(0)
    points = rng.uniform(-1.0, 1.0, (60, 3)) * [0.3, 0.05, 0.1] + [0.0, 0.0, 0.05]
    context.held = replace(holding(), arm=arm, points_hand=points)
    tip, shapes = model.arm(arm).tip, dict(model.tree.shapes)
    shapes[tip] = (*shapes[tip], box_around(points))
    loaded = replace(model, tree=replace(model.tree, shapes=shapes))
    oracle = MotionPlanner.of_arm(ArmReach(loaded, arm), limits=limb.limits.planner)
    q = limb.reach.chain.sampled(200, rng=rng)
    space = MotionSpace.from_points(
        rng.uniform(-1.0, 1.0, (5, 3)), ground_plane=np.array([0.0, 0.0, 1.0, 0.0])
    )
    found = carrying(context, limb).exact_test(space).is_free(q)
    np.testing.assert_array_equal(found, oracle.exact_test(space).is_free(q))
    assert 0 < found.sum() < limb.planner.exact_test(space).is_free(q).sum()


def test_the_box_around_something_as_wide_as_high_is_about_its_size(rng):
    size = np.array([0.5, 0.45, 0.45])
    points = rng.uniform(-0.5, 0.5, (1500, 3))
    side = rng.integers(3, size=1500)
    points[np.arange(1500), side] = rng.choice([-0.5, 0.5], 1500)
    points = points[(points[:, 2] > -0.1) | (points[:, 0] < -0.4)]  # half of it seen
    turned = so3.from_rpy(np.array([0.4, -0.8, 1.1]))
    seen = (points * size) @ turned.T + [1.0, -2.0, 0.5]
    box = box_around(seen)
    inside = box.T_link_shape.inverse().apply(seen)
    assert (np.abs(inside) <= 0.5 * np.array(box.size) + 1e-9).all()
    assert np.prod(box.size) < 1.1 * np.prod(np.ptp(points * size, axis=0))
    assert np.linalg.det(box.T_link_shape.R) == pytest.approx(1.0)


@pytest.mark.parametrize("n", [1, 2])
def test_the_box_around_a_few_points_holds_them(n, rng):
    points = rng.uniform(-0.5, 0.5, (n, 3))
    box = box_around(points)
    inside = box.T_link_shape.inverse().apply(points)
    assert (np.abs(inside) <= 0.5 * np.array(box.size) + 1e-9).all()


def hang(context, limb, weight, monkeypatch):
    """Let the sensor of a limb feel a weight on its hand that nothing lifts, [N]."""
    sensor, loads = limb.limb.sensor, limb.loads
    read = type(sensor).read

    def loaded(self):
        felt = read(self)
        if self is not sensor:
            return felt
        R, _ = limb.kinematics.pose(context.posture(limb).tolist())
        none = np.array(loads.load_ee([0.0] * 6, R))
        of_raw = np.column_stack([loads.load_ee(e, R) for e in np.eye(6).tolist()])
        down = -weight * np.reshape(R, (3, 3))[2]
        added = np.linalg.solve(of_raw - none[:, None], [*down, 0.0, 0.0, 0.0])
        return felt._replace(wrench_ft=np.asarray(felt.wrench_ft) + added)

    monkeypatch.setattr(type(sensor), "read", loaded)


@pytest.mark.parametrize(("share", "goes"), [(0.5, True), (1.0, True), (1.5, False)])
def test_what_hangs_near_the_limit_of_a_motion_is_still_put_down(
    pipeline, monkeypatch, share, goes
):
    """Above what the hand bears it is let go where it hangs."""
    _, task = executive(pipeline)
    context, limb = task.context, task.context.limbs["right"]
    context.state = State.RECOVER
    drive = Drive(context, "right")
    hang(context, limb, share * drive.limits.force, monkeypatch)
    height = limb.pose(context.posture(limb)).p[2]
    limb.limb.arm.engage()
    assert moves.lower(drive, 0.05) is None
    lowered = height - limb.pose(context.posture(limb)).p[2]
    assert lowered == pytest.approx(0.05 if goes else 0.0, abs=2e-3)
    assert not limb.limb.arm.is_stopped


@pytest.mark.parametrize(
    ("backed", "expected"),
    [(0.12, ["lower", "loosen", "back_out"]), (0.0, ["loosen"])],
)
def test_what_hangs_in_an_opened_hand_is_lowered_before_that_opens_wider(
    pipeline, monkeypatch, backed, expected
):
    _, task = executive(pipeline)
    context, done = task.context, []
    gripped_below(context, "right", backed)

    def hangs(drive, _seconds):
        drive.load = (0.0, 0.0, 50.0, 0.0, 0.0, 0.0)
        return []

    monkeypatch.setattr(Drive, "stand", hangs)
    monkeypatch.setattr(recovery, "free_share", lambda *_: 1.0)
    for name in ("lower", "loosen", "back_out"):
        monkeypatch.setattr(recovery, name, lambda *_, name=name: done.append(name))
    found = recovery._hanging(context, "right")
    assert found.fault == "not_released"
    assert done == expected


def test_what_was_put_down_is_in_the_way_wherever_the_base_stands(pipeline):
    context = after_a_look(pipeline)
    limb = context.limbs["right"]
    hand = limb.pose(context.posture(limb)).p
    wall = hand + np.random.default_rng(0).uniform(-0.1, 0.1, (4000, 3))
    T_now_before = SE3.from_parts(so3.from_rpy(np.array([0.0, 0.0, 0.6])), [0.5, 0, 0])
    context.dropped[:] = [T_now_before.inverse().apply(wall)]
    context.stands_elsewhere(T_now_before)
    np.testing.assert_allclose(context.dropped[0], wall, atol=1e-9)
    space = space_of(context, unknown=UnknownSpace.HIDDEN)
    assert not limb.planner.stands_free(context.posture(limb), space)
    assert context.last_seen is None
    assert context.known.is_new


def test_an_arm_that_met_something_is_away_before_the_trunk_turns(
    pipeline, monkeypatch
):
    _, task = executive(pipeline)
    context, order = task.context, []
    context.cycle.motion = SimpleNamespace(arm="left")
    monkeypatch.setattr(recovery, "relieve", lambda *_: None)
    monkeypatch.setattr(recovery, "to_rest", lambda _, arm: order.append(arm))
    assert recovery.clear_up(context) is None
    assert order == ["left", "right"]


def test_a_push_on_the_other_arm_ends_a_motion_of_the_trunk(pipeline, monkeypatch):
    _, task = executive(pipeline)
    context = task.context
    limb, drive = context.limbs["right"], Drive(context, "right")
    away = context.posture(limb).copy()
    away[0] += 0.8
    space = space_of(context, unknown=UnknownSpace.IGNORED)
    trajectory = planned(context, limb, away, space).trajectory
    for each in context.limbs.values():
        each.baseline_time = 1.0
    loads = iter([0.0, 20.0, 30.0, 61.0, np.nan, 61.0, 61.0, 500.0])

    def bears(_):
        force = next(loads)
        return force, force / 10.0

    monkeypatch.setattr(Along, "_bears", bears)
    fault = drive.follow(trajectory)
    assert (fault.fault, fault.arm) == ("plan_collision", "left")
    assert next(loads) == 500.0


@pytest.mark.parametrize(
    ("force", "torque", "fault"),
    [
        (44.0, 1.0, None),
        (130.0, 1.0, "plan_collision"),
        (10.0, 13.0, "plan_collision"),
        (np.nan, np.nan, "wrench_nan"),
    ],
)
def test_an_arm_that_is_taken_along_is_watched_within_its_limits(
    pipeline, monkeypatch, force, torque, fault
):
    _, task = executive(pipeline)
    drive = Drive(task.context, "left")
    begun = 0.0 if force < 100.0 else 125.0  # what it bears already allows no more
    monkeypatch.setattr(Along, "_bears", lambda _: (begun, 0.0))
    along = Along(drive)
    monkeypatch.setattr(Along, "_bears", lambda _: (force, torque))
    found = [each.fault for each in (along.met() for _ in range(12)) if each]
    assert set(found) == ({fault} if fault else set())


def test_a_camera_that_fails_keeps_no_arm_from_going_to_rest(pipeline, monkeypatch):
    _, task = executive(pipeline)
    context, order = task.context, []
    context.held = replace(holding(), is_lifted=True)
    context.cycle.motion = SimpleNamespace(arm="right")

    def fails(*_):
        raise DriverError("camera", "no answer")

    monkeypatch.setattr(recovery, "relieve", lambda *_: None)
    monkeypatch.setattr(recovery, "put_down", lambda *_: None)
    monkeypatch.setattr(recovery, "back_out", lambda *_: None)
    monkeypatch.setattr(recovery, "_hanging", lambda *_: None)
    monkeypatch.setattr(recovery, "_remember", lambda *_: True)
    monkeypatch.setattr(recovery, "looked_after", fails)
    monkeypatch.setattr(recovery, "to_rest", lambda _, arm: order.append(arm))
    assert recovery.clear_up(context) is None
    assert order == ["right", "left"]


def test_the_way_to_a_grasp_is_no_way_back_where_the_base_has_moved(
    pipeline, monkeypatch
):
    _, task = executive(pipeline)
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
    plain = moves._way_to

    def way_to(*args):
        asked.append(args)
        return plain(*args)

    monkeypatch.setattr(moves, "_way_to", way_to)
    assert to_rest(context, "right") is None
    assert len(asked) == 1


@pytest.mark.parametrize(("share", "is_in_way"), [(0.45, True), (0.15, False)])
def test_what_lies_across_the_border_of_the_workspace_is_in_the_way(
    pipeline, monkeypatch, share, is_in_way
):
    context = after_a_look(pipeline)
    seen = context.cycle.seen
    segment = seen.segmentation.segment(1)
    points = seen.cloud.points[seen.segmentation.points_of(1)]
    border = float(np.quantile(points[:, 0], share))
    assert segment.centroid[0] > border
    monkeypatch.setattr(Context, "is_in_way", lambda _, p: p[..., 0] < border)
    triage = _triage(context, seen, segment)
    reason = _not_in_the_way(context, seen, points, triage)
    assert (reason != "outside the workspace") is is_in_way
