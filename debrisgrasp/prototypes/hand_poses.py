"""Where a hand could take a surface: poses proposed along its principal axes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from debrisgrasp._arrays import (
    FloatArray,
    IntArray,
    as_floats,
    as_rows,
    require_finite,
    require_range,
)
from debrisgrasp._checked import checked
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, Bounds, so3, voxel_downsample
from debrisgrasp.geometry.sampling import fibonacci_sphere
from debrisgrasp.geometry.solids import Solid

from .check import FACING, LEAST_SHARE, MIN_CLEARANCE, check
from .gripper import GripperModel
from .in_hand import PALM_GAP, around_grip, contacts, settled
from .prototype import GraspPrototype, PrototypeDefinition
from .prototype_file import DEFAULT_CLEARANCE
from .surface_shape import SurfaceShape

__all__ = ["HandPose", "propose_hand_poses"]

_OVERLAP = 0.01
"""How far the fingertips reach past the middle of the piece [m]."""
_DEEPEST = 0.06
"""The fingertips reach no farther over the piece than this in a fingertip grasp [m]."""
_RETREATS = (0.0, 0.02, 0.04, 0.07, 0.1)
"""Places on the approach at which clearance is measured [m]."""
_FINE = 0.012
"""Clearance beyond this is no better [m]: it is the error of the pose."""
_NEAR = 0.25
"""Obstacles farther than this from the surface are left out [m]."""
_OF_A_KIND = 2
"""Poses of one way and preshape that are looked at closely."""
_STEP = 0.004
"""Openings between which the hand is not told apart [m]."""
_PROBE = 0.008
"""Distance between points at which clearance is measured [m]."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HandPose:
    """One way to take a surface."""

    T_surface_hand: SE3
    """Palm frame in the frame of the surface."""
    preshape: str
    width: float
    """Distance between the pads when closed on it [m]."""
    opening: float
    """Distance between the pads during the approach [m]."""
    clearance: float
    """Smallest distance between the open hand and anything, on the whole approach [m];
    negative if it hits something."""
    way: str
    """How the hand comes, in words."""
    known_sides: int = 2
    """How many of the two sides that the fingers close on are known surface."""
    findings: tuple[str, ...] = ()
    """What `check` says against it."""


@checked
def propose_hand_poses(
    surface: SurfaceShape,
    gripper: GripperModel,
    *,
    preshape: str | None = None,
    towards: FloatArray | None = None,
    obstacles: FloatArray | None = None,
    limit: int = 5,
) -> tuple[HandPose, ...]:
    """Propose poses of the hand, best first.

    The hand comes across the longest axis of the surface from twelve sides, along it
    from both ends, and closes along each of the axes that are left, near the palm and
    between the fingertips. Poses without findings go first, then those with more
    clearance, up to the 12 mm that the error of a pose takes.

    Parameters
    ----------
    preshape
        Only this one; all that are wide enough by default.
    towards
        Unit vector (3,): only approaches within 75 degrees of it, for instance the line
        of sight of the camera that saw the surface.
    obstacles
        Points of everything else [m], frame of the surface, shape (o, 3).
    limit
        How many at most.

    Returns
    -------
    tuple[HandPose, ...]
        Empty if the surface fits no preshape.

    Raises
    ------
    InputError
        If an argument is not what its annotation says, or no array of its shape.
    """
    require_range("limit", limit, 1)
    if towards is not None:
        towards = as_floats(towards, "towards", (3,))
        if not 0.99 <= np.linalg.norm(towards) <= 1.01:
            raise InputError("towards", got=towards.tolist(), expected="a unit vector")
    names = list(gripper.preshapes) if preshape is None else [preshape]
    for name in names:
        gripper.preshape(name)
    probe, others = _probes(surface, obstacles)
    hand = _Hand(gripper)
    candidates = []
    for R, way in _orientations(surface, towards):
        for name in names:
            candidates += list(_placed(surface, hand, name, R, way))
    measured = [
        replace(pose, clearance=_clearance(pose, hand, probe, others))
        for pose in candidates
    ]
    measured.sort(key=_merit)
    # A close look costs more, so only at the best of each kind.
    kinds: Counter[tuple[str, str]] = Counter()
    best: list[HandPose] = []
    for pose in measured:
        kinds[pose.way, pose.preshape] += 1
        if kinds[pose.way, pose.preshape] <= _OF_A_KIND:
            pose = _centered(surface, gripper, pose)
            pose = replace(pose, clearance=_clearance(pose, hand, probe, others))
            best.append(_looked_at(surface, gripper, pose))
        if len(best) == 3 * limit:
            break
    best.sort(key=lambda pose: (len(pose.findings), *_merit(pose)))
    return tuple(best[:limit])


@dataclass(frozen=True, slots=True, eq=False)
class _Hand:
    """A hand that remembers its solids, at openings in steps of 4 mm."""

    gripper: GripperModel
    _solids: dict[tuple[str, int], tuple[Solid, ...]] = field(default_factory=dict)

    def solids(self, preshape: str, opening: float) -> tuple[Solid, ...]:
        """Palm and fingers at the nearest step."""
        step = int(opening / _STEP)
        if (preshape, step) not in self._solids:
            solids = self.gripper.solids(preshape, _STEP * step)
            self._solids[preshape, step] = solids
        return self._solids[preshape, step]

    def reach(self, preshape: str, opening: float) -> float:
        """How far the fingers stand out in front of the palm [m]."""
        solids = self.solids(preshape, opening)
        return max(float(solid.bounds.upper[2]) for solid in solids)


def _orientations(
    surface: SurfaceShape, towards: FloatArray | None
) -> Iterator[tuple[FloatArray, str]]:
    """Rotations of the palm frame (3, 3), each with its way in words."""
    offset = surface.points - surface.points.mean(axis=0)
    axes = np.linalg.eigh(offset.T @ offset)[1].T[::-1]
    long, middle, short = axes
    across = [
        (np.cos(turn) * middle + np.sin(turn) * short, long)
        for turn in np.arange(12) * np.pi / 6
    ]
    along = [(sign * short, middle) for sign in (1, -1)]
    along += [(sign * middle, short) for sign in (1, -1)]
    ends = [(sign * long, axis) for sign in (1, -1) for axis in (middle, short)]
    for group, way in (
        (across, "across the long axis"),
        (along, "closing along the long axis"),
        (ends, "along the long axis"),
    ):
        for z, y in group:
            if towards is not None and z @ towards < np.cos(np.deg2rad(75.0)):
                continue
            R = np.column_stack([np.cross(y, z), y, z])
            yield R, way
            # Thumb and pair change sides.
            yield R @ so3.exp(np.array([0.0, 0.0, np.pi])), way


def _placed(
    surface: SurfaceShape, hand: _Hand, preshape: str, R: FloatArray, way: str
) -> Iterator[HandPose]:
    """Poses of one orientation: along the piece, near the palm and out at the tips."""
    shape = hand.gripper.preshape(preshape)
    widest = float(shape.openings[0])
    breadth = hand.gripper.closing_region(preshape, widest).half_extents[1]
    points, facing = surface.points @ R, surface.normals @ R[:, 0]
    low, high = points[:, 1].min(), points[:, 1].max()
    room = max((high - low) / 2 - breadth, 0.0)
    shares = (0.0, 0.5, -0.5) if room > 0.03 else (0.0,)
    for share in shares:
        y = (low + high) / 2 + share * room
        is_near = np.abs(points[:, 1] - y) <= breadth
        near = points[is_near]
        if len(near) < 10:
            continue
        sides = [np.mean(side * facing[is_near] > FACING) for side in (-1, 1)]
        top = near[:, 2].min()
        reach = hand.reach(preshape, widest)
        gripped = near[near[:, 2] < top + reach - PALM_GAP]
        width = float(np.ptp(gripped[:, 0]))
        if not shape.widths[0] <= width <= min(shape.widths[1], widest - MIN_CLEARANCE):
            continue
        opening = min(width + DEFAULT_CLEARANCE, widest)
        x = (gripped[:, 0].min() + gripped[:, 0].max()) / 2
        reach = hand.reach(preshape, width)
        over = min(np.ptp(near[:, 2]) / 2 + _OVERLAP, _DEEPEST)
        place = "" if share == 0.0 else ", beside the middle"
        gaps = {PALM_GAP: "at the palm", reach - over: "at the fingertips"}
        for gap, where in gaps.items():
            if gap >= PALM_GAP:
                origin = R @ np.array([x, y, top - gap])
                yield HandPose(
                    T_surface_hand=SE3.from_parts(R, origin),
                    preshape=preshape,
                    width=width,
                    opening=opening,
                    clearance=0.0,
                    way=f"{way}, {where}{place}",
                    known_sides=sum(bool(share > LEAST_SHARE) for share in sides),
                )


def _probes(
    surface: SurfaceShape, obstacles: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Thinned points of the surface and of what lies around it."""
    probe = surface.points[voxel_downsample(surface.points, _PROBE)]
    if obstacles is None or not len(obstacles):
        return probe, np.zeros((0, 3))
    obstacles = as_rows(obstacles, "obstacles")
    require_finite(obstacles, "obstacles")
    near = obstacles[Bounds.around(surface.points, _NEAR).contains(obstacles)]
    kept: IntArray = voxel_downsample(near, _PROBE) if len(near) else np.zeros(0, int)
    return probe, near[kept]


def _clearance(
    pose: HandPose, hand: _Hand, probe: FloatArray, others: FloatArray
) -> float:
    """Smallest distance of the open hand to points on its way in [m]."""
    points = np.concatenate([probe, others])
    own = pose.T_surface_hand.inverse().apply(points)
    solids = hand.solids(pose.preshape, pose.opening)
    boxes = [solid.bounds.grown(_FINE) for solid in solids]
    whole = Bounds(
        np.min([box.lower for box in boxes], axis=0),
        np.max([box.upper for box in boxes], axis=0),
    )
    least = np.inf
    for retreat in _RETREATS:
        at = own + np.array([0.0, 0.0, retreat])
        at = at[whole.contains(at)]
        for solid, box in zip(solids, boxes, strict=True):
            near = at[box.contains(at)]
            if len(near):
                least = min(least, float(solid.signed_distance(near).min()))
    return min(least, _FINE)


def _merit(pose: HandPose) -> tuple[float, ...]:
    """Sorts the better pose first."""
    return (
        -round(1e3 * min(pose.clearance, _FINE) / 3) * 1.0,
        2.0 - pose.known_sides,
        float("beside" in pose.way),
        float(not pose.way.startswith("across")),
        pose.width,
    )


def _in_hand(
    surface: SurfaceShape, gripper: GripperModel, pose: HandPose
) -> PrototypeDefinition:
    return PrototypeDefinition(
        name="proposed",
        gripper=gripper.name,
        preshape=pose.preshape,
        width=pose.width,
        opening=pose.opening,
        shape=around_grip(surface, pose.T_surface_hand, gripper, pose.preshape),
        T_hand_shape=SE3.identity(),
    )


def _centered(surface: SurfaceShape, gripper: GripperModel, pose: HandPose) -> HandPose:
    """Shift the hand along its closing axis until both sides touch at once."""
    thumb, pair = contacts(_in_hand(surface, gripper, pose), gripper)
    if thumb is None or pair is None:
        return pose
    # One side rests at -thumb / 2, the other at pair / 2: halfway is the middle.
    shift = SE3.from_parts(p=((pair - thumb) / 4, 0.0, 0.0))
    return replace(pose, T_surface_hand=pose.T_surface_hand @ shift)


def _looked_at(
    surface: SurfaceShape, gripper: GripperModel, pose: HandPose
) -> HandPose:
    """Let the fingers close on the surface, and check the outcome."""
    definition = settled(_in_hand(surface, gripper, pose), gripper)
    prototype = GraspPrototype.build(definition, fibonacci_sphere(1))
    findings = [str(finding) for finding in check(prototype, gripper)]
    if pose.clearance < 0.0:
        findings.append(f"the hand hits something {-1e3 * pose.clearance:.0f} mm deep")
    return replace(
        pose,
        width=definition.width,
        opening=definition.opening,
        findings=tuple(findings),
    )
