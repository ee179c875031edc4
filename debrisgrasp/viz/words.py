"""A plan in words: what was chosen, and why, and what was ruled out."""

from __future__ import annotations

import numpy as np

from debrisgrasp._words import counted
from debrisgrasp.planning import Grasp, GraspPlan
from debrisgrasp.segmentation import Segmentation

from .report import Report

__all__ = [
    "DOUBTFUL",
    "UNSURE",
    "doubt_line",
    "grasp_row",
    "headline",
    "load_rows",
    "object_doubt",
    "object_reason",
    "percent",
    "rejection_rows",
    "remarks",
    "summary",
]

UNSURE = 0.6
"""Certainty below which a segment may be several objects."""
DOUBTFUL = 0.25
"""Score of a border from which on two segments may be one object."""


def summary(report: Report) -> str:
    """One line of what was seen and found."""
    labels = report.labels
    n_objects = len({int(label) for label in labels[labels > 0]})
    n_grasps = len(report.plan.grasps)
    robot = report.plan.robot
    hand = "floating hand" if robot == "none" else f"robot {robot}"
    return (
        f"{_thousands(len(labels))} points, {counted(n_objects, 'segment')}, "
        f"{counted(n_grasps, 'grasp')}, {hand}, seed {report.plan.seed}"
    )


def doubt_line(segmentation: Segmentation) -> str:
    """Say what speaks against the pose of the camera; empty if nothing does."""
    doubt = segmentation.ground.pose_doubt
    return f"Camera pose in doubt: {doubt}" if doubt else ""


def headline(report: Report) -> str:
    """Tell the result in one sentence."""
    plan = report.plan
    if not plan.grasps and plan.passed_over:
        n = len(plan.passed_over)
        return f"No grasp: {counted(n, 'object')} considered, none offers one"
    if not plan.grasps:
        return "No grasp: " + (plan.why_empty or "no reason was recorded")
    best = plan.grasps[0]
    return (
        f"Grip {_named(plan)} with {best.prototype}, "
        f"{best.gripper} {best.preshape}: score {best.score:.2f}"
    )


def object_reason(report: Report) -> str:
    """Why the chosen object was chosen, and what its limits leave in doubt."""
    label = report.plan.object_label
    if label <= 0:
        return ""
    said = f"Object {label}"
    for place, item in enumerate(report.order, start=1):
        if item.label == label:
            said += f", number {place} in the order: {item.reason}"
    doubt = object_doubt(report.segmentation, label)
    return f"{said}. It {doubt}." if doubt else f"{said}."


def object_doubt(segmentation: Segmentation, label: int) -> str:
    """Say what an object may be part of, or made of; empty if nothing is in doubt."""
    found = []
    certainty = segmentation.segment(label).certainty
    if certainty < UNSURE:
        found.append(f"may be several objects (certainty {certainty:.2f})")
    edges = segmentation.edges
    near = np.flatnonzero((edges.labels == label).any(axis=1))
    others = {
        int(edges.labels[place].sum()) - label: edges.score[place]
        for place in near[np.argsort(-edges.score[near], kind="stable")]
        if edges.score[place] >= DOUBTFUL
    }
    if others:
        named = " or ".join(f"{other} ({score:.2f})" for other, score in others.items())
        found.append(f"may be one with object {named}")
    return " and ".join(found)


def remarks(report: Report) -> list[str]:
    """One line for each note, and for each object that was tried first and left.

    What speaks against the pose of the camera is told by `doubt_line`.
    """
    told = doubt_line(report.segmentation).lower()
    notes = [note for note in report.plan.notes if note.lower() != told]
    return [f"Note: {note}." for note in notes] + [
        f"Object {item.label} passed over: {item.reason}"
        for item in report.plan.passed_over
    ]


def rejection_rows(plan: GraspPlan) -> list[tuple[str, int]]:
    """Reasons that ruled out candidate poses, most frequent first."""
    rows = [(reason.replace("_", " "), n) for reason, n in plan.rejections.items()]
    return sorted(rows, key=lambda row: (-row[1], row[0]))


def load_rows(grasp: Grasp) -> list[tuple[str, str]]:
    """Names and values of what lifting will demand; none where it is not known."""
    load = grasp.load
    if load is None:
        return []
    mass, grip, torque = (_span(v) for v in (load.mass, load.grip, load.torque))
    return [
        ("Object", f"{load.build}, {mass} kg"),
        ("Lever", f"{1000 * load.lever:.0f} ± {1000 * load.lever_error:.0f} mm"),
        ("Squeeze", f"{grip} N"),
        ("At the wrist", f"{_span(load.force)} N, {torque} N m"),
        ("Margin", f"{load.margin:.2g} ({_span(load.margins)}), by {load.limit}"),
    ]


def _span(bounds: tuple[float, float]) -> str:
    low, high = (f"{v:.2g}" if v < 100 else f"{float(f'{v:.2g}'):.0f}" for v in bounds)
    return low if low == high else f"{low} to {high}"


def percent(part: int, whole: int) -> str:
    """Share of a count, such as ``"12 %"``; ``"<1 %"`` keeps small ones visible."""
    share = 100.0 * part / max(whole, 1)
    return "<1\u00a0%" if 0.0 < share < 1.0 else f"{share:.0f}\u00a0%"


def grasp_row(rank: int, grasp: Grasp) -> tuple[str, ...]:
    """Cells of one grasp: rank, prototype, hand, S, C, R, Q, score, opening.

    The hand is named with the arm that carries it and with its preshape.
    """
    values = (grasp.S, grasp.C, grasp.R, grasp.Q, grasp.score)
    return (
        str(rank),
        grasp.prototype,
        " ".join(filter(None, (grasp.arm, grasp.gripper, grasp.preshape))),
        *(f"{value:.2f}" for value in values),
        f"{1000 * grasp.opening:.0f} → {1000 * grasp.width:.0f} mm",
    )


def _named(plan: GraspPlan) -> str:
    return f"object {plan.object_label}" if plan.object_label > 0 else "in the region"


def _thousands(n: int) -> str:
    return f"{n:,}".replace(",", "\u202f")
