"""Tables: both denominators, stages in series, and what mending would buy."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from debrisgrasp.campaign import (
    CLASS_ORDER,
    CLASSES,
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


def test_stages_of_a_removal_are_a_series_too():
    runs = [*campaign(success=3), record("x", "planning", failed_stage="plan_motion")]
    (motion,) = (s for s in tabulate(runs).stages if s.name == "plan_motion")
    assert (motion.reached, motion.failed) == (4, 1)
    assert [s.name for s in tabulate(runs).stages] == list(STAGE_ORDER)


def test_comparison_says_what_is_clear():
    old = tabulate(campaign(success=19, bad_grasp=7, early_driver=17))
    new = tabulate(campaign(success=40, bad_grasp=2, early_driver=1))
    rows = {row.name: row for row in compare(old, new)}
    assert rows["success"].difference == pytest.approx(40 / 43 - 19 / 43)
    assert rows["success"].is_clear
    assert rows["driver"].difference < 0
    assert not rows["calibration"].is_clear
    assert rows["success of grasps"].old.total == 26
