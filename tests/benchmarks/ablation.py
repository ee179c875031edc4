"""What each piece of evidence buys, held against the true geometry of fresh piles.

Run: python -m tests.benchmarks.ablation [--json FILE]

The same piles, seen by a noisy camera, are planned on with one piece of evidence
switched off at a time. A grasp is right as in `truth`.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

import debrisgrasp
from debrisgrasp.cli.tables import columns
from debrisgrasp.pipeline import PipelineConfig
from debrisgrasp.planning import (
    ClearanceConfig,
    PlannerConfig,
    PoseUncertainty,
    SimilarityConfig,
)

from .piles import fresh_piles
from .report import arguments, begin, publish
from .truth import intended, verdict

PILES = range(9000, 9012)
N_BEST = 5
DEFAULT = PlannerConfig()
ABLATIONS: dict[str, PlannerConfig] = {
    "all of it": DEFAULT,
    "Eq. 5 for S": replace(DEFAULT, similarity=SimilarityConfig(measure="distance")),
    "no normals": replace(DEFAULT, similarity=SimilarityConfig(normal_sigma=10.0)),
    "no coverage": replace(DEFAULT, similarity=SimilarityConfig(full_coverage=0.01)),
    "no gate beside points": replace(
        DEFAULT, similarity=SimilarityConfig(tangential_gate=0.1)
    ),
    "unknown space is free": replace(
        DEFAULT, clearance=ClearanceConfig(unknown_cost=0.0)
    ),
    "no evidence of thickness": replace(DEFAULT, minimum_evidence=0.0),
    "no clearance in the search": replace(
        DEFAULT,
        clearance=ClearanceConfig(
            allowance=0.028, softness=0.0015, approach_steps=1, unknown_cost=0.0
        ),
    ),
    "no error of the pose": replace(
        DEFAULT, uncertainty=PoseUncertainty(position=0.0, rotation=0.0)
    ),
    "no alignment": replace(DEFAULT, alignments=0),
    "reach after the search": replace(DEFAULT, reach="after"),
}


def figures_of(piles: range = PILES) -> dict[str, float]:
    """Top grasps held against the truth, one piece of evidence missing at a time."""
    pipelines = {
        name: debrisgrasp.Pipeline(config=PipelineConfig(planner=config))
        for name, config in ABLATIONS.items()
    }
    verdicts = {name: Counter() for name in ABLATIONS}
    empty = Counter()
    for pile in fresh_piles(piles):
        seen = next(iter(pipelines.values())).perceive(pile.noisy)
        labels = np.zeros(pile.labels.size, dtype=int)
        labels[seen.cloud.pixels] = seen.segmentation.labels
        labels = labels.reshape(pile.labels.shape)
        for name, pipeline in pipelines.items():
            plan = pipeline.plan(seen).plan
            body = intended(pile, labels, plan.object_label)
            empty[name] += not plan.grasps
            verdicts[name].update(
                verdict(pile, pipeline.grippers[g.gripper], g, body).split(" ")[0]
                for g in plan.grasps[:N_BEST]
            )
        so_far = [f"{v['right']}/{v.total()}" for v in verdicts.values()]
        print(f"pile {pile.seed}, right so far:", ", ".join(so_far), flush=True)
    rows, figures = [], {}
    for name, found in verdicts.items():
        share = found["right"] / max(found.total(), 1)
        figures[f"right_{name.replace(' ', '_')}"] = share
        rows.append(
            [
                name,
                f"{share:.2f}",
                str(found.total()),
                str(found["hand"]),
                str(found["holds"] + found["nothing"]),
                str(empty[name]),
            ]
        )
    print()
    header = ["evidence", "right", "of", "hand in solid", "wrong content", "no grasp"]
    print(columns(header, rows) + "\n")
    return figures


def main() -> None:
    options = arguments((__doc__ or "").splitlines()[0])
    publish(figures_of(), options.json)


if __name__ == "__main__":
    begin(main)
