"""Put down what a hand holds, so that it lies before the hand opens."""

from __future__ import annotations

from collections import deque
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._physics import GRAVITY
from debrisgrasp.control import LegOutcome, TarePolicy, identify_payload
from debrisgrasp.control._rigid import Wrench
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, so3

from .carrying import MET
from .context import Context, Held
from .drive import Drive
from .dropoff import room_below
from .folding import free_share
from .lowering import lower, lowering_limits, lowering_speed
from .moves import let_go
from .pacing import hand_corners
from .relief import standing_load
from .result import FaultFound, LegEnd
from .stopping import reset_stops

__all__ = ["put_down"]

_HIGH, _LOWERINGS = 0.15, 3
"""What is let go higher above the ground falls [m]: it is lowered so often."""
_SPARE = 0.02
"""Before the last bit of a way that an arm can't go it could hardly go back [m]."""
_SAME = 0.1
"""Share of its weight by which what hangs free may differ from that."""
_LEAST, _BORNE, _MOST = 0.1, 0.6, 0.95
"""Share of its weight from which an object stands on something, of which about so much
is borne as it is turned, and at which the turn ends: it stands on more than it did."""
_INEXACT = 0.25
"""By no more than this that share differs as a turn begins."""
_GIVES = 3e-5
"""Way on which an arm presses harder on the hardest thing [m/N]."""
_STANDS = 0.03
"""What stands so far from below its centre of mass falls over no farther [m]."""
_TURN, _LEGS = 0.1, 24
"""Turned by so much at a time [rad]; legs of all turns."""
_LITTLE, _AGAIN = 0.1, 3
"""What goes on by a smaller share of a turn, so many times, lies."""
_FEET, _LATEST = 4, 5
"""So many places tell on what it stands now, so many readings where."""
_OVER = 0.015
"""A hand comes no nearer to the ground as it turns what it holds [m]."""


def put_down(context: Context, most: float) -> FaultFound | None:
    """Lower what a hand holds until it lies on something, and let go.

    So far (``most`` [m]), or as far as its lowest point is over the ground, and on from
    there: that may not reach as far down as it was taken to. High above the ground it
    may just have brushed something, and is lowered on, too.
    """
    held = context.held
    if held is None:
        return None
    limb, drive = context.limbs[held.arm], Drive(context, held.arm)
    held.is_watched = False  # here its weight falls; and a loss ends each lowering, too
    fault = _weighed_again(drive, held)
    if fault is not None:
        return fault
    is_met = False
    for n_before in range(_LOWERINGS if held.is_lifted else 0):
        q = context.posture(limb)
        points = limb.pose(q).apply(held.points_hand)
        lowest = float(points[:, 2].min()) if len(points) else 0.0
        if is_met and lowest < _HIGH:
            break
        depth = max(most, lowest)
        share = free_share(limb, q, np.array([0.0, 0.0, -depth]))
        depth = depth if share > 1.0 - 1e-6 else share * depth - _SPARE
        if depth <= 2e-3:
            break
        end = lower(drive, depth)
        if isinstance(end, FaultFound):
            if not n_before or end.fault != "too_heavy":
                return end
            reset_stops(context)  # its far end lies on something, and bends no farther
            break
        is_met = end.outcome is not LegOutcome.DONE
    return _laid(drive, held) or let_go(context)


def _weighed_again(drive: Drive, held: Held) -> FaultFound | None:
    """Find the centre of mass across gravity as it hangs now, if all of it does.

    Weighed in another attitude, or before it slipped in the hand, it was known less.
    """
    if held.payload.mass <= 0.0:
        return None
    loads, load = drive.limb.loads, standing_load(drive.context, drive)
    if isinstance(load, FaultFound):
        return load
    R = drive.limb.pose(drive.context.posture(drive.limb)).R
    raw = loads.reading(load, tuple(R.ravel().tolist()))
    with suppress(InputError):  # something pushes it up
        payload, _ = identify_payload(
            loads, raw, R @ loads.T_ee_ft.R, expected_com=held.payload.com
        )
        if abs(payload.mass - held.payload.mass) < _SAME * held.payload.mass:
            held.payload = payload
    return None


class _Stance(NamedTuple):
    """Where something stands that a hand holds."""

    share: float
    """Of its weight, that is borne there."""
    foot: FloatArray
    """Middle of where it stands, base frame [m], shape (3,)."""
    com: FloatArray
    """Below its centre of mass, as low, base frame [m], shape (3,)."""


class _Scales:
    """Tells from the load on a hand how what it holds stands on something else."""

    def __init__(self, drive: Drive, held: Held) -> None:
        self._drive, self._held = drive, held
        self._loads = drive.limb.loads.with_payload(held.payload)
        self.weight = GRAVITY * held.payload.mass
        """[N]."""
        T = drive.limb.pose(drive.context.posture(drive.limb))
        points = T.apply(held.points_hand)
        # Its underside is a guess, and may be below what it stands on.
        under = min(room_below(drive.context, points), 0.0)
        self._height = float(points[:, 2].min(initial=T.p[2])) - under

    def stance(self, load: FloatArray | Wrench) -> _Stance:
        """Find how it stands by what a load (6,) differs from its weight."""
        limb = self._drive.limb
        T = limb.pose(self._drive.context.posture(limb))
        weight = self._loads.payload_ee(tuple(T.R.ravel().tolist()))
        contact = np.asarray(load) - np.array(weight)
        force, torque = T.R @ contact[:3], T.R @ contact[3:]
        up, low = max(float(force[2]), 1e-6), self._height - T.p[2]
        x = (low * force[0] - torque[1]) / up
        y = (low * force[1] + torque[0]) / up
        com = T.apply(self._loads.T_ee_ft.apply(self._loads.payload.com))
        return _Stance(
            up / self.weight,
            T.p + np.array([x, y, low]),
            np.array([com[0], com[1], self._height]),
        )

    def reach(self, foot: FloatArray) -> float:
        """Farthest point that moves as it turns about its foot (3,) [m]."""
        T = self._drive.limb.pose(self._drive.context.posture(self._drive.limb))
        away = np.concatenate([T.apply(self._held.points_hand), [T.p]]) - foot
        return float(np.linalg.norm(away, axis=1).max())


def _laid(drive: Drive, held: Held) -> FaultFound | None:
    """Turn what stands on a corner or an edge about that until it lies.

    Let go there it would fall over, and hit or take along fingers that are around it.
    """
    if held.payload.mass <= 0.0:
        return None
    scales = _Scales(drive, held)
    n_little, feet = 0, deque[FloatArray](maxlen=_FEET)
    for _ in range(_LEGS):
        load = standing_load(drive.context, drive)
        if isinstance(load, FaultFound):
            return load
        stance = scales.stance(load)
        if feet and float(np.linalg.norm(stance.foot - feet[-1])) < _STANDS:
            feet.pop()
        feet.append(stance.foot)
        beside = _beside(np.array(feet), stance.com)
        if stance.share < _LEAST or float(np.linalg.norm(beside)) < _STANDS:
            return None
        is_turn = abs(stance.share - _BORNE) < _INEXACT
        end = (
            _turned(drive, scales, stance.foot, beside, load)
            if is_turn
            else _pressed(drive, scales, stance.share, load)
        )
        if isinstance(end, FaultFound):
            if end.fault not in MET:
                return end
            reset_stops(drive.context)
            return None
        if end is None or end.outcome is LegOutcome.BLOCKED:
            return None
        if is_turn:
            n_little = n_little + 1 if end.share < _LITTLE else 0
        if n_little == _AGAIN:
            return None
    return None


def _beside(feet: FloatArray, com: FloatArray) -> FloatArray:
    """Shortest way from where something stands to its centre of mass [m], shape (3,).

    It stands on what lies between the points at which it was felt to stand.

    Parameters
    ----------
    feet
        Those, base frame [m], shape (n, 3).
    com
        Below its centre of mass, shape (3,).
    """
    ways = (com - feet)[:, :2]
    angles = np.sort(np.arctan2(ways[:, 1], ways[:, 0]))
    gaps = np.diff(angles, append=angles[0] + 2.0 * np.pi)
    if gaps.max() < np.pi:
        return np.zeros(3)
    edges = ways[:, None] - ways  # from each to each
    sizes = np.maximum((edges**2).sum(axis=2), 1e-12)
    shares = np.einsum("ik,ijk->ij", ways, edges) / sizes
    left = ways[:, None] - np.clip(shares, 0.0, 1.0)[..., None] * edges
    left = left.reshape(-1, 2)
    x, y = left[(left**2).sum(axis=1).argmin()]
    return np.array([x, y, 0.0])


def _pressed(
    drive: Drive, scales: _Scales, share: float, load: FloatArray
) -> LegEnd | FaultFound:
    """Go up or down so far that what stands is borne about as it should be."""
    down = _GIVES * scales.weight * (_BORNE - share)
    return drive.leg(
        [0.0, 0.0, -down],
        speed=lowering_speed(drive, load),
        tare=TarePolicy.SESSION,
        limits=lowering_limits(drive, load),
    )


def _turned(
    drive: Drive, scales: _Scales, at: FloatArray, beside: FloatArray, load: FloatArray
) -> LegEnd | FaultFound | None:
    """Turn what stands, its weight downwards; None if the hand has no room.

    Until it stands on more, or less, than it did, or below its weight.

    Parameters
    ----------
    at, beside
        Where it stands, and how far beside its weight is, base frame [m], each (3,).
    """
    context, limb = drive.context, drive.limb
    T = limb.pose(context.posture(limb))
    far = float(np.linalg.norm(beside))
    x, y, _ = beside / far
    foot = SE3.from_parts(p=at)
    turn = SE3.from_parts(so3.exp(_TURN * np.array([-y, x, 0.0])))
    goal = foot @ turn @ foot.inverse() @ T
    corners = goal.apply(hand_corners(limb, limb.preshape, limb.opening))
    if (corners[:, 2] - context.memory.heights(corners)).min() < _OVER:
        return None
    latest: deque[_Stance] = deque(maxlen=_LATEST)

    def stands(load: Wrench) -> bool:
        latest.append(scales.stance(load))
        share = sum(found.share for found in latest) / len(latest)
        left = sum((found.com - found.foot) @ beside for found in latest) / len(latest)
        is_sure = len(latest) == _LATEST
        return is_sure and not (_LEAST < share < _MOST and left > 0.5 * _STANDS * far)

    speed = lowering_speed(drive, load)
    return drive.leg(
        goal,
        speed=speed,
        turn_rate=speed / scales.reach(at),
        tare=TarePolicy.SESSION,
        until=stands,
        limits=lowering_limits(drive, load),
    )
