"""Down until what a hand holds lies: limits, speeds, and what stands on a corner."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.control import Body, LegOutcome
from debrisgrasp.executive import laying, recover
from debrisgrasp.executive.drive import Drive
from debrisgrasp.executive.lowering import lower
from debrisgrasp.executive.relief import with_room
from debrisgrasp.executive.result import FaultFound, LegEnd
from debrisgrasp.executive.senses import SAFETY
from debrisgrasp.executive.states import State
from debrisgrasp.geometry import so3
from tests.unit.executive.rigs import before_a_brick, holding


def feel(context, limb, load, monkeypatch):
    """Let the sensor of a limb feel one more load (6,) on the hand, in its axes."""
    sensor = limb.limb.sensor
    read = type(sensor).read

    def loaded(own):
        felt = read(own)
        if own is not sensor:
            return felt
        R, _ = limb.kinematics.pose(context.posture(limb).tolist())
        more = limb.loads.reading(load(), R) - limb.loads.reading(np.zeros(6), R)
        return felt._replace(wrench_ft=np.asarray(felt.wrench_ft) + more)

    monkeypatch.setattr(type(sensor), "read", loaded)


def hang(context, limb, weight, monkeypatch, aside=0.0):
    """Let the sensor of a limb feel a weight [N], aside of its hand [m], in base."""

    def load():
        _, forward, up = limb.pose(context.posture(limb)).R
        return [*(-weight * up), *(weight * aside * forward)]

    feel(context, limb, load, monkeypatch)


@pytest.mark.parametrize(
    ("share", "aside", "goes"),
    [(0.5, 0.0, True), (1.0, 0.0, True), (1.5, 0.0, False), (0.99, 0.42, True)],
)
def test_what_hangs_near_the_limit_of_a_motion_is_still_put_down(
    pipeline, monkeypatch, share, aside, goes
):
    """Above what the hand bears it is let go where it hangs."""
    _, task = before_a_brick(pipeline)
    context, limb = task.context, task.context.limbs["right"]
    context.state = State.RECOVER
    drive = Drive(context, "right")
    limits = drive.limits
    weight = share * (limits.torque / aside if aside else limits.force)
    hang(context, limb, weight, monkeypatch, aside)
    height = limb.pose(context.posture(limb)).p[2]
    limb.limb.arm.engage()
    assert lower(drive, 0.05).outcome is (
        LegOutcome.DONE if goes else LegOutcome.BLOCKED
    )
    lowered = height - limb.pose(context.posture(limb)).p[2]
    assert lowered == pytest.approx(0.05 if goes else 0.0, abs=2e-3)
    assert not limb.limb.arm.is_stopped


@pytest.mark.parametrize(
    ("lowest", "outcome", "lowerings"),
    [
        (0.05, LegOutcome.CONTACT, 1),
        (0.6, LegOutcome.CONTACT, 3),
        (0.05, LegOutcome.DONE, 3),
    ],
)
def test_what_brushed_something_high_up_or_nothing_is_lowered_on(
    pipeline, monkeypatch, lowest, outcome, lowerings
):
    """What was seen of an object as it hung may not be its lowest end."""
    _, task = before_a_brick(pipeline)
    context, done = task.context, []
    context.state, limb = State.RECOVER, context.limbs["right"]
    T = limb.pose(context.posture(limb))
    bottom = T.inverse().apply(np.array([[*T.p[:2], lowest]]))
    context.held = holding(points_hand=bottom, is_lifted=True)
    monkeypatch.setattr(laying, "free_share", lambda *_: 1.0)

    def lowered(_, depth):
        assert not context.held.is_watched  # what bears it is no slip
        done.append(depth)
        return LegEnd(outcome, 1.0, depth)

    monkeypatch.setattr(laying, "lower", lowered)
    monkeypatch.setattr(laying, "let_go", lambda _: None)
    assert laying.put_down(context, 0.1) is None
    assert done == pytest.approx([max(lowest, 0.1)] * lowerings)


def test_what_bends_on_something_far_out_is_let_go_there(pipeline, monkeypatch):
    """The second lowering only presses its far end down, to the limit of the hand."""
    _, task = before_a_brick(pipeline)
    context, limb = task.context, task.context.limbs["right"]
    T = limb.pose(context.posture(limb))
    bottom = T.inverse().apply(np.array([[*T.p[:2], 0.4]]))
    context.held = holding(points_hand=bottom, is_lifted=True)
    monkeypatch.setattr(laying, "free_share", lambda *_: 1.0)
    monkeypatch.setattr(laying, "let_go", lambda _: None)
    ends = [
        LegEnd(LegOutcome.CONTACT, 0.5, 0.4),
        FaultFound("too_heavy", "32 N m"),
    ]
    monkeypatch.setattr(laying, "lower", lambda *_: ends.pop(0))
    assert laying.put_down(context, 0.1) is None
    assert not ends
    ends[:] = [FaultFound("too_heavy", "32 N m")]
    assert laying.put_down(context, 0.1).fault == "too_heavy"


@pytest.mark.parametrize(("reach", "is_slow"), [(0.2, False), (0.8, True)])
@pytest.mark.parametrize("is_put_down", [True, False])
def test_what_is_long_is_lowered_so_slowly_that_its_end_overloads_no_wrist(
    pipeline, monkeypatch, reach, is_slow, is_put_down
):
    """To where it is put down, or back to where its lift began."""
    _, task = before_a_brick(pipeline)
    context, speeds = task.context, []
    drive = Drive(context, "right")
    begun = drive.limb.pose(context.posture(drive.limb)).p - [0.0, 0.0, 0.05]
    context.held = holding(
        arm="right",
        points_hand=np.array([[reach, 0.0, 0.0]]),
        is_lifted=is_put_down,
        begun=begun,
    )
    monkeypatch.setattr(Drive, "leg", lambda *_, speed, **__: speeds.append(speed))
    if is_put_down:
        lower(drive, 0.05)
    else:
        recover._gone_back(context, context.held)
    usual, torque = context.settings.lift_speed, drive.limb.limits.controller.torque
    assert speeds[0] == pytest.approx(usual) or is_slow
    assert speeds[0] < 0.6 * usual or not is_slow
    # Through the stiffest contact, a tenth of a second later.
    assert 3e4 * speeds[0] * 0.1 * reach < torque


def test_what_swings_a_little_on_a_hand_near_its_limit_is_put_down_all_the_same(
    pipeline,
):
    """A hanging pallet: 31.7 N m of 32.2, and 0.2 more in one tick."""
    _, task = before_a_brick(pipeline)
    drive = Drive(task.context, "right")
    load = np.array([0.0, 0.0, -75.0, 0.0, 0.99 * drive.limits.torque, 0.0])
    room = with_room(drive.limits, load).torque - load[4]
    assert 0.2 * SAFETY.lead / drive.period < 0.5 * room
    assert load[4] + room < drive.limb.limits.controller.torque


class Ground:
    """What a limb feels of a rigid body that it holds over a springy ground."""

    STIFFNESS = 2e4

    def __init__(self, context, limb, corners_hand, mass, monkeypatch):
        self.context, self.limb, self.corners = context, limb, corners_hand
        self.weight = np.array([0.0, 0.0, -9.81 * mass])
        self.com = corners_hand.mean(axis=0)
        self.height = self.where()[:, 2].min() - 0.02
        self.most = np.zeros(2)
        feel(context, limb, self.load, monkeypatch)

    def where(self):
        """Corners in base, (8, 3)."""
        return self.limb.pose(self.context.posture(self.limb)).apply(self.corners)

    def load(self):
        """On the hand, its axes, (6,)."""
        T = self.limb.pose(self.context.posture(self.limb))
        deep = np.maximum(self.height - self.where()[:, 2], 0.0)
        pushes = np.outer(self.STIFFNESS * deep, [0.0, 0.0, 1.0])
        arms = self.where() - T.p
        force = pushes.sum(axis=0) + self.weight
        torque = np.cross(arms, pushes).sum(axis=0)
        torque += np.cross(T.R @ self.com, self.weight)
        self.most = np.maximum(
            self.most, [np.linalg.norm(force), np.linalg.norm(torque)]
        )
        return np.concatenate([T.R.T @ force, T.R.T @ torque])


def block_in_hand(context, limb, tilt):
    """Corners of a block below a hand (8, 3), its own frame [m], turned by ``tilt``."""
    block = np.array(np.meshgrid([-0.2, 0.2], [-0.1, 0.1], [-0.1, 0.1])).reshape(3, -1)
    T = limb.pose(context.posture(limb))
    where = block.T @ so3.exp(tilt).T + [0.12, -0.05, -0.25]
    return where @ T.R


@pytest.mark.parametrize(
    "tilt", [(0.0, 0.2, 0.0), (-0.15, 0.1, 0.5), (0.2, -0.25, 1.0), (0.3, 0.0, -0.7)]
)
def test_what_hangs_aslant_is_turned_until_it_lies(pipeline, monkeypatch, tilt):
    _, task = before_a_brick(pipeline)
    context, limb = task.context, task.context.limbs["right"]
    context.state = State.RELEASE
    corners = block_in_hand(context, limb, tilt)
    ground = Ground(context, limb, corners, 5.0, monkeypatch)
    com_ft = limb.loads.T_ee_ft.inverse().apply(ground.com)
    held = holding(points_hand=corners, payload=Body(5.0, com_ft), is_lifted=True)
    context.held = held
    drive = Drive(context, "right")
    limb.limb.arm.engage()
    assert lower(drive, 0.05).outcome is LegOutcome.CONTACT
    slanting = np.sort(ground.where()[:, 2])
    assert np.ptp(slanting[:4]) > 0.03
    assert laying._laid(drive, held) is None
    lying = np.sort(ground.where()[:, 2])
    assert np.ptp(lying[:4]) < 0.012
    assert abs(lying[:4].mean() - ground.height) < 5e-3
    # Nothing pressed harder than it hung.
    assert (ground.most < [1.2 * 9.81 * 5.0, 12.0]).all()
    assert not limb.limb.arm.is_stopped


@pytest.mark.parametrize(("mass", "is_found"), [(5.0, True), (4.0, False)])
def test_what_slipped_in_the_hand_is_weighed_again_where_it_hangs(
    pipeline, monkeypatch, mass, is_found
):
    """What is lighter than it was touches something, and is no new weight."""
    _, task = before_a_brick(pipeline)
    context, limb = task.context, task.context.limbs["right"]
    context.state = State.RELEASE
    corners = block_in_hand(context, limb, (0.0, 0.2, 0.0))
    ground = Ground(context, limb, corners, mass, monkeypatch)
    T = limb.pose(context.posture(limb))
    before = ground.com + T.R.T @ [0.06, -0.04, 0.03]
    known = Body(5.0, limb.loads.T_ee_ft.inverse().apply(before))
    held = holding(points_hand=corners, payload=known, is_lifted=True)
    assert laying._weighed_again(Drive(context, "right"), held) is None
    off = T.R @ (limb.loads.T_ee_ft.apply(held.payload.com) - ground.com)
    expected = [0.0, 0.0, 0.03] if is_found else [0.06, -0.04, 0.03]
    assert off == pytest.approx(expected, abs=5e-3)
    assert held.payload.mass == pytest.approx(5.0, abs=0.1)
