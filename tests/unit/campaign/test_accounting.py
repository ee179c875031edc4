"""Tables: both denominators, stages in series, and what mending would buy."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from debrisgrasp.campaign import (
    CLASS_ORDER,
    CLASSES,
    LATER_TRY,
    SUCCESS,
    UNCLASSIFIED,
    compare,
    stages_in_series,
    system_reliability,
    tabulate,
)
from debrisgrasp.campaign.record import STAGE_ORDER
from debrisgrasp.errors import InputError

from .records import campaign, record

outcomes = st.lists(st.sampled_from([None, *CLASS_ORDER]), min_size=1, max_size=60)


def test_the_series_has_every_class_once():
    assert sorted(CLASS_ORDER) == sorted([*CLASSES, UNCLASSIFIED])


@given(outcomes, st.permutations(CLASS_ORDER))
def test_the_product_of_the_stages_is_the_share_of_successes_exactly(ends, order):
    stages = stages_in_series(order, ends)
    assert system_reliability(stages) == Fraction(ends.count(None), len(ends))
    assert stages[0].reached == len(ends)
    assert sum(stage.failed for stage in stages) == len(ends) - ends.count(None)


@given(outcomes, st.sampled_from(CLASS_ORDER))
def test_mending_a_stage_divides_by_its_reliability(ends, name):
    stages = stages_in_series(CLASS_ORDER, ends)
    (mended,) = (stage for stage in stages if stage.name == name)
    system = system_reliability(stages)
    if mended.reliability == 0:
        assert system_reliability(stages, perfect=name) is None
    else:
        bought = system_reliability(stages, perfect=name)
        assert bought == system / mended.reliability
        assert bought >= system


def test_runs_that_ended_later_are_not_forgotten():
    # 43 runs, 17 lost before a grasp, 7 by it. Successes over successes plus failures
    # of each stage alone, multiplied, would give 0.386 instead of 0.442.
    stages = stages_in_series(
        ("before", "grasp"), ["before"] * 17 + ["grasp"] * 7 + [None] * 19
    )
    assert [stage.reliability for stage in stages] == [
        Fraction(26, 43),
        Fraction(19, 26),
    ]
    assert float(system_reliability(stages)) == pytest.approx(0.442, abs=5e-4)
    censored = (19 / (19 + 17)) * (19 / (19 + 7))
    assert censored == pytest.approx(0.386, abs=5e-4)
    assert float(system_reliability(stages, perfect="before")) == pytest.approx(19 / 26)


def test_an_unknown_stage_is_refused():
    with pytest.raises(InputError, match="'lunch'"):
        stages_in_series(("driver",), ["lunch", None])


def test_both_denominators():
    tables = tabulate(campaign(success=19, bad_grasp=7, early_driver=17))
    assert (tables.success.count, tables.success.total) == (19, 43)
    assert (tables.grasp_success.count, tables.grasp_success.total) == (19, 26)
    assert dict(tables.of_all)["driver"].count == 17
    assert dict(tables.of_grasps)["driver"].count == 0
    assert tables.success.interval == pytest.approx((0.304333, 0.588924), abs=1e-6)


@given(st.lists(st.sampled_from([SUCCESS, *CLASSES]), min_size=1, max_size=40))
def test_every_run_is_in_exactly_one_row(ends):
    tables = tabulate([record(str(i), end) for i, end in enumerate(ends)])
    assert sum(share.count for _, share in tables.of_all) == len(ends)
    assert {share.total for _, share in tables.of_all} == {len(ends)}
    for stages in (tables.classes, tables.stages):
        assert float(system_reliability(stages)) == tables.success.value


def test_failed_runs_are_counted_by_their_first_fault_too():
    runs = [
        record("a", "driver", fault="wrench_nan", first_fault="empty_cloud"),
        record("b", "driver", fault="wrench_nan", first_fault="wrench_nan"),
        record("c", "driver"),  # of an older version
        record("d", first_fault="slip"),  # answered: it cost nothing
        record("e", UNCLASSIFIED),
    ]
    tables = tabulate(runs)
    counted = {name: count for name, count in tables.by_first_fault if count}
    assert counted == {"success": 1, "perception": 1, "driver": 2, "unclassified": 1}
    assert dict(tables.of_all)["driver"].count == 3


def test_checks_and_objects_are_added_up():
    runs = [
        record("a", n_objects=3, n_removed=2, checks={"false_cleared": 1}),
        record("b", n_objects=4, n_removed=4, checks={"false_cleared": 2}),
    ]
    tables = tabulate(runs)
    assert (tables.removed.count, tables.removed.total) == (6, 7)
    assert dict(tables.checks)["false_cleared"] == 3
    assert sum(count for _, count in tables.checks) == 3


def test_nothing_to_count_is_refused():
    with pytest.raises(InputError, match="one or more finished runs"):
        tabulate([])


def begun_to(stage: str) -> tuple[str, ...]:
    return STAGE_ORDER[: STAGE_ORDER.index(stage) + 1]


def test_stages_of_a_removal_are_a_series_too():
    early = {"reached": begun_to("plan_motion"), "failed_stage": "plan_motion"}
    tables = tabulate([*campaign(success=3), record("x", "planning", **early)])
    (motion,) = (s for s in tables.stages if s.name == "plan_motion")
    assert (motion.reached, motion.failed) == (4, 1)
    assert [s.name for s in tables.stages] == [*STAGE_ORDER, LATER_TRY]
    assert dict(tables.ended_in)["plan_motion"] == 1


def test_a_run_that_removed_something_and_found_no_more_passed_every_stage():
    late = {"reached": STAGE_ORDER, "failed_stage": "select"}
    tables = tabulate([*campaign(success=1), record("x", "planning", **late)])
    stages = {stage.name: stage for stage in tables.stages}
    assert {stage.reached for stage in tables.stages} == {2}
    assert (stages["select"].failed, stages[LATER_TRY].failed) == (0, 1)
    assert dict(tables.ended_in)["select"] == 1


def test_a_run_that_fails_in_retreat_passed_no_retreat():
    ended = {"reached": STAGE_ORDER, "failed_stage": "retreat"}
    stages = {s.name: s for s in tabulate([record("x", "driver", **ended)]).stages}
    assert (stages["retreat"].failed, stages[LATER_TRY].reached) == (1, 0)


def test_a_retreat_from_a_push_is_none_from_a_release():
    pushed = {"reached": (*begun_to("select"), "retreat"), "failed_stage": "select"}
    stages = {s.name: s for s in tabulate([record("x", "planning", **pushed)]).stages}
    assert stages["select"].failed == 1
    assert stages["close"].reached == 0


reached = st.sampled_from(STAGE_ORDER).map(begun_to)
failures = st.tuples(st.sampled_from(CLASSES), reached, st.sampled_from(STAGE_ORDER))


@given(st.lists(failures, min_size=1, max_size=30), st.integers(0, 5))
def test_who_reached_the_closing_of_the_fingers_got_to_a_grasp(ends, n_successes):
    runs = campaign(success=n_successes)
    for i, (outcome, begun, failed) in enumerate(ends):
        failed = min(failed, begun[-1], key=STAGE_ORDER.index)
        runs.append(record(str(i), outcome, reached=begun, failed_stage=failed))
    tables = tabulate(runs)
    (close,) = (stage for stage in tables.stages if stage.name == "close")
    assert close.reached == tables.grasp_success.total
    assert system_reliability(tables.stages) == Fraction(n_successes, len(runs))


def test_comparison_says_what_is_clear():
    old = tabulate(campaign(success=19, bad_grasp=7, early_driver=17))
    new = tabulate(campaign(success=40, bad_grasp=2, early_driver=1))
    rows = {row.name: row for row in compare(old, new)}
    assert rows["success"].difference == pytest.approx(40 / 43 - 19 / 43)
    assert rows["success"].is_clear
    assert rows["driver"].difference < 0
    assert not rows["calibration"].is_clear
    assert rows["success of grasps"].old.total == 26
