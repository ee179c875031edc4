"""Runs for tests, in a module that other processes can import."""

from __future__ import annotations

import os
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from debrisgrasp.campaign import RunRecord

from .records import record


@dataclass(frozen=True)
class Told:
    """A run that does as it is told."""

    name: str
    outcome: str = "success"
    folder: str = ""
    """Where it leaves a mark each time that it is begun."""
    act: str = ""
    seconds: float = 0.0

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


def told(n: int, folder: Path, **changes: Any) -> list[Told]:
    return [Told(f"{i:03d}", folder=str(folder), **changes) for i in range(n)]


def begun(folder: Path) -> list[str]:
    """Names of the runs that were begun, as often as they were."""
    return sorted(path.name.split("+")[0] for path in Path(folder).glob("*+*"))


def do(spec: Told) -> RunRecord:
    mark = Path(spec.folder) / f"{spec.name}+{time.time_ns()}+{os.getpid()}"
    mark.touch()
    time.sleep(spec.seconds)
    if spec.act == "raise":
        raise ZeroDivisionError("told to")
    if spec.act == "die" or (
        spec.act == "die once" and begun(Path(spec.folder)).count(spec.name) == 1
    ):
        os._exit(9)
    if spec.act == "hang":
        time.sleep(3600)
    return record(spec.name, spec.outcome, spec=spec.to_json())
