"""Which object is taken next."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._words import counted
from debrisgrasp.pipeline import (
    Perception,
    is_ground,
    too_small,
)
from debrisgrasp.segmentation import Segment

from .aside import to_push
from .context import Context
from .reposition import repositioned, stepped_back
from .result import Done, FaultFound, StepResult
from .shown import never_shown, was_shown
from .states import State
from .triage import Triage, Way, judge

__all__ = ["select"]

_INSIDE = 1.0 / 3.0
"""What was seen of an object lies in the way if so much of it does."""
_UNSURE = 0.05
"""The middle of what was seen may be so far from that of an object [m]."""
_SPECK = 20
"""Fewer cells of surface than this are noise, wherever they are."""


def select(context: Context) -> StepResult:
    """Take the first object of the order that is worth a try, or find the way clear."""
    seen = context.cycle.seen
    assert seen is not None
    if seen.is_marked is not None:
        return _select_marked(context, seen)
    if context.settings.is_object_specific:
        return _not_seen(context)
    # A look aside is for what those before it did not show; of that all is said.
    before = context.shown[:-1]
    left = dict(context.left) if before else {}
    failed: list[Segment] = []
    open_: list[tuple[Segment, Triage, str]] = []
    for candidate in seen.order(context.pipeline.policy):
        segment = seen.segmentation.segment(candidate.label)
        name = _named(context, segment)
        triage = _triage(context, seen, segment)
        own = seen.cloud.points[seen.segmentation.points_of(segment.label)]
        if _not_in_the_way(context, seen, own, triage) or was_shown(before, own):
            continue
        why = context.marks.why_left(
            segment.centroid, context.n_changes, context.settings.tries
        )
        # What was tried and stays is in the way, even if no more can be done with it.
        if triage.way is Way.DRIVE_OVER or (triage.way is Way.LEAVE and not why):
            left[name] = f"{triage.way.value}: {triage.reason}"
            continue
        if triage.way is Way.DRAG:
            mark = context.marks.of(segment.centroid)
            assert mark is not None
            is_tried = mark.tries > context.settings.tries
            why = why if is_tried or mark.is_sought(context.n_changes) else ""
        if why:
            left[name] = why
            failed.append(segment)
            continue
        open_.append((segment, triage, candidate.reason))
    context.left = left
    if open_:
        marks, n = context.marks, context.n_changes
        return _chosen(
            context, *min(open_, key=lambda item: marks.turn(item[0].centroid, n))
        )
    if failed:
        pushed = to_push(context, failed)
        if pushed is not None:
            triage = replace(_triage(context, seen, pushed), way=Way.PUSH, arms=())
            words = "no hand could take what is left; it has the shortest way out"
            return replace(_chosen(context, pushed, triage, words), next=State.PUSH)
        moved = repositioned(context, [segment.centroid for segment in failed])
        if moved:
            return Done({"moved": round(moved, 3), "left": left}, State.CAPTURE)
        return _nothing_more(context, left, len(failed))
    if seen.segmentation.ground.plane is None:
        return FaultFound("empty_cloud", "no ground was seen: nothing says it is clear")
    return _clear(context, left)


def _clear(context: Context, left: dict[str, str]) -> StepResult:
    """End the task where all of the way was seen; look there, or drive back, first."""
    missing, gaze = never_shown(context)
    if gaze is not None:
        context.cycle.gaze = gaze
        return Done({"looks_at": np.round(gaze, 2).tolist()}, State.CAPTURE)
    moved = stepped_back(context, missing)
    if moved:
        share = round(missing, 3)
        seen_so_far = {"moved": round(moved, 3), "missing_share": share, "left": left}
        return Done(seen_so_far, State.CAPTURE)
    if missing > context.settings.max_dropout:
        words = f"{100 * missing:.0f} % of the workspace are in no picture, and the "
        words += "head does not turn there: nothing says that it is clear"
        return FaultFound("empty_cloud", words, None, {"missing_share": missing})
    facts = {"cleared": True, "left": left, "missing_share": round(missing, 3)}
    return Done(facts, State.CLEARED)


def _select_marked(context: Context, seen: Perception) -> StepResult:
    """Take the marked object, whatever it was divided into."""
    marked = seen.is_marked
    assert marked is not None
    own = seen.segmentation.labels[marked]
    label = int(np.bincount(own[own > 0], minlength=1).argmax())
    points = seen.cloud.points[seen.segmentation.labels == label]
    if not label or _bare_ground(context, seen, points):
        return _not_seen(context)
    segment = seen.segmentation.segment(label)
    why = context.marks.why_left(
        segment.centroid, context.n_changes, context.settings.tries
    )
    if why:
        return _nothing_more(context, {_named(context, segment): why}, 1)
    triage = replace(_triage(context, seen, segment), way=Way.PINCH, arms=())
    return _chosen(context, segment, triage, "it is the marked object")


def _not_seen(context: Context) -> StepResult:
    """Tell that the object of interest is gone, or that it never was in a picture."""
    if context.n_removed:
        return Done({"cleared": True}, State.CLEARED)
    words = "no object was seen where one was sought"
    if context.settings.region is not None:
        words = (
            f"no object was seen in the region {context.settings.region} of the "
            "base frame; move or widen it"
        )
    return FaultFound("empty_cloud", words)


def _chosen(context: Context, segment: Segment, triage: Triage, reason: str) -> Done:
    cycle = context.cycle
    cycle.label, cycle.triage, cycle.look = segment.label, triage, context.n_looks
    x, y, z = segment.centroid.tolist()
    cycle.centroid = (x, y, z)
    facts: dict[str, object] = {
        "object": segment.label,
        "look": context.n_looks,
        "centroid": np.round(segment.centroid, 4).tolist(),
        "way": triage.way.value,
        "arms": list(triage.arms),
        "why_it": reason,
        "why_so": triage.reason,
        "left": dict(context.left),
    }
    return Done(facts)


def _nothing_more(context: Context, left: dict[str, str], n_failed: int) -> FaultFound:
    """Objects remain, and none is worth another try: not clear, and honest about it."""
    context.left = left
    words = f"{counted(n_failed, 'object')} could not be taken"
    return FaultFound("no_grasp", f"no candidate is left to try: {words}")


def _named(context: Context, segment: Segment) -> str:
    """Name an object so that no other of the run has that name."""
    x, y, z = segment.centroid
    size = " x ".join(f"{100 * e:.0f}" for e in segment.extents)
    name = f"object {segment.label} of look {context.n_looks}"
    return f"{name}, {size} cm at ({x:.2f}, {y:.2f}, {z:.2f})"


def _not_in_the_way(
    context: Context, seen: Perception, points: FloatArray, triage: Triage
) -> str:
    """Why points (n, 3) that were divided off are no object in the way, or nothing."""
    config = context.pipeline.config
    # Only the side towards the camera was seen: what is behind it counts, too.
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    is_outside = not context.is_in_way(middle, _UNSURE)
    if context.is_in_way(points).mean() < _INSIDE and is_outside:
        return "outside the workspace"
    is_low = triage.way is Way.DRIVE_OVER
    least = config.min_object_points if is_low else _SPECK
    return (
        _bare_ground(context, seen, points)
        or too_small(points, config.planner.scene.spacing, least)
        or ""
    )


def _bare_ground(context: Context, seen: Perception, points: FloatArray) -> str:
    """Why points (n, 3) that were divided off are the ground itself, or nothing."""
    config = context.pipeline.config.segmentation.ground
    return is_ground(points, seen.segmentation.ground, config) or ""


def _triage(context: Context, seen: Perception, segment: Segment) -> Triage:
    plane = seen.segmentation.ground.plane
    x, y, _ = segment.centroid
    height = 0.0
    if plane is not None:
        a, b, c, d = plane
        height = float(-(a * x + b * y + d) / c)
    mark = context.marks.of(segment.centroid)
    return judge(
        segment,
        height,
        {name: limb.hand for name, limb in context.limbs.items()},
        context.settings,
        is_too_heavy=mark is not None and mark.is_heavy,
        can_drag=context.base is not None,
    )
