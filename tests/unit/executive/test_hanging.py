"""The second look at what was lifted, on the robot in memory."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from debrisgrasp.executive import hanging
from debrisgrasp.executive.dropoff import object_in_hand
from debrisgrasp.executive.gaze import look_of
from debrisgrasp.executive.hanging import (
    _divided,
    looked_after,
    looked_around,
    looked_at,
)
from debrisgrasp.executive.obstacles import space_of
from debrisgrasp.executive.perceive import image
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.motion import UnknownSpace
from debrisgrasp.robot import HandReading
from debrisgrasp.robot.fake_hand import FakeGripper
from debrisgrasp.worlds import World, make_body
from tests.unit.executive.rigs import holding, look, task_before

LENGTH, UP = 0.5, 0.3
WALL = {"length": 0.1, "width": 0.4, "height": 0.3}
BEAM = SE3.from_parts(so3.from_rpy(np.array([0.0, np.pi / 2, 0.0])), [1.2, 0.0, 0.25])
BLOCK = SE3.from_parts(p=[1.0, 0.0, 0.15])


@pytest.fixture
def lifted(pipeline):
    """A beam that stood behind a block, whose top was seen and gripped, is lifted."""
    beam = make_body("brick", {"length": LENGTH, "width": 0.08, "height": 0.08}, 2.0)
    block = make_body("brick", WALL, 5.0, name="wall")
    fake, task = task_before(pipeline, beam.at(BEAM), block.at(BLOCK))
    context = task.context
    look(context)
    seen, top = context.cycle.seen, BEAM.p + np.array([0.0, 0.0, 0.2])
    context.cycle.label = min(
        seen.segmentation.segments, key=lambda s: np.linalg.norm(s.centroid - top)
    ).label
    points = seen.cloud.points[seen.segmentation.points_of(context.cycle.label)]
    assert np.ptp(points[:, 2]) < 0.35  # the rest is behind the block
    hand = context.limbs["right"].hand
    grasp = SimpleNamespace(preshape=next(iter(hand.preshapes)), width=0.08)
    context.cycle.motion = SimpleNamespace(arm="right", grasp=grasp)
    lifted = T_base_hand(context).inverse().apply(points + np.array([0, 0, UP]))
    context.held = held = holding(points_hand=lifted)
    rises = SE3.from_parts(p=[0.0, 0.0, UP])
    assert fake.change_world(
        lambda w: World((w.bodies[0].at(rises @ BEAM), w.bodies[1]), w.ground)
    )
    return fake, context, held


def T_base_hand(context):
    limb = context.limbs["right"]
    return limb.pose(context.posture(limb))


def test_what_hangs_in_the_hand_is_seen_in_its_whole_length(lifted):
    _, context, held = lifted
    assert looked_at(context, held) > 50
    points = T_base_hand(context).apply(held.points_hand)
    assert points[:, 2].max() == pytest.approx(LENGTH + UP, abs=0.03)
    assert UP - 0.12 < points[:, 2].min() < UP + 0.03  # and some underside
    assert np.all(np.abs(points[:, :2] - BEAM.p[:2]) < 0.1)


def test_the_pile_around_it_is_seen_anew_without_it(lifted):
    _, context, held = lifted
    looked_at(context, held)
    space = space_of(context, context.cycle.is_own, unknown=UnknownSpace.IGNORED)
    points = space.measured_points
    beside = np.abs(points[:, :2] - BEAM.p[:2]).max(axis=1) < 0.08
    assert np.count_nonzero(beside & (points[:, 2] > 0.35)) < 10  # flying pixels
    face = np.abs(points - BLOCK.p - np.array([0, 0, 0.15])).max(axis=1) < 0.06
    assert np.count_nonzero(face) > 20


def test_of_an_object_that_is_gripped_at_a_part_the_whole_is_lifted(lifted):
    _, context, _ = lifted
    cycle, pose = context.cycle, SE3.identity()
    part = object_in_hand(context, pose, 0.05)
    is_own = cycle.is_own | (np.abs(cycle.seen.cloud.points - BLOCK.p) < 0.2).all(
        axis=1
    )
    cycle.plan = SimpleNamespace(is_own=is_own)
    whole = object_in_hand(context, pose, 0.05)
    assert whole[:, 2].min() < 0.1 < part[:, 2].min()
    space = space_of(context, cycle.is_own, unknown=UnknownSpace.IGNORED)
    assert (np.abs(space.measured_points - BLOCK.p) > 0.16).any(axis=1).all()


def test_what_is_out_of_the_picture_remains_what_it_was_taken_for(lifted):
    fake, context, held = lifted
    away = SE3.from_parts(p=[-5.0, 0.0, 0.0])
    fake.change_world(
        lambda w: World((w.bodies[0].at(away @ BEAM), w.bodies[1]), w.ground)
    )
    known = held.points_hand.copy()
    assert looked_at(context, held) == 0
    np.testing.assert_array_equal(held.points_hand, known)
    above = context.cycle.around[:, 2] > 0.35
    assert np.count_nonzero(above) < 5  # nothing stands there any more


def test_what_an_empty_hand_moved_is_seen_where_it_is_now(lifted, monkeypatch):
    fake, context, _ = lifted
    context.held = None
    before = context.cycle.seen.cloud.points
    aside = SE3.from_parts(p=[0.0, 0.3, 0.0])
    fake.change_world(
        lambda w: World((w.bodies[0].at(aside @ BEAM), w.bodies[1]), w.ground)
    )
    # It is at rest here; where it touches something it stands in the picture.
    monkeypatch.setattr(hanging, "look_towards", lambda *_: look_of(context))
    looked_around(context, "right")
    after = context.cycle.around

    def n_standing(points, place):
        beside = np.abs(points[:, :2] - place[:2]).max(axis=1) < 0.1
        return np.count_nonzero(beside & (points[:, 2] > 0.35))

    assert n_standing(before, BEAM.p) > 50
    assert n_standing(after, BEAM.p) < 5
    assert n_standing(after, (aside @ BEAM).p) > 50
    # Nobody sees its back: whatever is there is a guess.
    (hidden,) = context.memory.fallen
    from_camera = (aside @ BEAM).p - context.cycle.seen.cloud.viewpoint
    behind = (aside @ BEAM).p + 0.1 * from_camera / np.linalg.norm(from_camera)
    assert np.linalg.norm(hidden - behind, axis=1).min() < 0.03
    assert np.linalg.norm(hidden - BEAM.p, axis=1).min() > 0.1
    assert np.linalg.norm(hidden - BLOCK.p, axis=1).min() > 0.1


@pytest.mark.parametrize("openings", [(np.nan,) * 3, (-5e-4,) * 3, (np.nan, 0.1, 0.3)])
def test_fingers_that_tell_no_sizes_keep_nobody_from_looking(
    lifted, monkeypatch, openings
):
    _, context, _ = lifted
    context.held = None
    read = HandReading(0.0, openings, (0.0,) * 3)
    monkeypatch.setattr(FakeGripper, "read", lambda _: read)
    looked_around(context, "right")
    assert len(context.cycle.around) > 50
    assert looked_after(context, "right", np.array([0.75, -0.85, 0.1])) is not None


def test_what_was_put_down_is_seen_where_it_lies(lifted):
    fake, context, _ = lifted
    sizes = {"length": 0.3, "width": 0.2, "height": 0.2}
    crate = make_body("brick", sizes, 2.0, name="crate")
    fake.change_world(
        lambda w: World(
            (*w.bodies, crate.at(SE3.from_parts(p=[0.75, -0.85, 0.1]))), w.ground
        )
    )
    # It fell over to the side, and the hand stands where it was let go.
    hand = T_base_hand(context).p + 0.004 * np.random.default_rng(0).normal(size=(9, 3))
    grid = np.stack(np.meshgrid(*3 * [[-0.03, 0.0, 0.03]]), axis=-1).reshape(-1, 3)
    guess = grid + np.array([0.75, -0.85, 0.5])
    context.memory.dropped[:] = [hand, guess]
    place = context.memory.dropped[-1].mean(axis=0)
    assert len(looked_after(context, "right", place)) > 50
    (lying,) = context.memory.settled
    assert lying[:, 2].max() == pytest.approx(0.2, abs=0.03)
    beside = np.abs(lying[:, :2] - [0.75, -0.85]).max(axis=1) < 0.18
    assert beside.mean() > 0.95
    # Where the image has no depth, the guess remains.
    assert sum(map(len, context.memory.dropped)) < 0.2 * (len(hand) + len(guess))


@pytest.mark.parametrize(("height", "border"), [(0.6, 0), (1.1, 0), (1.1, 4)])
def test_what_stands_on_end_is_seen_up_to_its_top(lifted, monkeypatch, height, border):
    """Though one picture that shows the place does not show so far up."""
    fake, context, _ = lifted
    camera = type(context.robot.camera)
    whole = camera.capture

    def bordered(self):
        frame = whole(self)
        inner = np.pad(np.ones(np.subtract(frame.depth.shape, 2 * border)), border)
        return replace(frame, depth=np.where(inner > 0.0, frame.depth, np.nan))

    monkeypatch.setattr(camera, "capture", bordered)
    sizes = {"length": 0.12, "width": 0.12, "height": height}
    post = make_body("brick", sizes, 2.0, name="post")
    place = [0.6, -0.75, 0.5 * height]
    fake.change_world(
        lambda w: World((*w.bodies, post.at(SE3.from_parts(p=place))), w.ground)
    )
    context.memory.dropped[:] = [np.add(place, [[-0.05, 0.0, -0.2], [0.05, 0.0, 0.2]])]
    assert len(looked_after(context, "right", np.array(place))) > 50
    (lying,) = context.memory.settled
    assert lying[:, 2].max() == pytest.approx(height, abs=0.03)


def post_at(x, low=0.0, high=0.6):
    heights = np.arange(low, high, 0.01)
    return np.array([x, -0.85, 0.0]) + heights[:, None] * [0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("seen", "heights"),
    [
        (np.concatenate([post_at(0.75, high=0.15), post_at(1.0)]), (0.2, 0.6, 0.6)),
        (np.concatenate([post_at(0.75, 0.5), post_at(1.0)]), (0.6, 0.6, 0.6)),
        (np.zeros((0, 3)), (0.2, 0.2, 0.6)),
        (None, (0.6, 0.6, 0.6)),
    ],
)
def test_what_leaned_on_the_hand_is_not_believed_to_stand_when_that_is_away(
    lifted, monkeypatch, seen, heights
):
    """What is seen in part stands, as does what stood elsewhere; nothing is known from
    no picture.
    """
    _, context, _ = lifted
    posts = [post_at(x) for x in (0.75, 1.0, 1.4)]
    looks = []
    monkeypatch.setattr(hanging, "looked_after", lambda *_: looks.append(1) or seen)
    context.memory.settled[:] = [np.concatenate(posts)]
    context.memory.dropped[:] = [np.add(post, [0.02, 0.0, 0.0]) for post in posts]
    place = np.array([0.75, -0.85, 0.3])
    hanging.looked_again(context, "right", place, post_at(0.75, high=0.15))
    assert not looks  # what lies can't fall
    hanging.looked_again(context, "right", place, np.concatenate(posts))
    (lain,) = context.memory.settled
    for i, (x, height) in enumerate(zip((0.75, 1.0, 1.4), heights, strict=True)):
        top = lain[np.abs(lain[:, 0] - x) < 0.1, 2].max()
        assert top == pytest.approx(height, abs=0.02)
        assert context.memory.dropped[i][:, 2].max() == pytest.approx(height, abs=0.02)


def test_a_head_at_its_stop_takes_no_picture_twice(lifted, monkeypatch):
    fake, context, _ = lifted
    sizes = {"length": 0.12, "width": 0.12, "height": 1.1}
    place = [0.6, -0.75, 0.55]
    post = make_body("brick", sizes, 2.0, name="post").at(SE3.from_parts(p=place))
    fake.change_world(lambda w: World((*w.bodies, post), w.ground))
    context.memory.dropped[:] = [np.add(place, [[-0.05, 0.0, -0.2], [0.05, 0.0, 0.2]])]
    stop = hanging.look_towards(context, np.array([*place[:2], 0.25]))
    monkeypatch.setattr(hanging, "look_towards", lambda *_: stop)
    taken = []
    monkeypatch.setattr(
        hanging, "image", lambda *a, **k: taken.append(a) or image(*a, **k)
    )
    assert len(looked_after(context, "right", np.array(place))) > 50
    assert len(taken) == 1


def test_what_the_arm_divides_in_the_picture_belongs_together_if_it_moved():
    def patch(x, y):
        grid = np.linspace(-0.05, 0.05, 11)
        return np.stack(np.meshgrid(x + grid, y + grid, [0.5]), -1).reshape(-1, 3)

    held, beyond, lying, far = (
        patch(0, 0),
        patch(0.2, 0),
        patch(0, 0.2),
        patch(0.6, 0),
    )
    points = np.concatenate([held, beyond, lying, far, [[0.1, 0.1, 0.7]]])
    # What lies beside it was uncovered; the others came into free space.
    gap = np.where(np.arange(len(points)) // len(held) == 2, -0.1, 0.1)
    of_held, is_noise = _divided(points, gap, np.ones(len(points), bool), held)
    parts = of_held[:-1].reshape(4, -1)
    assert parts.all(axis=1).tolist() == [True, True, False, False]
    assert parts.any(axis=1).tolist() == [True, True, False, False]
    assert np.flatnonzero(is_noise).tolist() == [len(points) - 1]
