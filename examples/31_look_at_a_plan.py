"""Show a plan and the motion of its first feasible grasp in the browser.

Serves a page until Ctrl-C; with --once it ends as soon as the page is up. Needs the
extra `viz`.

Run: python examples/31_look_at_a_plan.py [CAPTURE] [--once]
"""

from __future__ import annotations

import sys

import debrisgrasp
from debrisgrasp.api import plan_motion
from debrisgrasp.io import data_path
from debrisgrasp.viewer import show


def main() -> None:
    arguments = [word for word in sys.argv[1:] if word != "--once"]
    path = arguments[0] if arguments else data_path("captures", "pile.npz")
    result = debrisgrasp.plan(debrisgrasp.Capture.load(path))
    motions = plan_motion(result)
    with show(result, motions=motions) as viewer:
        print(f"{len(result.plan.grasps)} grasps; open {viewer.url}", flush=True)
        if "--once" not in sys.argv:
            viewer.wait()


if __name__ == "__main__":
    main()
