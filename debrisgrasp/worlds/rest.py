"""Where bodies come to rest, without dynamics and without a physics engine.

One body moves at a time, the others stand still: it takes small steps down, each the
closest to free fall that contact and friction allow, until none is left to take. What
stood on it follows in the next round.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import lsq_linear, nnls

from debrisgrasp._arrays import BoolArray, FloatArray, frozen, require_range
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp.geometry import SE3, Bounds, Box, so3

from .body import Body, Part, volume_and_centroid
from .hull import Hull
from .raycast import corners_around
from .world import World

__all__ = ["RestConfig", "Rested", "come_to_rest", "let_down"]

_TANGENTS = 4
_ROWS_AT_ONCE = 8
_EXCHANGES = 40
_DEEPEST = 0.002
"""Overlap that one step undoes at most [m]."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class RestConfig:
    """How bodies move until they rest."""

    friction: float = 0.6
    """Coefficient of friction."""
    step: float = 0.006
    """Free fall per step [m]; larger is faster, and cuts corners."""
    touch: float = 0.001
    """Gap below which friction acts [m]."""
    pitch: float = 0.015
    """Distance of the points on edges that are tested for contact [m]."""
    still: float = 0.02
    """A body rests when a step moves it by less than this share of free fall."""
    max_steps: int = 400
    """Most steps of one body in one round."""
    max_rounds: int = 6
    """Most rounds over all bodies."""

    def __post_init__(self) -> None:
        require_range("friction", self.friction, 0.0, 10.0)
        for name in ("step", "touch", "pitch", "still"):
            require_range(name, getattr(self, name), 1e-6, 1.0)
        require_range("max_steps", self.max_steps, 1)
        require_range("max_rounds", self.max_rounds, 1)


@dataclass(frozen=True, slots=True, eq=False)
class Rested:
    """A world in which no body falls."""

    world: World
    is_at_rest: bool
    """False if the steps ran out before."""
    moved: tuple[str, ...]
    """Bodies that are not where they were."""


@checked
def come_to_rest(
    world: World,
    config: RestConfig | None = None,
    *,
    fixed: Sequence[str] = (),
) -> Rested:
    """Let bodies that nothing holds sink to the next support.

    Parameters
    ----------
    world
        Bodies that do not overlap by more than a few millimetres.
    config
        How bodies move.
    fixed
        Names of bodies that are held, for instance by a hand.

    Notes
    -----
    A step minimises the distance to free fall in the metric of the body's inertia,
    under the linearised conditions that no point enters a body and that sliding needs
    separation (the convex relaxation of Coulomb friction by Anitescu, 2006). Six
    unknowns under inequalities: a least-distance problem (Lawson and Hanson, 1974,
    chapter 23), solved as one of non-negative least squares.
    """
    config = config or RestConfig()
    held = {world.index(name) for name in fixed}
    bodies = list(world.bodies)
    moved: set[int] = set()
    is_at_rest = False
    for _ in range(config.max_rounds):
        # Low bodies first: what rests on them then finds them where they stay.
        order = np.argsort([_lowest(body) for body in bodies])
        shifted = set()
        all_rest = True
        for i in order:
            if i in held:
                continue
            mover = _Mover(bodies[i], bodies[:i] + bodies[i + 1 :], world, config)
            pose, rests = mover.run()
            all_rest &= rests
            if pose is not None:
                bodies[i] = bodies[i].at(pose)
                shifted.add(int(i))
        moved |= shifted
        if not shifted:
            is_at_rest = all_rest
            break
    names = tuple(world.names[i] for i in sorted(moved))
    return Rested(world.placed([b.T_base_body for b in bodies]), is_at_rest, names)


@checked
def let_down(world: World, config: RestConfig | None = None) -> Rested:
    """Lower bodies onto each other in their order, each to where it rests.

    Their heights are of no account. Bodies that already lie don't yield to the weight
    of those that follow.
    """
    config = config or RestConfig()
    lying: list[Body] = []
    all_rest = True
    for body in world.bodies:
        mover = _Mover(body, lying, world, config)
        pose, rests = mover.run(mover.lowered())
        lying.append(body.at(pose or body.T_base_body))
        all_rest &= rests
    poses = [body.T_base_body for body in lying]
    return Rested(world.placed(poses), all_rest, world.names)


class _Mover:
    """One body among others that stand still; lives inside `come_to_rest` only."""

    def __init__(
        self, body: Body, others: Sequence[Body], world: World, config: RestConfig
    ) -> None:
        self.body, self.world, self.config = body, world, config
        self.others = [part for other in others for part in other.solids]
        self.bounds = [solid.bounds for solid in self.others]
        corners = [(box.lower, box.upper) for box in self.bounds]
        self.corners = np.array(corners).reshape(-1, 2, 3)
        self.own_bounds = [part.bounds for part in body.parts]
        points = [other.T_base_body.apply(edge_points(other, config.pitch))
                  for other in others]  # fmt: skip
        self.their_points = np.concatenate([*points, np.zeros((0, 3))])
        self.own_points = edge_points(body, config.pitch)
        self.center = body.center_of_mass
        self.reach = float(np.linalg.norm(self.own_points - self.center, axis=1).max())
        self.margin = 2.5 * config.step
        self.inertia = _specific_inertia(body)

    def lowered(self) -> SE3:
        """Pose just above what is beneath the body."""
        tops = [box.upper[2] for box in self.bounds]
        start = max([float(self.world.ground.heights.max()), *tops])
        pose = self.body.T_base_body
        pose = _raised(pose, start - _lowest(self.body) + self.margin)
        while not len(self._contacts(pose)[0]):
            pose = _raised(pose, -0.9 * self.margin)
        return pose

    def run(self, start: SE3 | None = None) -> tuple[SE3 | None, bool]:
        """Pose at rest, None where the body is already, and whether it rests."""
        pose = start = start or self.body.T_base_body
        limit = self.config.still * self.config.step
        has_moved = start is not self.body.T_base_body
        for _ in range(self.config.max_steps):
            motion = self._step(pose)
            shift = np.linalg.norm(motion[:3]) + self.reach * np.linalg.norm(motion[3:])
            if shift < limit:
                return (pose if has_moved else None), True
            has_moved = has_moved or bool(
                np.linalg.norm(pose.p - start.p) + shift > 3 * limit
            )
            center = pose.apply(self.center)
            R = so3.exp(motion[3:])
            turned = center + motion[:3] + R @ (pose.p - center)
            pose = SE3.from_parts(R @ pose.R, turned)
        return pose, False

    def _step(self, pose: SE3) -> FloatArray:
        """Motion (shift of the centre of mass, turn) in base axes, shape (6,)."""
        free = np.array([0.0, 0.0, -self.config.step, 0.0, 0.0, 0.0])
        points, normals, gaps = self._contacts(pose)
        if not len(points):
            return free
        directions, bounds, owner = self._conditions(normals, gaps)
        arms = (points - pose.apply(self.center))[owner]
        J = np.hstack([directions, np.cross(arms, directions)])
        root = np.linalg.cholesky(pose.R @ self.inertia @ pose.R.T)
        metric = np.eye(6)
        metric[3:, 3:] = np.linalg.inv(root).T
        rows, needed = J @ metric, -bounds - J @ free
        shift = _least(rows, needed / self.config.step)
        if shift is None:
            # Squeezed from two sides: what overlaps stays, but nothing goes deeper.
            needed = -np.maximum(bounds, 0.0) - J @ free
            shift = _least(rows, needed / self.config.step)
        if shift is None:
            return np.zeros(6)
        motion = free + metric @ shift * self.config.step
        # The conditions are linear; a turn by more than this leaves where they hold.
        size = float(
            np.linalg.norm(motion[:3]) + self.reach * np.linalg.norm(motion[3:])
        )
        return np.asarray(motion * min(1.0, 2.0 * self.config.step / max(size, 1e-12)))

    def _conditions(
        self, normals: FloatArray, gaps: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Directions d and gaps g with ``d . motion >= -g``, and whose points."""
        gaps = np.maximum(gaps, -_DEEPEST)
        near = np.flatnonzero(gaps < self.config.touch)
        aside = np.eye(3)[np.argmin(np.abs(normals[near]), axis=1)]
        first = np.cross(normals[near], aside)
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        second = np.cross(normals[near], first)
        turns = np.arange(_TANGENTS) * (2 * np.pi / _TANGENTS)
        slides = [np.cos(t) * first + np.sin(t) * second for t in turns]
        directions = [normals[near] + self.config.friction * slide for slide in slides]
        owner = np.concatenate([np.arange(len(gaps)), np.tile(near, _TANGENTS)])
        return np.concatenate([normals, *directions]), gaps[owner], owner

    def _contacts(self, pose: SE3) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Points [m] on the body, normals towards it, and gaps [m] within reach."""
        margin = self.margin
        own = pose.apply(self.own_points)
        heights = own[:, 2] - self.world.ground.height(own[:, :2])
        low = heights < margin
        up = np.broadcast_to([0.0, 0.0, 1.0], (int(low.sum()), 3))
        found = [(own[low], up, heights[low])]
        lower, upper = own.min(axis=0) - margin, own.max(axis=0) + margin
        beside = (self.corners[:, 0] > upper) | (self.corners[:, 1] < lower)
        for i in np.flatnonzero(~beside.any(axis=1)):
            found.append(_near(self.others[i], self.bounds[i], own, margin))
        inside = _inside(self.their_points, lower, upper)
        theirs = pose.inverse().apply(self.their_points[inside])
        for part, box in zip(self.body.parts, self.own_bounds, strict=True):
            points, normals, gaps = _near(part, box, theirs, margin)
            found.append((pose.apply(points), -pose.rotate(normals), gaps))
        points, normals, gaps = (
            np.concatenate(items) for items in zip(*found, strict=True)
        )
        return points, normals, gaps


def _nonnegative(system: FloatArray, target: FloatArray) -> FloatArray:
    """Non-negative least squares; conditions that repeat each other make it fail."""
    try:
        found, distance = nnls(system, target, maxiter=100 * system.shape[1])
        # At the optimum the residual is its own projection on the target.
        excess = (target - system @ found) @ target - distance**2
        is_optimal = bool(abs(excess) < 1e-8)
    except RuntimeError:
        is_optimal = False
    if not is_optimal:
        found = lsq_linear(system, target, (0.0, np.inf), method="bvls").x
    return np.asarray(found)


def _least(rows: FloatArray, needed: FloatArray) -> FloatArray | None:
    """Smallest x with ``rows @ x >= needed``; None if there is none of moderate size.

    Few conditions decide, so that only those enter which the last solution broke.
    """
    chosen = np.argsort(-needed)[:_ROWS_AT_ONCE]
    target = np.zeros(rows.shape[1] + 1)
    target[-1] = 1.0
    x = np.zeros(rows.shape[1])
    for _ in range(_EXCHANGES):
        system = np.vstack([rows[chosen].T, needed[chosen]])
        multipliers = _nonnegative(system, target)
        rest = system @ multipliers - target
        if rest[-1] > -0.02:
            return None
        x = rest[:-1] / -rest[-1]
        excess = needed - rows @ x
        broken = np.flatnonzero(excess > 1e-4)
        broken = broken[np.argsort(-excess[broken])][:_ROWS_AT_ONCE]
        if not len(broken) or np.isin(broken, chosen).all():
            break
        chosen = np.union1d(chosen, broken)
    return x


def edge_points(body: Body, pitch: float) -> FloatArray:
    """Points on the edges of a body's parts, at most ``pitch`` apart; (n, 3) [m]."""
    return _edge_points(body.parts, pitch)


@lru_cache(maxsize=256)
def _edge_points(parts: tuple[Part, ...], pitch: float) -> FloatArray:
    """Remembered for the parts themselves: a body that moves keeps them."""
    found = []
    for part in parts:
        vertices, faces = part.mesh()
        pairs = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)), axis=0)
        start, end = vertices[pairs[:, 0]], vertices[pairs[:, 1]]
        counts = np.ceil(np.linalg.norm(end - start, axis=1) / pitch).astype(int)
        which = np.repeat(np.arange(len(pairs)), counts)
        step = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
        share = (step / counts[which])[:, None]
        found.append(vertices)
        found.append((1 - share) * start[which] + share * end[which])
    points = np.concatenate(found)
    points = points[np.unique(points.round(5), axis=0, return_index=True)[1]]
    return frozen(points, "points on edges", (3,))


def _near(
    part: Part, box: Bounds, points: FloatArray, margin: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points within a margin of a part, its outward normals there, and distances.

    The box is that around the part.
    Polytopes answer by their planes, which is exact over their faces and too near
    beyond their edges: quick, and safe.
    """
    points = points[_inside(points, box.lower - margin, box.upper + margin)]
    if isinstance(part, (Box, Hull)):
        sides, offsets = _planes(part)
        beyond = points @ sides.T - offsets
        gaps = largest_in_rows(beyond)
        is_near = gaps < margin
        which = beyond[is_near].argmax(axis=1)
        return points[is_near], sides[which], gaps[is_near]
    gaps = part.signed_distance(points)
    is_near = gaps < margin
    points, gaps = points[is_near], gaps[is_near]
    slopes = [
        part.signed_distance(points + tiny) - part.signed_distance(points - tiny)
        for tiny in 1e-6 * np.eye(3)
    ]
    normals = np.stack(slopes, axis=-1) / 2e-6
    length = np.linalg.norm(normals, axis=1)
    sure = length > 0.5
    return points[sure], normals[sure] / length[sure, None], gaps[sure]


def _inside(points: FloatArray, lower: FloatArray, upper: FloatArray) -> BoolArray:
    """Which points (n, 3) lie within a box, shape (n,)."""
    inside = np.ones(len(points), dtype=bool)
    for along, low, high in zip(points.T, lower, upper, strict=True):
        inside &= (along > low) & (along < high)
    return inside


def largest_in_rows(values: FloatArray) -> FloatArray:
    """Largest value of each row of a few, (n, few) -> (n,).

    NumPy is slow along a short last axis.
    """
    return np.asarray(np.ascontiguousarray(values.T).max(axis=0, initial=-np.inf))


def _planes(part: Box | Hull) -> tuple[FloatArray, FloatArray]:
    """Outward normals (s, 3) of the sides and their distances from the origin (s,)."""
    if isinstance(part, Hull):
        return part.normals, part.offsets
    normals = np.concatenate([part.T_frame_solid.R.T, -part.T_frame_solid.R.T])
    half = np.tile(part.half_extents, 2)
    return normals, half + normals @ part.T_frame_solid.p


def _raised(pose: SE3, height: float) -> SE3:
    return SE3.from_parts(pose.R, pose.p + np.array([0.0, 0.0, height]))


def _lowest(body: Body) -> float:
    return min(float(solid.bounds.lower[2]) for solid in body.solids)


def _specific_inertia(body: Body) -> FloatArray:
    """Inertia about the centre of mass over mass [m^2], body axes, shape (3, 3)."""
    second, total, com = np.zeros((3, 3)), 0.0, body.center_of_mass
    for part in body.parts:
        volume, centroid = volume_and_centroid(part)
        corners = corners_around(part)
        spread = np.cov(corners.T, bias=True) / 3.0
        offset = centroid - com
        second += volume * (np.outer(offset, offset) + spread)
        total += volume
    second /= total
    return np.asarray(np.trace(second) * np.eye(3) - second)
