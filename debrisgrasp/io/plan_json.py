"""Plans as JSON, the same plan always as the same bytes."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import numpy as np

from debrisgrasp._arrays import require_metres, require_range, rounded
from debrisgrasp._files import (
    naming_fields,
    read_schema,
    require_own,
    write_atomic,
)
from debrisgrasp.geometry import SE3, Bounds
from debrisgrasp.planning import (
    SUCCESS_TERMS,
    Advice,
    LoadForecast,
    Retreat,
    SuccessForecast,
)
from debrisgrasp.planning.plan import Grasp, GraspPlan, PassedOver

__all__ = ["SCHEMA", "load_plan", "plan_to_dict", "plan_to_json", "save_plan"]

SCHEMA = "debrisgrasp/grasps/1"
_WIDEST, _FARTHEST = 2.0, 1e3
"""No hand opens wider [m], and no joint is farther from zero [rad or m]."""
_DIGITS = 9
_DIGITS_OF_DISTANCE = 6
"""Fewer, so that 16 cm between rounded poses are still 0.16."""
_rounded = partial(rounded, digits=_DIGITS)
_INTERVALS = ("mass", "force", "torque", "grip", "margins")
_NUMBERS = ("lever", "lever_error", "tilt", "margin")
"""Fields of a `LoadForecast`."""


def plan_to_dict(plan: GraspPlan) -> dict[str, Any]:
    """Plan as JSON values; numbers rounded to 1e-9, times left out."""
    region = plan.region
    return {
        "schema": SCHEMA,
        "frame": "base",
        "robot": plan.robot,
        "seed": plan.seed,
        "object": plan.object_label,
        "region": None
        if region is None
        else {"lower": _rounded(region.lower), "upper": _rounded(region.upper)},
        "grasps": [_grasp_to_dict(grasp) for grasp in plan.grasps],
        "effective_samples": _rounded(plan.effective_samples),
        "why_empty": plan.why_empty,
        "rejections": {reason: int(n) for reason, n in plan.rejections.items()},
        "notes": list(plan.notes),
        "passed_over": [
            {"object": passed.label, "reason": passed.reason}
            for passed in plan.passed_over
        ],
        "advice": [_advice_to_dict(advice) for advice in plan.advice],
    }


def plan_to_json(plan: GraspPlan) -> str:
    """Plan as the text of its file."""
    return json.dumps(plan_to_dict(plan), indent=1, allow_nan=False) + "\n"


def save_plan(plan: GraspPlan, path: str | os.PathLike[str]) -> None:
    """Write a plan, whole or not at all.

    Raises
    ------
    ConfigError
        If the file's name does not end in .json.
    OutputError
        If it can't be written, or a file is there that is no plan.
    """
    require_own(path, SCHEMA, "a plan")
    write_atomic(path, plan_to_json(plan))


def load_plan(path: str | os.PathLike[str]) -> GraspPlan:
    """Read a plan back.

    Raises
    ------
    ConfigError
        Naming the file and the field that is missing or wrong.
    """
    content = read_schema(path, SCHEMA)
    with naming_fields(path, SCHEMA):
        return _plan_from_dict(content)


def _grasp_to_dict(grasp: Grasp) -> dict[str, Any]:
    joints = grasp.joints
    # What follows from numbers follows from those that are written: else a plan that
    # was read would be other bytes.
    grasp = replace(
        grasp,
        T_base_hand=SE3(_rounded(grasp.T_base_hand.matrix)),
        T_base_pregrasp=SE3(_rounded(grasp.T_base_pregrasp.matrix)),
        **{name: _rounded(getattr(grasp, name)) for name in "SCR"},
    )
    return {
        "pose": grasp.T_base_hand.matrix.tolist(),
        "gripper": grasp.gripper,
        "preshape": grasp.preshape,
        "opening": _rounded(grasp.opening),
        "width": _rounded(grasp.width),
        "prototype": grasp.prototype,
        "Q": _rounded(grasp.Q),
        "S": grasp.S,
        "C": grasp.C,
        "R": grasp.R,
        "coverage": _rounded(grasp.coverage),
        "support": grasp.support,
        "expected": _rounded(grasp.expected),
        "score": _rounded(grasp.score),
        "approach": {
            "pregrasp": grasp.T_base_pregrasp.matrix.tolist(),
            "distance": round(grasp.approach_distance, _DIGITS_OF_DISTANCE),
        },
        "arm": grasp.arm,
        "joints": None
        if joints is None
        else {name: _rounded(value) for name, value in joints.items()},
        "object": grasp.object_label,
        "retreat": None if grasp.retreat is None else _plain(grasp.retreat),
        "load": None if grasp.load is None else _load_to_dict(grasp.load),
        "success": None if grasp.success is None else _success_to_dict(grasp.success),
    }


def _success_to_dict(success: SuccessForecast) -> dict[str, Any]:
    return {
        "probability": _rounded(success.probability),
        "terms": {
            name: _rounded(term)
            for name, term in zip(SUCCESS_TERMS, success.terms, strict=False)
        },
        "outside": list(success.outside),
        "squeezed": _rounded(success.squeezed),
    }


def _success_from_dict(content: dict[str, Any]) -> SuccessForecast:
    # What other models forecast from has no place among the terms of this one.
    told = content["terms"]
    is_ours = isinstance(told, dict) and set(told) == set(SUCCESS_TERMS)
    return SuccessForecast(
        probability=_share(content, "probability"),
        terms=tuple(float(told[name]) for name in SUCCESS_TERMS) if is_ours else (),
        outside=tuple(str(name) for name in content["outside"]),
        squeezed=_share({"squeezed": 1.0, **content}, "squeezed"),
    )


def _load_to_dict(load: LoadForecast) -> dict[str, Any]:
    numbers = {name: _rounded(getattr(load, name)) for name in _INTERVALS + _NUMBERS}
    return {"build": load.build, **numbers, "limit": load.limit}


def _load_from_dict(content: dict[str, Any]) -> LoadForecast:
    values: dict[str, Any] = {name: float(content[name]) for name in _NUMBERS}
    for name in _INTERVALS:
        low, high = content[name]
        values[name] = (float(low), float(high))
    values |= {name: str(content[name]) for name in ("build", "limit")}
    return LoadForecast(**values)


def _plan_from_dict(content: dict[str, Any]) -> GraspPlan:
    region, frame = content["region"], content["frame"]
    if frame != "base":
        raise ValueError(f"frame is {frame!r}, not 'base'")
    return GraspPlan(
        grasps=tuple(_grasp_from_dict(grasp) for grasp in content["grasps"]),
        object_label=int(content["object"]),
        region=None
        if region is None
        else Bounds(np.array(region["lower"]), np.array(region["upper"])),
        robot=str(content["robot"]),
        seed=int(content["seed"]),
        rejections={str(k): int(n) for k, n in content["rejections"].items()},
        notes=tuple(str(note) for note in content.get("notes", [])),
        passed_over=tuple(
            PassedOver(int(passed["object"]), str(passed["reason"]))
            for passed in content["passed_over"]
        ),
        effective_samples=float(content.get("effective_samples", 0.0)),
        why_empty=content["why_empty"],
        advice=tuple(
            Advice(
                kind=str(advice["kind"]),
                text=str(advice["text"]),
                freed=int(advice["freed"]),
                of=int(advice["of"]),
                change={str(k): float(v) for k, v in advice["change"].items()},
            )
            for advice in content.get("advice", [])
        ),
    )


def _plain(retreat: Retreat) -> dict[str, Any]:
    return {name: _rounded(value) for name, value in asdict(retreat).items()}


def _retreat_from_dict(content: dict[str, Any]) -> Retreat:
    x, y, z = content["direction"]
    numbers = ("overlap", "hand_free", "lift_overlap", "lift_hand_free")
    return Retreat(
        direction=(float(x), float(y), float(z)),
        **{name: float(content[name]) for name in numbers},
    )


def _advice_to_dict(advice: Advice) -> dict[str, Any]:
    return {
        "kind": advice.kind,
        "text": advice.text,
        "freed": advice.freed,
        "of": advice.of,
        "change": {name: _rounded(value) for name, value in advice.change.items()},
    }


def _pose(matrix: Any, name: str) -> SE3:
    pose = SE3.from_matrix(matrix, name)
    require_metres(f"place of a {name}", pose.p)
    # The nearest rotation would differ in the last digit when it is written again.
    is_rounded = np.allclose(matrix, pose.matrix, rtol=0.0, atol=10.0**-_DIGITS)
    return SE3(matrix) if is_rounded else pose


def _share(content: dict[str, Any], name: str) -> float:
    """Read a number from 0 to 1."""
    share = float(content[name])
    require_range(f"{name} of a grasp", share, 0.0, 1.0)
    return share


def _gap(content: dict[str, Any], name: str) -> float:
    """Distance between finger pads."""
    gap = float(content[name])
    require_range(f"{name} of a grasp [m]", gap, 0.0, _WIDEST)
    return gap


def _joints(content: dict[str, Any]) -> dict[str, float]:
    joints = {str(name): float(value) for name, value in content.items()}
    for name, value in joints.items():
        require_range(f"joint {name} of a grasp", value, -_FARTHEST, _FARTHEST)
    return joints


def _grasp_from_dict(content: dict[str, Any]) -> Grasp:
    joints, arm = content["joints"], content["arm"]
    if not (arm is None or isinstance(arm, str)):
        raise ValueError(f"arm is {arm!r}, not a name")
    return Grasp(
        T_base_hand=_pose(content["pose"], "pose"),
        T_base_pregrasp=_pose(content["approach"]["pregrasp"], "pregrasp"),
        gripper=str(content["gripper"]),
        preshape=str(content["preshape"]),
        opening=_gap(content, "opening"),
        width=_gap(content, "width"),
        prototype=str(content["prototype"]),
        S=_share(content, "S"),
        C=_share(content, "C"),
        R=_share(content, "R"),
        # Files of earlier versions do not have these.
        coverage=_share({"coverage": 0.0, **content}, "coverage"),
        support=int(content.get("support", 0)),
        expected=_share({"expected": content["score"], **content}, "expected"),
        score=_share(content, "score"),
        arm=arm,
        joints=None if joints is None else _joints(joints),
        object_label=int(content["object"]),
        load=None if content.get("load") is None else _load_from_dict(content["load"]),
        retreat=None
        if content.get("retreat") is None
        else _retreat_from_dict(content["retreat"]),
        success=None
        if content.get("success") is None
        else _success_from_dict(content["success"]),
    )
