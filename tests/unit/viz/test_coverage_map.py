"""The picture of what a dictionary covers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from debrisgrasp.prototypes import CoverageMap
from debrisgrasp.viz.coverage_map import coverage_png
from debrisgrasp.viz.page import Page


@pytest.mark.parametrize("hand", ["jaw", "SCHUNK_EGU_80_pn_ie_sd_left_arm", "w" * 200])
def test_a_hand_s_name_ends_before_the_approaches(
    hand: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pages: list[Page] = []
    monkeypatch.setattr(Page, "write", lambda page, _: pages.append(page))
    coverage = CoverageMap(
        rows=((hand, "across a round piece"), (hand, "edge or rim")),
        sizes=np.array([0.02, 0.03]),
        counts=np.array([[0, 1], [2, 0]]),
        in_range=np.ones((2, 2), dtype=int),
    )
    coverage_png(tmp_path / "map.png", coverage)
    boxes = {
        text.get_text(): text.get_window_extent() for text in pages[0].figure.texts
    }
    approach = boxes["across a round piece"]
    beside = [box for box in boxes.values() if abs(box.y1 - approach.y1) < 3]
    assert len(beside) == 2
    assert not beside[0].overlaps(beside[1])
