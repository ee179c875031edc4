"""Segmentation of simulated piles and of labelled real scenes: scores and time.

Run: python -m tests.benchmarks.segmentation [--json FILE] [--plot FILE] [--piles N]
     [--large]

Scores are means over captures; bodies of which fewer than 60 pixels are seen don't
count. Times are those of one thread of the processor, in ms from a depth image to
labels: points, normals, ground and surroundings, division into objects, their
measurement. They are taken on some of the captures.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from debrisgrasp.cli.tables import columns
from debrisgrasp.geometry import SE3
from debrisgrasp.io import Capture
from debrisgrasp.segmentation import LccpConfig, SegmentationConfig, segment_cloud
from debrisgrasp.worlds import render

from .piles import FEWEST_PIXELS, FreshPile, fresh_pile, fresh_piles
from .report import begin, publish
from .segmentation_scores import Scores, scores

DATA = Path(__file__).parents[3] / "shared" / "data"
FIRST_SEED = 95_000
"""Of the fresh piles; nothing was fitted to these, or chosen on them."""
REPEATS = 3
TIMED = 20
"""Captures on which times are taken."""
METHODS = {
    "default": SegmentationConfig(),
    "lccp": SegmentationConfig(method=LccpConfig()),
}
SIZES = ((160, 120), (320, 240), (640, 480), (1280, 960))
TARGETS = {
    "lccp_ms_whole": ("at most", 240.0),
    "lccp_ms_ground_removed": ("at most", 115.0),
    "default_ms": ("at most", 150.0),
    "seconds_5_million": ("at most", 30.0),
    "wov_lccp_fresh": ("at least", 0.72),
    "wov_default_clean": ("at least", 0.85),
    "wov_default_noisy": ("at least", 0.82),
    "wov_default_clean_fresh": ("at least", 0.85),
    "wov_default_noisy_fresh": ("at least", 0.82),
    "found_default_fresh": ("at least", 0.90),
    "fusc_default_fresh": ("at most", 0.03),
    "default_over_lccp_osd": ("at least", 0.0),
    "default_over_lccp_osd_whole": ("at least", 0.0),
    "default_over_lccp_osd_either": ("at least", 0.0),
}
T = TypeVar("T")


@dataclass(frozen=True)
class Row:
    capture: str
    method: str
    scores: Scores
    ms: float


def processor_ms(work: Callable[[], T], repeats: int = REPEATS) -> tuple[T, float]:
    """Result and the least of a few processor times [ms]."""
    times = []
    for _ in range(repeats):
        start = time.thread_time()
        result = work()
        times.append(1e3 * (time.thread_time() - start))
    return result, min(times)


def reference(path: Path) -> np.ndarray:
    """Labels of pixels: -1 not scored, 0 ground, 1.. objects."""
    content = np.load(path)
    if "labels_parts" not in content:
        return content["labels"].astype(int)
    # Parts 1 to 9 are the table, 0 was cut away or not measured.
    labels = content["labels_parts"].astype(int)
    return np.where(labels == 0, -1, np.where(labels < 10, 0, labels))


def labelled(piles: Iterable[FreshPile]) -> Iterable[tuple[Capture, np.ndarray]]:
    """Both captures of each pile with their true labels."""
    for pile in piles:
        for capture in (pile.clean, pile.noisy):
            name = f"fresh_{capture.name.removeprefix('pile_')}"
            size = np.bincount(np.maximum(pile.labels.ravel(), 0))
            is_hint = (pile.labels > 0) & (size[pile.labels] < FEWEST_PIXELS)
            yield replace(capture, name=name), np.where(is_hint, -1, pile.labels)


def shared() -> Iterable[tuple[Capture, np.ndarray]]:
    """Captures beside the checkout with their true labels, if there are any."""
    for path in sorted(DATA.glob("piles/pile_*.npz")) + sorted(
        DATA.glob("real/osd_*.npz")
    ):
        capture = Capture.load(path)
        if capture.T_base_camera is None:
            capture = capture.posed("level")
        yield capture, reference(path)


def of_whole_objects() -> Iterable[tuple[Capture, np.ndarray]]:
    """Real captures again; what is seen of an object in several places is one."""
    for capture, parts in shared():
        if capture.name.startswith("osd"):
            objects = np.load(DATA / "real" / f"{capture.name}.npz")["labels"]
            truth = np.where(parts > 0, objects.astype(int), parts)
            yield replace(capture, name=f"whole_{capture.name}"), truth


def with_joined_parts(parts: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Count the parts of an object as one if the same segment shows most of them.

    Whether the camera shows an object in one place or in several is then neither for
    nor against a method that joins them. Parts of object k are numbered from 10 k on.
    """
    joined = parts.copy()
    first: dict[tuple[int, int], int] = {}
    for part in np.unique(parts[parts > 0]).tolist():
        of_segments = np.bincount(labels[parts == part], minlength=2)[1:]
        segment = int(of_segments.argmax()) if of_segments.any() else -part
        joined[parts == part] = first.setdefault((part // 10, segment), part)
    return joined


def evaluated(capture: Capture, truth: np.ndarray, *, is_timed: bool) -> list[Row]:
    """Scores and times of every method on one capture."""
    truth = truth.ravel()[np.isfinite(capture.depth).ravel()]
    rows = []
    for name, config in METHODS.items():
        result, ms = processor_ms(
            lambda c=config: segment_cloud(capture.cloud(), c),
            REPEATS if is_timed else 1,
        )
        rows.append(Row(capture.name, name, scores(result.labels, truth), ms))
        if capture.name.startswith("osd"):
            found = scores(result.labels, with_joined_parts(truth, result.labels))
            rows.append(Row(f"either_{capture.name}", name, found, ms))
    return rows


def whole_ms(capture: Capture) -> float:
    """Processor time of LCCP on the cloud with its ground [ms]."""
    config = METHODS["lccp"]
    return processor_ms(
        lambda: segment_cloud(capture.cloud(), config, is_cropped=True)
    )[1]


def resized(pile: FreshPile, width: int, height: int) -> Capture:
    """Exact view of a pile by the same camera with other pixels."""
    share = width / pile.intrinsics.width
    intrinsics = replace(
        pile.intrinsics,
        fx=share * pile.intrinsics.fx,
        fy=share * pile.intrinsics.fy,
        cx=share * (pile.intrinsics.cx + 0.5) - 0.5,
        cy=share * (pile.intrinsics.cy + 0.5) - 0.5,
        width=width,
        height=height,
    )
    depth = render(pile.settled.world, intrinsics, pile.T_base_camera).depth
    return Capture(
        depth=np.where(depth > 0, depth, np.nan),
        intrinsics=intrinsics,
        T_base_camera=pile.T_base_camera,
    )


def times_by_size() -> dict[str, list[float]]:
    """Milliseconds of each method for each of the sizes."""
    pile = fresh_pile(FIRST_SEED)
    captures = [resized(pile, *size) for size in SIZES]
    times = {
        name: [
            processor_ms(lambda k=k, c=config: segment_cloud(k.cloud(), c))[1]
            for k in captures
        ]
        for name, config in METHODS.items()
    }
    rows = [
        [f"{w}x{h}", *(f"{times[name][i]:.0f}" for name in METHODS)]
        for i, (w, h) in enumerate(SIZES)
    ]
    print(columns(["image", *(f"{name} [ms]" for name in METHODS)], rows), end="\n\n")
    return times


def plotted(times: dict[str, list[float]], path: Path) -> None:
    """Write time against pixels, with a line of proportional growth."""
    from matplotlib.figure import Figure  # only drawing needs it

    pixels = np.array([w * h for w, h in SIZES])
    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.add_subplot()
    for name, values in times.items():
        axes.loglog(pixels, values, "o-", label=name)
    axes.loglog(
        pixels, times["lccp"][2] * pixels / pixels[2], "k:", label="proportional"
    )
    axes.set_xticks(pixels, [f"{w}x{h}" for w, h in SIZES])
    axes.minorticks_off()
    axes.set_ylabel("processor time, depth to labels [ms]")
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=120)


def large_seconds() -> float:
    """Processor time for an unorganised cloud of five million points [s]."""
    rng = np.random.default_rng(0)
    n = 5_000_000
    points = rng.uniform([0.3, -2, 0], [4.3, 2, 0], (n, 3))
    boxes = rng.integers(-1, 40, n)
    corner = rng.uniform([0.6, -1.8, 0], [4, 1.8, 0], (40, 3))
    size = rng.uniform(0.1, 0.4, (40, 3))
    on_box = (boxes >= 0) & (rng.random(n) < 0.4)
    place = rng.uniform(0, 1, (n, 3))
    face = rng.integers(0, 3, n)
    place[np.arange(n), face] = face == 2
    points[on_box] = (corner[boxes] + place * size[boxes])[on_box]
    points += rng.normal(0, 0.002, (n, 3))
    capture = Capture(
        points=points, viewpoint=np.array([0, 0, 1.6]), T_base_camera=SE3.from_parts()
    )
    start = time.process_time()
    segment_cloud(capture.cloud())
    return time.process_time() - start


def figures_of(rows: list[Row]) -> dict[str, float]:
    """Mean scores and times over kinds of captures."""
    figures = {}
    kinds = {
        "clean": ("pile_", "clean"),
        "noisy": ("pile_", "noisy"),
        "osd": ("osd", ""),
        "osd_whole": ("whole_osd", ""),
        "osd_either": ("either_osd", ""),
        "clean_fresh": ("fresh", "clean"),
        "noisy_fresh": ("fresh", "noisy"),
        "fresh": ("fresh", ""),
    }
    for method in METHODS:
        for kind, (start, end) in kinds.items():
            chosen = [
                row.scores
                for row in rows
                if row.method == method
                and row.capture.startswith(start)
                and row.capture.endswith(end)
            ]
            for figure in ("wov", "fusc", "found"):
                if chosen:
                    values = [getattr(score, figure) for score in chosen]
                    figures[f"{figure}_{method}_{kind}"] = float(np.mean(values))
    for kind in ("osd", "osd_whole", "osd_either"):
        if f"wov_default_{kind}" in figures:
            difference = figures[f"wov_default_{kind}"] - figures[f"wov_lccp_{kind}"]
            figures[f"default_over_lccp_{kind}"] = difference
    for key, method in (("lccp_ms_ground_removed", "lccp"), ("default_ms", "default")):
        times = [
            row.ms
            for row in rows
            if row.method == method and not row.capture.startswith("either")
        ][:TIMED]
        figures[key] = float(np.mean(times))
    return figures


def main() -> None:
    """Print the tables and publish the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="time against pixels")
    parser.add_argument("--piles", type=int, default=40, help="number of fresh piles")
    parser.add_argument("--large", action="store_true", help="five million points too")
    options = parser.parse_args()
    rows, whole = [], []
    seeds = range(FIRST_SEED, FIRST_SEED + options.piles)
    for source in (shared(), labelled(fresh_piles(seeds)), of_whole_objects()):
        for capture, truth in source:
            is_timed = len(whole) < TIMED
            rows += evaluated(capture, truth, is_timed=is_timed)
            if is_timed:
                whole.append(whole_ms(capture))
    titles = ["capture", "method", *(f.name for f in fields(Scores)), "ms"]
    table = [
        [r.capture, r.method, *(f"{v:.3f}" for v in astuple(r.scores)), f"{r.ms:.0f}"]
        for r in rows
    ]
    print(columns(titles, table), end="\n\n")
    times = times_by_size()
    if options.plot:
        plotted(times, options.plot)
    figures = {"lccp_ms_whole": float(np.mean(whole)), **figures_of(rows)}
    for name, values in times.items():
        figures |= {
            f"{name}_ms_{w}x{h}": value
            for (w, h), value in zip(SIZES, values, strict=True)
        }
    if options.large:
        figures["seconds_5_million"] = large_seconds()
    compared = [
        [name, f"{words} {limit:g}", f"{figures[name]:.4g}"]
        for name, (words, limit) in TARGETS.items()
        if name in figures
    ]
    print(columns(["target", "wanted", "measured"], compared), end="\n\n")
    publish(figures, options.json)


if __name__ == "__main__":
    begin(main)
