"""Calibrations as JSON; a new one never replaces an old one, which is kept beside."""

from __future__ import annotations

import json
import os
import platform
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray, frozen, rounded
from debrisgrasp._files import naming_fields, read_schema, read_text, write_atomic
from debrisgrasp.calibration import (
    BEFORE_CAMERA,
    CalibratedCamera,
    Calibration,
    Head,
    displacement,
)
from debrisgrasp.calibration.uncertainty import checked_covariance
from debrisgrasp.errors import ConfigError, OutputError
from debrisgrasp.geometry import SE3, so3

__all__ = [
    "SCHEMA",
    "StoredCalibration",
    "calibration_to_dict",
    "difference",
    "load_calibration",
    "save_calibration",
]

SCHEMA = "debrisgrasp/calibration/1"
_EXPECTED = "a calibration: the JSON file that `debrisgrasp calibrate --out` writes"
_rounded = partial(rounded, digits=12)
_CONVENTION = (
    "T_true = exp(twist) @ T_{0}_camera; twist = (vx, vy, vz, wx, wy, wz) "
    "[m, rad], linear part first, about the origin of {0}, in {0} axes"
)
_HEAD_CONVENTION = (
    "mount twist (v, w) [m, rad] in the camera frame, "
    "T_base_camera @ exp(twist), then the offsets of the joints [rad]"
)


def calibration_to_dict(
    calibration: Calibration,
    *,
    date: datetime,
    T_base_shoulder: SE3 | None = None,
    robot: str | None = None,
    fiducial: str | Sequence[float] | None = None,
) -> dict[str, Any]:
    """Calibration as JSON values.

    Parameters
    ----------
    calibration
        Result to write.
    date
        When it was made.
    T_base_shoulder
        Pose of the link that carries arm and camera, if it is not the base.
    robot
        Name of the robot, where it is known.
    fiducial
        Its link, or where it was said to stand in base [m].
    """
    c = calibration
    pose, frame = c.T_link_camera, "base" if c.link is None else "link"
    shoulder = None
    if T_base_shoulder is not None:
        shoulder = _rounded((T_base_shoulder.inverse() @ pose).matrix)
    return {
        "schema": SCHEMA,
        "date": date.astimezone(UTC).isoformat(timespec="seconds"),
        "robot": robot,
        "accepted": c.decision.accepted,
        "findings": [
            {"problem": f.problem, "remedy": f.remedy} for f in c.decision.findings
        ],
        "notes": list(c.decision.notes),
        "link": c.link,
        # Under another name, so that none takes it for the camera's pose in base.
        f"T_{frame}_camera": _rounded(pose.matrix),
        "T_shoulder_camera": shoulder,
        "covariance": _rounded(c.covariance, digits=18),
        "covariance_convention": _CONVENTION.format(frame),
        "predicted_error": {
            "rms": _rounded(c.error.rms),
            "worst": _rounded(c.error.worst),
            "worst_at": _rounded(c.error.worst_at),
            "lower": _rounded(c.error.bounds.lower),
            "upper": _rounded(c.error.bounds.upper),
        },
        "rmse": _rounded(c.rmse),
        "lever": _rounded(c.lever),
        "model": c.model,
        "why_model": c.why_model,
        "attempts": [
            {
                "model": a.model,
                "used": a.n_used,
                "chi_square": _rounded(a.chi_square),
                "degrees_of_freedom": a.degrees_of_freedom,
                "p_value": a.p_value,
            }
            for a in c.attempts
        ],
        "fiducial": fiducial if isinstance(fiducial, str | None) else list(fiducial),
        "fiducial_shift": _rounded(c.fiducial),
        "fiducial_covariance": _rounded(c.fit_covariance[-3:], digits=18),
        "head": _head_to_dict(c),
        "observations": _observations_to_list(c),
        "kinematic_sigma": c.observations.kinematic_sigma,
        "versions": {
            "python": platform.python_version(),
            **{name: version(name) for name in ("debrisgrasp", "numpy", "scipy")},
        },
    }


def save_calibration(
    path: str | os.PathLike[str], content: Mapping[str, Any]
) -> tuple[dict[str, Any] | None, Path | None]:
    """Write a calibration; one that is there already moves aside first.

    Returns
    -------
    difference, kept
        How far the new one is from the old one (see `difference`), which is in the file
        too, and where the old one is now; both None if there was none.

    Raises
    ------
    OutputError
        If it can't be written; nothing is lost then.
    ConfigError
        If what is there is no calibration, or one of a camera elsewhere.
    """
    path = Path(path)
    if not path.exists():
        write_atomic(path, _text(content))
        return None, None
    old = load_calibration(path)
    link = content.get("link")
    if old.link != link:
        raise ConfigError(
            f"calibration {path}, which would be replaced",
            got=f"one of a camera on {old.link or 'no link of an arm'}",
            expected=f"one of a camera on {link or 'no link of an arm'}",
            mend="Give another file.",
        )
    change = difference(old, content)
    kept = _beside(path, old.date)
    write_atomic(kept, read_text(path))
    write_atomic(
        path, _text({**content, "previous": {"file": kept.name, "difference": change}})
    )
    return change, kept


def difference(old: StoredCalibration, new: Mapping[str, Any]) -> dict[str, Any]:
    """How far two calibrations are apart, and whether their covariances explain it."""
    T_old = old.T_link_camera
    T_new = SE3.from_matrix(
        new["T_base_camera" if old.link is None else "T_link_camera"]
    )
    moved = displacement(T_old, T_new)
    if old.link is not None:  # by points in front of the camera, in its frame
        moved = displacement(SE3.identity(), T_old.inverse() @ T_new, BEFORE_CAMERA)
    change = T_new @ T_old.inverse()
    covariance = old.covariance + np.array(new["covariance"])
    twist = change.log()
    spread = float(np.sqrt(twist @ np.linalg.solve(covariance, twist) / 6.0))
    turn = float(np.linalg.norm(so3.log(T_old.R.T @ T_new.R)))
    return {
        "translation": _rounded(np.linalg.norm(T_new.p - T_old.p)),
        "rotation": _rounded(turn),
        "workspace_rms": _rounded(np.sqrt(np.mean(moved**2))),
        "workspace_worst": _rounded(moved.max()),
        "in_standard_deviations": round(spread, 3),
    }


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StoredCalibration(CalibratedCamera):
    """What a calibration's file says about the camera."""

    fiducial_given: str | tuple[float, ...] | None
    """Its link, or where it was said to stand in base [m]; None if that is not known.
    """
    date: str
    robot: str | None
    """Name of the robot; None if it was not known."""
    problems: tuple[str, ...]
    """Why it was refused; empty if it was accepted."""
    path: Path

    def __repr__(self) -> str:
        refused = "refused: " + "; ".join(self.problems)
        decision = refused if self.problems else "accepted"
        return f"<StoredCalibration {self.path}, {decision}>"

    @property
    def _called(self) -> str:
        return f"calibration {self.path}"

    def require_accepted(self) -> None:
        """Raise `ConfigError` if the calibration was refused."""
        if self.problems:
            raise ConfigError(
                self._called,
                got="one that was refused: " + "; ".join(self.problems),
                expected="an accepted one",
                mend="Calibrate again."
                + (
                    " To look at a scene nevertheless, give the file as --camera-pose."
                    if self.link is None
                    else ""
                ),
            )

    def require_of(self, robot: str) -> None:
        """Raise `ConfigError` if the calibration names another robot than this."""
        if self.robot not in (None, robot):
            raise ConfigError(
                self._called,
                got=f"one of the robot {self.robot!r}",
                expected=f"one of {robot!r}, the robot in use",
                mend="Name its robot with --robot, or as `robot` of the site.",
            )


def load_calibration(path: str | os.PathLike[str]) -> StoredCalibration:
    """Read a calibration back, accepted or not.

    Raises
    ------
    ConfigError
        Naming the file and the field that is missing or wrong.
    """
    path = Path(path)
    try:
        content = read_schema(path, SCHEMA)
    except ConfigError as error:
        raise ConfigError(error.what, got=error.got, expected=_EXPECTED) from error
    with naming_fields(path, SCHEMA):
        return _stored(content, path)


def _stored(content: dict[str, Any], path: Path) -> StoredCalibration:
    head = content["head"]
    names = tuple(map(str, head["joints"]))
    k = len(names)
    problems = tuple(str(f["problem"]) for f in content["findings"])
    if content["accepted"] is not True:
        problems = problems or ("no reason given",)
    link, given = content.get("link"), content.get("fiducial")
    pose = "T_base_camera" if link is None else "T_link_camera"
    return StoredCalibration(
        T_link_camera=SE3.from_matrix(content[pose], pose),
        link=None if link is None else str(link),
        fiducial_given=tuple(map(float, given)) if isinstance(given, list) else given,
        covariance=checked_covariance(content["covariance"], "covariance", 6),
        head=Head(
            T_base_camera_at_zero=SE3.from_matrix(
                head["T_base_camera_at_zero"], "T_base_camera_at_zero"
            ),
            axes=np.array(head["axes"], dtype=np.float64).reshape(-1, 3),
            points=np.array(head["points"], dtype=np.float64).reshape(-1, 3),
            joint_names=names,
            offsets=np.array(head["offsets"], dtype=np.float64),
        ),
        reference=frozen(head["reference"], "reference", (k,)),
        fit_covariance=_whole_covariance(content, k),
        fiducial=frozen(content["fiducial_shift"], "fiducial_shift", (3,)),
        date=str(content["date"]),
        robot=None if content.get("robot") is None else str(content["robot"]),
        problems=problems,
        path=path,
    )


def _whole_covariance(content: dict[str, Any], k: int) -> FloatArray:
    """Read that of mount and offsets, with that of the fiducial, if it is there."""
    whole = np.zeros((9 + k, 9 + k))
    of_head = content["head"]["covariance"]
    whole[:-3, :-3] = checked_covariance(of_head, "covariance of the head", 6 + k)
    if "fiducial_covariance" in content:
        rows = frozen(content["fiducial_covariance"], "fiducial_covariance", (3, 9 + k))
        whole[-3:], whole[:, -3:] = rows, rows.T
    return checked_covariance(whole, "covariance with that of the fiducial", 9 + k)


def _head_to_dict(calibration: Calibration) -> dict[str, Any]:
    head = calibration.head
    return {
        "joints": list(head.joint_names),
        "reference": _rounded(calibration.reference),
        "offsets": _rounded(np.asarray(head.offsets)),
        "T_base_camera_at_zero": _rounded(head.T_base_camera_at_zero.matrix),
        "axes": _rounded(head.axes),
        "points": _rounded(head.points),
        "covariance": _rounded(calibration.head_covariance, digits=18),
        "covariance_convention": _HEAD_CONVENTION,
    }


def _observations_to_list(calibration: Calibration) -> list[dict[str, Any]]:
    seen = calibration.observations
    return [
        {
            "name": name,
            "position": _rounded(seen.points_base[i]),
            "point": _rounded(seen.points_camera[i]),
            "sigma": _rounded(np.asarray(seen.sigmas)[i]),
            "head": _rounded(seen.readings[i]),
            "residual": _rounded(calibration.gaps[i]),
            "held_out_error": _rounded(calibration.held_out[i]),
            "outlier": bool(calibration.is_outlier[i]),
        }
        for i, name in enumerate(seen.names)
    ]


def _beside(path: Path, date: str) -> Path:
    """Free name beside a file, with the date of what is in it."""
    stamp = re.sub(r"[^0-9A-Za-z]+", "-", date.split("+")[0]).strip("-") or "undated"
    for number in range(1, 1000):
        suffix = "" if number == 1 else f"-{number}"
        kept = path.with_name(f"{path.stem}.{stamp}{suffix}{path.suffix}")
        if not kept.exists():
            return kept
    raise OutputError(path, "a thousand older ones lie beside it already")


def _text(content: Mapping[str, Any]) -> str:
    return json.dumps(content, indent=1, allow_nan=False) + "\n"
