"""How soon the page of the viewer shows the bundled plan, in headless Chromium.

``python -m tests.benchmarks.viewer [--n 5] [--json FILE]``. From opening the address in
an empty browser to the figures of the first grasp, and to the first picture with the
cloud in it, which a graphics card draws faster than the processor does here. ``cpu_s``
is the time that all processes together computed until the figures were there: on a
machine with nothing else to do it takes less. Needs playwright and Chromium, on Linux.
Target: 3 s.
"""

from __future__ import annotations

import argparse
import io
import os
import time
from pathlib import Path

import numpy as np
from PIL import Image

import debrisgrasp
from debrisgrasp.io import Capture, data_path
from debrisgrasp.viewer import show
from tests import browser

from .report import begin, publish


def loaded(url: str) -> tuple[float, float, float, float]:
    """Seconds to the figures, computed until then, to the scene; megabytes sent."""
    with browser.opened(800, 500) as page:
        sent = [0]
        page.on("response", lambda r: sent.append(_size(r)))
        start, computed = time.perf_counter(), _computed()
        page.goto(url)
        page.get_by_text("Grasp 1:").first.wait_for()
        figures, computed = time.perf_counter() - start, _computed() - computed
        while not _shows_something(page.locator("canvas").first.screenshot()):
            pass
        scene = time.perf_counter() - start
        return figures, computed, scene, sum(sent) / 1e6


def _computed() -> float:
    """Processor time of this process and of all that it started [s]."""
    parents, spent = {}, {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            words = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue  # it has ended
        pid = int(stat.parent.name)
        parents[pid] = int(words[1])
        spent[pid] = (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")
    own, grew = {os.getpid()}, True
    while grew:
        more = {pid for pid, parent in parents.items() if parent in own} - own
        own, grew = own | more, bool(more)
    return sum(spent.get(pid, 0.0) for pid in own)


def _size(response: object) -> int:
    return int(response.headers.get("content-length", 0))  # type: ignore[attr-defined]


def _shows_something(png: bytes) -> bool:
    """Tell whether the picture has colours, as the objects have."""
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), dtype=np.int16)
    return bool((np.ptp(pixels, axis=2) > 60).mean() > 0.02)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=5)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    if browser.chromium() is None:
        parser.exit(1, "needs Chromium, and the package playwright\n")
    result = debrisgrasp.plan(Capture.load(data_path("captures", "pile.npz")))
    start = time.perf_counter()
    with show(result) as viewer:
        served = time.perf_counter() - start
        times = np.array([loaded(viewer.url) for _ in range(arguments.n)])
    figures = {
        "served_s": served,
        "figures_s_median": float(np.median(times[:, 0])),
        "figures_s_min": float(times[:, 0].min()),
        "cpu_s_median": float(np.median(times[:, 1])),
        "scene_s_median": float(np.median(times[:, 2])),
        "scene_s_min": float(times[:, 2].min()),
        "page_mb": float(times[0, 3]),
        "target_s": 3.0,
    }
    publish(figures, arguments.json)


if __name__ == "__main__":
    begin(main)
