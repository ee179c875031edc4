"""The command ``ik``: joints for palm poses."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray, require_metres
from debrisgrasp._unreadable import UNREADABLE_ARRAY, why_unreadable
from debrisgrasp._words import arm_called
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.io import read_json
from debrisgrasp.io.camera_pose import require_radians
from debrisgrasp.io.plan_json import SCHEMA, load_plan
from debrisgrasp.kinematics import (
    ArmReach,
    IkResult,
    IkStatus,
    solve,
    solve_distinct,
)

from .arm_arguments import add_arm, chosen_arms, require_carried
from .tables import columns, is_number

__all__ = ["add"]


def add(parser: argparse.ArgumentParser) -> None:
    """Add ``ik``."""
    parser.description = (
        "Solve palm poses in the base frame. The palm's z axis is its "
        "approach. Nothing around the robot is known here; whether it touches itself "
        "is told. Exit status 1 if no pose is solved."
    )
    parser.add_argument(
        "poses",
        nargs="+",
        metavar="POSE",
        help="x y z roll pitch yaw (metres, radians; six numbers a pose), or a file: "
        "grasps.json, JSON with 4x4 matrices, or .npz with T_base_hand",
    )
    add_arm(parser)
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    arms = chosen_arms(arguments)
    T, grippers = _poses(arguments.poses)
    require_carried(arms, grippers)
    answers = []
    for arm in arms:
        mine = [i for i, g in enumerate(grippers) if g in (None, arm.gripper)]
        if mine:
            found = solve(
                arm.chain,
                SE3(T[mine]),
                q_seed=arm.q_present,
                reach_map=arm.reach_map,
                rng=np.random.default_rng(0),
                config=arm.config.ik,
            )
            answers += _answers(arm, mine, _untangled(arm, SE3(T[mine]), found))
    answers.sort(key=lambda answer: answer["pose"])
    if arguments.json:
        print(json.dumps(answers, indent=1, allow_nan=False))
    else:
        print(_table(answers))
    return 0 if any(a["status"] == "solved" for a in answers) else 1


def _untangled(arm: ArmReach, T_base_hand: SE3, found: IkResult) -> IkResult:
    """Replace postures in which the robot touches itself, where others don't."""
    touching = np.flatnonzero(found.is_solved & arm.collision.hits_itself(found.q))
    if not len(touching):
        return found
    others = solve_distinct(
        arm.chain,
        SE3(T_base_hand.matrix[touching]),
        _ALTERNATIVES,
        reach_map=arm.reach_map,
        rng=np.random.default_rng(0),
        config=arm.config.ik,
    )
    is_free = others.is_solved & ~arm.collision.hits_itself(others.q)
    first, has_free = is_free.argmax(axis=1), is_free.any(axis=1)
    rows, picks = touching[has_free], (np.flatnonzero(has_free), first[has_free])
    fields = {
        name: getattr(found, name).copy()
        for name in ("q", "position_error", "rotation_error")
    }
    for name, values in fields.items():
        values[rows] = getattr(others, name)[picks]
    return replace(found, **fields)


def _answers(
    arm: ArmReach, index: Sequence[int], found: IkResult
) -> list[dict[str, Any]]:
    return [
        {
            "pose": i + 1,
            "arm": arm.name,
            "status": IkStatus(int(found.status[row])).name.lower(),
            "position_error": round(float(found.position_error[row]), 9),
            "rotation_error": round(float(found.rotation_error[row]), 9),
            "touches": [
                list(pair) for pair in arm.collision.self_contacts(found.q[row])
            ]
            if found.is_solved[row]
            else [],
            "joints": {
                name: round(value, 9)
                for name, value in arm.chain.named(found.q[row]).items()
            },
        }
        for row, i in enumerate(index)
    ]


_ALTERNATIVES = 24
"""Postures of a pose among which one without self-collision is sought."""


def _table(answers: Sequence[dict[str, Any]]) -> str:
    lines = []
    for a in answers:
        touching = "; ".join(" and ".join(pair) for pair in a["touches"][:2])
        is_solved = a["status"] == "solved"
        joints = " ".join(f"{v:.4f}" for v in a["joints"].values())
        lines.append(
            [
                str(a["pose"]),
                a["arm"],
                a["status"],
                f"{1e3 * a['position_error']:.3g}",
                f"{1e3 * a['rotation_error']:.3g}",
                (touching or "nothing") if is_solved else "-",
                joints if is_solved else "-",
            ]
        )
    header = ["pose", "arm", "status", "off [mm]", "off [mrad]", "robot touches"]
    names = {a["arm"]: ", ".join(a["joints"]) for a in answers}
    text = columns([*header, "joints [rad or m]"], lines)
    return text + "".join(
        f"\njoints of the {arm_called(k)}: {v}" for k, v in names.items()
    )


def _poses(words: Sequence[str]) -> tuple[FloatArray, list[str | None]]:
    """Poses (n, 4, 4) from the command line, and the gripper each is for."""
    if len(words) == 1 and all(map(is_number, words[0].split(","))):
        words = words[0].split(",")
    if len(words) == 1 and not is_number(words[0]):
        return _poses_of_file(Path(words[0]))
    if len(words) % 6 or not all(map(is_number, words)):
        raise InputError(
            "poses",
            got=f"{len(words)} words: {' '.join(words)}",
            expected="six numbers a pose (x y z roll pitch yaw), or one file",
        )
    values = np.array([float(word) for word in words]).reshape(-1, 6)
    require_radians(values[:, 3:], "pose")
    T = SE3.from_parts(so3.from_rpy(values[:, 3:]), values[:, :3]).matrix
    return _checked(T), [None] * len(T)


def _poses_of_file(path: Path) -> tuple[FloatArray, list[str | None]]:
    if path.suffix.lower() == ".npz":
        try:
            with np.load(path, allow_pickle=False) as arrays:
                content: Any = arrays["T_base_hand"]
        except UNREADABLE_ARRAY as error:
            raise ConfigError(
                str(path),
                got=why_unreadable(error),
                expected="a .npz with T_base_hand, (n, 4, 4)",
            ) from error
    else:
        content = read_json(path)
        if isinstance(content, dict) and content.get("schema") == SCHEMA:
            grasps = load_plan(path).grasps
            T = np.array([g.T_base_hand.matrix for g in grasps]).reshape(-1, 4, 4)
            return _require_some(T, path), [g.gripper for g in grasps]
        if isinstance(content, dict):
            content = content.get("poses", content)
    T = _matrices(content)
    if T.ndim != 3 or T.shape[1:] != (4, 4):
        raise ConfigError(
            f"poses in {path}",
            got=f"shape {T.shape}" if T.size else "no numbers of one shape",
            expected="one or several 4x4 matrices",
        )
    return _require_some(_checked(T), path), [None] * len(T)


def _matrices(content: Any) -> FloatArray:
    """Content of a file as an array, of no size if it is none."""
    try:
        T = np.asarray(content, dtype=np.float64)
    except (TypeError, ValueError):
        return np.zeros(0)
    return T[None] if T.ndim == 2 else T


def _require_some(T: FloatArray, path: Path) -> FloatArray:
    if not len(T):
        raise ConfigError(str(path), got="no pose", expected="at least one")
    return T


def _checked(T: FloatArray) -> FloatArray:
    require_metres("pose", T[:, :3, 3])
    return T
