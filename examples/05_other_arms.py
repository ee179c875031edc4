"""Plan on one capture for other arms: Panda, UR10, and the humanoid TALOS.

Each is a text file in examples/robots; their URDFs come with the extra `robots`.

Run: python examples/05_other_arms.py [ROBOT.yaml ...] [--reports DIR]
"""

import argparse
from pathlib import Path

import debrisgrasp
from debrisgrasp.io import data_path
from debrisgrasp.viz import Report, report_png

HERE = Path(__file__).parent


def draw(result: debrisgrasp.PlanningResult, path: Path) -> None:
    title = f"{result.plan.robot} on {result.capture.name}"
    report_png(path, Report.of(result, title))
    print(f"  wrote {path}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    shipped = sorted((HERE / "robots").glob("*.yaml"))
    parser.add_argument("robots", nargs="*", type=Path, default=shipped)
    parser.add_argument("--reports", type=Path, help="folder for a picture of each")
    arguments = parser.parse_args()
    capture = debrisgrasp.Capture.load(data_path("captures", "pile.npz"))
    seen = None
    for path in arguments.robots:
        pipeline = debrisgrasp.Pipeline(
            robot=str(path),
            grippers=HERE / "grippers",
            prototypes=HERE / "jaw_prototypes",
        )
        # What is seen doesn't depend on the robot: look once.
        seen = seen or pipeline.perceive(capture)
        result = pipeline.plan(seen, seed=0)
        plan = result.plan
        print(f"{plan.robot}: {len(plan.grasps)} grasps on object {plan.object_label}")
        for passed in plan.passed_over:
            print(f"  passed over object {passed.label}: {passed.reason}")
        if not plan.grasps:
            print(f"  {plan.why_empty}")
            continue
        best = plan.grasps[0]
        print(f"  best: {best.prototype}, Q {best.Q:.2f}, with the joints")
        print("  " + ", ".join(f"{q:.2f}" for q in (best.joints or {}).values()))
        if arguments.reports:
            arguments.reports.mkdir(parents=True, exist_ok=True)
            draw(result, arguments.reports / f"{plan.robot}.png")


if __name__ == "__main__":
    main()
