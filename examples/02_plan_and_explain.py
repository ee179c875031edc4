"""Plan grasps for the RoMan robot and ask the plan for its reasons.

Run: python examples/02_plan_and_explain.py [CAPTURE]
"""

import sys

import debrisgrasp
from debrisgrasp.io import data_path


def main() -> None:
    path = sys.argv[1] if len(sys.argv) > 1 else data_path("captures", "pile.npz")
    capture = debrisgrasp.Capture.load(path)

    # Robot, hands and dictionary are loaded once; then capture after capture.
    pipeline = debrisgrasp.Pipeline(robot="roman")
    plan = pipeline.plan(capture, seed=0).plan

    for note in plan.notes:
        print(f"note: {note}")
    for passed in plan.passed_over:
        print(f"passed over object {passed.label}: {passed.reason}")
    if plan.why_empty:
        print(plan.why_empty)
        return

    best = plan.grasps[0]
    x, y, z = best.T_base_hand.p
    print(f"grip object {plan.object_label} with the {best.arm} arm's {best.gripper},")
    print(f"fingers {best.preshape}, {100 * best.opening:.0f} cm open,")
    print(f"palm at x {x:.2f}, y {y:.2f}, z {z:.2f} m:")
    print(f"  it looks like a {best.prototype} (S = {best.S:.2f}),")
    print(f"  the hand has room (C = {best.C:.2f}), the arm reaches (R = {best.R:.0f})")
    print(f"  joints: {', '.join(f'{q:.2f}' for q in (best.joints or {}).values())}")
    print("ruled out on the way:")
    for reason, count in plan.rejections.items():
        print(f"  {count:4d} {reason}")


if __name__ == "__main__":
    main()
