"""Pictures of an arm's motion: postures overlaid, and its joints over time."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from debrisgrasp._arrays import BoolArray, FloatArray, require_range
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp.errors import InputError, ShapeError
from debrisgrasp.geometry import SE3, PointCloud, voxel_downsample
from debrisgrasp.kinematics import LimitSet, RobotModel, Trajectory

from .colors import (
    BACKGROUND_COLOR,
    CHOSEN_COLOR,
    GROUND_COLOR,
    INK,
    MUTED_INK,
    hex_color,
)
from .page import Page, Slot, draw_picture, shortened
from .raster import Mesh, Splats, render
from .scene import ground_grid, merged, point_spacing
from .view import View

__all__ = ["MotionTrack", "motion_png"]

_SIZE = (1500, 1010)
_PANELS = (Slot(30, 120, 710, 560), Slot(760, 120, 710, 560))
_PLOTS = (Slot(75, 730, 655, 220), Slot(805, 730, 655, 220))
_DIRECTIONS = ((-0.75, 0.75, -0.6), (-0.35, -0.9, -0.4))
_START, _END = np.array([0.60, 0.74, 0.90]), np.array([0.05, 0.30, 0.66])
_TORSO = (0.70, 0.73, 0.77)
_BAD = np.array([0.80, 0.10, 0.15])
_BEHIND = 0.002
"""How far each posture is drawn behind the next one [m]."""
_PATH = (0.56, 0.13, 0.62)
_SHOWN = 2.0
"""Points of the scene farther from the base than this are not drawn [m]."""


@checked_fields
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MotionTrack:
    """One motion of an arm, in one or several pieces."""

    label: str
    trajectories: Sequence[Trajectory]
    """Pieces, each of which begins where the one before it ends."""
    limits: LimitSet
    touches: FloatArray | None = None
    """Postures (k, d) in which the arm touches something: drawn in red."""

    def __post_init__(self) -> None:
        moved = {piece.joint_names for piece in self.trajectories}
        if moved != {self.limits.joint_names}:
            raise InputError(
                "trajectories of a track",
                got=f"those of {sorted(moved)}" if moved else "none",
                expected=f"one or more of {self.limits.joint_names}, as the limits",
            )

    def at(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Posture and speed at times (n,) from the start of the first piece."""
        q = np.empty((len(t), self.limits.n_joints))
        dq = np.empty_like(q)
        begin = 0.0
        for piece in self.trajectories:
            rows = t >= begin
            q[rows], dq[rows], _ = piece.at(t[rows] - begin)
            begin += piece.duration
        return q, dq

    @property
    def duration(self) -> float:
        """Seconds of all pieces."""
        return sum(piece.duration for piece in self.trajectories)


@checked
def motion_png(
    path: str | os.PathLike[str],
    title: str,
    robot: RobotModel,
    arm: str,
    tracks: Sequence[MotionTrack],
    *,
    cloud: PointCloud | None = None,
    gripped: BoolArray | None = None,
    n_postures: int = 6,
    note: str = "",
) -> None:
    """Draw one motion from two sides, or two motions beside each other.

    Parameters
    ----------
    path
        PNG to write, 1500 x 1010 pixels.
    tracks
        One or two; their joints are those of the arm's chain.
    cloud
        What was measured, base frame.
    gripped
        Which of its points are those of the gripped object, shape (n,): drawn in its
        colour.
    n_postures
        How many postures of each motion are drawn, first and last among them; the
        later, the darker.

    Raises
    ------
    ConfigError, OutputError
        If the file has another suffix, or can't be written.
    InputError
        If a track is of other joints than those of the arm, or there are more than two.
    """
    _require_drawable(robot, arm, tracks, cloud, gripped)
    require_range("n_postures", n_postures, 2)
    page = Page(*_SIZE)
    page.text(30, 20, shortened(title, 80), 20, weight="bold")
    page.text(30, 62, shortened(note, 150), 11.5, color=MUTED_INK)
    shown = [*tracks, tracks[0]][:2]
    is_pair = len(tracks) > 1
    scene = None if cloud is None else _scene(cloud, gripped)
    for i, (track, slot) in enumerate(zip(shown, _PANELS, strict=True)):
        side = "seen from the front, " + ("right", "left")[0 if is_pair else i]
        axes = page.titled_panel(slot, track.label if is_pair or not i else "", side)
        direction = _DIRECTIONS[0 if is_pair else i]
        colors, way = _rendered(robot, arm, track, scene, direction, slot, n_postures)
        scale, left, top = draw_picture(axes, colors, slot)
        axes.plot(*(scale * way + (left, top)).T, color=hex_color(_PATH), linewidth=2.2)
    for i, slot in enumerate(_PLOTS):
        track = shown[i]
        kind = "speed" if is_pair or i else "posture"
        heading = f"{'Speed' if kind == 'speed' else 'Posture'} of the joints"
        axes = page.scaled_panel(slot, heading, "seconds", (8, 5))
        _draw_joints(axes, track, robot, of_speed=kind == "speed")
    page.write(path)


def _require_drawable(
    robot: RobotModel,
    arm: str,
    tracks: Sequence[MotionTrack],
    cloud: PointCloud | None,
    gripped: BoolArray | None,
) -> None:
    joints = robot.chain(arm).joint_names
    moved = [track.limits.joint_names for track in tracks]
    if moved not in ([joints], [joints] * 2):
        raise InputError(
            "tracks of a picture",
            got=f"{len(moved)}, of the joints {sorted(set(moved))}",
            expected=f"one or two of {joints}, as the {arm} arm",
        )
    if cloud is not None:
        cloud.require_frame("base")
    if gripped is not None and cloud is not None and len(gripped) != len(cloud):
        raise ShapeError("gripped", got=len(gripped), expected=f"({len(cloud)},)")


def _rendered(
    robot: RobotModel,
    arm: str,
    track: MotionTrack,
    scene: Splats | None,
    direction: Sequence[float],
    slot: Slot,
    n_postures: int,
) -> tuple[FloatArray, FloatArray]:
    """Picture, and the palm's path in its pixels (n, 2)."""
    tree, joints = robot.tree, track.limits.joint_names
    whole = tree.links_below(tree.joints[joints[1 if len(joints) > 7 else 0]].child)
    # Whole arms in between would hide one another.
    end = tree.links_below(tree.joints[joints[-2]].child)
    q, _ = track.at(np.linspace(0.0, track.duration, n_postures))
    groups: list[Mesh] = []
    # What turns about its own axis stands where it stood: the latest hides the others.
    behind = _BEHIND * np.asarray(direction) / np.linalg.norm(direction)
    for k, row in enumerate(q):
        share = k / max(1, n_postures - 1)
        color = (1.0 - share) * _START + share * _END
        links = whole if k in (0, n_postures - 1) else end
        mesh = _arm_mesh(robot, joints, row, links, color)
        groups.append(mesh.moved(SE3.from_parts(p=(n_postures - 1 - k) * behind)))
    for row in () if track.touches is None else track.touches:
        groups.append(_arm_mesh(robot, joints, row, end, _BAD))
    values = dict(zip(joints, q[-1].tolist(), strict=True))
    still = (s for n, s in robot.links_solids(values) if n not in whole)
    groups.append(merged(still, _TORSO))
    way, _ = track.at(np.linspace(0.0, track.duration, 400))
    tips = robot.chain(arm).fk(way).p
    splats = []
    corners = np.concatenate([tips, *(group.vertices for group in groups)])
    if scene is not None:
        corners = np.concatenate([corners, scene.points])
        splats.append(scene)
    else:
        splats.append(_dots_of(ground_grid(corners, 0.5)))
    view = View.fitted(corners, direction, slot.size, margin=1.02)
    background = np.array(BACKGROUND_COLOR)
    colors = render(view, splats, groups, background=background).colors
    return colors, view.project(tips)[0]


def _scene(cloud: PointCloud, gripped: BoolArray | None) -> Splats:
    """Draw what was measured near the robot, the gripped object in its colour."""
    shown = np.flatnonzero(np.abs(cloud.points).max(axis=1) < _SHOWN)
    shown = shown[voxel_downsample(cloud.points[shown], 0.008)]
    near = cloud.points[shown]
    colors = np.asarray(GROUND_COLOR) * np.where(near[:, 2:] > 0.02, 0.72, 1.05)
    if gripped is not None:
        colors[gripped[shown]] = CHOSEN_COLOR
    sizes = np.minimum(point_spacing(near), 0.013)
    return Splats(near, np.clip(colors, 0.0, 1.0), sizes)


def _arm_mesh(
    robot: RobotModel,
    joints: Sequence[str],
    q: FloatArray,
    links: frozenset[str],
    color: FloatArray,
) -> Mesh:
    values = dict(zip(joints, q.tolist(), strict=True))
    r, g, b = color.tolist()
    return merged((s for n, s in robot.links_solids(values) if n in links), (r, g, b))


def _dots_of(lines: FloatArray) -> Splats:
    """Lines (l, 2, 3) as rows of discs."""
    share = np.linspace(0.0, 1.0, 400)[:, None]
    points = lines[:, 0, None] * (1.0 - share) + lines[:, 1, None] * share
    points = points.reshape(-1, 3)
    colors = np.full(points.shape, (0.80, 0.82, 0.85))
    return Splats(points, colors, np.full(len(points), 0.006))


def _draw_joints(
    axes: Axes, track: MotionTrack, robot: RobotModel, *, of_speed: bool
) -> None:
    t = np.linspace(0.0, track.duration, 500)
    q, dq = track.at(t)
    values = dq / track.limits.velocity if of_speed else q
    for i in range(values.shape[1]):
        axes.plot(t, values[:, i], linewidth=1.5, label=track.limits.joint_names[i])
    if of_speed:
        for bound in (-1.0, 1.0):
            axes.axhline(bound, color=hex_color(INK), linewidth=1.0, linestyle="--")
        axes.set_ylim(-1.15, 1.9)
    begin = 0.0
    for piece in track.trajectories[:-1]:
        begin += piece.duration
        axes.axvline(begin, color=hex_color(MUTED_INK), linewidth=0.8)
    if not of_speed:
        low, high = float(values.min()), float(values.max())
        axes.set_ylim(low - 0.2, high + 0.4 * (high - low) + 0.2)
    kinds = [robot.tree.joints[name].kind for name in track.limits.joint_names]
    units = dict.fromkeys("m" if kind == "prismatic" else "rad" for kind in kinds)
    unit = "share of the limit" if of_speed else " or ".join(units)
    axes.set_ylabel(unit, fontsize=10, color=hex_color(MUTED_INK))
    axes.set_xlim(0.0, max(track.duration, 1e-3))
    axes.legend(fontsize=8, ncols=4, loc="upper right", handlelength=1.2)
