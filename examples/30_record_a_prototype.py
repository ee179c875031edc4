"""Record an object of a capture as a prototype, and grip it with nothing else.

Writes the prototype and a page that shows it into FOLDER (default: my_prototypes).

Run: python examples/30_record_a_prototype.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import debrisgrasp
from debrisgrasp.io import Capture, data_path
from debrisgrasp.prototypes import (
    GripperModel,
    PrototypeLibrary,
    write_new_prototype,
)
from debrisgrasp.viz import prototypes_html
from debrisgrasp.workbench import record

OBJECT = 6


def main() -> None:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "my_prototypes")
    capture = Capture.load(data_path("captures", "pile.npz"))
    hand = GripperModel.load("robotiq_3f")

    made = record(capture, "grey_part", hand, object_label=OBJECT, preshape="pinch")
    for rank, pose in enumerate(made.proposals, start=1):
        print(f"{rank}. {pose.way}: {1e3 * pose.clearance:.0f} mm clear")
    for finding in made.findings:
        print("check:", finding)
    write_new_prototype(made.definition, folder / "grey_part.yaml", force=True)

    library = PrototypeLibrary.load(folder)
    prototypes_html(folder / "prototypes.html", library, library.grippers)
    result = debrisgrasp.plan(capture, prototypes=folder, object_label=OBJECT)
    best = result.plan.grasps[0]
    print(
        f"grips object {OBJECT} with {best.prototype}: Q {best.Q:.2f}, {best.arm} arm"
    )


if __name__ == "__main__":
    main()
