"""Rates of faults, and the runs that are drawn with them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from debrisgrasp._files import data_path
from debrisgrasp.campaign import (
    FAKE_TIERS,
    FaultRates,
    Rate,
    RunRecord,
    RunSpec,
    draw_specs,
    fake_world,
    random_faults,
    tabulate,
    wilson,
)
from debrisgrasp.errors import ConfigError, InputError, UnknownNameError
from debrisgrasp.executive import FAULTS, STAGES, State
from debrisgrasp.robot import INJECTABLE, Injection

from .records import record

SHIPPED = sorted(data_path("campaigns").glob("*.yaml"))


def test_faults_strike_as_often_as_their_rate_says(rng):
    rates = FaultRates(
        (
            Rate(rate=0.3, one_of=("slip", "empty_grip")),
            Rate(rate=0.05, one_of=("joint_stuck",), state="any"),
            Rate(rate=0.0, one_of=("wrench_nan",)),
            Rate(rate=1.0, one_of=("empty_cloud",)),
        )
    )
    n = 4000
    drawn = [rates.drawn(rng) for _ in range(n)]
    counts = {
        name: sum(i.fault == name for run in drawn for i in run) for name in INJECTABLE
    }
    for name, rate in (("slip", 0.15), ("empty_grip", 0.15), ("joint_stuck", 0.05)):
        low, high = wilson(counts[name], n, confidence=0.9999)
        assert low < rate < high
    assert counts["wrench_nan"] == 0
    assert counts["empty_cloud"] == n
    states = {i.state for run in drawn for i in run if i.fault == "joint_stuck"}
    assert len(states) > 12
    assert None not in states


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_rates_can_be_read(path, rng):
    assert FaultRates.load(path).rates
    FaultRates.load(path).drawn(rng)


def test_there_are_shipped_rates():
    assert {path.stem for path in SHIPPED} >= {"field", "paper_piles", "paper_handle"}


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("rates: []", "schema"),
        ("[1, 2]", "schema"),
        ("schema: debrisgrasp/fault-rates/1", "rates"),
        ("", "got nothing"),
        ("schema: other/1", "got schema other/1"),
        ("schema: debrisgrasp/fault-rates/1\nrates: []", r"rates: got \[\]"),
        ("schema: debrisgrasp/fault-rates/1\nrates: [a]\nmore: 1", "more"),
        ("schema: debrisgrasp/fault-rates/1\nrates: [a]\n1: a\nb: c", "'1', 'b'"),
        (f"{{}}- {{{{rate: 1{'0' * 400}, one_of: slip}}}}", "rate 1: got 10{50}"),
        ("{}- {{rate: 2, one_of: slip}}", "rate 1: got 2"),
        ("{}- {{rate: 1e-3, one_of: slip}}", r"'1e-3'.*write 1\.0e-3 or 0\.001"),
        ("{}- {{rate: often, one_of: slip}}", r"a number, 0 to 1\.$"),
        ("{}- {{rate: yes, one_of: slip}}", "rate 1, rate"),
        ("{}- {{rate: .nan, one_of: slip}}", "rate 1: got nan"),
        ("{}- {{rate: 0.1, one_of: [slip, slop]}}", "'slop'"),
        ("{}- {{rate: 0.1, one_of: []}}", "nothing"),
        ("{}- {{rate: 0.1, one_of: [1]}}", "one_of"),
        ("{}- {{rate: 0.1}}", "without one_of"),
        ("{}- {{rate: 0.1, one_of: slip, when: now}}", "with when"),
        ("{}- {{rate: 0.1, one_of: slip, state: lunch}}", "'lunch'"),
        ("{}- slip", "rate 1: got slip"),
    ],
)
def test_bad_rates_are_named(tmp_path: Path, text, match):
    path = tmp_path / "rates.yaml"
    path.write_text(text.format("schema: debrisgrasp/fault-rates/1\nrates:\n"))
    with pytest.raises(ConfigError, match=match) as caught:
        FaultRates.load(path)
    assert "rates.yaml" in str(caught.value)


def test_random_faults_are_one_or_two_of_any_kind_at_any_state(rng):
    drawn = [random_faults(rng) for _ in range(600)]
    assert {len(run) for run in drawn} == {1, 2}
    assert {i.fault for run in drawn for i in run} == set(INJECTABLE)
    assert all(len({i.fault for i in run}) == len(run) for run in drawn)
    states = {state.value for state in State if state is not State.CLEARED}
    assert {i.state for run in drawn for i in run} == {None, *states}


def test_any_state_is_any_in_which_something_can_go_wrong(rng):
    rate = Rate(rate=1.0, one_of=("connection_lost",), state="any")
    states = {state.value for state in State if state is not State.CLEARED}
    assert {rate.drawn(rng).state for _ in range(600)} == states


@given(st.integers(1, 30), st.integers(0, 2**32))
def test_more_runs_leave_the_first_ones_as_they_were(n, seed):
    longer = draw_specs(n + 5, seed=seed, faults=random_faults)
    assert longer[:n] == draw_specs(n, seed=seed, faults=random_faults)
    assert len({spec.seed for spec in longer}) == len(longer)


def test_a_spec_survives_its_record():
    for spec in draw_specs(20, seed=3, faults=random_faults, max_removals=2):
        assert RunSpec.from_json(json.loads(json.dumps(spec.to_json()))) == spec


@pytest.mark.parametrize(
    "changes",
    [
        {"world": "moon"},
        {"seed": -1},
        {"max_attempts": 0},
        {"max_removals": 0},
        {"world": "mujoco", "faults": (Injection(fault="slip"),)},
        {"faults": (Injection(fault="slip", state="lfit"),)},
        {"faults": ("slip",)},
        {"faults": [Injection(fault="slip")]},
        {"name": 3},
        {"tier": "singel"},
        {"tier": ["single"]},
        {"site": 5},
        {"seed": 1.5},
        {"seed": None},
        {"seed": True},
        {"recovery": "x"},
        {"max_removals": 1.5},
        {"max_attempts": True},
    ],
)
def test_runs_that_make_no_sense_are_refused(changes):
    with pytest.raises(InputError):
        RunSpec(**{"name": "x", "seed": 1, **changes})


@pytest.mark.parametrize("n", [0, -3, 10**7])
def test_a_number_of_runs_that_is_none_is_refused(n):
    with pytest.raises(ConfigError, match="runs of a campaign"):
        draw_specs(n, seed=0)


@pytest.mark.parametrize("seed", [-1, "a", 1.5])
def test_a_seed_that_is_none_is_refused(seed):
    with pytest.raises(InputError, match="seed"):
        draw_specs(1, seed=seed)


def test_a_spec_of_another_program_is_refused():
    with pytest.raises(ConfigError, match="run"):
        RunSpec.from_json({"name": "x", "colour": "red"})
    for faults in (5, None, "slip", {"fault": "slip"}, [5], ["slip"]):
        with pytest.raises(ConfigError, match=r"faults|injection"):
            RunSpec.from_json({"name": "x", "seed": 1, "faults": faults})
    # Whether there is such a pile is for the physics to say.
    RunSpec(name="x", seed=1, world="mujoco", tier="other")


@pytest.mark.parametrize("tier", ["single", "handle", "few", "wood_on_truss"])
def test_scenes_are_at_rest_and_the_same_for_the_same_seed(tier):
    first, second = (fake_world(tier, np.random.default_rng(5)) for _ in range(2))
    for one, other in zip(first.bodies, second.bodies, strict=True):
        np.testing.assert_array_equal(one.T_base_body.matrix, other.T_base_body.matrix)
        assert min(float(s.bounds.lower[2]) for s in one.solids) < 0.5


def test_an_unknown_tier_names_the_known_ones(rng):
    with pytest.raises(UnknownNameError, match="single"):
        fake_world("singel", rng)
    assert "pile" in FAKE_TIERS


@pytest.mark.parametrize(
    ("name", "successes", "grasps", "runs"),
    [("paper_piles", 19, 26, 43), ("paper_handle", 95, 99, 147)],
)
def test_a_robot_that_fails_by_nothing_else_shows_the_papers_proportions(
    name, successes, grasps, runs
):
    rates = FaultRates.load(data_path("campaigns", f"{name}.yaml"))
    n = 4000
    tables = tabulate(
        [ended_by_first(spec) for spec in draw_specs(n, seed=1, faults=rates.drawn)]
    )
    reached = tables.grasp_success.total
    for counted, total, paper in (
        (tables.success.count, n, successes / runs),
        (tables.grasp_success.count, reached, successes / grasps),
        (reached, n, grasps / runs),
    ):
        low, high = wilson(counted, total, confidence=0.999)
        assert low < paper < high


def ended_by_first(spec: RunSpec) -> RunRecord:
    """What a run ends in whose every fault is final, and that has no others."""
    stages = [stage.value for stage in STAGES]
    faults = sorted(spec.faults, key=lambda i: stages.index(i.kind.state))
    early = [i for i in faults if FAULTS[i.fault].fault_class.value != "bad_grasp"]
    if not faults:
        return record(spec.name)
    fault = (early or faults)[0].fault
    reached = ("self_test",) if early else ("self_test", "close")
    return record(
        spec.name,
        FAULTS[fault].fault_class.value,
        reached=reached,
        failed_stage=reached[-1],
    )
