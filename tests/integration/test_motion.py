"""From a capture to a motion: the facade and the command line."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import debrisgrasp
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.geometry import SE3
from debrisgrasp.io import Capture, data_path
from debrisgrasp.io.motion_json import load_motion
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.motion import MotionPlanner, MotionSpace, MotionStatus, UnknownSpace
from debrisgrasp.pipeline import (
    GraspMotions,
    MotionsConfig,
    first_executable,
    grasp_chain,
    motion_space,
    recall_plan,
)

GROUND = np.array([0.0, 0.0, 1.0, 0.0])


@pytest.fixture(scope="module")
def result():
    capture = Capture.load(data_path("captures", "pile.npz"))
    return debrisgrasp.plan(capture, arm="right")


def test_the_whole_chain_hangs_together_and_keeps_the_limits(result):
    found = debrisgrasp.plan_motion(result)
    chosen = found.chosen
    assert chosen is not None, found.why_none
    assert [index for index, _ in found.passed_over] == list(range(chosen.index))
    assert all(reason for _, reason in found.passed_over)
    robot = result.robot
    limits, chain = robot.limits(chosen.arm).planner, robot.chain(chosen.arm)
    here = chain.vector(robot.posture(chosen.arm, robot.arm(chosen.arm).present))
    for motion in chosen.trajectories.values():
        motion.require_executable(limits)
        np.testing.assert_allclose(motion.q[0], here, atol=1e-6)
        here = motion.q[-1]
    grasp = chosen.grasp
    reached = [chain.fk(m.q[-1]) for m in chosen.trajectories.values()]
    lift = np.array([0.0, 0.0, 0.15])
    goals = [grasp.T_base_pregrasp.p, grasp.T_base_hand.p, grasp.T_base_hand.p + lift]
    for pose, goal in zip(reached, goals, strict=True):
        np.testing.assert_allclose(pose.p, goal, atol=2e-3)


def test_where_short_searches_fail_one_serves_all_grasps(result, monkeypatch):
    asked, plan = [], MotionPlanner.plan

    def stingy(self, q_start, goal, space, *, max_rounds=None, **more):
        asked.append((len(goal), max_rounds))
        if max_rounds == grasp_chain._SHORT:
            point = self.chain.fk(q_start).p[None]
            space = MotionSpace.from_points(point, ground_plane=GROUND)
        return plan(self, q_start, goal, space, max_rounds=max_rounds, **more)

    monkeypatch.setattr(MotionPlanner, "plan", stingy)
    best = replace(result, plan=replace(result.plan, grasps=result.plan.grasps[:4]))
    found = debrisgrasp.plan_motion(best)
    chosen = found.chosen
    assert chosen is not None, found.why_none
    over = [index for index, _ in found.passed_over]
    assert sorted([*over, chosen.index]) == list(range(4))
    assert all(reason for _, reason in found.passed_over)
    grasp = result.plan.grasps[chosen.index]
    np.testing.assert_array_equal(chosen.grasp.T_base_hand.p, grasp.T_base_hand.p)
    np.testing.assert_allclose(
        chosen.reach.trajectory.q[-1], chosen.approach.trajectory.q[0], atol=1e-9
    )
    n_goals, rounds = asked[-1]
    assert n_goals > 1
    assert rounds > grasp_chain._SHORT


def test_the_long_search_has_no_more_time_than_is_left(result, monkeypatch):
    given, plan = [], MotionPlanner.plan

    def stingy(self, *places, max_rounds=None, deadline=None, **more):
        if max_rounds != grasp_chain._SHORT:
            given.append(deadline)
        failed = plan(self, *places, max_rounds=1, deadline=1e-6, **more)
        return replace(failed, status=MotionStatus.BUDGET, trajectory=None, path=None)

    monkeypatch.setattr(MotionPlanner, "plan", stingy)
    best = replace(result, plan=replace(result.plan, grasps=result.plan.grasps[:2]))
    assert debrisgrasp.plan_motion(best).chosen is None
    assert set(given) == {None}
    given.clear()
    assert debrisgrasp.plan_motion(best, deadline=600.0).chosen is None
    assert given
    assert all(0.0 < left < 600.0 for left in given)


def test_a_way_that_is_known_is_gone_again(result, monkeypatch):
    first = debrisgrasp.plan_motion(result).chosen
    hidden = UnknownSpace.HIDDEN
    space = motion_space(result.capture, result.cloud, result.segmentation, hidden)
    given, plan = [], MotionPlanner.plan

    def noted(self, *places, known=None, **more):
        given.append(known)
        return plan(self, *places, known=known, **more)

    monkeypatch.setattr(MotionPlanner, "plan", noted)
    again = first_executable(
        result.plan,
        result.robot,
        space,
        known={first.arm: first.reach.path},
        rng=np.random.default_rng(0),
    )
    assert again.chosen is not None
    assert all(known is first.reach.path for known in given)


def test_same_seed_same_motion(result):
    one, other = (debrisgrasp.plan_motion(result, seed=3).chosen for _ in "ab")
    np.testing.assert_array_equal(one.reach.path, other.reach.path)


def test_a_lift_that_no_arm_can_do_passes_every_grasp_over(result):
    config = MotionsConfig(lift=(0.0, 0.0, 2.5), tries=1)
    found = debrisgrasp.plan_motion(result, config=config)
    assert found.chosen is None
    assert len(found.passed_over) == len(result.plan.grasps)
    assert "none of" in found.why_none
    assert any(reason.startswith("lift") for _, reason in found.passed_over)


def test_bad_input_is_refused(result):
    with pytest.raises(ConfigError, match="seed"):
        debrisgrasp.plan_motion(result, seed=-1)
    with pytest.raises(ConfigError, match="deadline"):
        debrisgrasp.plan_motion(result, deadline=0.0)
    floating = debrisgrasp.plan(result.capture, robot="none", gripper="robotiq_3f")
    with pytest.raises(InputError, match="floating hand"):
        debrisgrasp.plan_motion(floating)


def test_the_command_writes_motions_and_a_picture(run, tmp_path):
    out, report = tmp_path / "motion.json", tmp_path / "motion.png"
    capture = data_path("captures", "pile.npz")
    ended = run("motion", capture, "--arm", "right", "--out", out, "--report", report)
    assert ended.status == 0, ended.err
    assert "approach" in ended.out
    assert report.read_bytes()[:4] == b"\x89PNG"
    content = json.loads(out.read_text())
    assert content["schema"] == "debrisgrasp/motion/2"
    assert [m["name"] for m in content["motions"]] == ["reach", "approach", "lift"]
    limits = RobotModel.load("roman").limits("right").planner
    for motion in content["motions"]:
        assert motion["limits"] == limits.hash
        assert len(motion["times"]) == len(motion["q"]) == len(motion["dq"])


def test_a_saved_plan_is_carried_out_as_the_plan_itself(run, result, tmp_path):
    grasps, out = tmp_path / "grasps.json", tmp_path / "motion.json"
    result.save(grasps)
    capture = data_path("captures", "pile.npz")
    ended = run("motion", capture, "--grasps", grasps, "--out", out)
    assert ended.status == 0, ended.err
    stored, chosen = load_motion(out), debrisgrasp.plan_motion(result).chosen
    assert (stored.rank, stored.arm) == (chosen.index + 1, chosen.arm)
    for name, motion in chosen.trajectories.items():
        np.testing.assert_allclose(stored.trajectories[name].q[-1], motion.q[-1], 1e-4)


def test_a_saved_plan_is_refused_where_it_does_not_belong(refused, result, tmp_path):
    grasps, capture = tmp_path / "grasps.json", data_path("captures", "pile.npz")
    result.save(grasps)
    assert "nothing is searched" in refused(
        "motion", capture, "--grasps", grasps, "--mass", "3"
    )
    assert "--n-best: got one" in refused(
        "motion", capture, "--grasps", grasps, "--n-best", "3"
    )
    with pytest.raises(ConfigError, match="for which"):
        recall_plan(grasps, result.capture, None)
    content = json.loads(grasps.read_text())
    grasps.write_text(json.dumps(content | {"object": 99}))
    assert "object 99" in refused("motion", capture, "--grasps", grasps)


def test_what_was_not_tried_is_told_apart():
    late = "not tried: the deadline had passed"
    found = GraspMotions(
        chosen=None, passed_over=((0, "reach: too far"), (1, late), (2, late))
    )
    assert found.tried == ((0, "reach: too far"),)
    assert "none of 1 grasp tried" in found.why_none
    assert "2 more were not tried" in found.why_none


def test_the_command_needs_an_arm(refused):
    capture = data_path("captures", "pile.npz")
    assert "an arm to move" in refused("motion", capture, "--robot", "none")


def test_the_command_refuses_an_unknown_policy(run):
    ended = run("motion", data_path("captures", "pile.npz"), "--unknown", "some")
    assert ended.status == 2
    assert "--unknown" in ended.err


@pytest.mark.parametrize(
    ("field", "value", "named"),
    [
        ("gripper", "foo", "gripper.*grippers="),
        ("gripper", "other", "carries"),
        ("preshape", "foo", "preshape"),
        ("joints", {"a": 1.0}, "joints"),
        ("object", 99, "object"),
    ],
)
def test_a_saved_grasp_that_the_robot_cannot_have_is_refused(
    result, tmp_path, field, value, named
):
    path = tmp_path / "grasps.json"
    result.save(path)
    content = json.loads(path.read_text())
    grasp = content["grasps"][0]
    hands = {"robotiq_3f": "camhand", "camhand": "robotiq_3f"}
    grasp[field] = hands[grasp["gripper"]] if value == "other" else value
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=named):
        recall_plan(path, result.capture, result.robot)


def test_joints_at_their_limits_are_recalled_although_a_file_rounds(result, tmp_path):
    chain = result.robot.chain("right")
    q = np.where(np.round(chain.upper, 9) > chain.upper, chain.upper, chain.lower)
    assert (np.round(q, 9) > chain.upper).any()
    palm = chain.fk(q)
    grasp = replace(
        result.plan.grasps[0],
        T_base_hand=palm,
        T_base_pregrasp=palm @ SE3.from_parts(p=[0.0, 0.0, -0.1]),
        joints=chain.named(q),
    )
    saved = replace(result, plan=replace(result.plan, grasps=(grasp,)))
    saved.save(tmp_path / "grasps.json")
    recalled = recall_plan(tmp_path / "grasps.json", result.capture, result.robot)
    joints = chain.vector(recalled.plan.grasps[0].joints)
    assert ((chain.lower <= joints) & (joints <= chain.upper)).all()
    recalled.save(tmp_path / "again.json")
    again = (tmp_path / "again.json").read_bytes()
    assert again == (tmp_path / "grasps.json").read_bytes()


def _raised(grasp):
    grasp["pose"][2][3] += 0.3


def _raised_with_its_pregrasp(grasp):
    _raised(grasp)
    grasp["approach"]["pregrasp"][2][3] += 0.3


def _ahead(grasp):
    pose, away = np.array(grasp["pose"]), np.array(grasp["approach"]["pregrasp"])
    away[:3, 3] = 2.0 * pose[:3, 3] - away[:3, 3]
    grasp["approach"]["pregrasp"] = away.tolist()


def _far_joint(grasp):
    grasp["joints"] = dict.fromkeys(grasp["joints"], 100.0)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (_raised, r"grasps\[0\]\.approach\.pregrasp"),
        (_ahead, r"grasps\[0\]\.approach\.pregrasp"),
        (_raised_with_its_pregrasp, r"grasps\[0\]\.joints"),
        (_far_joint, r"grasps\[0\]\.joints"),
    ],
)
def test_a_saved_grasp_that_contradicts_itself_is_refused(
    result, tmp_path, change, named
):
    path = tmp_path / "grasps.json"
    result.save(path)
    content = json.loads(path.read_text())
    change(content["grasps"][0])
    path.write_text(json.dumps(content))
    with pytest.raises(ConfigError, match=named):
        recall_plan(path, result.capture, result.robot)


def test_a_saved_plan_in_another_frame_is_refused(result, tmp_path):
    path = tmp_path / "grasps.json"
    result.save(path)
    path.write_text(path.read_text().replace('"frame": "base"', '"frame": "camera"'))
    with pytest.raises(ConfigError, match="frame"):
        recall_plan(path, result.capture, result.robot)


@pytest.mark.parametrize("present", [{"zz": 1.0}, {"torso_joint": "a"}])
def test_a_present_posture_that_is_none_is_refused(result, present):
    with pytest.raises(InputError, match="joint"):
        debrisgrasp.plan_motion(result, present=present)
