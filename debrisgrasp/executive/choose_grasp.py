"""Which hand, which grasp on the chosen object, which way to it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from debrisgrasp.motion import MotionSpace, MotionStatus, UnknownSpace
from debrisgrasp.pipeline import (
    GraspMotion,
    MotionsConfig,
    Passage,
    first_executable,
)
from debrisgrasp.planning import Grasp

from .context import Context
from .dropoff import drop_postures, no_place, object_in_hand
from .noticed import misplaced
from .obstacles import room_for
from .result import Done, FaultFound, StepResult
from .states import State
from .triage import Triage, Way

__all__ = ["plan_grasp", "plan_motion"]

_ALIKE, _ALIKE_TURN = 0.03, 0.35
"""Grasps nearer to each other than this are one [m], [rad]."""
_PREFERRED = 0.05
"""By so much likelier to hold the grasp of another hand must be."""
_REPEATED = 0.2
"""By so much likelier must a prototype be that failed on an object, each time."""
_LIKELY = 0.5
"""What is less likely to hold is put off."""
_FELT = 0.2
"""What fingers squeeze with a smaller probability lies loosely in their hook: nobody
feels it, and it is taken for an empty hand."""
_SEARCHES = 3
"""So often at most grasps are sought on an object that was not got the last time."""
_KNOWN = 40
"""Corners of ways to earlier grasps that are remembered."""


def plan_grasp(context: Context) -> StepResult:
    """Seek grasps on the chosen object; the preferred hand's come first."""
    cycle = context.cycle
    assert cycle.seen is not None
    assert cycle.triage is not None
    label = None if cycle.seen.is_marked is not None else cycle.label
    mark = context.marks.of(cycle.centroid or (np.inf,) * 3)
    failed = [] if mark is None else mark.failed
    in_vain = [] if mark is None else mark.in_vain(cycle.seen)
    mass = None if mark is None else mark.mass
    # A search is drawn: what found nothing good is repeated, and all finds count.
    offered = [] if mark is None else mark.offered.get(cycle.seen, [])
    grasps = [g for g in offered if not any(_is_like(g, other) for other in in_vain)]
    n_before = 0 if mark is None or offered else mark.searches + mark.tries
    for _ in range(min(1 + n_before, _SEARCHES)):
        seed = int(context.rng.integers(2**31))
        found = context.pipeline.plan(
            cycle.seen, object_label=label, seed=seed, mass=mass
        )
        for grasp in found.plan.grasps:
            known = (*in_vain, *grasps)
            if grasp.arm in context.limbs and not any(
                _is_like(grasp, other) for other in known
            ):
                grasps.append(grasp)
    if not grasps:
        why = found.plan.why_empty or "no hand in use takes any of the grasps"
        is_taken = any(grasp.arm in context.limbs for grasp in found.plan.grasps)
        if mark is not None and is_taken:
            why = mark.reason  # all are like those that failed
        name = "unreachable" if _mostly_far(found.plan.rejections) else "no_grasp"
        n_candidates = float(sum(found.plan.rejections.values()))
        return FaultFound(name, why, None, {"candidates": n_candidates})
    cycle.plan = replace(
        found, plan=replace(found.plan, grasps=_ordered(grasps, cycle.triage, failed))
    )
    best = cycle.plan.plan.grasps[0]
    if _is_put_off(context, cycle.plan.plan.grasps):
        return Done({"put_off": _grasp_facts(best)}, State.SELECT)
    return Done({"seed": seed, "grasps": len(grasps), "best": _grasp_facts(best)})


def _is_put_off(context: Context, grasps: Sequence[Grasp]) -> bool:
    """Whether what an object offers is so poor that all others are tried before it.

    Its grasps, the best first, are kept for its turn.
    """
    cycle, n_changes, kept = context.cycle, context.n_changes, _kept(grasps[0])
    assert cycle.seen is not None
    assert cycle.triage is not None
    is_only = cycle.seen.is_marked is not None or cycle.triage.way is Way.DRAG
    if is_only or cycle.centroid is None or kept >= _LIKELY:
        return False
    if context.marks.promise(cycle.centroid, n_changes) is not None:
        return False
    context.marks.put_off(cycle.centroid, kept, n_changes).offered[cycle.seen] = list(
        grasps
    )
    return True


def _no_drop(context: Context, motion: GraspMotion, space: MotionSpace) -> str:
    """Say that what a motion lifts can't be put down, or nothing."""
    triage = context.cycle.triage
    if triage is not None and triage.way is Way.DRAG:
        return ""
    grasp, limb = motion.grasp, context.limbs[motion.arm]
    points = object_in_hand(context, grasp.T_base_hand, grasp.width)
    is_free = limb.planner.exact_test(space, with_hand=False).is_free
    if len(drop_postures(context, limb, points, motion.lift.q[-1], is_free, 1)):
        return ""
    T_base_lifted = limb.pose(motion.lift.q[-1])
    return f"transport: {no_place(context, limb, points, T_base_lifted)}"


def _is_like(grasp: Grasp, failed: Grasp) -> bool:
    """Whether a grasp is about one that was tried in vain."""
    if grasp.arm != failed.arm:
        return False
    T, T_failed = grasp.T_base_hand, failed.T_base_hand
    turn = np.arccos(np.clip((np.trace(T.R.T @ T_failed.R) - 1.0) / 2.0, -1.0, 1.0))
    return bool(np.linalg.norm(T.p - T_failed.p) < _ALIKE and turn < _ALIKE_TURN)


def _mostly_far(rejections: Mapping[str, int]) -> bool:
    """Whether most poses were ruled out because no arm gets there."""
    far = sum(n for why, n in rejections.items() if why.startswith("no arm gets"))
    return 2 * far > sum(rejections.values())


def _ordered(
    grasps: list[Grasp], triage: Triage, failed: Sequence[Grasp] = ()
) -> tuple[Grasp, ...]:
    """Put the preferred hand first among grasps that are about as good.

    What failed on the object once is likely to fail elsewhere on it: a grip with
    another prototype comes before.
    """
    preferred = triage.arms[0] if triage.arms else None
    n_failed = Counter({id(grasp): grasp.prototype for grasp in failed}.values())

    def worth(grasp: Grasp) -> float:
        liked = _PREFERRED if grasp.arm == preferred else 0.0
        return _kept(grasp) + liked - _REPEATED * n_failed[grasp.prototype]

    return tuple(sorted(grasps, key=worth, reverse=True))


def _kept(grasp: Grasp) -> float:
    """How likely a grasp is to hold an object all the way to where it is put down.

    Below zero for what is overloaded.
    """
    success = grasp.success
    if success is None:
        return grasp.rank
    kept = grasp.rank * success.steady
    return kept if success.squeezed >= _FELT else min(kept, success.squeezed)


def _grasp_facts(grasp: Grasp) -> dict[str, object]:
    return {
        "prototype": grasp.prototype,
        "arm": grasp.arm,
        "score": round(grasp.score, 4),
        "width": round(grasp.width, 4),
        "gripper": grasp.gripper,
        "preshape": grasp.preshape,
        "opening": round(grasp.opening, 4),
        "pose": np.round(grasp.T_base_hand.matrix, 5).tolist(),
    }


def plan_motion(context: Context) -> StepResult:
    """Find the first grasp whose whole chain of motions is feasible."""
    cycle = context.cycle
    assert cycle.plan is not None
    assert cycle.seen is not None
    for limb in context.limbs.values():
        fault = misplaced(context.posture(limb), limb.limits.controller, limb.name)
        if fault is not None:
            return fault
    settings = context.settings
    config = MotionsConfig(
        lift=(0.0, 0.0, settings.lift), tries=6, clamp=settings.clamp
    )
    space = room_for(context, context.limbs.values(), unknown=UnknownSpace.HIDDEN)
    passage = Passage(
        space.measured_points,
        cycle.plan.object_points,
        cycle.plan.grippers,
        along=cycle.plan.kin_points,
    )
    found = first_executable(
        cycle.plan.plan,
        context.model,
        space,
        passage=passage,
        present=context.joint_values(),
        known={
            name: limb.ways
            for name, limb in context.limbs.items()
            if limb.ways is not None
        },
        config=config,
        accepted=lambda motion: _no_drop(context, motion, space),
        rng=context.rng,
    )
    if found.chosen is None:
        reasons = [reason for _, reason in found.passed_over]
        is_far = all(MotionStatus.NO_GOAL_POSTURE.value in r for r in reasons)
        name = "unreachable" if is_far else "plan_collision"
        return FaultFound(name, found.why_none)
    if _is_put_off(context, cycle.plan.plan.grasps[found.chosen.index :]):
        return Done({"put_off": _grasp_facts(found.chosen.grasp)}, State.SELECT)
    cycle.motion = found.chosen
    limb, path = context.limbs[found.chosen.arm], found.chosen.reach.path
    assert path is not None
    before = path[:0] if limb.ways is None else limb.ways
    limb.ways = np.concatenate([before, path[1:]])[-_KNOWN:]
    seconds = {k: round(v.duration, 3) for k, v in found.chosen.trajectories.items()}
    return Done(
        {
            "grasp": found.chosen.index,
            "passed_over": [list(p) for p in found.passed_over],
            "seconds": seconds,
            **_grasp_facts(found.chosen.grasp),
        }
    )
