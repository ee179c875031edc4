"""An object that was marked once stays marked where it lies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.errors import CaptureError, ConfigError
from debrisgrasp.executive import State, TaskSettings
from debrisgrasp.executive.choose import select
from debrisgrasp.executive.marking import StaysMarked
from debrisgrasp.executive.marks import Marks
from debrisgrasp.executive.perceive import segment
from debrisgrasp.executive.result import FaultFound
from debrisgrasp.geometry import SE3, Bounds, Intrinsics, so3
from debrisgrasp.io import Capture, measured
from debrisgrasp.worlds import (
    World,
    let_down,
    look_at,
    make_body,
    named_scene,
    render,
)
from tests.unit.executive.rigs import look, task_before
from tests.unit.robot.rigs import drive

CAMERA = Intrinsics(fx=120.0, fy=120.0, cx=63.5, cy=47.5, width=128, height=96)
VIEW = look_at([0.1, 0.0, 1.2], [0.95, 0.0, 0.2])
ASIDE = look_at([0.1, 0.1, 1.2], [0.95, -0.1, 0.2])


def bodies(*places):
    sizes = {"length": 0.3, "width": 0.1, "height": 0.1}
    return World(
        tuple(
            make_body("brick", sizes, 2.0, name=f"b{i}").at(
                SE3.from_parts(so3.from_rpy(np.array([0.0, 0.0, 0.3])), place)
            )
            for i, place in enumerate(places)
        )
    )


def seen(world, view=VIEW, mask=None):
    picture = render(world, CAMERA, view)
    taken = Capture(
        depth=picture.depth, intrinsics=CAMERA, T_base_camera=view, mask=mask
    )
    return taken, picture.labels


BOTH = bodies([0.9, -0.2, 0.05], [1.0, 0.2, 0.05])


def marked():
    _, labels = seen(BOTH)
    return StaysMarked.of(seen(BOTH, mask=labels == 2)[0])


def test_the_object_is_marked_again_also_from_elsewhere():
    again, labels = seen(BOTH, ASIDE)
    mask, own = marked()(again), labels == 2
    assert mask.shape == own.shape
    assert (mask & own).sum() > 0.8 * own.sum()
    assert not (mask & (labels == 1)).any()


def test_once_it_is_gone_nothing_is_marked():
    # A strip of the ground where it stood may be within the tolerance.
    mask = marked()(seen(bodies([0.9, -0.2, 0.05]))[0])
    assert mask.sum() < 0.1 * (seen(BOTH)[1] == 2).sum()


@pytest.mark.parametrize("mask", [None, np.zeros((96, 128), dtype=bool)])
def test_a_capture_that_marks_nothing_is_refused(mask):
    with pytest.raises(CaptureError, match="mask of"):
        StaysMarked.of(seen(BOTH, mask=mask)[0])


@pytest.fixture(scope="module")
def handle(pipeline):
    """Return a way to look at the crate with a handle, with some settings."""
    crate = let_down(named_scene("crate_with_handle")).world

    def looked(world=crate, n_removed=0, **settings):
        settings = TaskSettings(**settings)
        _, task = task_before(pipeline, *world.bodies, settings=settings)
        context = task.context
        look(context)
        context.n_removed = n_removed
        return context, select(context)

    return looked


HANDLE = Bounds(np.array([0.85, -0.3, 0.21]), np.array([1.35, 0.3, 0.5]))


def test_only_the_object_in_the_region_is_taken(handle):
    context, found = handle(region=HANDLE)
    assert found.facts["why_it"] == "it is the marked object"
    seen = context.cycle.seen
    assert HANDLE.contains(seen.cloud.points[seen.is_marked]).all()


def _marked_by(handle, way):
    """Settings that mark the crate by a region, or by a mask that it was drawn in."""
    if way == "region":
        return {"region": HANDLE}
    context, _ = handle(region=HANDLE)
    return {"mark": StaysMarked.of(context.cycle.capture)}


@pytest.mark.parametrize("way", ["region", "mask"])
def test_a_mark_stays_where_it_was_when_the_base_has_moved(handle, way):
    context, found = handle(**_marked_by(handle, way))
    began, base = np.array(found.facts["centroid"]), context.robot.base
    before = base.read()
    drive(context.robot, 0.08, 0.1, 1.5)
    base.stop()
    context.wait(1.0)
    T_now_before = base.read().inverse() @ before
    assert np.linalg.norm(T_now_before.p) > 0.1
    context.stands_elsewhere(T_now_before)
    look(context)
    again = np.array(select(context).facts["centroid"])
    assert np.linalg.norm(again - T_now_before.apply(began)) < 0.03


@pytest.mark.parametrize("n_removed", [0, 1])
def test_bare_ground_in_the_region_is_no_object(handle, n_removed):
    ground = Bounds(np.array([0.6, -0.5, -0.05]), np.array([1.3, 0.3, 0.3]))
    _, found = handle(bodies([3.0, 0.0, 0.05]), n_removed, region=ground)
    if n_removed:
        assert found.next is State.CLEARED
    else:
        assert found.fault == "empty_cloud"


@pytest.mark.parametrize("n_removed", [0, 1])
def test_what_a_detector_never_found_is_no_cleared_way(handle, n_removed):
    _, found = handle(n_removed=n_removed, mark=lambda _: None)
    if n_removed:
        assert found.next is State.CLEARED
    else:
        assert found.fault == "empty_cloud"


def test_a_region_without_an_object_is_told(handle):
    low, high = np.array([1.7, 0.5, 0.9]), np.array([2.0, 0.6, 1.1])
    _, found = handle(region=Bounds(low, high))
    assert isinstance(found, FaultFound)
    assert "x 1.7 to 2, y 0.5 to 0.6, z 0.9 to 1.1 m of the base frame" in found.message


def test_a_region_where_nothing_is_in_the_way_is_refused():
    with pytest.raises(ConfigError, match=r"got x 5 to 6.*meets x 0\.45 to 1\.9"):
        TaskSettings(region=Bounds(np.full(3, 5.0), np.full(3, 6.0)))


def test_a_mask_marks_the_same_object_as_the_region_it_was_drawn_in(handle):
    context, by_region = handle(region=HANDLE)
    again, by_mask = handle(mark=StaysMarked.of(context.cycle.capture))
    first, then = (
        looked.cycle.seen.segmentation.segments[found.facts["object"] - 1].centroid
        for looked, found in ((context, by_region), (again, by_mask))
    )
    assert np.linalg.norm(first - then) < 0.03  # labels change from look to look
    assert again.cycle.capture.mask.sum() == pytest.approx(
        context.cycle.capture.mask.sum(), rel=0.2
    )


def test_a_mask_over_several_objects_is_told_of_once(handle, caplog):
    context, _ = handle(region=HANDLE)
    capture_, seen = context.cycle.capture, context.cycle.seen
    handle(mark=StaysMarked.of(capture_))
    assert "the mask covers" not in caplog.text
    everything = np.zeros(capture_.depth.shape, dtype=bool)
    everything[measured(capture_)] = seen.segmentation.labels > 0
    context, _ = handle(mark=StaysMarked.of(replace(capture_, mask=everything)))
    assert caplog.text.count("the mask covers") == 1
    assert "notes" not in segment(context).facts


def test_reasons_of_what_is_left_are_not_told_again_by_the_fault(handle, monkeypatch):
    context, _ = handle(region=HANDLE)
    monkeypatch.setattr(Marks, "why_left", lambda *_: "no arm gets there")
    found = select(context)
    assert list(context.left.values()) == ["no arm gets there"]
    assert found.message == ("no candidate is left to try: 1 object could not be taken")


def test_objects_of_two_looks_have_two_names_and_two_pictures(handle, monkeypatch):
    context, first = handle(region=HANDLE)
    look(context)
    second = select(context)
    assert (first.facts["look"], second.facts["look"]) == (1, 2)
    assert context.cycle.capture.name == "capture_002"
    monkeypatch.setattr(Marks, "why_left", lambda *_: "no arm gets there")
    select(context)
    (name,) = context.left
    assert name.startswith(f"object {second.facts['object']} of look 2, ")


def test_an_object_that_is_marked_and_never_seen_is_no_cleared_way(handle):
    nowhere = Bounds(np.array([0.9, -0.6, 0.6]), np.array([1.0, -0.5, 0.7]))
    context, found = handle(region=nowhere)
    assert isinstance(found, FaultFound)
    assert found.fault == "empty_cloud"
    context.n_removed = 1
    assert select(context).next is State.CLEARED
