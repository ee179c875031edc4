"""Which of what was seen is in the way."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.executive import choose
from debrisgrasp.executive.choose import _not_in_the_way, _triage
from debrisgrasp.executive.context import Context
from tests.unit.executive.rigs import before_a_brick, look


@pytest.mark.parametrize(
    ("share", "unsure", "is_in_way"),
    [(0.45, 0.0, True), (0.15, 0.0, False), (0.15, 2.0, True)],
)
def test_what_lies_across_the_border_of_the_workspace_is_in_the_way(
    pipeline, monkeypatch, share, unsure, is_in_way
):
    """As is what may do, for all that was seen of it."""
    _, task = before_a_brick(pipeline)
    context = task.context
    look(context)
    seen = context.cycle.seen
    segment = seen.segmentation.segment(1)
    points = seen.cloud.points[seen.segmentation.points_of(1)]
    border = float(np.quantile(points[:, 0], share))
    assert segment.centroid[0] > border
    monkeypatch.setattr(choose, "_UNSURE", unsure)
    monkeypatch.setattr(
        Context, "is_in_way", lambda _, p, more=0.0: p[..., 0] < border + more
    )
    triage = _triage(context, seen, segment)
    reason = _not_in_the_way(context, seen, points, triage)
    assert (reason != "outside the workspace") is is_in_way
