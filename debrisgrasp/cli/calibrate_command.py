"""The command ``calibrate``: solve, choose postures."""

from __future__ import annotations

import argparse
import json
import os
from dataclasses import replace
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from debrisgrasp._calibrating import (
    PosturePlan,
    Rig,
    View,
    WristRig,
    choose_postures,
    information_of,
    observations_of,
    require_same_robot,
    rig_of,
)
from debrisgrasp._files import is_yaml, require_own
from debrisgrasp._words import as_text
from debrisgrasp.calibration import (
    Calibration,
    CalibrationConfig,
    Known,
    calibrate,
)
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.io.calibration_json import SCHEMA as CALIBRATION_SCHEMA
from debrisgrasp.io.calibration_json import (
    calibration_to_dict,
    load_calibration,
    save_calibration,
)
from debrisgrasp.io.observations_file import (
    ObservationFile,
    load_observations,
    require_unfilled,
    save_observations,
)

from . import marker_commands, watch_command
from .calibrate_text import change_in_words, plan_table, plan_to_list, summary
from .reports import (
    PICTURE_FORMS,
    print_written,
    require_places,
    telling_written,
)
from .rig_arguments import (
    add_fiducial_sigma,
    add_robot,
    limits_of,
    rig_given,
    view_of,
)
from .site_arguments import site_of
from .values import some_path, whole

__all__ = ["add"]

_ACTIONS = ("solve", "choose", "find", "pick", "watch")
_MOST_SUGGESTIONS = 6


def add(parser: argparse.ArgumentParser) -> None:
    """Add ``calibrate OBSERVATIONS`` and its further actions."""
    parser.description = (
        "`calibrate OBSERVATIONS` is short for `calibrate solve OBSERVATIONS`."
    )
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    _add_solve(actions)
    _add_choose(actions)
    marker_commands.add_find(actions)
    marker_commands.add_pick(actions)
    watch_command.add_watch(actions)
    parse = parser.parse_known_args

    def parse_known_args(words: Any = None, namespace: Any = None) -> Any:
        # A file in the place of the action is what to solve.
        known = (*_ACTIONS, "-h", "--help")
        if words and words[0] not in known:
            words = ["solve", *words]
        return parse(words, namespace)

    setattr(parser, "parse_known_args", parse_known_args)  # noqa: B010 - for mypy


def _add_solve(actions: Any) -> None:
    parser = actions.add_parser("solve", help="fit the camera's pose to observations")
    parser.add_argument(
        "observations", type=some_path, help="a .yaml, .json or .csv file"
    )
    add_robot(parser, "overrides the one in the observations")
    add_fiducial_sigma(parser)
    parser.add_argument(
        "--previous",
        type=some_path,
        metavar="FILE",
        help="calibration to start from: it is kept if it still fits, and a slipped "
        "head needs 3 places only",
    )
    parser.add_argument("--out", type=some_path, metavar="FILE", help="result as JSON")
    parser.add_argument(
        "--report", type=some_path, metavar="FILE", help="picture as .png"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=run_solve)


def run_solve(arguments: argparse.Namespace) -> int:
    """Calibrate; status 1 if the result is refused."""
    source = arguments.observations
    require_places([arguments.report], PICTURE_FORMS, arguments.out, source=source)
    if arguments.out:
        require_own(arguments.out, CALIBRATION_SCHEMA, "a calibration")
    given = _with_sigma(load_observations(source), arguments)
    rig = rig_given(arguments, given, source)
    previous = load_calibration(arguments.previous) if arguments.previous else None
    known = None if rig is None else Known(head=rig.head)
    if previous is not None:
        require_same_robot(previous, rig)
        known = previous.known
    observations = observations_of(given, rig)
    reference = None
    if rig is not None and len(rig.reference):
        reference = rig.reference
    site = site_of(arguments)
    config = limits_of(site, rig, given)
    result = calibrate(observations, known, reference=reference, config=config)
    plan = None
    if rig is not None and not result.decision.accepted:
        plan = _next_postures(rig, result, config, view_of(site))
        plan = plan and plan.renamed(observations.names)
    content = calibration_to_dict(
        result,
        date=datetime.now(UTC),
        T_base_shoulder=None if rig is None else rig.T_base_shoulder,
        robot=None if rig is None else rig.robot.name,
        fiducial=None if rig is None else rig.fiducial,
    )
    change, kept = None, None
    with telling_written(arguments.out, arguments.report):
        if arguments.out:
            change, kept = save_calibration(arguments.out, content)
        words = "" if change is None or kept is None else change_in_words(change, kept)
        if arguments.report:
            _draw(arguments.report, as_text(source.name), result, plan, words)
    if arguments.json:
        print(json.dumps({**content, "next": plan_to_list(plan)}, indent=1))
    else:
        print(summary(result, plan))
        if words:
            print(words)
        print_written(arguments.out, arguments.report)
    return 0 if result.decision.accepted else 1


def _with_sigma(
    given: ObservationFile, arguments: argparse.Namespace
) -> ObservationFile:
    """Observations with what the arguments say about the place of their fiducial."""
    sigma = arguments.fiducial_sigma
    return given if sigma is None else replace(given, fiducial_sigma=sigma)


def _next_postures(
    rig: Rig, result: Calibration, config: CalibrationConfig, view: View
) -> PosturePlan | None:
    """Postures that would bring a result that was refused below its limit."""
    try:
        plan = choose_postures(
            rig,
            _MOST_SUGGESTIONS,
            rng=np.random.default_rng(0),
            information=information_of(result),
            view=view,
            config=config,
        )
    except InputError:
        return None  # the robot can't show it; the refusal has said what is wrong
    needed = plan.choice.needed(config.max_rms) or _MOST_SUGGESTIONS
    return plan.shortened(max(needed, _fewest(rig, config) - _n_used(result), 1))


def _fewest(rig: Rig, config: CalibrationConfig) -> int:
    """Places that are asked for where nothing is known yet."""
    stands = isinstance(rig, WristRig)
    return config.min_places_fiducial if stands else config.min_places


def _add_choose(actions: Any) -> None:
    parser = actions.add_parser(
        "choose",
        help="postures of the arm that tell most about the camera",
        description="Choose postures that the camera sees and in which the robot "
        "touches nothing of itself. The way between them is not looked at.",
    )
    add_robot(parser, "default: the site's, or roman")
    add_fiducial_sigma(parser)
    parser.add_argument(
        "-n", type=whole, default=8, dest="count", help="how many (default: 8)"
    )
    parser.add_argument(
        "--known", type=some_path, metavar="FILE", help="calibration to add to"
    )
    parser.add_argument("--seed", type=whole, default=0, help="default: 0")
    parser.add_argument(
        "--out",
        type=some_path,
        metavar="FILE",
        help="observations to be filled in, JSON",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=run_choose)


def run_choose(arguments: argparse.Namespace) -> int:
    """Choose postures."""
    if not 1 <= arguments.count <= 100:
        raise ConfigError("-n", got=arguments.count, expected="1 to 100")
    if arguments.seed < 0:
        raise ConfigError("--seed", got=arguments.seed, expected="0 or more")
    require_places((), (), arguments.out, source=arguments.known)
    if arguments.out:
        require_unfilled(arguments.out)
    site = site_of(arguments)
    robot = site.robot
    given = _with_sigma(ObservationFile(rows=()), arguments)
    rig = rig_of(given, Path(), robot, arguments.fiducial)
    if rig is None:
        raise AssertionError("a robot is named above")
    stored = load_calibration(arguments.known) if arguments.known else None
    if stored is not None:
        require_same_robot(stored, rig)
    config = limits_of(site, rig, given)
    known = None
    if stored is not None:
        is_carried = stored.link is not None
        known = stored.head_covariance if is_carried else stored.covariance
    plan = choose_postures(
        rig,
        arguments.count,
        rng=np.random.default_rng(arguments.seed),
        information=None if known is None else np.asarray(np.linalg.inv(known)),
        T_link_camera=None if stored is None else stored.T_link_camera,
        view=view_of(site),
        config=config,
    )
    if arguments.out:
        named = str(robot)
        if is_yaml(robot) and not Path(robot).is_absolute():
            # Where the observations are read, a robot's file is sought beside them.
            named = os.path.relpath(robot, arguments.out.parent)
        todo = plan.to_file(named, rig.fiducial, arguments.fiducial_sigma)
        save_observations(todo, arguments.out)
    if arguments.json:
        print(json.dumps(plan_to_list(plan), indent=1))
        return 0
    print(plan_table(plan, rig.link if isinstance(rig, WristRig) else None))
    needed = plan.choice.needed(config.max_rms)
    fewest = _fewest(rig, config) if stored is None else 1
    if needed is None:
        print(f"\nall of them leave more than {1e3 * config.max_rms:g} mm: choose more")
    elif len(plan.postures) < fewest:
        print(f"\nfewer than {fewest} different places are refused: choose more")
    else:
        print(
            f"\nthe first {max(needed, fewest)} bring the error below "
            f"{1e3 * config.max_rms:g} mm; the more, the surer a wrong pick is found"
        )
    if arguments.out:
        print(f"wrote {arguments.out}")
    return 0


def _n_used(result: Calibration) -> int:
    return int((~result.is_outlier).sum())


def _draw(
    path: Path, name: str, result: Calibration, plan: PosturePlan | None, change: str
) -> None:
    viz: ModuleType = import_module("debrisgrasp.viz.calibration")
    suggestions = ()
    if plan is not None:
        suggestions = tuple(
            viz.Suggestion(name=p.name, place=p.place, rms_after=error.rms)
            for p, error in zip(plan.postures, plan.choice.errors, strict=True)
        )
    picture = viz.CalibrationPicture(
        title=f"Calibration from {name}",
        calibration=result,
        suggestions=suggestions,
        change=change,
    )
    viz.calibration_png(path, picture)
