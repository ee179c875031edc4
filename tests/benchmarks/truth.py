"""Grasps held against the true geometry of fresh piles, their hidden sides included.

Run: python -m tests.benchmarks.truth [--json FILE]

A grasp is right if the open hand enters no body, nor the ground, by more than 5 mm, and
the space between the fingers holds one body, the one that the grasp is for.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

import debrisgrasp
from debrisgrasp.cli.tables import columns
from debrisgrasp.planning import Grasp
from debrisgrasp.prototypes import GripperModel

from .piles import FreshPile, fresh_piles
from .report import arguments, begin, publish

FIRST_SEED, PILES = 9000, 16
TOLERANCE = 0.005
SPACING = 0.006
SHARE_OF_ONE = 0.9
N_BEST = 5


def filling(solid) -> np.ndarray:
    """Points of a lattice inside a solid, with those of its surface mesh (n, 3)."""
    lower, upper = solid.bounds.lower, solid.bounds.upper
    axes = [
        np.arange(a, b + SPACING, SPACING) for a, b in zip(lower, upper, strict=True)
    ]
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return np.concatenate([lattice[solid.contains(lattice)], solid.mesh()[0]])


def depth_in(pile: FreshPile, points: np.ndarray) -> np.ndarray:
    """How deep points lie in each body, and in the ground last [m], (bodies + 1, n).

    Outside a body it is only told that they are.
    """
    world = pile.settled.world
    depth = np.full((len(world.bodies) + 1, len(points)), -1.0)
    for row, body in enumerate(world.bodies):
        for part in body.solids:
            near = np.flatnonzero(part.bounds.contains(points))
            inside = -part.signed_distance(points[near])
            depth[row, near] = np.maximum(depth[row, near], inside)
    depth[-1] = world.ground.height(points[:, :2]) - points[:, 2]
    return depth


def intended(pile: FreshPile, labels: np.ndarray, label: int) -> int:
    """Index of the body that most pixels of a segment show; -1 if it is the ground."""
    truth = pile.labels[labels == label]
    counts = np.bincount(truth[truth >= 0], minlength=1)
    return int(counts.argmax()) - 1


def verdict(pile: FreshPile, gripper: GripperModel, grasp: Grasp, body: int) -> str:
    """What is wrong with a grasp, or "right"."""
    names = [*(b.kind for b in pile.settled.world.bodies), "the ground"]
    hand = np.concatenate(
        [filling(solid) for solid in gripper.solids(grasp.preshape, grasp.opening)]
    )
    depth = depth_in(pile, grasp.T_base_hand.apply(hand))
    worst = depth.max(axis=1)
    if worst.max() > TOLERANCE:
        hit = int(worst.argmax())
        whose = "its own object" if hit == body else names[hit]
        return f"hand {1e3 * worst.max():.0f} mm in {whose}"
    between = filling(gripper.closing_region(grasp.preshape, grasp.opening))
    held = (depth_in(pile, grasp.T_base_hand.apply(between)) > 0).sum(axis=1)
    if held.sum() < 5:
        return "nothing between the fingers"
    first = int(held.argmax())
    if first != body:
        return f"holds {names[first]}"
    if held[first] < SHARE_OF_ONE * held.sum():
        others = held.copy()
        others[first] = 0
        return f"holds {names[int(others.argmax())]} too"
    return "right"


def main() -> None:
    options = arguments(__doc__ or "")
    pipeline = debrisgrasp.Pipeline(robot="roman")
    rows, verdicts, first, empty = [], Counter(), 0, 0
    for pile in fresh_piles(range(FIRST_SEED, FIRST_SEED + PILES)):
        result = pipeline.plan(pile.noisy)
        plan = result.plan
        labels = np.zeros(pile.labels.size, dtype=int)
        labels[result.cloud.pixels] = result.segmentation.labels
        labels = labels.reshape(pile.labels.shape)
        body = intended(pile, labels, plan.object_label)
        found = [
            verdict(pile, result.grippers[grasp.gripper], grasp, body)
            for grasp in plan.grasps[:N_BEST]
        ]
        empty += not found
        first += bool(found) and found[0] == "right"
        verdicts.update(found)
        kind = "the ground" if body < 0 else pile.settled.world.bodies[body].kind
        wrong = "; ".join(v for v in dict.fromkeys(found) if v != "right")
        rows.append(
            [str(pile.seed), kind, f"{found.count('right')}/{len(found)}", wrong]
        )
    print(columns(["pile", "object", "right", "what is wrong"], rows))
    print()
    offered = sum(verdicts.values())
    figures = {
        "piles": float(PILES),
        "right_share_top5": verdicts["right"] / max(offered, 1),
        "right_share_top1": first / PILES,
        "piles_without_grasp": float(empty),
    }
    publish(figures, options.json)


if __name__ == "__main__":
    begin(main)
