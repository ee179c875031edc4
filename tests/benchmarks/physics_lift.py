"""How much less a hand bears that gives way to the wrench while it lifts.

Run: python -m tests.benchmarks.physics_lift [--n 20 --seed0 1000 --json FILE]

Two scenes, each lifted stiffly and by a hand that gives way (`TrialSpec`'s reactive
lift): a hedgehog by the first grasp of a plan, and a beam of 7.5 kg near its raised
end, across, by the stronger hand, which turns about its other end. Lifts are 40 cm,
since what the hand gives way to hangs down and has to clear the ground, in 6 s; they
are compared where the stiff one holds. Only torque can be taken off a hand: the weight
has to be carried in any case.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from debrisgrasp.cli.tables import columns
from debrisgrasp.geometry import SE3, Box
from debrisgrasp.pipeline import Pipeline
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.sim import Flight, FlightConfig, FlownGrasp, Verdict, fly, tier_scene
from debrisgrasp.trials import YIELD, TrialSpec, trial
from debrisgrasp.worlds import Body, World

from .report import begin, publish

LIFT = FlightConfig(lift=(0.0, 0.0, 0.4), lift_time=6.0)
YIELDING = replace(LIFT, compliance=YIELD)
MASS = 7.5
"""Of the beam [kg]."""
FROM_END = 0.12
"""Of the middle of the hand [m]."""
ABOVE = 0.05
"""Palm over the top of the beam [m]."""
HALF = 0.5
"""Of the stiff lift's peak torque: aimed at."""
GOOD = (Verdict.HELD, Verdict.PULLED_CLEAR)


@dataclass(frozen=True)
class Across:
    """A grasp of a beam, from above."""

    T_base_hand: SE3
    T_base_pregrasp: SE3
    opening: float
    width: float
    preshape: str = "claw"


Case = tuple[World, GripperModel, FlownGrasp]


def hedgehogs(seeds: range) -> Iterator[tuple[int, Case]]:
    """First grasps of plans."""
    pipeline = Pipeline()
    for seed in seeds:
        done = trial(TrialSpec(tier="hedgehog", seed=seed), pipeline)
        if done.grasp is not None:
            hand = pipeline.grippers[done.grasp.gripper]
            yield seed, (done.scene.world, hand, done.grasp)


def beams(seeds: range) -> Iterator[tuple[int, Case]]:
    """Beams with one end on a block, gripped near that end."""
    hand = GripperModel.load("camhand")
    for seed in seeds:
        world = tier_scene("beam_on_edge", seed).world
        k = world.index("beam")
        beam = replace(world.bodies[k], mass=MASS)
        world = replace(world, bodies=(*world.bodies[:k], beam, *world.bodies[k + 1 :]))
        grasp = across(beam, hand)
        yield seed, (world, hand, grasp)


def across(beam: Body, hand: GripperModel) -> Across:
    """Grip a beam near its raised end, square to it, from as far above as can be."""
    (part,) = beam.parts
    assert isinstance(part, Box)
    edges = beam.T_base_body.R @ part.T_frame_solid.R * part.half_extents
    longest = edges[:, np.argmax(part.half_extents)]
    half = float(np.linalg.norm(longest))
    along = longest / half * np.sign(longest[2])
    down = along[2] * along - np.array([0.0, 0.0, 1.0])
    down /= np.linalg.norm(down)
    R = np.stack([np.cross(along, down), along, down], axis=1)
    width, _, height = 2.0 * np.abs(R.T @ edges).sum(axis=1)
    end = beam.T_base_body.apply(beam.center_of_mass) + along * (half - FROM_END)
    palm = end - (height / 2 + ABOVE) * down
    return Across(
        SE3.from_parts(R, palm),
        SE3.from_parts(R, palm - 0.15 * down),
        opening=min(width + 0.05, hand.opening_range[1]),
        width=width,
    )


def compared(case: Case) -> tuple[Flight, Flight]:
    """Lift stiffly, and giving way."""
    return fly(*case, config=LIFT), fly(*case, config=YIELDING)


SCENES: dict[str, Callable[[range], Iterator[tuple[int, Case]]]] = {
    "hedgehog": hedgehogs,
    "beam": beams,
}


def main() -> None:
    """Fly both lifts and print their peaks."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--n", type=int, default=20)
    parser.add_argument("--seed0", type=int, default=1000)
    parser.add_argument("--json", type=Path, metavar="FILE")
    chosen = parser.parse_args()
    rows, figures = [], {}
    for name, cases in SCENES.items():
        torques, forces, held = [], [], [0, 0]
        for seed, case in cases(range(chosen.seed0, chosen.seed0 + chosen.n)):
            stiff, soft = compared(case)
            held = [
                n + (f.verdict in GOOD)
                for n, f in zip(held, (stiff, soft), strict=True)
            ]
            if stiff.verdict in GOOD:
                torques.append(soft.peak_torque / stiff.peak_torque)
                forces.append(soft.peak_force / stiff.peak_force)
            peaks = (
                f"{f.verdict.value}, {f.peak_torque:.1f} N m" for f in (stiff, soft)
            )
            print(f"{name} {seed}: stiff {', yielding '.join(peaks)}", flush=True)
        low, middle, high = np.quantile(torques, [0.0, 0.5, 1.0])
        figures[f"{name}_torque_ratio"] = float(middle)
        figures[f"{name}_force_ratio"] = float(np.median(forces))
        figures[f"{name}_halved_share"] = float(np.mean(np.array(torques) <= HALF))
        rows.append(
            [
                name,
                f"{held[0]}/{chosen.n}",
                f"{held[1]}/{chosen.n}",
                f"{middle:.2f} ({low:.2f} to {high:.2f})",
                f"{figures[f'{name}_halved_share']:.0%}",
                f"{figures[f'{name}_force_ratio']:.2f}",
            ]
        )
    header = ["scene", "stiff held", "yielding held"]
    header += ["torque, of the stiff lift's (0.5)", "halved", "force"]
    print("\n" + columns(header, rows) + "\n")
    publish(figures, chosen.json)


if __name__ == "__main__":
    begin(main)
