"""One grasp in the physics of the extra ``sim``, as a run of a campaign."""

from __future__ import annotations

import time

from debrisgrasp.trials import NO_GRASP, TrialSpec, run_trial

from .fake_run import pipeline_of
from .record import SUCCESS, RunRecord
from .specs import RunSpec

__all__ = ["run_physics"]

_PLANNED = ("capture", "segment", "select", "plan_grasp")
_GRIPPED = (*_PLANNED, "plan_motion", "pregrasp", "approach", "close")


def run_physics(spec: RunSpec) -> RunRecord:
    """Try the first grasp of one scene; see `debrisgrasp.trials.run_trial`.

    Raises
    ------
    UnknownNameError
        If there is no such tier.
    MissingExtraError
        If MuJoCo is not installed.
    """
    start = time.thread_time()
    pipeline = pipeline_of(spec.site)
    trial = run_trial(TrialSpec(tier=spec.tier, seed=spec.seed), pipeline)
    is_planned = trial.outcome != NO_GRASP
    outcome, stage, fault = "bad_grasp", "close", trial.outcome
    if not is_planned:
        outcome, stage, fault = "planning", "plan_grasp", "no_grasp"
    return RunRecord(
        name=spec.name,
        spec=spec.to_json(),
        outcome=SUCCESS if trial.is_success else outcome,
        reached=_GRIPPED if is_planned else _PLANNED,
        failed_stage=None if trial.is_success else stage,
        fault=None if trial.is_success else fault,
        first_fault=None if trial.is_success else fault,
        end=trial.outcome,
        faults=() if trial.is_success else (fault,),
        n_objects=1,
        n_removed=int(trial.is_success),
        seconds=round(time.thread_time() - start, 3),
        details=trial.as_dict(),
    )
