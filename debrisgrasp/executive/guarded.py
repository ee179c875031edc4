"""Whatever goes wrong in a step is a fault with evidence, and never an exception."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from pathlib import Path

from debrisgrasp.errors import DriverError

from .result import FaultFound, FaultRaised, StepResult

__all__ = ["guarded"]


def guarded(step: Callable[[], StepResult]) -> StepResult:
    """Run something; whatever it raises becomes a fault with evidence."""
    try:
        return step()
    except FaultRaised as raised:
        return raised.found
    except DriverError as error:
        return FaultFound("connection_lost", str(error))
    except (Exception, SystemExit) as error:  # noqa: BLE001 - a robot survives software
        at = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(at.filename).name}, line {at.lineno}, in {at.name}"
        words = f"{type(error).__name__} in {where}: {error}"
        return FaultFound("software_error", words)
