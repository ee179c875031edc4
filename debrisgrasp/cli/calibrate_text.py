"""What ``calibrate`` prints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from debrisgrasp._calibrating import PosturePlan
from debrisgrasp.calibration import Calibration

from .tables import columns

__all__ = ["change_in_words", "plan_table", "plan_to_list", "summary"]


def summary(result: Calibration, plan: PosturePlan | None) -> str:
    """Return verdict, reasons, residuals and what to do next, as text."""
    error, link = result.error, result.link
    where = "the workspace" if link is None else "what is before the camera"
    lines = [
        "accepted" if result.decision.accepted else "REFUSED",
        *(f"  {finding}" for finding in result.decision.findings),
        f"predicted error: {1e3 * error.rms:.1f} mm over {where}, "
        f"{1e3 * error.worst:.1f} mm at its worst corner",
        f"RMSE: {1e3 * result.rmse:.1f} mm (how noisy the looks are; it says nothing "
        "about the error above)",
        f"model: {result.why_model}",
        *(f"note: {note}" for note in result.decision.notes),
        "",
        columns(
            ["observation", "residual [mm]", "held out [mm]", "verdict"],
            [
                [
                    name,
                    f"{1e3 * np.linalg.norm(result.gaps[i]):.1f}",
                    f"{1e3 * result.held_out[i]:.1f}",
                    "wrong pick" if result.is_outlier[i] else "used",
                ]
                for i, name in enumerate(result.observations.names)
            ],
        ),
        "",
        "T_base_camera:" if link is None else f"T_link_camera, in link {link}:",
        *(
            "  " + "  ".join(f"{v:9.5f}" for v in row)
            for row in result.T_link_camera.matrix
        ),
    ]
    if plan is not None:
        lines += ["", "measure next:", plan_table(plan, link)]
    return "\n".join(lines)


def plan_table(plan: PosturePlan, link: str | None) -> str:
    """Return the postures, and the error after each, as a table.

    With the link of the arm that carries the camera, if one does.
    """
    header = ["posture", "x [m]", "y [m]", "z [m]", "error after [mm]", "joints"]
    rows = [
        [
            p.name,
            *(f"{v:.2f}" for v in p.place),
            f"{1e3 * error.rms:.1f}" if error.rms < 0.1 else "-",
            " ".join(f"{v:.3f}" for v in p.joints.values()),
        ]
        for p, error in zip(plan.postures, plan.choice.errors, strict=True)
    ]
    names = " ".join(plan.postures[0].joints)
    frame = "" if link is None else "\nx y z: in the frame of the camera"
    return columns(header, rows) + f"{frame}\njoints: {names}"


def plan_to_list(plan: PosturePlan | None) -> list[dict[str, Any]]:
    """Return the postures as JSON values; without a plan, none."""
    if plan is None:
        return []
    return [
        {
            "name": p.name,
            "joints": dict(p.joints),
            "place": list(p.place),
            "pixel": list(p.pixel),
            "rms_after": error.rms,
        }
        for p, error in zip(plan.postures, plan.choice.errors, strict=True)
    ]


def change_in_words(change: Mapping[str, Any], kept: Path) -> str:
    """Say how far a calibration is from the one before, which was kept."""
    return (
        f"against the one before (now {kept.name}): camera moved by "
        f"{1e3 * change['translation']:.1f} mm and "
        f"{np.rad2deg(change['rotation']):.2f} deg, points of the workspace by "
        f"{1e3 * change['workspace_rms']:.1f} mm "
        f"({change['in_standard_deviations']:.1f} standard deviations)"
    )
