"""An arm with something in its hand, on its way to the drop-off."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from debrisgrasp.control import Body, FingerReading, GripPhase
from debrisgrasp.executive import carrying as carriage
from debrisgrasp.executive.drive import Drive
from debrisgrasp.executive.faults import Action
from debrisgrasp.executive.loaded import carrying
from debrisgrasp.executive.obstacles import box_around
from debrisgrasp.executive.result import Done, FaultFound
from debrisgrasp.executive.states import State
from debrisgrasp.executive.table import answer_to
from debrisgrasp.executive.tries import remember
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.kinematics import ArmReach
from debrisgrasp.motion import MotionPlanner, MotionSpace
from tests.unit.executive.rigs import POINTS, before_a_brick, holding


@pytest.mark.parametrize("arm", ["right", "left"])
def test_what_is_held_is_a_part_of_the_arm_as_if_its_file_had_it(pipeline, arm):
    _, task = before_a_brick(pipeline)
    context, model = task.context, pipeline.robot
    limb, rng = context.limbs[arm], np.random.default_rng(0)
    points = rng.uniform(-1.0, 1.0, (60, 3)) * [0.3, 0.05, 0.1] + [0.0, 0.0, 0.05]
    context.held = holding(arm=arm, points_hand=points)
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


@pytest.mark.parametrize(
    ("is_highest", "fault", "action"),
    [(True, "unreachable", Action.NEXT), (False, "plan_collision", Action.RETRY)],
)
def test_what_finds_no_way_is_lifted_again_only_if_that_can_be(
    pipeline, monkeypatch, is_highest, fault, action
):
    _, task = before_a_brick(pipeline)
    context = task.context
    context.held = holding(points_hand=POINTS)
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


@pytest.mark.parametrize(
    ("looks_up", "met", "expected"),
    [
        (False, None, (None, 0)),
        (True, None, (None, 1)),
        (True, "plan_collision", (None, 1)),
        (True, "wrench_frozen", ("wrench_frozen", 1)),
    ],
)
def test_what_lies_on_a_palm_is_taken_back_before_it_is_let_go(
    pipeline, monkeypatch, looks_up, met, expected
):
    _, task = before_a_brick(pipeline)
    context, limb, ways = task.context, task.context.limbs["right"], []
    context.held = holding(arm="right", points_hand=POINTS, is_lifted=True)
    q_hung = context.posture(limb) + 0.2
    context.cycle.hung = q_hung
    palm = so3.exp(np.array([0.0 if looks_up else np.pi, 0.0, 0.0]))
    monkeypatch.setattr(limb, "pose", lambda _: SE3.from_parts(palm, [0.5, -0.5, 1.0]))

    def planned(_, __, goal, *___, **____):
        np.testing.assert_array_equal(goal, q_hung)
        return SimpleNamespace(trajectory="back")

    def follow(_, trajectory, **__):
        ways.append(trajectory)
        return None if met is None else FaultFound(met, "as asked")

    monkeypatch.setattr(carriage, "planned", planned)
    monkeypatch.setattr(Drive, "follow", follow)
    found = carriage.taken_back(context)
    assert ((found and found.fault), len(ways)) == expected


@pytest.mark.parametrize(("beyond", "is_planned"), [(0.02, True), (0.2, False)])
def test_it_is_taken_back_to_where_a_leg_led_a_joint_beyond_what_plans_use(
    pipeline, monkeypatch, beyond, is_planned
):
    """Legs may use the last bit of a joint's range; a plan ends just before it."""
    _, task = before_a_brick(pipeline)
    context, limb, goals = task.context, task.context.limbs["right"], []
    context.held = holding(arm="right", points_hand=POINTS, is_lifted=True)
    limits = limb.limits.planner
    context.cycle.hung = context.posture(limb)
    context.cycle.hung[4] = limits.upper[4] + beyond
    monkeypatch.setattr(limb, "pose", lambda _: SE3.from_parts(p=[0.5, -0.5, 1.0]))
    nowhere = FaultFound("plan_collision", "as asked")

    def planned(_, __, goal, *___, **____):
        goals.append(goal)
        return nowhere

    monkeypatch.setattr(carriage, "planned", planned)
    assert carriage.taken_back(context) is None
    assert len(goals) == is_planned
    assert all(not limits.violation(goal) for goal in goals)


@pytest.mark.parametrize(
    ("is_lifted", "is_planned", "state", "force"),
    [
        (True, True, State.RECOVER, 30.0),
        (True, False, State.RECOVER, None),
        (True, False, State.TRANSPORT, 30.0),
        (False, True, State.PREGRASP, None),
    ],
)
def test_what_is_carried_on_a_planned_way_should_touch_nothing(
    pipeline, is_lifted, is_planned, state, force
):
    _, task = before_a_brick(pipeline)
    task.context.state = state
    task.context.held = holding(is_lifted=is_lifted)
    drive = Drive(task.context, "right")
    supervisor, _ = drive.supervised(is_planned=is_planned)
    assert supervisor.config.motion_force == force


def test_fingers_that_closed_during_the_lift_have_lost_nothing_by_that(
    pipeline, monkeypatch
):
    """They curl around what they lift; weight that goes later is borne by something."""
    _, task = before_a_brick(pipeline)
    context, weighed = task.context, Body(2.5)
    held = context.held = holding(points_hand=POINTS, is_lifted=True)
    before, now = (0.06,) * 3, (0.05,) * 3
    held.state = held.state._replace(
        phase=GripPhase.HOLDING, held_openings=before, most_carried=30.0
    )
    monkeypatch.setattr(carriage, "looked_at", lambda *_: 0)
    monkeypatch.setattr(carriage, "identify_payload", lambda *_, **__: (weighed, 0.0))
    monkeypatch.setattr(
        Drive, "fingers", lambda _: FingerReading(now, (40.0, 20.0, 20.0))
    )
    context.state = State.VERIFY_HOLD
    assert isinstance(carriage.verify_hold(context), Done)
    context.state = State.TRANSPORT
    drive = Drive(context, held.arm)
    monkeypatch.setattr(drive, "carried", lambda _load: 10.0)
    found = [drive._watched_fingers((0.0,) * 6) for _ in range(60)]
    assert {f.fault for f in found if f is not None} == {"plan_collision"}


def test_what_hangs_too_far_beside_the_hand_is_not_carried(pipeline, monkeypatch):
    """The next grasp is sought by its mass, elsewhere; after two it is too heavy."""
    _, task = before_a_brick(pipeline)
    context, weighed = task.context, Body(2.5)
    context.state = State.VERIFY_HOLD
    context.cycle.centroid = (1.3, 0.0, 0.03)
    context.cycle.motion = SimpleNamespace(grasp="grasp")
    context.held = holding(points_hand=POINTS, is_lifted=True)
    most = context.limbs["right"].limits.controller.torque
    monkeypatch.setattr(carriage, "looked_at", lambda *_: 0)
    monkeypatch.setattr(carriage, "identify_payload", lambda *_, **__: (weighed, 0.0))
    for share, n in ((0.35, 0), (0.45, 1), (0.45, 2)):
        load = (0.0, 0.0, -25.0, share * most, 0.0, 0.0)
        monkeypatch.setattr(Drive, "mean_load", lambda *_, load=load: load)
        found = carriage.verify_hold(context)
        if not n:
            assert isinstance(found, Done)
            continue
        assert found.fault == "too_heavy"
        assert "2.5 kg hang beside the hand" in found.message
        remember(context, State.VERIFY_HOLD, found)
        mark = context.marks.of(context.cycle.centroid)
        assert mark.mass == 2.5
        assert mark.failed == ["grasp"]
        assert mark.is_heavy == (n == 2)
