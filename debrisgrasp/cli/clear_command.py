"""``clear``: the whole task on the robot in memory."""

from __future__ import annotations

import argparse
import json
import os
from typing import TYPE_CHECKING

from debrisgrasp._files import is_yaml
from debrisgrasp._words import arm_called, counted
from debrisgrasp.errors import OutputError
from debrisgrasp.settings import Settings

from .commands import version
from .reports import PAGE_FORMS, print_written, require_places
from .site_arguments import add_site
from .tables import columns
from .task_files import contents_of
from .values import add_region, count, number, region_of, seed, some_path

if TYPE_CHECKING:
    from debrisgrasp.executive.record import MemoryRecord, RunRecord
    from debrisgrasp.executive.simulated import Simulated, SimulatedTask
    from debrisgrasp.pipeline import Pipeline

__all__ = ["add"]


def add(parser: argparse.ArgumentParser) -> None:
    """Add ``clear``."""
    parser.description = (
        "Take objects one after another from a pile and carry them to the "
        "drop-off, until nothing that can be removed is left."
    )
    parser.add_argument(
        "--scene",
        metavar="NAME",
        help="one of the paper's scenes: wood_on_truss, block_on_wood, "
        "crate_with_handle or hedgehog",
    )
    parser.add_argument(
        "--objects",
        type=count(1, 50),
        metavar="K",
        help="bodies of a drawn pile (1 to 50; default: 3 to 8)",
    )
    parser.add_argument("--seed", type=seed, help="default: the site's, or 0")
    add_site(parser)
    parser.add_argument(
        "--robot", help="a shipped robot or a YAML file (default: the site's, or roman)"
    )
    parser.add_argument("--arm", help="use only this arm")
    parser.add_argument("--gripper", help="use only this hand")
    one_object = parser.add_mutually_exclusive_group()
    add_region(
        one_object,
        "take only the object in this box, also with prototypes for special objects, "
        "such as handles",
        "0.85 -0.3 0.19 1.35 0.3 0.5 for the handle in --scene crate_with_handle",
    )
    one_object.add_argument(
        "--mask",
        type=some_path,
        metavar="CAPTURE",
        help="take only the object that the mask of this capture (.npz) shows",
    )
    parser.add_argument(
        "--faults",
        metavar="A,B@STATE",
        help="faults to inject, each at a state or where it usually shows; "
        "'list' prints all faults and states",
    )
    parser.add_argument(
        "--max-removals", type=count(1, 10_000), metavar="N", help="stop after so many"
    )
    parser.add_argument(
        "--drive-over",
        type=number,
        default=0.10,
        metavar="M",
        help="leave what is measured at least 1 cm lower than this [m] (default: 0.10)",
    )
    parser.add_argument(
        "--pushes",
        type=count(0, 100),
        default=20,
        metavar="N",
        help="push so often aside what no hand can hold; 0: never (default: 20)",
    )
    parser.add_argument(
        "--record",
        type=some_path,
        metavar="DIR",
        help="folder for the record of the run",
    )
    parser.add_argument(
        "--report", type=some_path, metavar="FILE", help="page of the run as .html"
    )
    parser.add_argument(
        "--json", action="store_true", help="print JSON for machines instead of text"
    )
    parser.set_defaults(run=_clear)


def _clear(arguments: argparse.Namespace) -> int:
    from debrisgrasp.executive.record import MemoryRecord, RunRecord

    from .live import ToldRun  # slow to load

    if arguments.faults == "list":
        return _list_faults(as_json=arguments.json)
    region_of(arguments)
    task = _task(arguments)
    # Whatever can be wrong is found before any work is done.
    pipeline = task.pipeline()
    settings = task.settings(pipeline)
    require_places([arguments.report], PAGE_FORMS)
    contents = contents_of(task)
    inputs = {**task.to_json(), "version": version(), "contents": contents}
    record: RunRecord | MemoryRecord = MemoryRecord(inputs)
    if arguments.record:
        record = RunRecord(arguments.record, inputs)
    told = ToldRun(record) if arguments.json else ToldRun(record, _print_now)
    done = task.run(told, pipeline=pipeline, settings=settings)
    # What became of the run is told first, whatever of it can't be written.
    _print_now(json.dumps(_facts(done)) if arguments.json else _summary(done))
    _keep(record, arguments, pipeline)
    end = done.result.end.value
    return {"cleared": 0, "finished": 0, "interrupted": 130}.get(end, 1)


def _keep(
    record: RunRecord | MemoryRecord, arguments: argparse.Namespace, pipeline: Pipeline
) -> None:
    """Write the page, and say what was written; raise if the record is cut short."""
    from debrisgrasp.executive.record import RunRecord, load_run

    if isinstance(record, RunRecord) and not (arguments.json or record.fault):
        print_written(record.folder)
    if arguments.report:
        from debrisgrasp.viz.run import run_html  # slow to load

        stored = load_run(record.folder) if isinstance(record, RunRecord) else record
        run_html(arguments.report, stored, grippers=pipeline.grippers)
        if not arguments.json:
            print_written(arguments.report)
    if isinstance(record, RunRecord) and record.fault:
        raise OutputError(
            record.folder,
            record.fault,
            f"It has {load_run(record.folder).reached}, and the run went on. Make "
            "room, and clear again with another record: equal tasks give equal runs.",
        )


def _print_now(words: str) -> None:
    """Print, also to a pipe."""
    print(words, flush=True)


def _list_faults(*, as_json: bool) -> int:
    """Print what ``--faults`` may name."""
    from debrisgrasp.executive import FAULTS, State
    from debrisgrasp.robot import INJECTABLE

    specs = (FAULTS[name] for name in INJECTABLE)
    rows = [[spec.name, spec.fault_class.value, spec.words] for spec in specs]
    if as_json:
        names = ("fault", "class", "means")
        faults = [dict(zip(names, row, strict=True)) for row in rows]
        states = [state.value for state in State]
        print(json.dumps({"faults": faults, "states": states}))
        return 0
    print(columns(["fault", "class", "means"], rows))
    print("\nstates: " + ", ".join(state.value for state in State))
    return 0


def _task(arguments: argparse.Namespace) -> SimulatedTask:
    from debrisgrasp.executive.simulated import SimulatedTask

    number = arguments.seed
    if number is None:
        number = 0 if arguments.site is None else Settings.load(arguments.site).seed
    return SimulatedTask(
        scene=arguments.scene,
        objects=arguments.objects,
        seed=number,
        site=None if arguments.site is None else os.path.realpath(arguments.site),
        robot=_robot_of(arguments.robot),
        gripper=arguments.gripper,
        arms=() if arguments.arm is None else (arguments.arm,),
        mask=None if arguments.mask is None else os.path.realpath(arguments.mask),
        region=None if arguments.region is None else tuple(arguments.region),
        faults=() if arguments.faults is None else tuple(arguments.faults.split(",")),
        max_removals=arguments.max_removals,
        drive_over=arguments.drive_over,
        pushes=arguments.pushes,
    )


def _robot_of(given: str | None) -> str | None:
    """Name of a robot, or where its file is: a record is replayed from anywhere."""
    return os.path.realpath(given) if given and is_yaml(given) else given


def _facts(done: Simulated) -> dict[str, object]:
    result = done.result
    return {
        "end": result.end.value,
        "class": result.counted_as,
        "removed": list(done.truth.removed),
        "attempts": len(result.attempts),
        "faults": [event.fault for event in result.faults],
        "injected": list(done.happened),
        "not_injected": list(done.missed),
        "left": dict(result.left),
        "still_held": result.holding,
        "not_stopped": list(result.silent),
        "seconds": round(result.duration, 3),
    }


def _summary(done: Simulated) -> str:
    result = done.result
    lines = [f"left: {name}: {reason}" for name, reason in result.left.items()]
    lines += [f"NOT STOPPED: {words}" for words in result.silent]
    if result.holding is not None:
        words = f"the hand of the {arm_called(result.holding)} still holds something"
        lines.append(f"STILL HELD: {words}; support it before the hand is opened")
    if done.missed:
        missed = ", ".join(done.missed)
        lines.append(f"not injected, for it never came to that: {missed}")
    failure, counted_as = result.fault_class, result.counted_as
    done_so_far = f"{result.n_removed} removed"
    if result.n_pushed:
        done_so_far += f", {counted(result.n_pushed, 'time')} pushed aside"
    lines.append(
        f"{result.end.value} after {result.duration:.0f} s of the robot's time: "
        f"{done_so_far}; "
        + (f"counts as {counted_as}" if counted_as else "not counted")
    )
    if failure is not None and counted_as and result.faults:
        lines.append(f"ended by: {result.faults[-1].message}")
    if result.is_nothing_there:
        lines.append("nothing was taken: nothing lies in the way")
    if result.is_all_driven_over:
        lines.append(
            "nothing was taken: all that lies in the way is low enough to stay; with a "
            "lower --drive-over, in metres, it is taken"
        )
    return "\n".join(lines)
