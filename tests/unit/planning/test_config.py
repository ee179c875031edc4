"""Settings of the search are bounded by what memory and time can hold."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.errors import InputError
from debrisgrasp.planning import LocalMove, PlannerConfig, Schedule
from debrisgrasp.planning.clearance import ClearanceConfig
from debrisgrasp.planning.contacts import ContactConfig


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        (PlannerConfig, "starts", 10**6),
        (PlannerConfig, "walkers", 10**400),
        (PlannerConfig, "rounds", 10**6),
        (PlannerConfig, "alignments", 10**6),
        (PlannerConfig, "refinement_steps", 10**6),
        (PlannerConfig, "doubtful_share", 10**6),
        (ClearanceConfig, "approach_steps", 10**6),
        (ContactConfig, "min_points", 10**20),
        (Schedule, "sweeps", 10**6),
        (LocalMove, "position", (np.inf, np.inf)),
        (LocalMove, "position", (0.02,)),
        (LocalMove, "rotation", (8.6, 1.1)),
    ],
)
def test_what_memory_or_time_cannot_hold_is_refused(kind, name, value):
    with pytest.raises(InputError, match=name):
        kind(**{name: value})


def test_a_doubtful_search_stays_within_what_may_be_asked_for():
    wider = PlannerConfig(starts=8000, walkers=4000, doubtful_share=2).wider()
    assert (wider.starts, wider.walkers) == (10_000, 8000)
