"""The truth about bodies and hands: who touches, holds, pushes and carries whom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import dist, hypot

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._physics import GRAVITY
from debrisgrasp.control._rigid import (
    IDENTITY,
    Rotation,
    Vector,
    Wrench,
    added,
    parts,
    times,
    turned,
)
from debrisgrasp.geometry import SE3
from debrisgrasp.worlds import World

from .burden import load_of
from .config import FakeConfig
from .fake_arm import FakeArm, FakeForceSensor
from .fake_hand import FakeGripper
from .holding import Grip, Hold, Seat, is_enclosed, sides_of
from .links import LinkSpheres
from .pushing import Pushes
from .rubble import Rubble
from .settling import HandState, Settling
from .slipping import Leaning, slip_of
from .springs import GROUND, HELD, PALM, Spring
from .touch import Touch

__all__ = ["Stage"]

_SLIP_CHECK = 0.004
"""After every so much of slip the grip is looked at again [m]."""
_PAST = 0.01
"""Slipped by so much, a body that the fingers lose is past them [m]."""
_LIFTED = 0.005
"""Moved by so much, a held body no longer bears what lay on it as before [m]."""
_RIDE = 0.015
"""After every so much of a way what lies on a held body sinks to rest again [m]."""
_LOOSE = 0.5
"""Squeezed with less, a body is let go [N]."""
_OFF_SEAT = 0.02
"""Moved by so much, a body no longer rests where it lay [m]."""
_FALLS_WITHIN = 0.03
"""What slides off a held body takes so long to be gone [s]."""
_SETTLE_WAYS = (0.005, 0.05, 0.25)
"""Ways of a held body after which what it bore sinks to rest [m]."""


class Stage:
    """Bodies where they are, and what they do to the hands."""

    def __init__(
        self,
        world: World,
        arms: Mapping[str, FakeArm],
        hands: Mapping[str, FakeGripper],
        sensors: Mapping[str, FakeForceSensor],
        config: FakeConfig,
    ) -> None:
        self._config = config
        self.friction = config.friction
        """Between bodies, ground and fingers."""
        self.sticky_ticks = 0
        """For so many periods hands let go of nothing."""
        self._rubble = Rubble(world, config)
        self._hands = {
            name: HandState(
                arms[name],
                hands[name],
                sensors[name],
                Touch(hands[name], world.ground, config),
            )
            for name in arms
        }
        self._settling = Settling(self._rubble, list(self._hands.values()))
        self._started = [shape.com.copy() for shape in self._rubble.shapes]
        self._pushes = Pushes(self._rubble, config)
        self._is_far: dict[int, bool] = {}
        self._moved = 0.0
        """How far pushes moved bodies in the last period [m]."""
        self._base: tuple[SE3, Rotation, Vector]
        self._base = SE3.identity(), IDENTITY, (0.0, 0.0, 0.0)
        """Pose of the base in odom, and the same as plain numbers."""
        self.peak_force = dict.fromkeys(arms, 0.0)
        self.peak_torque = dict.fromkeys(arms, 0.0)
        self.scrapes: dict[tuple[str, str], float] = {}

    @property
    def world(self) -> World:
        """Bodies where they are now, frame odom."""
        return self._rubble.world

    @property
    def held(self) -> dict[str, str]:
        """Bodies in hands, by arm."""
        names = self._rubble.names
        return {
            arm: names[hand.hold.index]
            for arm, hand in self._hands.items()
            if hand.hold is not None
        }

    @property
    def removed(self) -> tuple[str, ...]:
        """Bodies that a hand put down, or pushed, far from where they were."""
        return tuple(
            self._rubble.names[i] for i, is_far in self._is_far.items() if is_far
        )

    def remember(self, before: Stage) -> None:
        """Go on with the account of a stage that this one replaces."""
        self.friction, self.sticky_ticks = before.friction, before.sticky_ticks
        self.peak_force, self.peak_torque = before.peak_force, before.peak_torque
        names = self._rubble.names
        for i, is_far in before._is_far.items():
            name = before._rubble.names[i]
            if name in names:
                self._is_far[names.index(name)] = is_far
        # What now is where a hand is lies against it, and does not strike it.
        for hand in self._hands.values():
            hand.touch.settled(range(len(names)))

    def is_at_a_body(self, arm: str) -> bool:
        """Whether a hand holds a body, or is near enough to one to meet it."""
        hand = self._hands[arm]
        return hand.hold is not None or hand.is_at(
            set(range(len(self._rubble.shapes))), self._rubble
        )

    def advance(self, T_odom_base: SE3) -> None:
        """Let a period pass for fingers and bodies."""
        touched: dict[int, list[Spring]] = {}
        if T_odom_base is not self._base[0]:
            self._base = T_odom_base, *parts(T_odom_base)
        self.sticky_ticks = max(self.sticky_ticks - 1, 0)
        for name, hand in self._hands.items():
            self._advance_hand(name, hand)
            for spring in hand.springs:
                if spring.body != GROUND and not self._is_held(spring.body):
                    touched.setdefault(spring.body, []).append(spring)
        self._moved = 0.0
        if touched or self._pushes:
            self._push(touched)
        if self._settling.is_leaning:
            self._settling.follow()

    def scrape(self, arm: str, links: LinkSpheres, T_odom_base: SE3) -> None:
        """Take note of the bodies that an arm's links go through."""
        held = self._held_bodies()
        q = self._hands[arm].arm.q
        for body, depth in links.overlaps(q, T_odom_base, self._rubble.shapes):
            if body not in held:
                key = arm, self._rubble.names[body]
                self.scrapes[key] = max(depth, self.scrapes.get(key, 0.0))

    def _is_held(self, body: int) -> bool:
        return any(
            hand.hold is not None
            and (hand.hold.index == body or body in hand.hold.riders)
            for hand in self._hands.values()
        )

    def _held_bodies(self) -> set[int]:
        return {h.hold.index for h in self._hands.values() if h.hold is not None}

    def _advance_hand(self, name: str, hand: HandState) -> None:
        fingers_moved = hand.gripper.advance()
        pose = hand.arm.pose()
        hold = hand.hold
        is_slipping = hold is not None and (hold.is_slipping or hold.is_loading)
        key = (pose, self._base[0], self._rubble.version, hand.gripper.force)
        if hand.seen == key and not fingers_moved and not is_slipping:
            return
        if hand.seen is None or hand.seen[2] != key[2]:
            hand.touch.forget()
        hand.seen = key
        axes, place = self._in_odom(*pose)
        is_clear = not fingers_moved and hand.touch.is_clear(axes, place)
        if hold is None and is_clear:
            return
        before, moved = (hand.R, hand.p), self._moved
        R, p = hand.R, hand.p = np.array(axes).reshape(3, 3), np.array(place)
        if hand.hold is not None:
            moved += self._carry(hand.hold, R, p)
            self._bear(hand, hand.hold, *before)
        if not is_clear or hand.springs:
            pushed = [spring.seen_from(*before) for spring in hand.springs]
            left_out = self._left_out(hand)
            hand.springs = hand.touch.springs(R, p, self._rubble.shapes, left_out)
            seen = [spring.seen_from(R, p) for spring in hand.springs]
            if hand.hold is not None:
                hand.hold.feel(pushed, seen, moved, self._config)
            self._feel(hand, seen)
        if hand.hold is None:
            self._try_hold(hand, R, p)
        on_body, load = load_of(hand, self._rubble.shapes, axes, place)
        hand.sensor.load_ee = load
        self.peak_force[name] = max(self.peak_force[name], hypot(*load[:3]))
        self.peak_torque[name] = max(self.peak_torque[name], hypot(*load[3:]))
        if hand.hold is not None:
            self._check_hold(hand, hand.hold, on_body)

    def _in_odom(self, R: Rotation, p: Vector) -> tuple[Rotation, Vector]:
        """Pose of a hand in odom as plain numbers."""
        _, R_odom_base, p_odom_base = self._base
        if R_odom_base == IDENTITY:  # it has not turned yet
            return R, added(p, p_odom_base)
        p_turned = turned(R_odom_base, p)
        return times(R_odom_base, R), added(p_turned, p_odom_base)

    def _left_out(self, hand: HandState) -> set[int]:
        """Bodies that a hand passes through: in the other hand, or on what it holds."""
        left_out = set() if hand.hold is None else set(hand.hold.riders)
        for other in self._hands.values():
            if other is not hand and other.hold is not None:
                left_out |= {other.hold.index, *other.hold.riders}
        return left_out

    def _feel(self, hand: HandState, springs: Sequence[Spring]) -> None:
        """Tell each finger what it feels, by springs in the frame of the hand."""
        if hand.grip.contacts is not hand.touch.grip:
            body = GROUND if hand.hold is None else hand.hold.index
            hand.grip = Grip.of(hand.touch.grip, body, hand.touch)
        forces = list(hand.grip.felt)
        for owner, _, point, force, *_ in springs:
            if owner > PALM:
                forces[owner - 1] += hand.touch.felt(owner, point, force)
        hand.gripper.forces = forces

    def _try_hold(self, hand: HandState, R: FloatArray, p: FloatArray) -> None:
        """Hold what the fingers enclose; wide open, or opening, they only touch it."""
        if hand.gripper.is_wide_open or hand.gripper.is_opening:
            return
        for body in {spring.body for spring in hand.springs} - {GROUND}:
            if self._is_held(body):
                continue
            sides = sides_of(hand.springs, body, hand.gripper.model)
            if not is_enclosed(*sides, self.friction):
                continue
            rubble, shape = self._rubble, self._rubble.shapes[body]
            pushed_along = {*self._pushes.forget(body)} - {body}
            com = shape.com.copy()
            hand.hold = Hold(
                index=body,
                R=R.T @ shape.R,
                p=R.T @ (shape.p - p),
                seat=Seat(
                    com.copy(),
                    self._config.stiffness_at(dist(com, p)),
                    self.friction,
                    rubble.is_on_ground(body),
                ),
                start=com,
                settled_at=com,
                neighbours=rubble.touching(body),
            )
            hand.touch.hold(body, shape, hand.hold.R, hand.hold.p)
            hand.springs = [s for s in hand.springs if s.body != body]
            if pushed_along:
                self._settling.settle(pushed_along, self._held_bodies())
            return

    def _carry(self, hold: Hold, R: FloatArray, p: FloatArray) -> float:
        """Move what is held, and what lies on it, with the hand; how far [m]."""
        shape = self._rubble.shapes[hold.index]
        R_before, p_before, com = shape.R, shape.p, shape.com
        R_new, p_new = R @ hold.R, R @ hold.p + p
        self._rubble.place(hold.index, R_new, p_new)
        if hold.riders:
            turn = R_new @ R_before.T
            way = p_new - turn @ p_before
            for rider in hold.riders:
                other = self._rubble.shapes[rider]
                self._rubble.place(rider, turn @ other.R, turn @ other.p + way)
        gone = dist(shape.com, hold.start)
        if hold.seat is not None and gone > _OFF_SEAT and not hold.seat.on_ground:
            hold.seat = None
        n = hold.n_settled
        is_due = n < len(_SETTLE_WAYS) and gone > _SETTLE_WAYS[n]
        since = dist(shape.com, hold.settled_at) if hold.riders else 0.0
        if is_due or since > _RIDE:
            loose = set(hold.riders)
            if is_due:
                hold.n_settled += 1
                loose |= hold.neighbours
            hold.settled_at = shape.com.copy()
            hold.riders = self._rubble.riders(hold.index)
            self._settling.settle(loose, self._held_bodies())
            hold.riders = self._rubble.riders(hold.index)
        return dist(shape.com, com) + shape.radius * dist(R_new.flat, R_before.flat)

    def _bear(
        self, hand: HandState, hold: Hold, R_before: FloatArray, p_before: FloatArray
    ) -> None:
        """Let weights on what is held come on as the hand has moved it, and go."""
        share = min(self._config.period / _FALLS_WITHIN, 1.0)
        hold.fade(share)
        if not (hold.riders or hold.borne):
            return
        com, p = self._rubble.shapes[hold.index].com, hand.p
        # What it slips in the fingers takes nothing on.
        way = com - p_before - R_before @ (hand.R.T @ (com - p))
        x, y, up = way.tolist()
        moved = hypot(x, y, max(up, 0.0))  # what sinks takes nothing on
        wanted, grown = {}, {}
        for i, share in hold.riders.items():
            rider = self._rubble.shapes[i]
            wanted[i] = share * GRAVITY * rider.mass
            grown[i] = self._config.stiffness_at(dist(rider.com, p)) * moved
        hold.load(wanted, grown, share)

    def _check_hold(self, hand: HandState, hold: Hold, on_body: Wrench) -> None:
        """Let a body slip that the fingers can't keep, and go that they don't enclose.

        ``on_body`` is the load on it in the frame of the hand.
        """
        if hand.grip.contacts is not hand.touch.grip:
            hand.grip = Grip.of(hand.touch.grip, hold.index, hand.touch)
        grip = hand.grip
        if self.sticky_ticks:
            return
        if grip.squeeze < _LOOSE or hand.gripper.is_wide_open:
            self._let_go(hand, hold, has_slipped=hold.slipped > _PAST)
            return
        shape, model = self._rubble.shapes[hold.index], hand.gripper.model
        leaning = Leaning(
            (
                tuple(((spring.point + spring.lag - hand.p) @ hand.R).tolist())
                for spring in hand.springs
                if spring.owner == HELD
            ),
            dist(shape.middle, hand.p) + shape.radius,
            hold.turn,
        )
        slip = slip_of(on_body, grip, leaning, self.friction, model, self._config)
        hold.is_slipping = slip is not None
        hold.turn = (0.0, 0.0, 0.0) if slip is None else slip.turn
        if slip is None:
            return
        turn = np.reshape(slip.rotation, (3, 3))
        hold.R = turn @ hold.R
        hold.p = turn @ (hold.p - slip.centre) + slip.centre + slip.way
        n_before = hold.slipped // _SLIP_CHECK
        hold.slipped += slip.distance
        hand.touch.hold(hold.index, shape, hold.R, hold.p)
        is_due = hold.slipped // _SLIP_CHECK > n_before
        if is_due and not is_enclosed(*grip.sides, self.friction):
            self._let_go(hand, hold, has_slipped=True)

    def _let_go(self, hand: HandState, hold: Hold, *, has_slipped: bool) -> None:
        """Let a body sink to rest that no hand holds any more.

        What has slipped out is past the fingers, which still squeeze.
        """
        hand.hold = None
        hand.touch.hold(None, None, np.eye(3), np.zeros(3))
        hand.gripper.forces = [0.0] * len(hand.gripper.forces)
        passed = hand if has_slipped else None
        self._settling.settle({hold.index, *hold.riders}, self._held_bodies(), passed)
        self._rubble.version += 1
        self._note_far(hold.index)

    def _note_far(self, body: int) -> None:
        """Take note of whether a body is far from where it was."""
        way = self._rubble.shapes[body].com - self._started[body]
        self._is_far[body] = bool(np.linalg.norm(way) > self._config.removed_beyond)

    def _push(self, touched: Mapping[int, list[Spring]]) -> None:
        """Move what is pushed with more than friction, and settle what no longer is."""
        # What would fall into a hand waits until that is away.
        hands = self._hands.values()
        over = self._pushes.ended(
            touched, lambda body: any(hand.touch.is_near(body) for hand in hands)
        )
        for push in over:
            for body in push.bodies:
                self._note_far(body)
            loose = {body for body in push.bodies if not self._is_held(body)}
            if push.way > _LIFTED and loose:
                beside = (self._rubble.touching(body) for body in loose)
                self._settling.settle(loose.union(*beside), self._held_bodies())
        way = self._moved = self._pushes.push(touched, self._is_held)
        if way > 0.0:
            for hand in hands:
                hand.touch.shifted(way)
                if hand.seen is not None:
                    hand.seen = (None, *hand.seen[1:])
