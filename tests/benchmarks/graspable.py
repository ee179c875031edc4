"""Could the hands hold it at all? Objects that were not taken, seen from all sides.

Run: python -m tests.benchmarks.physics --tier isolated --n 30 --seed0 30000 \\
         --records FILE
     python -m tests.benchmarks.graspable FILE [--json FILE]

Of each `isolated` scene whose first grasp failed, or that had none, the whole surface
is given to the planner, without noise, with the true mass and no arm; the best grasps
are flown. Where none holds, no hand of the robot can lift the object as it lies; where
one does, one look from the robot's place did not show it, or no arm gets there.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from debrisgrasp._arrays import Float32Array
from debrisgrasp._stopwatch import Stopwatch
from debrisgrasp.campaign import wilson
from debrisgrasp.cli.tables import columns
from debrisgrasp.geometry import PointCloud, voxel_downsample
from debrisgrasp.io import Capture
from debrisgrasp.pipeline import PipelineConfig
from debrisgrasp.planning import Grasp, GraspPlanner, GraspScene
from debrisgrasp.prototypes import PrototypeLibrary
from debrisgrasp.segmentation import region_of_interest
from debrisgrasp.sim import TierScene, Verdict, fly, tier_scene
from debrisgrasp.worlds import look_at, render

from .report import begin, publish

AROUND = 8
"""So many looks around, from two heights each, and one from above."""
HEIGHTS = (0.12, 0.7)
"""Their elevations [rad]."""
DISTANCE = 1.1
SPACING = 0.004
TAKEN = (Verdict.HELD.value, Verdict.PULLED_CLEAR.value)
"""Outcomes of those that need no other look."""
FLOWN = 3
"""So many grasps are flown, those of the best forecasts."""


class AllFree:
    """Lines of sight that leave nothing unknown."""

    def clearance(
        self, x: Float32Array, y: Float32Array, z: Float32Array
    ) -> Float32Array:
        """One metre for every point."""
        return np.ones(np.broadcast_shapes(x.shape, y.shape, z.shape), "f4")


def eyes(middle: np.ndarray) -> list[np.ndarray]:
    """Where the looks are from, base frame [m]."""
    places = []
    for elevation in HEIGHTS:
        for turn in 2 * np.pi * np.arange(AROUND) / AROUND:
            level = np.cos(elevation) * np.array([np.cos(turn), np.sin(turn)])
            places.append(middle + DISTANCE * np.array([*level, np.sin(elevation)]))
    return [*places, middle + np.array([0.01, 0.0, DISTANCE])]


def surface(scene: TierScene) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals of all of the first body that can be seen, (n, 3) each."""
    middle = scene.world.bodies[0].T_base_body.p
    points, normals = [], []
    for eye in eyes(middle):
        pose = look_at(eye, middle)
        seen = render(scene.world, scene.intrinsics, pose)
        depth = np.where(seen.depth > 0, seen.depth, np.nan)
        cloud = Capture(
            depth=depth, intrinsics=scene.intrinsics, T_base_camera=pose
        ).cloud()
        own = seen.labels.ravel()[cloud.pixels] == 1
        own &= np.isfinite(cloud.normals[:, 0])
        points.append(cloud.points[own])
        normals.append(cloud.normals[own])
    every = np.concatenate(points)
    kept = voxel_downsample(every, SPACING)
    return every[kept], np.concatenate(normals)[kept]


def best_grasps(planner: GraspPlanner, scene: TierScene) -> list[Grasp]:
    """Grasps of a free hand on the whole surface, best first."""
    points, normals = surface(scene)
    body, found = scene.world.bodies[0], []
    # What a prototype shows depends on where it is seen from.
    for eye in eyes(body.T_base_body.p)[AROUND:]:
        near = GraspScene.build(
            PointCloud(points=points, normals=normals, viewpoint=eye),
            np.ones(len(points), dtype=bool),
            region_of_interest(points),
            AllFree(),
            PipelineConfig().planner.scene,
            ground_plane=np.array([0.0, 0.0, 1.0, 0.0]),
        )
        result = planner.plan(
            near,
            (),
            lambda points: np.full(points.shape[:-1], np.inf),
            rng=np.random.default_rng(scene.seed),
            watch=Stopwatch(None, None),
            mass=body.mass,
        )
        found += result.grasps[:1]
    return sorted(found, key=lambda grasp: -grasp.score)


def main() -> None:
    """Print what could have been held, and the share of it that was."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("records", type=Path, metavar="FILE")
    parser.add_argument("--json", type=Path, metavar="FILE")
    chosen = parser.parse_args()
    rows = [json.loads(line) for line in chosen.records.open()]
    rows = [row for row in rows if row["tier"] == "isolated" and not row["rank"]]
    library = PrototypeLibrary.load().select(kind="generic")
    planner = GraspPlanner(library, PipelineConfig().planner)
    told, impossible = [], 0
    held = sum(row["outcome"] in TAKEN for row in rows)
    for row in rows:
        if row["outcome"] in TAKEN:
            continue
        scene = tier_scene("isolated", int(row["seed"]))
        grasps, how = best_grasps(planner, scene)[:FLOWN], "none holds"
        for grasp in grasps:
            flight = fly(scene.world, library.grippers[grasp.gripper], grasp)
            if flight.verdict is Verdict.HELD:
                how = f"{grasp.gripper}, {grasp.prototype} ({grasp.score:.2f})"
                break
        impossible += how == "none holds"
        told.append([str(row["seed"]), row["kind"], row["outcome"], how])
        print(told[-1], flush=True)
    print(
        "\n" + columns(["seed", "kind", "outcome", "seen from all sides"], told) + "\n"
    )
    figures: dict[str, float] = {"isolated": held / max(len(rows), 1)}
    figures["isolated_n"] = len(rows)
    possible = len(rows) - impossible
    figures["graspable"] = held / max(possible, 1)
    figures["graspable_n"] = possible
    figures["graspable_low"], figures["graspable_high"] = wilson(held, possible)
    publish(figures, chosen.json)


if __name__ == "__main__":
    begin(main)
