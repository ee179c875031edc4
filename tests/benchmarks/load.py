"""What an object weighs and what its grasps must hold, against bodies that are known.

Run: python -m tests.benchmarks.load [--json FILE]

`within` and `inside` are the shares of bodies whose true mass and centre of mass lie
within the bounds; `factor` is the spread (one standard deviation) of the expected mass
around the true one. `demand_*` is the true load over the limit of the grip for the best
grasp, ranked by the load and, for comparison, by the horizontal lever alone.
"""

from __future__ import annotations

import numpy as np

import debrisgrasp
from debrisgrasp.cli.tables import columns
from debrisgrasp.geometry import SE3, Intrinsics, so3, voxel_downsample
from debrisgrasp.io import Capture
from debrisgrasp.planning import LoadConfig, ObjectMass, PlannerConfig
from debrisgrasp.planning.levers import GripLevers
from debrisgrasp.planning.load import LoadModel
from debrisgrasp.planning.mass import Build
from debrisgrasp.worlds import KINDS, Body, World, draw_body, look_at, render

from .report import arguments, publish

CAMERA = Intrinsics(fx=307.0, fy=307.0, cx=159.5, cy=119.5, width=320, height=240)
VIEW = look_at([0.1, 0.0, 1.2], [0.95, 0.0, 0.2])
CONFIG = LoadConfig()
LEVER = 0.35
"""Lever at which the score was halved before loads were known [m]."""


def seen(kind: str, rng: np.random.Generator) -> tuple[Body, Capture, np.ndarray]:
    body = draw_body(kind, rng=rng)
    turn = so3.from_rpy(np.array([0.0, 0.0, rng.uniform(0, 2 * np.pi)]))
    lowest = (body.mesh()[0] @ turn.T)[:, 2].min()
    body = body.at(SE3.from_parts(turn, [0.95, 0.0, 0.05 - lowest]))
    picture = render(World((body,)), CAMERA, VIEW)
    capture = Capture(
        depth=picture.depth, intrinsics=CAMERA, T_base_camera=VIEW, name=kind
    )
    return body, capture, picture.labels.ravel() == 1


def main() -> None:
    options = arguments(__doc__ or "")
    rng = np.random.default_rng(0)
    config = debrisgrasp.PipelineConfig(planner=PlannerConfig(n_best=100))
    pipeline = debrisgrasp.Pipeline(robot="none", config=config)
    rows, within, inside, ratio, loads, levers = [], [], [], [], [], []
    for kind in KINDS:
        body, capture, is_body = seen(kind, rng)
        cloud = capture.cloud()
        own = np.flatnonzero(is_body[cloud.pixels])
        own = own[voxel_downsample(cloud.points[own], 0.01)]
        what = ObjectMass.from_surface(
            cloud.points[own], cloud.normals[own], VIEW.p, CONFIG, spacing=0.01
        )
        com = body.T_base_body.apply(body.center_of_mass)
        within.append(what.mass[0] <= body.mass <= what.mass[1])
        offset = np.linalg.solve(what.spread, com - what.com)
        inside.append(np.linalg.norm(offset) <= 1)
        ratio.append(what.expected_mass / body.mass)
        grasps = pipeline.plan(capture).plan.grasps
        cells = [kind, f"{body.mass:.1f}", what.build.value]
        cells.append(f"{what.mass[0]:.1f} to {what.mass[1]:.1f}")
        if grasps:
            truth = ObjectMass(
                build=Build.SOLID,
                mass=(body.mass, body.mass),
                expected_mass=body.mass,
                com=com,
                spread=np.zeros((3, 3)),
            )
            hands = [
                (pipeline.grippers[g.gripper], g.preshape, g.width) for g in grasps
            ]
            Ts = np.stack([g.T_base_hand.matrix for g in grasps])
            model = LoadModel((truth,), CONFIG)
            true = model(Ts, np.arange(len(Ts)), GripLevers.of(hands, CONFIG))
            by_lever = [
                g.expected / (1 + (g.load.lever / LEVER) ** 2) for g in grasps if g.load
            ]
            loads.append(true.demand[0, 1])
            levers.append(true.demand[int(np.argmax(by_lever)), 1])
            cells += [f"{loads[-1]:.2f}", f"{levers[-1]:.2f}"]
        rows.append([*cells, "-", "-"][:6])
    header = ["kind", "kg", "looks", "estimate [kg]", "demand", "by lever"]
    print(columns(header, rows))
    print()
    figures = {
        "within": float(np.mean(within)),
        "inside": float(np.mean(inside)),
        "factor": float(np.exp(np.std(np.log(ratio)))),
        "demand_median": float(np.median(loads)),
        "demand_median_by_lever": float(np.median(levers)),
        "holds_share": float(np.mean(np.array(loads) <= 1)),
        "holds_share_by_lever": float(np.mean(np.array(levers) <= 1)),
    }
    publish(figures, options.json)


if __name__ == "__main__":
    main()
