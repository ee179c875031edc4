"""The picture of a campaign."""

from __future__ import annotations

from math import nan

import numpy as np
import pytest
from PIL import Image

from debrisgrasp.errors import OutputError
from debrisgrasp.viz import Bar, campaign_png

BARS = [Bar("success", 0.44, 0.3, 0.59, "19 of 43"), Bar("bad_grasp", nan, 0.0, 1.0)]


def drawn(path, **changes):
    parts = {"of_all": BARS, "of_grasps": BARS, "stages": BARS, "mended": BARS}
    campaign_png(path, "Campaign", "43 runs", **(parts | changes), system=0.44)
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB"))


def test_longer_bars_are_drawn_longer(tmp_path):
    blue = np.array([51, 107, 178])

    def painted(share):
        bars = [Bar("success", share, share, share)]
        picture = drawn(
            tmp_path / "a.png", of_all=bars, of_grasps=[Bar("x", nan, 0, 1)]
        )
        left = picture[:, :720].astype(int)
        return np.count_nonzero(np.abs(left - blue).sum(axis=2) < 12)

    empty, half, full = painted(0.0), painted(0.5), painted(1.0)
    assert full - empty == pytest.approx(2 * (half - empty), rel=0.05)


def test_what_was_not_counted_has_only_its_note(tmp_path):
    noted, bare = (
        drawn(tmp_path / "a.png", mended=[Bar("planning", nan, nan, nan, note)])
        for note in ("?", "")
    )
    rows, columns = np.nonzero((noted != bare).any(axis=2))
    assert 910 < columns.min() < columns.max() < 940
    assert rows.max() - rows.min() < 20


def test_equal_tables_give_equal_files(tmp_path):
    drawn(tmp_path / "a.png")
    drawn(tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_place_that_can_not_be_written_is_named(tmp_path):
    with pytest.raises(OutputError, match="no"):
        drawn(tmp_path / "no" / "a.png")
