"""Segmentation of the simulated piles and of labelled real scenes: scores and time.

Run: python -m tests.benchmarks.segmentation [--json FILE]

Times are those of the processor, in ms per capture: normals, ground, division into
objects, measurement of the objects.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import TypeVar

import numpy as np

from debrisgrasp.cli.tables import columns
from debrisgrasp.geometry import PointCloud
from debrisgrasp.io import Capture
from debrisgrasp.segmentation import LccpConfig, SegmentationConfig, segment_cloud
from debrisgrasp.segmentation.assembly import assembled
from debrisgrasp.segmentation.ground import find_ground
from debrisgrasp.segmentation.lccp import lccp
from debrisgrasp.segmentation.singulation import SingulationConfig, singulate

from .report import arguments, publish
from .segmentation_scores import Scores, scores

DATA = Path(__file__).parents[3] / "shared" / "data"
REPEATS = 3
METHODS = {"default": SingulationConfig(), "lccp": LccpConfig()}
T = TypeVar("T")


@dataclass(frozen=True)
class Row:
    capture: str
    method: str
    scores: Scores
    ms: dict[str, float]


def processor_ms(work: Callable[[], T]) -> tuple[T, float]:
    """Result and the least of a few processor times [ms]."""
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        result = work()
        times.append(1e3 * (time.process_time() - start))
    return result, min(times)


def reference(path: Path) -> np.ndarray:
    """Labels of pixels: -1 not scored, 0 ground, 1.. objects."""
    content = np.load(path)
    if "labels_parts" not in content:
        return content["labels"].astype(int)
    # Parts 1 to 9 are the table, 0 was cut away or not measured.
    labels = content["labels_parts"].astype(int)
    return np.where(labels == 0, -1, np.where(labels < 10, 0, labels))


def divided(cloud: PointCloud, standing: np.ndarray, method: object):
    if isinstance(method, SingulationConfig):
        return singulate(cloud, standing, method)
    return lccp(cloud.selected(standing), method)


def evaluated(path: Path, name: str) -> Row:
    """Run one method on one capture, stage by stage."""
    capture = Capture.load(path)
    if capture.T_base_camera is None:
        capture = capture.posed("level")
    config = SegmentationConfig(method=METHODS[name])
    cloud, normals_ms = processor_ms(capture.cloud)
    (is_ground, report), ground_ms = processor_ms(
        lambda: find_ground(cloud, config.ground)
    )
    graph, divide_ms = processor_ms(lambda: divided(cloud, ~is_ground, config.method))
    _, measure_ms = processor_ms(
        lambda: assembled(
            cloud.points,
            ~is_ground,
            graph,
            report,
            min_points=config.min_points,
            method="lccp",
        )
    )
    labels = segment_cloud(cloud, config).labels
    truth = reference(path).ravel()[cloud.pixels]
    ms = {
        "normals": normals_ms,
        "ground": ground_ms,
        "divide": divide_ms,
        "measure": measure_ms,
    }
    return Row(path.stem, name, scores(labels, truth), ms)


def whole_cloud_ms(path: Path) -> float:
    """Processor time of LCCP on the cloud with its ground [ms]."""
    cloud = Capture.load(path).cloud()
    return processor_ms(lambda: lccp(cloud, LccpConfig()))[1]


def mean(rows: list[Row], method: str, kind: str, figure: str) -> float:
    """Mean score over the captures whose name contains ``kind``."""
    chosen = [row for row in rows if row.method == method and kind in row.capture]
    return float(np.mean([getattr(row.scores, figure) for row in chosen]))


def main() -> None:
    """Print the table and publish the figures."""
    options = arguments(__doc__.splitlines()[0])
    piles = sorted((DATA / "piles").glob("pile_*.npz"))
    paths = piles + sorted((DATA / "real").glob("osd_*.npz"))
    if not piles:
        raise SystemExit("no shared captures beside this checkout")
    rows = [evaluated(path, name) for name in METHODS for path in paths]
    titles = ["capture", "method", *(f.name for f in fields(Scores)), *rows[0].ms]
    table = [
        [
            row.capture,
            row.method,
            *(f"{value:.3f}" for value in astuple(row.scores)),
            *(f"{value:.0f}" for value in row.ms.values()),
        ]
        for row in rows
    ]
    print(columns(titles, table))
    print()

    def stage_mean(method: str, *stages: str) -> float:
        return float(
            np.mean(
                [
                    sum(row.ms[stage] for stage in stages)
                    for row in rows
                    if row.method == method and row.capture.startswith("pile")
                ]
            )
        )

    figures = {
        "lccp_ms_whole": float(np.mean([whole_cloud_ms(path) for path in piles])),
        "lccp_ms_ground_removed": stage_mean("lccp", "divide"),
        "default_ms": stage_mean("default", "ground", "divide", "measure"),
        "ground_ms": stage_mean("default", "ground"),
    }
    for method in METHODS:
        for kind in ("clean", "noisy", "osd"):
            for figure in ("wov", "fusc", "found"):
                key = f"{figure}_{method}_{kind}"
                figures[key] = mean(rows, method, kind, figure)
    publish(figures, options.json)


if __name__ == "__main__":
    main()
