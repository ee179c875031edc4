"""Pictures of legs and of compliances: complete, repeatable, robust."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from debrisgrasp.control import (
    ArmResponse,
    Command,
    Compliance,
    Contact,
    Fault,
    LegOutcome,
    Rehearsal,
    StabilityBound,
    Stop,
    TaskFrame,
    WrenchFilter,
    preview,
)
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.viz import LegTrace, Outline, leg_png, preview_png
from tests.unit.control.rigs import LIMITS

N = 50


def trace(*, stop: Stop | None = None, size: float = 60.0) -> LegTrace:
    ramp = np.linspace(0.0, 1.0, N)[:, None]
    run = Rehearsal(
        time=np.linspace(0, 2, N),
        load=ramp * np.array([0, 0, -size, 0, 5.0, 0]),
        deflection=ramp * np.array([0, 0, -0.01, 0, 0.1, 0]),
        position=ramp * np.array([0, 0, 0.2]),
        last=Command((0.0,), LegOutcome.DONE, 0.5, (0.0,) * 6, (0.0,) * 6, stop),
    )
    return LegTrace(label="a $leg$", run=run)


def test_ending_says_what_stopped_the_leg_and_where():
    assert trace().run.ending == "done, after 50 % of the way"
    stop = Stop(Fault.OVERLOAD, "too much", 1.0)
    assert trace(stop=stop).run.ending == "too much, after 50 % of the way"


def test_leg_picture_is_repeatable_and_survives_any_size(tmp_path):
    block = Outline(points=np.eye(3), label="100 % $block", trace=1, is_filled=True)
    traces = [trace(), trace(size=400.0)]
    for name in ("a", "b"):
        leg_png(
            tmp_path / f"{name}.png",
            "Title",
            traces,
            LIMITS,
            nominal=np.array([[0, 0, 0], [0, 0, 0.2]]),
            outlines=[block],
        )
    a, b = ((tmp_path / f"{name}.png").read_bytes() for name in ("a", "b"))
    assert a == b
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.size == (1500, 900)
        assert len(picture.convert("RGB").getcolors(1 << 24)) > 100


@pytest.mark.parametrize(
    "compliance",
    [
        Compliance.diagonal(4e-4, 0.01),
        Compliance.diagonal(0.0, 0.0),
        Compliance.diagonal(
            0.0, [0.05, 0, 0], frame=TaskFrame.about_line([1.0, 0, 0], [0, 1, 0])
        ),
    ],
)
def test_preview_picture_shows_the_moved_hand(compliance, tmp_path):
    bound = StabilityBound(ArmResponse(), WrenchFilter())
    T = SE3.from_parts(so3.from_rpy(np.array([2.4, 0.1, 0.7])), [0.8, -0.3, 0.5])
    shown = preview(compliance, T, bound=bound, contact=Contact(stiffness=1e3))
    preview_png(tmp_path / "preview.png", shown)
    with Image.open(tmp_path / "preview.png") as picture:
        assert picture.size == (1500, 1080)
        colors = picture.convert("RGB").getcolors(1 << 24)
    blue = sum(n for n, (r, g, b) in colors if b > 150 and r < 80)
    assert blue > 500
