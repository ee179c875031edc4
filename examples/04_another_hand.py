"""Bring a hand of your own: a parallel jaw as a text file, and prototypes made for it.

The hand is examples/grippers/jaw_140.yaml, its prototypes lie in jaw_prototypes: ten
that were written by hand. `adapt` makes a whole dictionary of the shapes that ship.

Run: python examples/04_another_hand.py [PICTURE.png]
"""

import sys
from pathlib import Path

import debrisgrasp
from debrisgrasp.io import data_path
from debrisgrasp.prototypes import GripperModel, PrototypeLibrary, adapt, check
from debrisgrasp.viz import prototype_png

HERE = Path(__file__).parent


def main() -> None:
    hand = GripperModel.load(HERE / "grippers/jaw_140.yaml")
    print(f"{hand.name}: {hand.description}, {hand.mass} kg, {hand.max_force:.0f} N")
    library = PrototypeLibrary.load(HERE / "jaw_prototypes", grippers={hand.name: hand})
    for prototype in library:
        faults = ", ".join(map(str, check(prototype, hand))) or "fits"
        print(f"  {prototype.name}, {1e3 * prototype.width:.0f} mm: {faults}")
    if len(sys.argv) > 1:
        prototype_png(sys.argv[1], library.prototypes, library.grippers)
        print(f"wrote {sys.argv[1]}")

    made = adapt(PrototypeLibrary.load(), hand)
    print(f"of the shapes that ship adapt makes {len(made.library)} prototypes")
    for finding in made.left_out:
        print(f"  not of {finding.prototype}: {finding}")

    pipeline = debrisgrasp.Pipeline(
        robot="none",  # the hand alone, which any arm may carry
        gripper=hand.name,
        grippers=HERE / "grippers",
        prototypes=HERE / "jaw_prototypes",
    )
    capture = debrisgrasp.Capture.load(data_path("captures", "pile.npz"))
    plan = pipeline.plan(capture, seed=0).plan
    print(f"{len(plan.grasps)} grasps on object {plan.object_label}, best first:")
    for grasp in plan.grasps[:3]:
        x, y, z = grasp.T_base_hand.p
        print(
            f"  {grasp.prototype}, {100 * grasp.opening:.0f} cm open, Q {grasp.Q:.2f}, "
            f"palm at x {x:.2f}, y {y:.2f}, z {z:.2f} m"
        )


if __name__ == "__main__":
    main()
