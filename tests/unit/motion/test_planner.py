from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, InputError, ShapeError
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import ArmReach, RobotModel
from debrisgrasp.kinematics.packages import package_folders
from debrisgrasp.motion import (
    MotionConfig,
    MotionPlanner,
    MotionSpace,
    MotionStatus,
    UnknownSpace,
    samples_of,
)

from .conftest import GROUND
from .test_contact import looking_down

EXAMPLES = Path(__file__).parents[3] / "examples"


def plan(planner, start, goal, space, seed=0, **more):
    return planner.plan(start, goal, space, rng=np.random.default_rng(seed), **more)


def require_free(planner, found, space):
    assert found.is_solved, found.reason
    assert repr(found).startswith("<MotionPlan solved: <Trajectory of 8 joints: ")
    found.trajectory.require_executable(planner.limits)
    q = samples_of(found.trajectory, 0.01)
    assert np.abs(np.diff(q, axis=0)).max() <= 0.01 + 1e-9
    assert planner.exact_test(space).is_free(q).all()


@pytest.mark.parametrize("step", [0, -0.1, np.nan, np.inf, "small"])
def test_a_step_that_is_none_samples_nothing(arm, planner, empty, step):
    """A step below zero gave the two ends alone."""
    found = plan(planner, arm.q_present, arm.q_present + 0.02, empty)
    with pytest.raises(ConfigError, match="step of samples"):
        samples_of(found.trajectory, step)


def test_in_the_open_the_way_is_straight(arm, planner, empty, q_goal):
    found = plan(planner, arm.q_present, q_goal, empty)
    require_free(planner, found, empty)
    assert len(found.path) == 2
    assert found.counts.rounds == 0
    np.testing.assert_allclose(found.trajectory.q[-1], q_goal, atol=1e-6)


def test_a_goal_is_sought_at_turns_within_the_limits_of_the_planner(arm, empty):
    limits = arm.robot.limits("left", arm.chain).planner
    full = 2.0 * np.pi
    chain = replace(
        arm.chain,
        lower=np.append(arm.chain.lower[:-1], -full),
        upper=np.append(arm.chain.upper[:-1], full),
    )
    inner = replace(
        limits,
        lower=np.append(limits.lower[:-1], 0.02 - full),
        upper=np.append(limits.upper[:-1], full - 0.02),
    )
    body = replace(arm.collision.body, chain=chain)
    planner = MotionPlanner(replace(arm.collision, body=body), inner)
    goal = np.append(arm.q_present[:-1], 0.0)
    for turn in (3.0, 3.3, 5.0, -3.5):
        found = plan(planner, np.append(goal[:-1], turn), goal, empty)
        require_free(planner, found, empty)
        assert found.trajectory.q[-1, -1] == pytest.approx(0.0, abs=1e-6)


def test_goes_around_what_is_in_the_way(arm, planner, pillar, q_goal):
    direct = arm.q_present + np.linspace(0, 1, 101)[:, None] * (q_goal - arm.q_present)
    assert not planner.exact_test(pillar).is_free(direct).all()
    for seed in range(3):
        found = plan(planner, arm.q_present, q_goal, pillar, seed)
        require_free(planner, found, pillar)
        assert found.counts.rounds > 0


def test_the_way_that_was_gone_leads_back_without_a_search(
    arm, planner, pillar, q_goal
):
    gone = plan(planner, arm.q_present, q_goal, pillar)
    known = samples_of(gone.trajectory, 0.2)
    back = plan(planner, q_goal, arm.q_present, pillar, known=known)
    require_free(planner, back, pillar)
    assert back.counts.rounds == 0


def test_a_known_way_that_is_blocked_now_is_gone_around(arm, planner, pillar, q_goal):
    known = arm.q_present + np.linspace(0, 1, 9)[:, None] * (q_goal - arm.q_present)
    found = plan(planner, arm.q_present, q_goal, pillar, known=known)
    require_free(planner, found, pillar)
    assert found.counts.rounds > 0
    with pytest.raises(InputError, match="known postures"):
        plan(planner, arm.q_present, q_goal, pillar, known=known * np.nan)


def test_known_postures_that_are_none_or_outside_the_limits_do_no_harm(
    arm, planner, pillar, q_goal
):
    alone = plan(planner, arm.q_present, q_goal, pillar)
    for known in ([], np.zeros((0, len(q_goal))), np.full((3, len(q_goal)), 50.0)):
        found = plan(planner, arm.q_present, q_goal, pillar, known=known)
        assert (found.trajectory.q == alone.trajectory.q).all()


def test_reaches_a_pose_of_the_hand(arm, planner, pillar):
    goal = SE3.from_parts(p=[0.0, 0.0, 0.1]) @ arm.chain.fk(arm.q_present)
    found = plan(planner, arm.q_present, goal, pillar)
    require_free(planner, found, pillar)
    reached = arm.chain.fk(found.trajectory.q[-1])
    np.testing.assert_allclose(reached.p, goal.p, atol=1e-3)


def test_same_seed_same_motion(arm, planner, pillar, q_goal):
    one, other = (plan(planner, arm.q_present, q_goal, pillar, 4) for _ in "ab")
    np.testing.assert_array_equal(one.trajectory.q, other.trajectory.q)
    np.testing.assert_array_equal(one.trajectory.times, other.trajectory.times)
    assert one.counts == other.counts


def test_a_start_in_contact_says_which_link_touches_what(arm, planner, q_goal):
    palm = arm.chain.fk(arm.q_present).p
    space = MotionSpace.from_points(palm[None], ground_plane=GROUND)
    found = plan(planner, arm.q_present, q_goal, space)
    assert found.status is MotionStatus.START_IN_COLLISION
    assert not planner.stands_free(arm.q_present, space)
    assert found.is_infeasible
    assert "right_robotiq_palm_link touches a measured surface" in found.reason
    assert {c.what for c in found.contacts} == {"a measured surface"}


def test_a_goal_in_contact_says_so(arm, planner, q_goal):
    space = MotionSpace.from_points(arm.chain.fk(q_goal).p[None], ground_plane=GROUND)
    for goal in (q_goal, arm.chain.fk(q_goal)):
        found = plan(planner, arm.q_present, goal, space)
        assert found.status is MotionStatus.GOAL_IN_COLLISION
        assert "robotiq" in found.reason
        assert found.counts.goals >= 1
        assert found.counts.free_goals == 0


def test_a_goal_out_of_reach_is_known_for_certain(arm, planner, empty):
    found = plan(planner, arm.q_present, SE3.from_parts(p=[3.0, 0, 1]), empty)
    assert found.status is MotionStatus.NO_GOAL_POSTURE
    assert found.is_infeasible
    assert "for certain" in found.reason


def test_a_cage_exhausts_the_budget_with_numbers(arm, q_goal):
    palm = arm.chain.fk(arm.q_present).p
    away = np.random.default_rng(0).normal(size=(6000, 3))
    shell = palm + 0.32 * away / np.linalg.norm(away, axis=1, keepdims=True)
    behind = arm.chain.fk(arm.q_present).R[:, 2] @ (shell - palm).T < -0.1
    space = MotionSpace.from_points(shell[~behind], ground_plane=GROUND)
    config = MotionConfig(attempts=1)
    planner = MotionPlanner.of_arm(arm, config=config)
    found = plan(planner, arm.q_present, q_goal, space, max_rounds=1)
    assert found.counts.rounds <= 1
    assert found.status in (MotionStatus.BUDGET, MotionStatus.START_IN_COLLISION)
    if found.status is MotionStatus.BUDGET:
        assert "rounds" in found.reason
        assert not found.is_infeasible


def test_a_deadline_ends_the_search(arm, planner, pillar, q_goal):
    found = plan(planner, arm.q_present, q_goal, pillar, deadline=1e-9)
    assert found.status is MotionStatus.BUDGET
    assert "deadline" in found.reason


def test_progress_names_the_stages(arm, planner, empty, q_goal):
    told = []
    plan(planner, arm.q_present, q_goal, empty, progress=lambda *a: told.append(a))
    assert [name for name, share in told if share == 1.0] == [
        "start",
        "goal",
        "path",
        "time",
    ]


def test_unknown_space_is_free_only_where_the_arm_starts(arm, planner, q_goal):
    cloud, sight = looking_down()
    seen = MotionSpace.build(cloud, sight, GROUND, unknown=UnknownSpace.ALL)
    for place, status in (
        (arm.q_present, MotionStatus.SOLVED),
        (q_goal, MotionStatus.GOAL_IN_COLLISION),
    ):
        # One unknown cell on the palm, at the start or at the goal.
        cell = MotionSpace.from_points(arm.chain.fk(place).p[None]).measured
        space = replace(seen, measured=cell, unknown=cell)
        hidden = replace(space, measured=far_from(cell))
        found = plan(planner, arm.q_present, q_goal, hidden)
        assert found.status is status, found.reason
        assert planner.stands_free(arm.q_present, hidden)
    assert "unknown space" in found.reason


def far_from(field):
    """The same grid with its points out of everything's way."""
    away = field.table.copy()
    away[:, :3] = 50.0
    return replace(field, table=away)


@pytest.mark.parametrize(
    ("start", "error", "words"),
    [
        (np.full(8, np.nan), InputError, "start posture"),
        (np.zeros(7), ShapeError, r"\(7,\)"),
        (np.zeros((1, 8)), ShapeError, r"\(1, 8\)"),
        (np.full(8, 3.3), InputError, "within the planner's limits"),
        ("ready", ShapeError, "start posture"),
    ],
)
def test_a_start_that_is_none_is_refused(planner, empty, q_goal, start, error, words):
    with pytest.raises(error, match=words):
        plan(planner, start, q_goal, empty)


@pytest.mark.parametrize(
    ("goal", "error"),
    [
        (np.full(8, np.inf), InputError),
        (np.zeros((2, 5)), ShapeError),
        (np.zeros((0, 8)), ShapeError),
        ("home", ShapeError),
        (np.full(8, 4.0), InputError),
        (SE3(np.tile(np.eye(4), (2, 1, 1))), ShapeError),
    ],
)
def test_a_goal_that_is_none_is_refused(arm, planner, empty, goal, error):
    with pytest.raises(error, match="goal"):
        plan(planner, arm.q_present, goal, empty)


@pytest.mark.parametrize("deadline", [0.0, -1.0, float("nan")])
def test_a_deadline_is_a_positive_time(arm, planner, empty, q_goal, deadline):
    with pytest.raises(ConfigError, match="deadline"):
        plan(planner, arm.q_present, q_goal, empty, deadline=deadline)


def test_limits_of_another_arm_are_refused(arm):
    with pytest.raises(ConfigError, match="joints of the limits"):
        MotionPlanner.of_arm(arm, limits=arm.robot.limits("left").planner)


def test_settings_out_of_range_are_refused():
    with pytest.raises(ConfigError, match="exact_step"):
        MotionConfig(exact_step=0.0)
    with pytest.raises(ConfigError, match=r"MotionConfig\.step"):
        MotionConfig(step=0.001)


@pytest.mark.parametrize("name", ["panda", "ur10"])
def test_an_arm_whose_links_pass_closely_finds_its_way(name, empty):
    robots = [f / "example-robot-data/robots" for f in package_folders()]
    if not any(folder.is_dir() for folder in robots):
        pytest.skip("example-robot-data is not installed")
    robot = RobotModel.load(EXAMPLES / f"robots/{name}.yaml")
    arm = ArmReach(robot, "arm")
    planner = MotionPlanner.of_arm(arm)
    goal = SE3.from_parts(p=[0.0, 0.05, 0.05]) @ arm.chain.fk(arm.q_present)
    require_free(planner, plan(planner, arm.q_present, goal, empty), empty)


def test_a_planner_tells_of_its_arm(arm, planner):
    assert repr(planner) == f"<MotionPlanner of {arm.chain}>"


def test_limits_are_one_set_of_a_family(arm):
    family = arm.robot.limits(arm.name, arm.chain)
    for make in (
        lambda: MotionPlanner(arm.collision, family),
        lambda: MotionPlanner.of_arm(arm, limits=family),
    ):
        with pytest.raises(InputError, match=r"limits: got LimitFamily.*\.planner"):
            make()
