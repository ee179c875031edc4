"""Settings of the search are bounded by what memory and time can hold."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.planning import (
    LoadConfig,
    LocalMove,
    PlannerConfig,
    SceneConfig,
    Schedule,
    SimilarityConfig,
)
from debrisgrasp.planning.clearance import ClearanceConfig
from debrisgrasp.planning.contacts import ContactConfig
from debrisgrasp.segmentation import (
    GroundConfig,
    SingulationConfig,
    SupportAware,
    SurroundingsConfig,
)


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


@pytest.mark.parametrize(
    ("config", "setting", "millimetres"),
    [
        (PlannerConfig, "region_size", 100.0),
        (PlannerConfig, "mode_distance", 30.0),
        (SceneConfig, "tangent_radius", 60.0),
        (SimilarityConfig, "tangential_gate", 18.0),
        (LoadConfig, "thin", 30.0),
        (LoadConfig, "patch", 20.0),
        (GroundConfig, "max_height", 40.0),
        (GroundConfig, "clearance", 12.0),
        (SingulationConfig, "max_gap", 13.0),
        (SupportAware, "openings", (155.0, 185.0)),
        (SurroundingsConfig, "min_wall", (800.0, 400.0)),
    ],
)
def test_a_length_in_millimetres_is_no_setting(config, setting, millimetres):
    with pytest.raises(ConfigError, match=rf"{setting} \[m\].*divide by 1000"):
        config(**{setting: millimetres})
