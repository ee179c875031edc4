"""Whatever goes wrong in a step is a fault with evidence, and never an exception."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

from debrisgrasp._words import arm_called
from debrisgrasp.errors import DriverError
from debrisgrasp.robot.kinds import odd_answers, odd_base, odd_head

from .context import Context
from .result import FaultFound, FaultRaised, StepResult

__all__ = ["guarded", "nonsense"]


def guarded(context: Context, step: Callable[[], StepResult]) -> StepResult:
    """Run something; whatever it raises becomes a fault with evidence.

    What a step trips over while a device answers in another kind than its protocol asks
    for is that device's fault, and else our software's.
    """
    try:
        return step()
    except FaultRaised as raised:
        return raised.found
    except DriverError as error:
        return FaultFound("connection_lost", str(error))
    except (Exception, SystemExit) as error:  # noqa: BLE001 - a robot survives software
        found = nonsense(context) or _raised_by_driver(context, error)
        if found is not None:
            return found
        at = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(at.filename).name}, line {at.lineno}, in {at.name}"
        words = f"{type(error).__name__} in {where}: {error}"
        return FaultFound("software_error", words)


def nonsense(context: Context) -> FaultFound | None:
    """Name a device at rest whose answers are not of the kind that is asked for."""
    for name, limb in context.robot.limbs.items():
        used = context.limbs.get(name)
        n_fingers = None if used is None else len(used.hand.fingers)
        odd = _first(odd_answers(limb, n_fingers))
        if odd:
            words = f"a driver of the {arm_called(name)} sends nonsense: {odd}"
            return FaultFound("connection_lost", words, name)
    head, base = context.robot.head, context.base
    for called, odd in (
        ("head", "" if head is None else _first(odd_head(head))),
        ("base", "" if base is None else _first(odd_base(base))),
    ):
        if odd:
            words = f"the driver of the {called} sends nonsense: {odd}"
            return FaultFound("connection_lost", words)
    return None


def _raised_by_driver(context: Context, error: BaseException) -> FaultFound | None:
    """Name the device, of somebody's own, in whose code an error came up."""
    robot = context.robot
    drivers: dict[int, tuple[str, str | None]] = {
        id(robot.camera): ("camera", None),
        id(robot.head): ("head", None),
        id(robot.base): ("base", None),
    }
    for name, limb in robot.limbs.items():
        called = arm_called(name)
        drivers[id(limb.arm)] = called, name
        drivers[id(limb.sensor)] = f"force sensor of the {called}", name
        drivers[id(limb.gripper)] = f"gripper of the {called}", name
    for frame, _ in traceback.walk_tb(error.__traceback__):
        own = frame.f_locals.get("self")
        is_ours = type(own).__module__.partition(".")[0] == "debrisgrasp"
        if own is not None and not is_ours and id(own) in drivers:
            called, arm = drivers[id(own)]
            words = f"the driver of the {called} raises {type(error).__name__}: {error}"
            return FaultFound("connection_lost", words, arm)
    return None


def _first(found: Iterator[str]) -> str:
    """Return what is said first, or what kept it from being said."""
    try:
        return next(found, "")
    except DriverError as error:
        return str(error)
    except Exception as error:  # noqa: BLE001 - a driver may raise anything
        return f"it raises {type(error).__name__}: {error}"
