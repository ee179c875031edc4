"""Observations of a fiducial as people write them down: YAML, JSON or CSV."""

from __future__ import annotations

import csv
import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import Any

from debrisgrasp._fields import require_distinct
from debrisgrasp._files import (
    read_json,
    read_text,
    read_yaml,
    require_suffix,
    write_atomic,
)
from debrisgrasp._unreadable import why_not_there
from debrisgrasp.errors import ConfigError, OutputError

__all__ = [
    "SCHEMA",
    "ObservationFile",
    "ObservationRow",
    "load_observations",
    "observations_to_dict",
    "require_unfilled",
    "save_observations",
]

SCHEMA = "debrisgrasp/observations/1"
_BASE = ("base_x", "base_y", "base_z")
_CAMERA = ("camera_x", "camera_y", "camera_z")

Vector = tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservationRow:
    """One look at the fiducial."""

    name: str
    point: Vector | None = None
    """Where the camera has it, optical frame [m], three numbers; None as long as it has
    not been measured."""
    joints: Mapping[str, float] = field(default_factory=dict)
    """Joint values by name [rad or m], of the arm, the head, or both."""
    position: Vector | None = None
    """Where the arm has it, base frame [m]; None to compute it from the joints."""
    sigma: Vector | None = None
    """Standard deviation of the measurement [m], one number or three; None: as in the
    file's head."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservationFile:
    """All looks of one session, and the robot they were made with."""

    rows: tuple[ObservationRow, ...]
    robot: str | None = None
    """Name of a shipped robot, or path of a robot's file."""
    fiducial: str | Vector | None = None
    """Link of the robot at whose origin the fiducial sits; or, of one that stands still
    before a camera that an arm carries, its place in base [m], three numbers."""
    fiducial_sigma: float | None = None
    """How well that is known: standard deviation of each coordinate [m]."""
    sigma: float | None = None
    kinematic_sigma: float | None = None


def load_observations(path: str | os.PathLike[str]) -> ObservationFile:
    """Read observations (docs/calibration.md has the formats).

    Raises
    ------
    ConfigError
        Naming the file, the observation and the field that is wrong.
    """
    path = Path(path)
    match path.suffix.lower():
        case ".csv":
            return _from_csv(path)
        case ".json":
            return _from_mapping(read_json(path), path)
        case ".yaml" | ".yml":
            return _from_mapping(read_yaml(path), path)
    raise ConfigError(
        "kind of observations file",
        got=f"suffix {path.suffix!r}",
        expected=".yaml, .json or .csv",
    )


def observations_to_dict(given: ObservationFile) -> dict[str, Any]:
    """Observations as JSON values; what isn't known is left out, but for points."""
    head = {
        "schema": SCHEMA,
        "robot": given.robot,
        "fiducial": given.fiducial,
        "fiducial_sigma": given.fiducial_sigma,
        "sigma": given.sigma,
        "kinematic_sigma": given.kinematic_sigma,
    }
    rows = [
        {
            "name": row.name,
            "joints": dict(row.joints),
            "position": row.position,
            "point": row.point,
            "sigma": row.sigma,
        }
        for row in given.rows
    ]
    content: dict[str, Any] = {k: v for k, v in head.items() if v is not None}
    content["observations"] = [
        {k: v for k, v in row.items() if k == "point" or v not in (None, {})}
        for row in rows
    ]
    return content


def save_observations(given: ObservationFile, path: str | os.PathLike[str]) -> None:
    """Write observations as JSON, which YAML readers take too."""
    content = observations_to_dict(given)
    write_atomic(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def require_unfilled(path: Path) -> None:
    """Raise if new observations would replace what was measured, or another file.

    Raises
    ------
    ConfigError
        If the file's name is not that of JSON or YAML.
    OutputError
        If a file is there that is no list of observations, or has points.
    """
    require_suffix(path, (".json", ".yaml", ".yml"), "new observations")
    if why_not_there(path, "file") or not path.stat().st_size:
        return
    try:
        rows = load_observations(path).rows
    except ConfigError as error:
        reason = "what is there is no observations to be filled in, and would be lost"
        raise OutputError(path, reason) from error
    n_filled = sum(row.point is not None for row in rows)
    if n_filled:
        raise OutputError(
            path,
            f"{n_filled} of the observations there have points, which would be lost",
            "Nothing was changed; give another place, and add its observations to "
            "these by hand.",
        )


def _from_mapping(content: Any, path: Path) -> ObservationFile:
    if not isinstance(content, dict) or not isinstance(
        content.get("observations"), list
    ):
        raise ConfigError(
            str(path),
            got=type(content).__name__
            if not isinstance(content, dict)
            else "no list of observations",
            expected="a mapping with the list `observations`",
        )
    if content.get("schema", SCHEMA) != SCHEMA:
        raise ConfigError(f"schema of {path}", got=content["schema"], expected=SCHEMA)
    sigmas = ("sigma", "kinematic_sigma", "fiducial_sigma")
    known = ("schema", "robot", "fiducial", *sigmas, "observations")
    _allow(content, known, str(path))
    rows = [
        _row(item, f"observation {number} of {path}", str(number))
        for number, item in enumerate(content["observations"], start=1)
    ]
    robot, fiducial = content.get("robot"), content.get("fiducial")
    if isinstance(fiducial, list):
        fiducial = _vector(fiducial, f"fiducial of {path}", (3,))
    elif not isinstance(fiducial, str | None):
        expected = "the name of a link, or a place in base, three numbers"
        raise ConfigError(f"fiducial of {path}", got=repr(fiducial), expected=expected)
    if not isinstance(robot, str | None):
        raise ConfigError(f"robot of {path}", got=repr(robot), expected="a name")
    stated = {
        key: _number(content[key], f"{key} of {path}")
        for key in sigmas
        if content.get(key) is not None
    }
    return ObservationFile(
        rows=_named_apart(rows, path),
        robot=robot,
        fiducial=fiducial,
        **stated,
    )


def _row(content: Any, where: str, default_name: str) -> ObservationRow:
    if not isinstance(content, dict):
        raise ConfigError(where, got=repr(content), expected="a mapping of fields")
    _allow(content, ("name", "joints", "position", "point", "sigma"), where)
    joints = content.get("joints") or {}
    if not isinstance(joints, dict):
        raise ConfigError(
            f"joints of {where}", got=repr(joints), expected="a mapping of joint names"
        )
    if not joints and content.get("position") is None:
        raise ConfigError(
            where,
            got="neither joints nor position",
            expected="joint values by name, or the fiducial's position in base",
        )
    sigma = content.get("sigma")
    if sigma is not None and not isinstance(sigma, list):
        sigma = [sigma]
    return ObservationRow(
        name=str(content.get("name", default_name)),
        point=None
        if content.get("point") is None
        else _vector(content["point"], f"point of {where}", (3,)),
        joints={
            str(name): _number(value, f"joint {name} of {where}")
            for name, value in joints.items()
        },
        position=None
        if content.get("position") is None
        else _vector(content["position"], f"position of {where}", (3,)),
        sigma=None if sigma is None else _vector(sigma, f"sigma of {where}", (1, 3)),
    )


def _from_csv(path: Path) -> ObservationFile:
    lines = [line for line in read_text(path).splitlines() if line.strip()]
    reader = csv.DictReader(StringIO("\n".join(lines)), skipinitialspace=True)
    columns = [name.strip() for name in reader.fieldnames or ()]
    reader.fieldnames = columns
    if len(columns) == 1 and ";" in columns[0]:
        raise ConfigError(
            f"columns of {path}",
            got="semicolons between them",
            expected="commas",
            mend="Export it with commas between the cells, and points in the numbers.",
        )
    if len(set(columns)) != len(columns) or not set(_CAMERA) <= set(columns):
        raise ConfigError(
            f"columns of {path}",
            got=", ".join(columns) or "none",
            expected="distinct ones, with " + ", ".join(_CAMERA),
            mend="Further columns: name, sigma, base_x, base_y, base_z, joint names.",
        )
    rows = []
    for number, cells in enumerate(reader, start=1):
        where = f"observation {number} of {path}"
        if None in cells or None in cells.values():
            raise ConfigError(
                where,
                got="a row of another length",
                expected=f"{len(columns)} cells, as in the first line",
            )
        filled = {k: v.strip() for k, v in cells.items() if v.strip()}
        content: dict[str, Any] = {"name": filled.pop("name", str(number))}
        for key, names in (("point", _CAMERA), ("position", _BASE)):
            values = [filled.pop(name, None) for name in names]
            if any(value is not None for value in values):
                content[key] = values
        if "sigma" in filled:
            content["sigma"] = filled.pop("sigma")
        content["joints"] = filled
        rows.append(_row(content, where, str(number)))
    return ObservationFile(rows=_named_apart(rows, path))


def _named_apart(
    rows: Sequence[ObservationRow], path: Path
) -> tuple[ObservationRow, ...]:
    if not rows:
        raise ConfigError(
            f"observations in {path}",
            got="none",
            expected="at least 3 to calibrate, better 8; 1 to watch for drift",
            mend="`debrisgrasp calibrate choose --out FILE` names places to measure.",
        )
    require_distinct(f"names of observations in {path}", [row.name for row in rows])
    return tuple(rows)


def _allow(content: Mapping[Any, Any], known: Iterable[str], where: str) -> None:
    for key in content:
        if key not in known:
            raise ConfigError(
                f"field {key!r} of {where}",
                got="an unknown field",
                expected="one of " + ", ".join(known),
            )


def _vector(values: Any, name: str, sizes: tuple[int, ...]) -> Vector:
    if not isinstance(values, list) or len(values) not in sizes:
        wanted = " or ".join(map(str, sizes))
        raise ConfigError(name, got=repr(values), expected=f"{wanted} numbers")
    return tuple(_number(value, name) for value in values)


def _number(value: Any, name: str) -> float:
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise ConfigError(name, got=repr(value), expected="a finite number")
    return number
