"""Plans on disk."""

from __future__ import annotations

import json
from dataclasses import asdict, fields, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from debrisgrasp.errors import ConfigError, OutputError
from debrisgrasp.geometry import SE3, Bounds, random_rotations
from debrisgrasp.io.plan_json import load_plan, plan_to_dict, plan_to_json, save_plan
from debrisgrasp.planning import Advice, LoadForecast, Retreat, SuccessForecast
from debrisgrasp.planning.plan import Grasp, GraspPlan, PassedOver


@pytest.fixture
def plan(rng) -> GraspPlan:
    T_base_hand = SE3.from_parts(random_rotations(1, rng=rng)[0], rng.normal(size=3))
    back = SE3.from_parts(None, [0.0, 0.0, -0.1])
    grasp = Grasp(
        T_base_hand=T_base_hand,
        T_base_pregrasp=T_base_hand @ back,
        gripper="robotiq_3f",
        preshape="pinch",
        opening=0.08,
        width=0.05,
        prototype="cylinder_50mm",
        S=0.8,
        C=0.9,
        R=1.0,
        coverage=0.9,
        support=12,
        expected=0.75,
        score=0.72,
        arm="right",
        joints={"right_arm_joint1": 0.1, "right_arm_joint2": -0.0},
        object_label=3,
        retreat=Retreat(
            direction=(-0.6, 0.0, 0.8),
            overlap=0.25,
            hand_free=0.15,
            lift_overlap=0.5,
            lift_hand_free=0.05,
        ),
        load=LoadForecast(
            build="hollow",
            mass=(1.5, 6.0),
            force=(14.7, 58.9),
            torque=(0.0, 9.25),
            grip=(7.5, 90.0),
            lever=0.125,
            lever_error=0.0625,
            tilt=0.5,
            margin=2.5,
            margins=(0.75, 8.0),
            limit="wrist torque",
        ),
        success=SuccessForecast(
            probability=0.875,
            terms=(-0.75, -0.125, 0.5, 0.0, 0.016, -0.75, 0.0, -0.25, -0.125),
            outside=("load",),
        ),
    )
    floating = replace(grasp, arm=None, joints=None, score=0.5, load=None, success=None)
    return GraspPlan(
        grasps=(grasp, floating),
        object_label=3,
        region=Bounds(np.zeros(3), np.ones(3)),
        robot="roman",
        seed=7,
        rejections={"out of reach": 12},
        passed_over=(PassedOver(1, "no grasp above 0.5"),),
        advice=(
            Advice(
                kind="base",
                text="9 of 40 free up if the base moves back 15 cm",
                freed=9,
                of=40,
                change={"x": -0.15, "y": 0.0, "yaw": 0.0},
            ),
        ),
        seconds={"search": 0.4},
    )


def test_a_plan_survives_saving(plan, tmp_path):
    save_plan(plan, tmp_path / "grasps.json")
    loaded = load_plan(tmp_path / "grasps.json")
    for field in fields(GraspPlan):
        if field.name not in ("grasps", "region", "seconds", "ruled_out", "advice"):
            assert getattr(loaded, field.name) == getattr(plan, field.name)
    assert_allclose(loaded.region.upper, plan.region.upper)
    (ours,), (theirs,) = loaded.advice, plan.advice
    assert asdict(ours) == asdict(theirs)
    for ours, theirs in zip(loaded.grasps, plan.grasps, strict=True):
        for field in fields(Grasp):
            value = getattr(theirs, field.name)
            if isinstance(value, SE3):
                assert_allclose(
                    getattr(ours, field.name).matrix, value.matrix, atol=1e-9
                )
            else:
                assert getattr(ours, field.name) == value
        assert_allclose(ours.Q, theirs.Q)


def test_a_plan_that_was_read_is_written_as_the_same_bytes(plan, tmp_path, rng):
    first, again = tmp_path / "grasps.json", tmp_path / "again.json"
    hands = random_rotations(50, rng=rng)
    pregrasp = SE3.from_parts(p=[0.0, 0.0, -0.16])
    grasps = []
    for R, p, (S, C) in zip(
        hands, rng.random((50, 3)), rng.random((50, 2)), strict=True
    ):
        T = SE3.from_parts(R, p)
        grasps.append(
            replace(
                plan.grasps[0], T_base_hand=T, T_base_pregrasp=T @ pregrasp, S=S, C=C
            )
        )
    save_plan(replace(plan, grasps=tuple(grasps)), first)
    save_plan(load_plan(first), again)
    assert again.read_bytes() == first.read_bytes()
    grasp = json.loads(first.read_text())["grasps"][0]
    assert grasp["approach"]["distance"] == 0.16


@pytest.mark.parametrize("told", [[-0.75, 0.0], {"fit": -0.75, "slack": 0.01}])
def test_terms_of_another_model_are_none_of_ours(plan, told, tmp_path):
    content = plan_to_dict(plan)
    content["grasps"][0]["success"]["terms"] = told
    path = tmp_path / "grasps.json"
    path.write_text(json.dumps(content))
    found = load_plan(path).grasps[0].success
    assert found.terms == ()
    assert found.probability == 0.875


def test_an_empty_plan_survives_with_its_reason(tmp_path):
    plan = GraspPlan(
        grasps=(),
        object_label=0,
        region=None,
        robot="none",
        seed=1,
        why_empty="Nothing was segmented.",
    )
    save_plan(plan, tmp_path / "grasps.json")
    loaded = load_plan(tmp_path / "grasps.json")
    assert loaded.grasps == ()
    assert loaded.region is None
    assert loaded.why_empty == "Nothing was segmented."


def test_the_schema_is_the_published_one(plan):
    content = plan_to_dict(plan)
    assert content["schema"] == "debrisgrasp/grasps/1"
    assert content["frame"] == "base"
    grasp = content["grasps"][0]
    assert np.shape(grasp["pose"]) == (4, 4)
    assert_allclose(grasp["Q"], grasp["S"] * grasp["C"] * grasp["R"])
    assert_allclose(grasp["approach"]["distance"], 0.1)
    assert content["why_empty"] is None
    assert "seconds" not in plan_to_json(plan)


def test_equal_plans_are_equal_bytes_whatever_the_times_and_last_digits(plan):
    slower = replace(plan, seconds={"search": 9.0})
    grasp = plan.grasps[0]
    shaken = SE3(grasp.T_base_hand.matrix + 1e-14)
    nearly = replace(
        plan, grasps=(replace(grasp, T_base_hand=shaken), *plan.grasps[1:])
    )
    assert plan_to_json(plan) == plan_to_json(slower) == plan_to_json(nearly)
    assert "-0.0," not in plan_to_json(plan)


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (("schema",), "other/1", "schema"),
        (("grasps", 0, "pose"), np.diag([1.0, 1, 2, 1]).tolist(), "pose"),
        (("grasps", 0, "pose"), [[1]], "pose"),
        (("grasps", 0, "S"), "high", "high"),
        (("grasps", 0, "S"), "nan", "S of a grasp"),
        (("grasps", 0, "score"), 90, "score of a grasp.* 0 to 1"),
        (("grasps", 0, "success", "probability"), -0.1, "probability of a grasp"),
        (("grasps", 0, "joints"), [1, 2], "grasps.json"),
        (("grasps",), 3, "grasps.json"),
        (("region",), {"lower": [0, 0, 0], "upper": [0, 0, 0]}, "region"),
        (("seed",), None, "grasps.json"),
        (("grasps", 0, "width"), -0.05, "width of a grasp"),
        (("grasps", 0, "opening"), 120.0, "opening of a grasp"),
        (("grasps", 0, "opening"), 10**400, "grasps.json"),
        (("grasps", 0, "arm"), -1, "arm is -1"),
        (("grasps", 0, "joints"), {"elbow": 1e30}, "joint elbow"),
        (("grasps", 0, "pose", 0, 3), 1282.6, "place of a pose.* metres"),
        (("grasps", 0, "approach", "pregrasp", 2, 3), 900.0, "pregrasp.* metres"),
    ],
)
def test_wrong_values_are_refused(plan, tmp_path, place, value, message):
    content = json.loads(plan_to_json(plan))
    target = content
    for key in place[:-1]:
        target = target[key]
    target[place[-1]] = value
    path = tmp_path / "grasps.json"
    path.write_text(json.dumps(content))
    with pytest.raises(ConfigError, match=message):
        load_plan(path)


@pytest.mark.parametrize("key", ["robot", "region", "grasps", "rejections"])
def test_missing_fields_are_named(plan, tmp_path, key):
    content = plan_to_dict(plan)
    del content[key]
    path = tmp_path / "grasps.json"
    path.write_text(json.dumps(content))
    with pytest.raises(ConfigError, match=key):
        load_plan(path)


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "grasps.json"
    for text in ("[]", "{}", "{", ""):
        path.write_text(text)
        with pytest.raises(ConfigError, match=r"grasps\.json"):
            load_plan(path)
    with pytest.raises(ConfigError, match=r"none\.json"):
        load_plan(tmp_path / "none.json")


def test_a_plan_that_can_not_be_written_leaves_the_old_one(plan, tmp_path):
    with pytest.raises(OutputError):
        save_plan(plan, tmp_path / "none" / "grasps.json")
