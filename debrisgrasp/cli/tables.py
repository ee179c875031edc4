"""Plain-text tables for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from debrisgrasp._words import counted
from debrisgrasp.planning import GraspPlan, LoadForecast

__all__ = ["columns", "is_number", "plan_summary"]


def columns(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Align cells in columns; numbers to the right, words to the left.

    Words of the last column may be long: it is ruled no further than its header.
    """
    table = [list(header), *(list(row) for row in rows)]
    widths = [max(len(row[i]) for row in table) for i in range(len(header))]
    is_right = [
        bool(rows) and all(is_number(row[i]) for row in rows)
        for i in range(len(header))
    ]
    lines = [
        "  ".join(
            cell.rjust(width) if right else cell.ljust(width)
            for cell, width, right in zip(row, widths, is_right, strict=True)
        ).rstrip()
        for row in table
    ]
    if not is_right[-1]:
        widths[-1] = len(header[-1])
    lines.insert(1, "  ".join("-" * width for width in widths).rstrip())
    return "\n".join(lines)


def is_number(text: str) -> bool:
    """Whether a word is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def plan_summary(plan: GraspPlan, limit: int = 10) -> str:
    """Table of the best grasps, and in words what was ruled out and why."""
    lines = [
        f"passed over object {p.label}: {p.reason}"
        for p in plan.passed_over
        if p.label and plan.grasps
    ]
    if plan.grasps:
        where = f"object {plan.object_label}" if plan.object_label else "the region"
        lines.append(f"{counted(len(plan.grasps), 'grasp')} on {where}, best first:")
        if plan.grasps[0].load is not None:
            lines.append(plan.grasps[0].load.in_words)
        lines.append("")
        lines.append(_grasp_table(plan, limit))
        if len(plan.grasps) > limit:
            lines.append(f"and {len(plan.grasps) - limit} more")
        loads = [g.load for g in plan.grasps[:limit] if g.load and g.load.margin < 1.0]
        if loads:
            is_known = loads[0].is_mass_known
            lines.append(_TOO_HEAVY if is_known else _OVERLOADED)
    else:
        lines.append(f"no grasp: {plan.why_empty}")
    if plan.rejections:
        lines.append("")
        lines.append("ruled out on this object:")
        ordered = sorted(plan.rejections.items(), key=lambda item: (-item[1], item[0]))
        lines.extend(f"  {count:5d}  {reason}" for reason, count in ordered)
    if plan.advice:
        lines += ["", "what would help:"]
        lines.extend(f"  {advice.text}" for advice in plan.advice)
    return "\n".join(lines)


_TOO_HEAVY = (
    "margin below 1: beyond a limit at the mass given, unless the object swings until "
    "it hangs;\nthe score counts that in, and what is within the limits comes first"
)
_OVERLOADED = (
    "margin below 1: beyond a limit if the object weighs what the middle of that range "
    "says;\nwhat it weighs is known no better, and the score counts that in"
)


def _load_cells(load: LoadForecast | None) -> list[str]:
    return ["-", "-"] if load is None else [f"{load.lever:.2f}", f"{load.margin:.2g}"]


def _grasp_table(plan: GraspPlan, limit: int) -> str:
    header = ["#", "score", "Q", "S", "C", "R", "arm", "prototype", "preshape"]
    header += ["opening [m]", "x [m]", "y [m]", "z [m]", "lever [m]", "margin"]
    rows = [
        [
            str(rank),
            *(f"{v:.2f}" for v in (g.score, g.Q, g.S, g.C, g.R)),
            g.arm or "-",
            g.prototype,
            g.preshape,
            f"{g.opening:.3f}",
            *(f"{v:z.3f}" for v in g.T_base_hand.p),
            *_load_cells(g.load),
        ]
        for rank, g in enumerate(plan.grasps[:limit], start=1)
    ]
    return columns(header, rows)
