"""One grasp flown by a hand without an arm: approach, close, lift, hold, or pull."""

from __future__ import annotations

from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray, require_finite
from debrisgrasp._physics import GRAVITY
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.worlds import World

from ._mujoco import mujoco
from .flight import Flight, FlightConfig, FlownGrasp, Moment, Verdict
from .hands import Grip, add_hand
from .model import compiled, for_grips, pose_of, world_tree
from .touch import Touch, touches, touches_others
from .wrist import Wrist
from .yielding import Yielding

__all__ = ["fly"]

_CHECK = 10
"""Steps between two looks at the contacts."""
_FREE_RISE = 0.8
"""Share of the lift below which a hand counts as held back."""
_SHORT = 0.02
"""An approach that ends so much before its goal has failed [m]."""
_SHIFTED = 0.03
"""A body that moved so far before the fingers met it was pushed [m]."""
_BURIED = 0.005
"""Depth at which a hand that starts in something has collided [m]."""
_DISTURBED = 0.02
"""A body that moved so far was disturbed [m]."""
_LEAST_SHARE = 0.06
"""Of the grip force: less doesn't overcome the springs of the fingers."""
_MOST_OF_WAY = 0.8
"""Share of the pull that an object must come along to be clear."""


def fly(
    world: World,
    hand: GripperModel,
    grasp: FlownGrasp,
    *,
    intended: str | None = None,
    config: FlightConfig | None = None,
) -> Flight:
    """Carry out one grasp in a world at rest.

    Parameters
    ----------
    world
        Bodies at rest, base frame.
    hand
        Of the grasp.
    grasp
        Pre-grasp and grasp pose of the palm, base frame, preshape, opening, width.
    intended
        Name of the body that the grasp is for; None: whatever is gripped.

    Raises
    ------
    InputError
        If a pose is not finite or the simulation diverges.
    UnknownNameError
        If there is no such body or preshape.
    MissingExtraError
        If MuJoCo is not installed.
    """
    if intended is not None:
        world.index(intended)
    for name in ("T_base_hand", "T_base_pregrasp"):
        require_finite(getattr(grasp, name).matrix, name)
    return _Flight(world, hand, grasp, config or FlightConfig()).flown(intended)


class _Flight:
    """One simulation; lives inside one call only."""

    def __init__(
        self, world: World, hand: GripperModel, grasp: FlownGrasp, config: FlightConfig
    ) -> None:
        self.world, self.hand, self.config = world, hand, config
        self.step = config.physics.time_step
        goal = grasp.T_base_hand
        start = SE3.from_parts(goal.R, grasp.T_base_pregrasp.p)
        self.way = goal.p - start.p
        root = world_tree(world, config.physics)
        for_grips(root)
        drives = add_hand(
            root,
            hand,
            preshape=grasp.preshape,
            opening=grasp.opening,
            width=grasp.width,
            T_base_hand=start,
            physics=config.hand,
            time_step=self.step,
        )
        self.mj, self.n = mujoco(), len(world.bodies)
        self.model: Any = compiled(root, world)
        self.data: Any = self.mj.MjData(self.model)
        for drive in drives:
            for joint, value in drive.joints.items():
                self.data.joint(joint).qpos[0] = value
        self.wrist = Wrist(self.model, start, config.wrist)
        self.yielding = Yielding(config, self.wrist)
        self.nominal = np.zeros(6)
        """Displacement of the wrist but for what it gives way."""
        self.grip = Grip(self.model, drives, config.hand)
        self.grip.reset(self.data)
        self.mj.mj_forward(self.model, self.data)
        self.start = self.centers()
        self.moments = [self.moment("start")]
        self.peak = np.zeros(2)
        self.deepest, self.n_steps, self.pulled = 0.0, 0, 0.0
        self.risen = np.zeros(self.n)
        self.touched: dict[int, Touch] = self.touching()

    def flown(self, intended: str | None) -> Flight:
        """Go through all phases."""
        index = None if intended is None else self.world.index(intended)
        if max((t.depth for t in self.touched.values()), default=0.0) > _BURIED:
            whole = float(np.linalg.norm(self.way))
            return self.result(Verdict.COLLISION_ON_APPROACH, index, short=whole)
        short = self.approach()
        before = self.centers()
        shift = 0.0
        if index is not None:
            shift = float(np.linalg.norm(before[index] - self.start[index]))
        self.close()
        gripped = self.gripped()
        if self.config.compliance is not None:
            self.stay(self.config.settle_time)
        poses = None if gripped is None else self.in_hand()
        self.peak[:] = 0.0
        risen = self.lift()
        self.risen = self.rises()
        verdict, body = self.judged(gripped, index, risen, short, shift)
        hangs = gripped is not None and self.gripped() == gripped
        if hangs and verdict is not Verdict.HELD and risen >= _FREE_RISE:
            assert gripped is not None
            if self.pull(gripped):
                verdict = Verdict.PULLED_CLEAR
        return self.result(verdict, body, poses, short=short, shift=shift)

    def approach(self) -> float:
        """Go straight to the grasp; return by how much contact cut it short [m]."""
        length = float(np.linalg.norm(self.way))
        duration = max(1.5 * length / self.config.approach_speed, 0.1)
        for share, rate in _profile(duration, self.step):
            self.wrist.target[:3] = share * self.way
            self.wrist.rate[:3] = rate * self.way
            if not self.tick():
                continue
            force = sum(touch.force for touch in self.touched.values())
            if force > self.config.contact_force:
                break
        self.wrist.target = self.wrist.displacement(self.data)
        self.wrist.rate[:] = 0.0
        self.moments.append(self.moment("approach"))
        left = self.way - self.wrist.target[:3]
        return max(0.0, float(left @ self.way) / max(length, 1e-9))

    def close(self) -> None:
        """Close gently until all fingers meet something, then press."""
        config = self.config
        share = config.resistance / config.hand.force_of(self.hand)
        gentle = float(np.clip(share, _LEAST_SHARE, 1.0))
        self.wrist.give_way()
        for _ in range(round(config.closing_time / self.step)):
            self.grip.advance(self.data, gentle, self.step)
            self.tick()
            efforts = self.grip.efforts(self.data)
            if (efforts >= 0.95 * gentle).all():
                break
        self.moments.append(self.moment("closing"))
        n_steps = round(config.squeeze_time / self.step)
        for k in range(n_steps):
            rise = min(1.0, 1.5 * k / n_steps)
            share = gentle + (1.0 - gentle) * rise
            self.grip.advance(self.data, share, self.step)
            self.tick(gripping=True)
        self.wrist.target = self.wrist.displacement(self.data)
        self.nominal = self.wrist.target.copy()
        self.wrist.hold_firmly()
        self.moments.append(self.moment("squeeze"))

    def lift(self) -> float:
        """Lift and hold; return the way of the hand over the commanded one."""
        start, direction = self.wrist.target[:3].copy(), np.array(self.config.lift)
        self.carry(direction, self.config.lift_time)
        self.moments.append(self.moment("lift"))
        self.stay(self.config.hold_time)
        self.moments.append(self.moment("hold"))
        moved = self.wrist.displacement(self.data)[:3] - start
        return float(moved @ direction / (direction @ direction))

    def pull(self, body: int) -> bool:
        """Pull what did not come up; say whether it came along, clear of all else."""
        config, way = self.config, np.array(self.config.pull)
        length, start = float(np.linalg.norm(way)), self.centers()[body]
        self.carry(way, 1.5 * length / config.pull_speed)
        self.stay(config.hold_time)
        self.moments.append(self.moment("pull"))
        self.pulled = float((self.centers()[body] - start) @ way / length)
        is_free = not touches_others(self.model, self.data, self.n, body)
        has_come = self.pulled >= _MOST_OF_WAY * length
        return has_come and is_free and self.gripped() == body

    def carry(self, way: FloatArray, duration: float) -> None:
        """Move the hand with what it holds."""
        start = self.nominal.copy()
        for share, rate in _profile(duration, self.step):
            self.nominal[:3] = start[:3] + share * way
            self.wrist.rate[:3] = rate * way
            self.hold_on()
        self.wrist.rate[:] = 0.0

    def stay(self, duration: float) -> None:
        """Hold still."""
        for _ in range(round(duration / self.step)):
            self.hold_on()

    def hold_on(self) -> None:
        """Let one step pass with the full squeeze, giving way as a compliance asks."""
        self.wrist.target = self.yielding.deflected(self.nominal, self.data)
        self.grip.advance(self.data, 1.0, self.step)
        self.tick(gripping=True)

    def tick(self, *, gripping: bool = False) -> bool:
        """Let one step pass; every tenth time look at the contacts and say so."""
        self.wrist.drive(self.data)
        self.mj.mj_step(self.model, self.data)
        if gripping:
            wrench = self.wrist.wrench
            sizes = (wrench[:3] @ wrench[:3], wrench[3:] @ wrench[3:])
            self.peak = np.maximum(self.peak, np.sqrt(sizes))
        self.n_steps += 1
        if self.n_steps % _CHECK:
            return False
        self.touched = self.touching()
        if gripping:
            depths = (t.depth for t in self.touched.values() if t.body >= 0)
            self.deepest = max(self.deepest, *depths, 0.0)
        return True

    def touching(self) -> dict[int, Touch]:
        """Bodies in contact with the hand."""
        return touches(self.model, self.data, self.n)

    def gripped(self) -> int | None:
        """Body that the hand holds from two sides; of several, the one held hardest."""
        side = {finger.name: finger.side for finger in self.hand.fingers}
        found = [
            touch
            for touch in self.touched.values()
            if touch.body >= 0 and len({side.get(s, 0) for s in touch.sides}) > 1
        ]
        return max(found, key=lambda touch: touch.force).body if found else None

    def judged(
        self,
        gripped: int | None,
        intended: int | None,
        risen: float,
        short: float,
        shift: float,
    ) -> tuple[Verdict, int | None]:
        """Name the outcome, and the body that it is about."""
        ways = self.risen
        up = [
            body
            for body, touch in self.touched.items()
            if body >= 0 and touch.force > 0.5 and ways[body] >= self.config.least_rise
        ]
        if up:
            best = max(up, key=lambda body: float(ways[body]))
            return Verdict.HELD, gripped if gripped in up else best
        body = intended if gripped is None else gripped
        if gripped is not None and risen < _FREE_RISE:
            return self.held_back(gripped), body
        if short > _SHORT:
            return Verdict.COLLISION_ON_APPROACH, body
        if gripped is not None:
            return Verdict.SLIPPED, body
        return (Verdict.PUSHED_AWAY if shift > _SHIFTED else Verdict.MISSED), body

    def held_back(self, body: int) -> Verdict:
        """Why the wrist gave way."""
        weight = GRAVITY * self.world.bodies[body].mass
        lever = np.linalg.norm(
            (self.centers()[body] - self.wrist.pose(self.data).p)[:2]
        )
        force, torque = self.config.wrist.limits
        is_heavy = weight > force or weight * lever > torque
        return Verdict.TOO_HEAVY if is_heavy else Verdict.STUCK

    def centers(self) -> FloatArray:
        """Centres of mass of all bodies, base frame [m], shape (n, 3)."""
        return np.array(self.data.xipos[1 : self.n + 1])

    def rises(self) -> FloatArray:
        """Way of each body's centre of mass along the lift [m], shape (n,)."""
        lift = np.array(self.config.lift)
        return np.asarray((self.centers() - self.start) @ lift / np.linalg.norm(lift))

    def in_hand(self) -> list[SE3]:
        """Poses of all bodies in the hand frame."""
        T_hand_base = self.wrist.pose(self.data).inverse()
        return [T_hand_base @ pose_of(self.data, i) for i in range(self.n)]

    def moment(self, phase: str) -> Moment:
        """Where all is now."""
        poses = [pose_of(self.data, i) for i in range(self.n)]
        T_base_hand = self.wrist.pose(self.data)
        solids = [solid.moved(T_base_hand) for solid in self.hand.palm]
        for finger in self.hand.fingers:
            for k, link in enumerate(finger.links):
                body = self.data.body(f"{finger.name}/{k}")
                pose = SE3.from_parts(body.xmat.reshape(3, 3), body.xpos)
                solids += [solid.moved(pose) for solid in link.solids]
        return Moment(phase, self.world.placed(poses), tuple(solids))

    def result(
        self,
        verdict: Verdict,
        body: int | None,
        gripped_at: list[SE3] | None = None,
        *,
        short: float,
        shift: float = 0.0,
    ) -> Flight:
        """Put together what is known at the end."""
        kinds = self.mj.mjtWarning
        bad = (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC)
        if any(self.data.warning[kind].number for kind in bad):
            raise InputError(
                "simulation of a grasp",
                got="one that diverged",
                expected="finite motion",
                mend="Take a smaller time_step, or bodies that don't overlap.",
            )
        turn = slide = 0.0
        if body is not None and gripped_at is not None:
            moved = gripped_at[body].inverse() @ self.in_hand()[body]
            turn = float(np.linalg.norm(so3.log(moved.R)))
            slide = float(np.linalg.norm(moved.p))
        ways = np.linalg.norm(self.centers() - self.start, axis=1)
        others = [i for i in range(self.n) if i != body and ways[i] > _DISTURBED]
        return Flight(
            verdict=verdict,
            held=None if body is None else self.world.names[body],
            rise=0.0 if body is None else float(self.risen[body]),
            pulled=self.pulled,
            turn=turn,
            slide=slide,
            short_of_goal=short,
            shift_before=shift,
            peak_force=float(self.peak[0]),
            peak_torque=float(self.peak[1]),
            deepest=self.deepest,
            is_through=self.deepest > self.config.deepest,
            moved_others=len(others),
            seconds=float(self.data.time),
            moments=tuple(self.moments),
        )


def _profile(duration: float, step: float) -> list[tuple[float, float]]:
    """Share of a way, and its rate [1/s], from rest to rest, step after step."""
    s = np.arange(1, round(duration / step) + 1) * step / duration
    s = np.minimum(s, 1.0)
    shares = s * s * (3.0 - 2.0 * s)
    rates = 6.0 * s * (1.0 - s) / duration
    return list(zip(shares.tolist(), rates.tolist(), strict=True))
