"""Clear a small pile with the robot in memory, and say what became of each try.

The robot, its sensors and the pile exist in memory only; the executive does not know
that. Whoever implements the protocols of `debrisgrasp.robot` runs the same code. A
folder that holds a run already is refused, so that no record is lost.

Run: python examples/15_clear_a_pile.py [FOLDER]
"""

import sys
import tempfile
from pathlib import Path

from debrisgrasp import api
from debrisgrasp.errors import DebrisGraspError
from debrisgrasp.executive import SimulatedTask, load_run
from debrisgrasp.viz.run import run_html


def main() -> None:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp()) / "run"
    task = SimulatedTask(objects=2, seed=12, max_removals=1)
    done = api.clear(task, record=folder)
    for attempt in done.result.attempts:
        fate = "removed" if attempt.is_removed else "not removed"
        faults = ", ".join(event.fault for event in attempt.faults) or "no fault"
        print(f"attempt {attempt.number}: {attempt.prototype}, {fate}, {faults}")
    for name, reason in done.result.left.items():
        print(f"stays: {name}: {reason}")
    print(f"{done.result.end.value}; really removed: {', '.join(done.truth.removed)}")
    run_html(folder.parent / "run.html", load_run(folder))
    print(f"wrote {folder} and {folder.parent / 'run.html'}")


if __name__ == "__main__":
    try:
        main()
    except DebrisGraspError as error:
        sys.exit(f"error: {error}")
