"""What flown grasps tell: how often they held, by object, prototype, hand, forecast."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from debrisgrasp.trials import TrialRecord, TrialSpec, trial

from .accounting import Comparison, Share
from .fake_run import pipeline_of
from .flight_picture import save_flight
from .record import RunRecord
from .specs import RunSpec

__all__ = ["FlightGroup", "compare_ends", "compare_groups", "draw_flight", "grouped"]

_LIFTED = 8.0
"""What is heavier is not lifted, but dragged or left [kg]."""
_KEYS: Mapping[str, Callable[[TrialRecord], str]] = {
    "tier": lambda r: r.tier,
    "object": lambda r: r.kind,
    "prototype": lambda r: r.prototype,
    "hand": lambda r: r.gripper,
    "forecast": lambda r: f"{int(10 * r.probability) / 10:.1f}" if r.prototype else "",
    "mass": lambda r: "heavy" if r.mass > _LIFTED else f"{_LIFTED:g} kg or less",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightGroup:
    """Flights that have something in common."""

    by: str
    """What: tier, object, prototype, hand, forecast (by tenths), or mass."""
    name: str
    """Which; "" where there was no grasp."""
    held: Share
    pulled_clear: int
    """How many of the others were pulled clear [count]."""
    failures: Mapping[str, int]
    """Outcomes of the rest, most frequent first."""
    through: int = 0
    """How many of all went so deep into a body that their outcome means little."""

    @property
    def success(self) -> Share:
        """Those that held or were pulled clear."""
        return Share(self.held.count + self.pulled_clear, self.held.total)


def grouped(flights: Iterable[TrialRecord]) -> tuple[FlightGroup, ...]:
    """Count flights by each of their properties, largest groups first."""
    flights, groups = tuple(flights), []
    for by, key in _KEYS.items():
        members: dict[str, list[TrialRecord]] = defaultdict(list)
        for flight in flights:
            members[key(flight)].append(flight)
        for name, some in sorted(members.items(), key=lambda item: -len(item[1])):
            failed = Counter(f.outcome for f in some if not f.is_success)
            n_held = sum(f.is_held for f in some)
            groups.append(
                FlightGroup(
                    by=by,
                    name=name,
                    held=Share(n_held, len(some)),
                    pulled_clear=len(some) - failed.total() - n_held,
                    failures=dict(failed.most_common()),
                    through=sum(f.is_through for f in some),
                )
            )
    return tuple(groups)


def compare_ends(
    old: Sequence[RunRecord], new: Sequence[RunRecord]
) -> tuple[Comparison, ...]:
    """How the runs of two campaigns ended, in their own words."""
    before, now = (Counter(r.end or r.outcome for r in runs) for runs in (old, new))
    return tuple(
        Comparison(end, Share(before[end], len(old)), Share(now[end], len(new)))
        for end, _ in (before + now).most_common()
    )


def compare_groups(
    old: Iterable[FlightGroup], new: Iterable[FlightGroup]
) -> dict[str, tuple[Comparison, ...]]:
    """Share that held or was pulled clear in two campaigns, by each property."""
    before, now = ({(g.by, g.name): g.success for g in some} for some in (old, new))
    none, rows = Share(0, 0), defaultdict(list)
    for by, name in {**before, **now}:
        pair = (some.get((by, name), none) for some in (before, now))
        rows[by].append(Comparison(name, *pair))
    return {by: tuple(some) for by, some in rows.items()}


def draw_flight(record: RunRecord, path: Path) -> None:
    """Fly the grasp of a run again, and draw it from two sides as PNG.

    Raises
    ------
    MissingExtraError
        If MuJoCo is not installed.
    OutputError
        If the picture can't be written.
    """
    spec = RunSpec.from_json(record.spec)
    done = trial(TrialSpec(tier=spec.tier, seed=spec.seed), pipeline_of(spec.site))
    save_flight(path, done)
