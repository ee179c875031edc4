"""Divide a capture into objects and put them in the order of removal.

Run: python examples/01_segment_a_pile.py [CAPTURE]
"""

import sys

import debrisgrasp
from debrisgrasp.io import data_path


def main() -> None:
    path = sys.argv[1] if len(sys.argv) > 1 else data_path("captures", "pile.npz")
    capture = debrisgrasp.Capture.load(path)
    segmentation = debrisgrasp.segment(capture)

    print(f"ground {segmentation.ground.status}: {segmentation.ground.reason}")
    for turn, candidate in enumerate(debrisgrasp.select(capture, segmentation), 1):
        segment = segmentation.segment(candidate.label)
        size = " x ".join(f"{100 * extent:.0f}" for extent in segment.extents)
        print(f"{turn}. object {candidate.label}, {size} cm: {candidate.reason}")


if __name__ == "__main__":
    main()
