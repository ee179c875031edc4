"""Layer 10: many runs, and what they say."""

from .accounting import (
    CLASS_ORDER,
    LATER_TRY,
    Comparison,
    Share,
    Stage,
    Tables,
    compare,
    stages_in_series,
    system_reliability,
    tabulate,
)
from .again import Change, asked_apart, changes, done_again, run_function
from .arm_run import run_arm
from .contents import contents_of_site, digest, edited, edited_since
from .fake_run import pipeline_of, run_fake
from .flight_picture import save_flight
from .flights import (
    FlightGroup,
    compare_ends,
    compare_groups,
    draw_flight,
    grouped,
)
from .in_the_way import Account, account
from .intervals import Interval, newcombe, wilson
from .physics_run import run_physics
from .rates import FaultRates, Rate, random_faults
from .record import (
    CHECKS,
    CLASSES,
    SUCCESS,
    UNCLASSIFIED,
    RunRecord,
    flight_of,
)
from .results import (
    comparison_to_json,
    flights_to_json,
    load_flights,
    load_header,
    load_results,
    save_results,
    tables_to_json,
)
from .runner import Campaign, Progress, damaged_runs, load_records
from .same_scenes import SameScenes, same_scenes
from .specs import FAKE_TIERS, LEVELS, WORLDS, RunSpec, draw_specs, fake_world
from .workers import ClusterWorkers, LocalWorkers, OwnWorkers

__all__ = [
    "CHECKS",
    "CLASSES",
    "CLASS_ORDER",
    "FAKE_TIERS",
    "LATER_TRY",
    "LEVELS",
    "SUCCESS",
    "UNCLASSIFIED",
    "WORLDS",
    "Account",
    "Campaign",
    "Change",
    "ClusterWorkers",
    "Comparison",
    "FaultRates",
    "FlightGroup",
    "Interval",
    "LocalWorkers",
    "OwnWorkers",
    "Progress",
    "Rate",
    "RunRecord",
    "RunSpec",
    "SameScenes",
    "Share",
    "Stage",
    "Tables",
    "account",
    "asked_apart",
    "changes",
    "compare",
    "compare_ends",
    "compare_groups",
    "comparison_to_json",
    "contents_of_site",
    "damaged_runs",
    "digest",
    "done_again",
    "draw_flight",
    "draw_specs",
    "edited",
    "edited_since",
    "fake_world",
    "flight_of",
    "flights_to_json",
    "grouped",
    "load_flights",
    "load_header",
    "load_records",
    "load_results",
    "newcombe",
    "pipeline_of",
    "random_faults",
    "run_arm",
    "run_fake",
    "run_function",
    "run_physics",
    "same_scenes",
    "save_flight",
    "save_results",
    "stages_in_series",
    "system_reliability",
    "tables_to_json",
    "tabulate",
    "wilson",
]
