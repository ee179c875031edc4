"""The command ``reach``: what the arms can grip, and where the base should go."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3, Bounds, lattice
from debrisgrasp.io.plan_json import load_plan
from debrisgrasp.kinematics import (
    APPROACHES,
    ArmReach,
    BasePlacement,
    ReachSurvey,
    base_placements,
    grid_places,
    palm_poses,
    survey_reach,
)
from debrisgrasp.planning import Grasp

from .arm_arguments import add_arm, chosen_arms, require_carried
from .reports import REPORT_FORMS, add_reports, require_places, telling_written
from .tables import columns
from .values import add_region, region_of, some_path

__all__ = ["add"]

_N_PLACES = 900
"""About so many places of a region are tried."""
_N_PLACEMENTS = 6
_MAP_STEP = 0.1


def add(parser: argparse.ArgumentParser) -> None:
    """Add ``reach``."""
    parser.description = (
        "Tell which part of a region each arm can grip from above, at 45 "
        "degrees and frontally, and rank places for the base. Nothing around the robot "
        "is known here. Exit status 1 if no arm can grip anything of the region."
    )
    add_arm(parser)
    add_region(parser, "box that is asked for (default: all around)")
    parser.add_argument(
        "--grasps",
        type=some_path,
        metavar="FILE",
        help="rank places for the base by the grasps of a plan instead of the region",
    )
    add_reports(parser, "maps")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    arms = chosen_arms(arguments)
    require_places(arguments.report, REPORT_FORMS, source=arguments.grasps)
    region, grasps = region_of(arguments), _grasps(arguments.grasps)
    if grasps:
        require_carried(arms, [grasp.gripper for grasp in grasps])
    asked = region or _workspace(arms)
    places = grid_places(asked, _step(asked))
    rng = np.random.default_rng(0)
    surveys = [survey_reach(arm, places, rng=rng) for arm in arms]
    placements: tuple[BasePlacement, ...] = ()
    if grasps:
        placements = _placements_for_grasps(arms, grasps, rng)
    elif region is not None:
        placements = _placements_for_region(arms, region, rng)
    rows = _survey_rows(surveys)
    with telling_written(*arguments.report):
        if arguments.report:
            _write_reports(arguments.report, arms, region, asked, rows, rng)
    if arguments.json:
        print(json.dumps(_facts(asked, surveys, placements), indent=1))
    else:
        print(f"{len(places)} places in {_box(asked)}, {_step(asked):.2g} m apart:\n")
        print(columns(rows[0], rows[1:]))
        if placements:
            print("\nplaces for the base (present base frame), best first:\n")
            table = _placement_rows(placements)
            print(columns(table[0], table[1:]))
        if arguments.report:
            print("\nwrote " + ", ".join(map(str, arguments.report)))
    return 0 if any(survey.is_free.any() for survey in surveys) else 1


def _survey_rows(surveys: Sequence[ReachSurvey]) -> list[list[str]]:
    if len(surveys) == 2:
        surveys = [*surveys, surveys[0].joined(surveys[1])]
    rows = [["arm", "approach", "places", "free", "directions", "within [m]"]]
    for survey in surveys:
        for k, approach in enumerate(survey.approaches):
            part = survey.part(k)
            reached = survey.is_reached[:, survey.kind == k].any(axis=1)
            rows.append(
                [
                    survey.arm,
                    approach.name,
                    f"{100 * reached.mean():.0f} %",
                    f"{100 * (survey.share(k) > 0).mean():.0f} %",
                    f"{100 * survey.share(k).mean():.0f} %",
                    "-" if part is None else _box(part),
                ]
            )
    return rows


def _placement_rows(placements: Sequence[BasePlacement]) -> list[list[str]]:
    rows = [["x [m]", "y [m]", "turn [deg]", "gripped", "travel [m]", ""]]
    shown = [*placements[:_N_PLACEMENTS]]
    shown += [p for p in placements[_N_PLACEMENTS:] if not p.travel]
    rows += [
        [
            f"{p.x:z.2f}",
            f"{p.y:z.2f}",
            f"{np.rad2deg(p.yaw):z.0f}",
            f"{100 * p.share:.0f} %",
            f"{p.travel:.2f}",
            "" if p.travel else "where it stands",
        ]
        for p in shown
    ]
    return rows


def _facts(
    asked: Bounds, surveys: Sequence[ReachSurvey], placements: Sequence[BasePlacement]
) -> dict[str, Any]:
    arms = {}
    for survey in surveys:
        arms[survey.arm] = {
            approach.name: {
                "reached": round(
                    float(survey.is_reached[:, survey.kind == k].any(axis=1).mean()), 4
                ),
                "free": round(float((survey.share(k) > 0).mean()), 4),
                "directions": round(float(survey.share(k).mean()), 4),
                "share": survey.share(k).round(4).tolist(),
            }
            for k, approach in enumerate(survey.approaches)
        }
    return {
        "region": [*asked.lower.round(6).tolist(), *asked.upper.round(6).tolist()],
        "places": surveys[0].places.round(6).tolist(),
        "arms": arms,
        "base": [
            {
                "x": round(p.x, 6),
                "y": round(p.y, 6),
                "yaw": round(p.yaw, 6),
                "share": round(p.share, 4),
                "travel": round(p.travel, 4),
            }
            for p in placements
        ],
    }


def _placements_for_region(
    arms: Sequence[ArmReach], region: Bounds, rng: np.random.Generator
) -> tuple[BasePlacement, ...]:
    places = grid_places(region, max(float(np.cbrt(np.prod(region.size) / 60)), 0.02))
    directions = np.concatenate([a.directions for a in APPROACHES])
    T = palm_poses(places, directions, 0.06).matrix.reshape(-1, 4, 4)
    return base_placements(arms, SE3(T), keep_out=places, rng=rng)


def _grasps(path: Path | None) -> tuple[Grasp, ...]:
    """Grasps of a plan; none if there is no file."""
    if path is None:
        return ()
    grasps = load_plan(path).grasps
    if not grasps:
        raise ConfigError(str(path), got="no grasp", expected="at least one")
    return grasps


def _placements_for_grasps(
    arms: Sequence[ArmReach], grasps: Sequence[Grasp], rng: np.random.Generator
) -> tuple[BasePlacement, ...]:
    T = SE3(np.array([grasp.T_base_hand.matrix for grasp in grasps]))
    grippers = [grasp.gripper for grasp in grasps]
    return base_placements(arms, T, grippers=grippers, rng=rng)


def _write_reports(
    paths: Sequence[Path],
    arms: Sequence[ArmReach],
    region: Bounds | None,
    asked: Bounds,
    rows: list[list[str]],
    rng: np.random.Generator,
) -> None:
    viz = import_module("debrisgrasp.viz")  # takes a second to load
    around = _workspace(arms)
    heights = np.linspace(max(asked.lower[2], around.lower[2]), asked.upper[2], 4)
    if region is None:
        heights = np.linspace(around.lower[2], 0.75 * around.upper[2], 4)
    x, y = (
        np.arange(around.lower[k], around.upper[k] + _MAP_STEP / 2, _MAP_STEP)
        for k in (0, 1)
    )
    z = np.arange(around.lower[2], around.upper[2] + _MAP_STEP / 2, _MAP_STEP)
    level = lattice(x, y, heights).reshape(-1, 3)
    middle = 0.5 * (asked.lower + asked.upper)[1]
    upright = lattice(x, [middle], z).reshape(-1, 3)
    picture = viz.ReachPicture(
        title=f"Reach of {arms[0].robot.name}",
        summary="share of approach directions that a palm can take, robot at rest, "
        "nothing around it",
        robot=arms[0].robot,
        level=tuple(survey_reach(arm, level, n_turns=1, rng=rng) for arm in arms),
        upright=tuple(survey_reach(arm, upright, n_turns=1, rng=rng) for arm in arms),
        region=region,
        rows=rows,
    )
    writers = {".png": viz.reach_png, ".html": viz.reach_html}
    for path in paths:
        writers[path.suffix.lower()](path, picture)


def _workspace(arms: Sequence[ArmReach]) -> Bounds:
    """Box around what the arms' palms reach, above the ground."""
    rng = np.random.default_rng(0)
    p = np.concatenate([a.chain.fk(a.chain.sampled(20_000, rng=rng)).p for a in arms])
    low, high = np.floor(p.min(axis=0) * 10) / 10, np.ceil(p.max(axis=0) * 10) / 10
    return Bounds(np.array([*low[:2], max(low[2], 0.0)]), high)


def _step(region: Bounds) -> float:
    return float(np.clip(np.cbrt(np.prod(region.size) / _N_PLACES), 0.02, 0.5))


def _box(bounds: Bounds) -> str:
    pairs = zip("xyz", bounds.lower, bounds.upper, strict=True)
    return ", ".join(f"{axis} {low:.2f} to {high:.2f}" for axis, low, high in pairs)
