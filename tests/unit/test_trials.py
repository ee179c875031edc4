from __future__ import annotations

import json
import pickle

import numpy as np
import pytest

from debrisgrasp import Pipeline, Settings
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.geometry import SE3, Box
from debrisgrasp.settings import SiteLimits
from debrisgrasp.sim import SceneConfig, Verdict, let_fall, scene_of
from debrisgrasp.trials import (
    NO_GRASP,
    TrialRecord,
    TrialSpec,
    pipeline_of,
    trial,
    trials,
)
from debrisgrasp.worlds import Body, World

pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def done():
    spec = TrialSpec(tier="isolated", seed=1, robot="none")
    return trial(spec, pipeline_of(spec))


def test_a_trial_ends_in_one_named_outcome(done):
    outcomes = {NO_GRASP, *(verdict.value for verdict in Verdict)}
    assert done.record.outcome in outcomes
    successes = ("held", "pulled_clear")
    assert done.record.is_success == (done.record.outcome in successes)


def test_a_record_survives_json(done):
    text = json.dumps(done.record.as_dict())
    assert TrialRecord(**json.loads(text)) == done.record


def test_spec_and_record_travel_between_processes(done):
    spec = TrialSpec(tier="pile", seed=3, scene=SceneConfig(noise=False))
    assert pickle.loads(pickle.dumps(spec)) == spec
    assert pickle.loads(pickle.dumps(done.record)) == done.record


def test_the_record_says_what_the_planner_said(done):
    assert done.grasp is not None
    assert done.record.prototype == done.grasp.prototype
    assert pytest.approx(done.grasp.Q) == done.record.Q
    assert done.record.n_bodies == 1
    assert done.record.kind == done.scene.world.bodies[0].kind


def test_further_grasps_of_a_plan_are_flown_in_the_untouched_scene(done):
    spec = TrialSpec(tier="isolated", seed=1, robot="none")
    n = len(done.planned.plan.grasps)
    again, last = trials(spec, pipeline_of(spec), ranks=(0, n - 1, n))
    assert again.record.outcome == done.record.outcome
    assert again.record.rise == pytest.approx(done.record.rise)
    assert (again.record.rank, last.record.rank) == (0, n - 1)
    assert last.record.probability == last.grasp.success_probability
    assert last.record.terms == last.grasp.success.terms


@pytest.fixture(scope="module")
def scene():
    """A case of 2 kg, which weighs 19.6 N."""
    case = Body("case", "own", (Box(np.array([0.2, 0.045, 0.045])),), 2.0)
    world = World((case.at(SE3.from_parts(p=[1.1, 0.0, 0.1])),))
    return scene_of(let_fall(world), 4, name="cases")


@pytest.mark.parametrize(
    ("limits", "outcome"),
    [
        (SiteLimits(), Verdict.HELD),
        (SiteLimits(force=15.0), Verdict.TOO_HEAVY),
        (SiteLimits(force=25.0, torque=5.0), Verdict.HELD),
    ],
)
def test_a_wrist_bears_what_the_arm_of_the_grasp_does(scene, limits, outcome):
    pipeline = Pipeline.from_settings(Settings(limits=limits))
    record = trial(TrialSpec(tier="cases", seed=4), pipeline, scene=scene).record
    (arm,) = [arm for arm in pipeline.arms if arm.name == record.arm]
    force, torque = arm.wrench_limits
    assert record.outcome == outcome.value
    assert record.peak_force <= force + 1e-9
    assert record.peak_torque <= torque + 1e-9


def test_bodies_of_your_own_are_tried_as_those_of_a_tier(scene):
    spec = TrialSpec(tier="cases", seed=4, robot="none")
    record = trial(spec, pipeline_of(spec), scene=scene).record
    assert (record.tier, record.seed, record.kind) == ("cases", 4, "own")
    assert record.mass == 2.0
    assert record.outcome == Verdict.HELD.value


def test_specs_that_make_no_sense_are_refused():
    with pytest.raises(ConfigError, match="order"):
        TrialSpec(tier="pile", seed=1, order="random")
    with pytest.raises(ConfigError, match="pull"):
        TrialSpec(tier="pile", seed=1, pull="sideways")
    with pytest.raises(ConfigError, match="clear"):
        TrialSpec(tier="pile", seed=1, clear=0.0)
    with pytest.raises(ConfigError, match="seed"):
        TrialSpec(tier="pile", seed=-1)


@pytest.mark.parametrize(
    "change",
    [{"seed": -1}, {"seed": "a"}, {"seed": 1.5}, {"lift": np.nan}, {"scene": None}],
)
def test_a_spec_that_means_nothing_is_refused(change):
    with pytest.raises(InputError, match=next(iter(change))):
        TrialSpec(**{"tier": "pile", "seed": 1, **change})


@pytest.mark.parametrize("ranks", [0, (-1,), (0, -2), ("a",)])
def test_ranks_that_no_plan_has_are_refused(ranks):
    with pytest.raises(InputError, match="rank"):
        trials(TrialSpec(tier="isolated", seed=1), ranks=ranks)
