r"""Tables of many runs: what became of them, and what it would pay to mend.

Each run ends in one class. Two denominators are kept apart, as in the paper's Table 1:
all runs, and those that got to a grasp. A system of stages in series has the product of
its stages' reliabilities (Figure 11b),

.. math::

   r_i = (n_i - f_i) / n_i, \qquad \prod_i r_i = \text{successes} / \text{runs},

where n_i runs reached stage i and f_i of them got no further. That holds exactly only
with the runs that really reached a stage. Dividing by successes plus failures of the
stage forgets the runs that ended later, and gives a product that is too small.

The stages of a removal are begun anew for each object. A run reached those that any of
its tries began, so that those that reached `GRASPED_STAGE` are those that got to a
grasp, and failed in the last of them. One that passed them all and was ended by a later
try failed in `LATER_TRY`, which stands behind them. A success passed all, also where
nothing had to be gripped. Where the fault was noticed that ended a run is counted
beside this (`Tables.ended_in`): it may be an early stage of a late try.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import prod

from debrisgrasp.errors import InputError
from debrisgrasp.executive import FAULTS, State

from .intervals import Interval, newcombe, wilson
from .record import CHECKS, STAGE_ORDER, SUCCESS, UNCLASSIFIED, RunRecord

__all__ = [
    "CLASS_ORDER",
    "LATER_TRY",
    "Comparison",
    "Share",
    "Stage",
    "Tables",
    "compare",
    "stages_in_series",
    "system_reliability",
    "tabulate",
]

CLASS_ORDER = (
    "driver",
    "operator_gripper_init",
    "operator_parameters",
    "calibration",
    "perception",
    "planning",
    "mechanical",
    "bad_grasp",
    "safety",
    "software",
    UNCLASSIFIED,
)
"""Classes in the order in which a run meets them: the stages of the series."""

LATER_TRY = "later_try"
"""Last stage of the series of a removal: all tries after one that passed the others."""

_RELEASED, _RETREAT = State.VERIFY_RELEASE.value, State.RETREAT.value


@dataclass(frozen=True, slots=True)
class Share:
    """So many of so many."""

    count: int
    total: int

    @property
    def value(self) -> float:
        """Count over total; NaN of nothing."""
        return self.count / self.total if self.total else float("nan")

    @property
    def interval(self) -> Interval:
        """Wilson interval, 95 %."""
        return wilson(self.count, self.total)


@dataclass(frozen=True, slots=True)
class Stage:
    """One of several stages, each of which a run must pass."""

    name: str
    reached: int
    """Runs that came so far."""
    failed: int
    """Runs that got no further."""

    @property
    def reliability(self) -> Fraction:
        """Share of the runs that passed; 1 of a stage that no run reached."""
        if not self.reached:
            return Fraction(1)
        return Fraction(self.reached - self.failed, self.reached)

    @property
    def interval(self) -> Interval:
        """Wilson interval of the reliability, 95 %."""
        return wilson(self.reached - self.failed, self.reached)


def stages_in_series(
    order: Sequence[str], failed_in: Iterable[str | None]
) -> tuple[Stage, ...]:
    """Count how many runs reached each stage, and how many got no further.

    Parameters
    ----------
    order
        Names of the stages, first to last.
    failed_in
        Of each run: the last stage that it reached, None after a success.

    Raises
    ------
    InputError
        If a run reached a stage that is not in the order.
    """
    ends = list(failed_in)
    remaining = len(ends)
    failures = Counter(end for end in ends if end is not None)
    unknown = sorted(failures.keys() - set(order))
    if unknown:
        raise InputError(
            "last stage of a run",
            got=", ".join(map(repr, unknown)),
            expected="one of " + ", ".join(order),
        )
    stages = []
    for name in order:
        stages.append(Stage(name, remaining, failures[name]))
        remaining -= failures[name]
    return tuple(stages)


def system_reliability(
    stages: Iterable[Stage], *, perfect: str | None = None
) -> Fraction | None:
    """Product of the stages: the share of runs that pass them all.

    Parameters
    ----------
    perfect
        Name of a stage that is taken as mended: r / r_j. None is returned if no run
        passed that stage, since then nothing is known of those behind it.
    """
    counted = list(stages)
    if any(s.name == perfect and s.failed == s.reached > 0 for s in counted):
        return None
    return prod(
        (s.reliability for s in counted if s.name != perfect), start=Fraction(1)
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Tables:
    """All that a campaign says in numbers."""

    of_all: tuple[tuple[str, Share], ...]
    """Share of each outcome in all runs, success first."""
    of_grasps: tuple[tuple[str, Share], ...]
    """Share of each outcome in the runs that got to a grasp."""
    by_first_fault: tuple[tuple[str, int], ...]
    """The same runs, those that failed by the class of `RunRecord.first_fault`."""
    classes: tuple[Stage, ...]
    """The classes as stages in series, in `CLASS_ORDER`."""
    stages: tuple[Stage, ...]
    """The stages of a removal in series, and `LATER_TRY`."""
    ended_in: tuple[tuple[str, int], ...]
    """In which stage the fault was noticed that ended a run, and how many runs."""
    mended: tuple[tuple[str, Fraction | None], ...]
    """Success of the whole if one class never occurred, in the same order."""
    removed: Share
    """Objects that are out of the way in the end, of those that were in it."""
    checks: tuple[tuple[str, int], ...]
    """How often each of `CHECKS` was violated, all runs together; those that no run
    looked at are left out."""

    @property
    def success(self) -> Share:
        """Successful runs of all runs."""
        return self.of_all[0][1]

    @property
    def grasp_success(self) -> Share:
        """Successful runs of those that got to a grasp."""
        return self.of_grasps[0][1]


def tabulate(records: Sequence[RunRecord]) -> Tables:
    """Count the outcomes of a campaign.

    Raises
    ------
    InputError
        If there is no run to count.
    """
    if not records:
        raise InputError(
            "runs of the campaign", got="none", expected="one or more finished runs"
        )
    grasped = [record for record in records if record.got_to_a_grasp]
    ends = Counter(record.failed_stage for record in records)
    firsts = Counter(map(_by_first_fault, records))
    classes = stages_in_series(
        CLASS_ORDER, (None if r.is_success else r.outcome for r in records)
    )
    mended = tuple(
        (name, system_reliability(classes, perfect=name)) for name in CLASS_ORDER
    )
    return Tables(
        of_all=_shares(records),
        of_grasps=_shares(grasped),
        by_first_fault=tuple((name, firsts[name]) for name in (SUCCESS, *CLASS_ORDER)),
        classes=classes,
        stages=stages_in_series((*STAGE_ORDER, LATER_TRY), map(_got_to, records)),
        ended_in=tuple((name, ends[name]) for name in STAGE_ORDER),
        mended=mended,
        removed=Share(
            sum(record.n_removed for record in records),
            sum(record.n_objects for record in records),
        ),
        checks=tuple(
            (name, sum(record.checks.get(name, 0) for record in records))
            for name in CHECKS
            if any(name in record.checks for record in records)
        ),
    )


def _by_first_fault(record: RunRecord) -> str:
    """Class that a run would count in if its first fault made it fail."""
    fault = FAULTS.get(record.first_fault or "")
    if record.is_success or fault is None:
        return record.outcome
    return fault.fault_class.value


def _got_to(record: RunRecord) -> str | None:
    """Last stage that any try of a run began; None after a success."""
    if record.is_success:
        return None
    begun = {*record.reached, record.failed_stage}
    if _RELEASED not in begun:
        begun.discard(_RETREAT)  # from a push, which also ends by it
    last = [STAGE_ORDER[0], *(name for name in STAGE_ORDER if name in begun)][-1]
    if last == _RETREAT and record.failed_stage != last:
        return LATER_TRY
    return last


def _shares(records: Sequence[RunRecord]) -> tuple[tuple[str, Share], ...]:
    counts = Counter(record.outcome for record in records)
    return tuple(
        (name, Share(counts[name], len(records))) for name in (SUCCESS, *CLASS_ORDER)
    )


@dataclass(frozen=True, slots=True)
class Comparison:
    """One share in two campaigns."""

    name: str
    old: Share
    new: Share

    @property
    def difference(self) -> float:
        """New share minus old."""
        return self.new.value - self.old.value

    @property
    def interval(self) -> Interval:
        """Newcombe interval of the difference, 95 %."""
        return newcombe(
            (self.old.count, self.old.total), (self.new.count, self.new.total)
        )

    @property
    def is_clear(self) -> bool:
        """Whether the interval leaves 0 out."""
        low, high = self.interval
        return not low <= 0.0 <= high


def compare(old: Tables, new: Tables) -> tuple[Comparison, ...]:
    """Every outcome in two campaigns, and the success of the runs with a grasp."""
    rows = [
        Comparison(name, share, dict(new.of_all)[name]) for name, share in old.of_all
    ]
    rows.insert(
        1, Comparison("success of grasps", old.grasp_success, new.grasp_success)
    )
    return tuple(rows)
