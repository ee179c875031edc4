"""The three-dimensional panels of the PNG report, as finished pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.planning import Grasp

from .colors import (
    BACKGROUND_COLOR,
    CHOSEN_COLOR,
    GROUND_COLOR,
    HAND_COLORS,
    label_colors,
    mixed,
)
from .outline import reach_outline, sampled_reach
from .raster import Mesh, Picture, Splats, render
from .report import Report
from .scene import (
    approach_arrow,
    box_edges,
    ground_grid,
    hand_mesh,
    point_spacing,
    robot_mesh,
    shown_ranks,
    thinned,
)
from .view import View

__all__ = ["Panels"]

_POINT_LIMIT = 120_000
_REGION_COLOR = (0.30, 0.36, 0.46)
_REACH_COLOR = (0.10, 0.52, 0.72)
_GRID_COLOR = (0.80, 0.82, 0.85)
_SIGHT_TURN, _SIDE_TURN = np.deg2rad(-20.0), np.deg2rad(65.0)
"""How far the two close-ups are turned from the line of sight of the sensor."""
_CLOSE = 0.3
"""Part of the object [m] around the hands that a close-up shows."""


@dataclass(frozen=True, slots=True, eq=False)
class Panels:
    """The scene of one report, ready to be looked at from several sides."""

    points: FloatArray
    """Points that are drawn [m], shape (m, 3)."""
    normals: FloatArray
    labels: IntArray
    sizes: FloatArray
    hands: Mapping[int, tuple[Mesh, ...]]
    """Hand and arrow of the grasps that are drawn, by rank from 0."""
    report: Report

    @classmethod
    def of(cls, report: Report) -> Panels:
        """Prepare what all panels share."""
        chosen = report.plan.object_label
        labels = report.labels
        keep = np.flatnonzero((labels == chosen) & (labels > 0))
        index = thinned(report.cloud, _POINT_LIMIT, keep)
        points = report.cloud.points[index]
        grasps = report.plan.grasps
        hands = {
            rank: (
                hand_mesh(grasps[rank], report.grippers, color),
                approach_arrow(grasps[rank], color),
            )
            for rank, color in zip(shown_ranks(grasps), HAND_COLORS, strict=False)
        }
        return cls(
            points=points,
            normals=report.cloud.normals[index],
            labels=labels[index],
            sizes=point_spacing(points),
            hands=hands,
            report=report,
        )

    @property
    def best(self) -> Grasp | None:
        """The grasp at the top of the list."""
        grasps = self.report.plan.grasps
        return grasps[0] if grasps else None

    def along_sight(self, size: tuple[int, int]) -> tuple[Picture, View]:
        """Show the best hands, from above and beside the sensor's line of sight."""
        direction = self._sight(turned=_SIGHT_TURN, descent=0.3)
        return self._close_up(direction, size, tuple(self.hands))

    def across_grip(self, size: tuple[int, int]) -> tuple[Picture, View]:
        """Show the best hand from where both sides of its grip are seen."""
        direction = self._sight(turned=_SIDE_TURN, descent=0.1)
        if self.best is not None:
            sight = self._sight(turned=0.0, descent=0.0)
            sight = sight / np.linalg.norm(sight)
            across = self.best.T_base_hand.R[:, 1]
            # The far side of things was not measured, so stay on the near one.
            direction = across * np.sign(across @ sight or 1.0) + 0.3 * sight
            direction[2] = min(direction[2], -0.25 * np.hypot(*direction[:2]))
        return self._close_up(direction, size, tuple(self.hands)[:1])

    def from_above(self, size: tuple[int, int]) -> tuple[Picture, View]:
        """Plan view of the whole scene; the base frame's x points up."""
        meshes = self._meshes(tuple(self.hands))
        corners = np.concatenate([self._objects(), *(m.vertices for m in meshes)])
        view = View.fitted(corners, [0.0, 0.0, -1.0], size, margin=1.15)
        return self._drawn(view, meshes), view

    def with_robot(self, size: tuple[int, int]) -> tuple[Picture, View]:
        """Show the robot in the posture of the best grasp, from its working side."""
        report = self.report
        if report.robot is None:
            return self.from_above(size)
        body = robot_mesh(report.robot, self.best)
        hand = self._meshes(tuple(self.hands)[:1])
        corners = [body.vertices, self._objects()]
        outlines = self.reach()
        corners += [line[::4] for line in outlines]
        # From the side on which the arm works, so that the body doesn't hide it.
        side = np.sign(self._focus().mean(axis=0)[1] or -1.0)
        if self.best is not None and self.best.arm is not None:
            side = 1.0 if "left" in self.best.arm else -1.0
        view = View.fitted(
            np.concatenate(corners), [0.1, -0.9 * side, -0.4], size, margin=1.03
        )
        picture = self._drawn(view, (body, *hand), outlines, grid=0.5)
        return picture, view

    def reach(self) -> list[FloatArray]:
        """Outline of what the arm of the best grasp reaches at the object's height."""
        robot, best = self.report.robot, self.best
        if robot is None or best is None or best.arm is None:
            return []
        height = float(best.T_base_hand.p[2])
        return reach_outline(sampled_reach(robot, best.arm), height)

    def _sight(self, *, turned: float, descent: float) -> FloatArray:
        """Line of sight to the object, turned about the vertical and lowered."""
        x, y, z = self._focus().mean(axis=0) - self.report.cloud.viewpoint
        level = max(float(np.hypot(x, y)), 1e-3)
        cos, sin = np.cos(turned), np.sin(turned)
        # Neither straight down nor from below: the slope stays between 20 and 60 deg.
        slope = np.clip(-z / level + descent, 0.36, 1.7)
        return np.array([cos * x - sin * y, sin * x + cos * y, -slope * level])

    def _focus(self) -> FloatArray:
        """Points of the chosen object; without one of the region, of all objects."""
        plan = self.report.plan
        is_object = self.labels > 0
        masks = [is_object & (self.labels == plan.object_label)]
        if plan.region is not None:
            masks.append(plan.region.contains(self.points))
        for mask in (*masks, is_object):
            if np.count_nonzero(mask) >= 3:
                chosen: FloatArray = self.points[mask]
                return chosen
        return self.points if len(self.points) else np.zeros((1, 3))

    def _objects(self) -> FloatArray:
        """Points of all objects without the few farthest, or of the whole cloud."""
        points = self.points[self.labels > 0]
        if len(points) < 3:
            points = self._focus()
        low, high = np.percentile(points, [0.5, 99.5], axis=0)
        return np.clip(points, low, high)

    def _meshes(self, ranks: Sequence[int]) -> tuple[Mesh, ...]:
        return tuple(mesh for rank in ranks for mesh in self.hands[rank])

    def _close_up(
        self, direction: FloatArray, size: tuple[int, int], ranks: Sequence[int]
    ) -> tuple[Picture, View]:
        focus, meshes = self._focus(), self._meshes(ranks)
        hands = np.concatenate([np.zeros((0, 3)), *(m.vertices for m in meshes)])
        if len(hands):
            # Of a long object, the part around the hands is what matters.
            away = np.linalg.norm(focus - hands.mean(axis=0), axis=1)
            focus = focus[away < max(_CLOSE, away.min() + 0.05)]
        view = View.fitted(np.concatenate([focus, hands]), direction, size, margin=1.1)
        return self._drawn(view, meshes, cut_before=focus), view

    def _drawn(
        self,
        view: View,
        meshes: tuple[Mesh, ...],
        outlines: Sequence[FloatArray] = (),
        *,
        grid: float = 0.1,
        cut_before: FloatArray | None = None,
    ) -> Picture:
        lines = [_line_splats(self._grid(grid), _GRID_COLOR, view)]
        region = self.report.plan.region
        if region is not None:
            lines.append(_line_splats(box_edges(region), _REGION_COLOR, view))
        for outline in outlines:
            pairs = np.stack([outline[:-1], outline[1:]], axis=1)
            lines.append(_line_splats(pairs, _REACH_COLOR, view, width=2.5))
        splats = [self._cloud(view, cut_before), *lines]
        return render(view, splats, meshes, background=np.array(BACKGROUND_COLOR))

    def _grid(self, step: float) -> FloatArray:
        around = self._objects()
        if self.report.robot is not None and step > 0.2:
            around = np.concatenate([around, [[-0.5, -1.0, 0.0], [1.0, 1.0, 0.0]]])
        return ground_grid(around, step)

    def _cloud(self, view: View, cut_before: FloatArray | None) -> Splats:
        """Leave out of the cloud what would hide the object from this eye."""
        chosen = self.report.plan.object_label
        is_chosen = (self.labels > 0) & (self.labels == chosen)
        colors = mixed(label_colors(self.labels), GROUND_COLOR, 0.4)
        # All but the chosen object step back, so that it and the hands stand out.
        colors[self.labels <= 0] = mixed(GROUND_COLOR, (1.0, 1.0, 1.0), 0.35)
        colors[is_chosen] = CHOSEN_COLOR
        ray = self.points - view.T_base_eye.p
        # Ground and walls are seen through from behind, as in a doll's house.
        is_hiding = (self.labels <= 0) & ((self.normals * ray).sum(axis=1) > 0.0)
        if cut_before is not None:
            axis = view.T_base_eye.R[:, 2]
            nearest = ((cut_before - view.T_base_eye.p) @ axis).min()
            is_hiding |= (ray @ axis < nearest - 0.02) & ~is_chosen
        sizes = np.where(np.isfinite(self.normals[:, 0]), 1.0, 0.6) * self.sizes
        shown = ~is_hiding
        return Splats(
            self.points[shown], colors[shown], sizes[shown], self.normals[shown]
        )


def _line_splats(
    segments: FloatArray,
    color: tuple[float, float, float],
    view: View,
    width: float = 1.5,
) -> Splats:
    """Straight lines (l, 2, 3) as rows of points, close enough to look drawn."""
    lengths = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    _, depth = view.project(segments.mean(axis=1))
    pixel = np.maximum(depth, 0.05) / view.intrinsics.fx
    counts = np.clip(np.ceil(2.0 * lengths / pixel), 2, 6000).astype(int)
    line = np.repeat(np.arange(len(segments)), counts)
    step = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (step / np.maximum(counts - 1, 1)[line])[:, None]
    points = segments[line, 0] * (1.0 - share) + segments[line, 1] * share
    colors = np.broadcast_to(color, points.shape)
    return Splats(points, np.asarray(colors), width * pixel[line])
