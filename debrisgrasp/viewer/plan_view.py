"""The view of a capture and of a plan on it."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp.geometry import SE3
from debrisgrasp.io import point_colors
from debrisgrasp.planning import Grasp
from debrisgrasp.viz.colors import (
    CHOSEN_COLOR,
    GROUND_COLOR,
    HAND_COLORS,
    label_colors,
    mixed,
)
from debrisgrasp.viz.scene import (
    approach_arrow,
    box_edges,
    point_spacing,
    thinned,
)
from debrisgrasp.viz.words import load_rows, object_doubt

from .contents import PlanContent
from .recording import RecordPanel
from .rejected import RejectedPanel
from .stage import RobotFigure, Stage, place

__all__ = ["PlanView"]

_POINT_LIMIT = 60_000
_REGION_COLOR = (0.30, 0.36, 0.46)
_LISTED = 25
"""Grasps, and poses of one reason, that have a button or a place on the slider."""
_FRAME_SECONDS = 0.04
_DISTANCE = 1.1
"""From which the object is first looked at [m]."""


class PlanView:
    """Scene and panel of a capture, its objects, its grasps and what was ruled out."""

    def __init__(self, stage: Stage, content: PlanContent) -> None:
        self.stage, self.content = stage, content
        self.gui = stage.server.gui
        self._lock = threading.RLock()
        self._is_playing = False
        self._draw_scene()
        self._robot = None
        if content.robot is not None:
            self._robot = RobotFigure(stage, content.robot)
        self._hands: dict[int, Any] = {}
        self._all_hands: Any = None
        self.selected = 0
        """Place of the grasp that is shown, from 1; 0 for none."""
        self.rejected: RejectedPanel | None = None
        self.recording: RecordPanel | None = None
        self.details: Any = None
        """Panel with the figures of what is selected."""
        self._make_panel()

    def select(self, rank: int) -> None:
        """Show a grasp, by its place in the list from 1."""
        plan = self.content.plan
        if plan is None or not 1 <= rank <= len(plan.grasps):
            return
        grasp = plan.grasps[rank - 1]
        with self._lock, self.stage.server.atomic():
            self._clear_others()
            for other, handle in self._hands.items():
                handle.visible = other == rank or self._all_hands.value
                handle.opacity = None if other == rank else 0.3
                place(handle, plan.grasps[other - 1].T_base_hand)
            arrow = approach_arrow(grasp, HAND_COLORS[0])
            self.stage.mesh("/arrow", arrow.vertices, arrow.faces, HAND_COLORS[0])
            self._take_posture(grasp)
            self.details.content = _figures(grasp, rank)
            self.selected = rank

    def show_motion(self, seconds: float) -> None:
        """Put the robot where it is after some seconds of its motions."""
        content = self.content
        if self._robot is None or not content.motions:
            return
        for name, motion in content.motions.items():
            if seconds <= motion.duration or name == list(content.motions)[-1]:
                break
            seconds -= motion.duration
        q, _, _ = motion.at(min(seconds, motion.duration))
        joints = dict(zip(motion.joint_names, q.tolist(), strict=True))
        robot = self._robot.robot
        with self._lock, self.stage.server.atomic():
            self._robot.stand(joints, hides=content.motion_arm)
            palm = robot.link_poses(joints)[robot.arm(content.motion_arm).tip]
            self._clear_others()
            for other, mesh in self._hands.items():
                mesh.visible = other == content.motion_grasp + 1
                if mesh.visible:
                    mesh.opacity = None
                    place(mesh, palm)
        self._motion_note.content = f"**{name}**, {seconds:.2f} s"

    # -- scene ---------------------------------------------------------------------

    def _draw_scene(self) -> None:
        content, labels = self.content, np.asarray(self.content.segmentation.labels)
        chosen = content.plan.object_label if content.plan is not None else 0
        keep = np.flatnonzero((labels > 0) & (labels == chosen))
        index = thinned(content.cloud, _POINT_LIMIT, keep)
        self._points = content.cloud.points[index]
        by_label = mixed(label_colors(labels[index], chosen), GROUND_COLOR, 0.15)
        by_label[labels[index] <= 0] = mixed(GROUND_COLOR, (1, 1, 1), 0.2)
        if chosen:
            by_label[labels[index] == chosen] = CHOSEN_COLOR
        seen = point_colors(content.capture)
        grey = np.full((len(index), 3), 0.6)
        self._colors = {
            "segments": by_label,
            "camera": grey if seen is None else seen[index],
        }
        self._index, self._labels = index, labels[index]
        size = float(np.median(point_spacing(self._points)))
        self._size = size
        self._cloud = self.stage.points("/cloud", self._points, by_label, size)
        focus = self._points[self._labels > 0]
        focus = focus if len(focus) > 3 else self._points
        self.stage.grid(focus)
        if content.plan is not None and content.plan.region is not None:
            edges = box_edges(content.plan.region)
            self.stage.lines("/region V", edges, _REGION_COLOR)
        self.stage.frame("/base", SE3.identity(), 0.15)
        middle = np.median(
            self._points[labels[index] == chosen] if chosen else focus, 0
        )
        self.stage.look(middle, middle + _DISTANCE * self._side(middle))

    def _side(self, middle: FloatArray) -> FloatArray:
        """Direction from which nothing of the robot hides the object, shape (3,)."""
        x, y, _ = self.content.cloud.viewpoint - middle
        plan = self.content.plan
        arm = plan.grasps[0].arm if plan is not None and plan.grasps else None
        # From the side on which the other arm is: this one comes from its own.
        turn = np.deg2rad(70.0 if arm is not None and "left" in arm else -70.0)
        level = max(float(np.hypot(x, y)), 1e-6)
        cos, sin = np.cos(turn) / level, np.sin(turn) / level
        side = np.array([cos * x - sin * y, sin * x + cos * y, 0.75])
        unit: FloatArray = side / np.linalg.norm(side)
        return unit

    def _take_posture(self, grasp: Grasp) -> None:
        if self._robot is None:
            return
        if grasp.joints is None or grasp.arm is None:
            self._robot.stand()
        else:
            self._robot.stand(grasp.joints, hides=grasp.arm)

    def _make_room(self, other: RejectedPanel | RecordPanel | None) -> None:
        """Take grasp, posture and another panel's things away, to look at something."""
        if other is not None:
            other.clear()
        for handle in self._hands.values():
            handle.visible = False
        self.stage.remove("/arrow")
        if self._robot is not None:
            self._robot.stand()

    def _clear_others(self) -> None:
        """Take away what the other panels have drawn."""
        for panel in (self.rejected, self.recording):
            if panel is not None:
                panel.clear()

    # -- panel ---------------------------------------------------------------------

    def _make_panel(self) -> None:
        content, gui = self.content, self.gui
        tabs = gui.add_tab_group()
        plan = content.plan
        if plan is not None:
            with tabs.add_tab("Grasps"):
                self._make_grasps()
            if len(plan.ruled_out):
                with tabs.add_tab("Ruled out"):
                    self.rejected = RejectedPanel(
                        self.stage,
                        content,
                        plan.ruled_out,
                        self._points,
                        self._size,
                        lambda: self._make_room(self.recording),
                    )
        if content.motions and self._robot is not None:
            with tabs.add_tab("Motion"):
                self._make_motion()
        with tabs.add_tab("Objects"):
            self._make_objects()
        with tabs.add_tab("Record"):
            self.recording = RecordPanel(
                self.stage,
                content,
                lambda: self._make_room(self.rejected),
                self._highlight,
            )
        with tabs.add_tab("Show"):
            self._make_toggles()
        if plan is not None and plan.grasps:
            self.select(1)

    def _make_grasps(self) -> None:
        plan, gui = self.content.plan, self.gui
        assert plan is not None
        if not plan.grasps:
            gui.add_markdown(f"**No grasp.** {plan.why_empty or ''}")
        self.details = gui.add_markdown("")
        self._all_hands = gui.add_checkbox("all hands", initial_value=False)
        self._all_hands.on_update(lambda _: self.select(self.selected))
        if plan.advice:
            lines = "\n".join(f"- {line.text}" for line in plan.advice)
            gui.add_markdown(f"Of the poses ruled out:\n\n{lines}")
        for rank, grasp in enumerate(plan.grasps[:_LISTED], start=1):
            button = gui.add_button(
                f"{rank}.  score {grasp.score:.2f}, {grasp.prototype}, "
                f"{grasp.arm or grasp.gripper}"
            )
            button.on_click(lambda _, rank=rank: self.select(rank))
            hand = self.content.grippers.get(grasp.gripper)
            if hand is None:
                continue
            handle = self.stage.solids(
                f"/hands/{rank}",
                hand.solids(grasp.preshape, grasp.opening),
                HAND_COLORS[0],
                pose=grasp.T_base_hand,
                visible=False,
            )
            handle.on_click(lambda _, rank=rank: self.select(rank))
            self._hands[rank] = handle

    def _make_motion(self) -> None:
        gui = self.gui
        length = sum(motion.duration for motion in self.content.motions.values())
        self._motion_note = gui.add_markdown("")
        when = gui.add_slider("seconds", 0.0, round(length, 2), 0.01, 0.0)
        when.on_update(lambda _: self.show_motion(float(when.value)))
        play = gui.add_button("play")

        def run() -> None:
            began = time.monotonic() - float(when.value) % length
            while self._is_playing:
                passed = time.monotonic() - began
                when.value = min(round(passed, 2), round(length, 2))
                self.show_motion(passed)
                if passed >= length:
                    break
                time.sleep(_FRAME_SECONDS)
            self._is_playing = False
            play.label = "play"

        def toggle(_: object) -> None:
            self._is_playing = not self._is_playing
            play.label = "pause" if self._is_playing else "play"
            if self._is_playing:
                threading.Thread(target=run, daemon=True).start()

        play.on_click(toggle)

    def _make_objects(self) -> None:
        gui, content = self.gui, self.content
        place = {c.label: (i, c.reason) for i, c in enumerate(content.order, start=1)}
        note = gui.add_markdown("")
        segments = content.segmentation.segments
        last = len(segments) + 1
        for segment in sorted(segments, key=lambda s: place.get(s.label, (last,))[0]):
            turn, reason = place.get(segment.label, (0, ""))
            size = " × ".join(f"{100 * v:.0f}" for v in segment.extents)
            text = f"**Object {segment.label}**, {size} cm\n\n"
            text += f"turn {turn}: {reason}" if turn else "not in the order"
            doubt = object_doubt(content.segmentation, segment.label)
            text += f"\n\nIt {doubt}." if doubt else ""

            def choose(_: object, label: int = segment.label, text: str = text) -> None:
                note.content = text
                self._highlight(np.asarray(content.segmentation.labels) == label)

            title = f"{turn}.  " if turn else "–  "
            button = gui.add_button(f"{title}object {segment.label}, {size} cm")
            button.on_click(choose)

    def _make_toggles(self) -> None:
        gui = self.gui
        colors = gui.add_dropdown("colours", ("segments", "camera"))
        colors.on_update(lambda _: self._paint(self._colors[colors.value]))
        drawn = round(1e3 * self._size, 1)
        least, most = min(1.0, drawn), max(15.0, 2.0 * drawn)
        size = gui.add_slider("point size [mm]", least, most, 0.1, drawn)

        def resize(_: object) -> None:
            self._cloud.point_size = 1e-3 * float(size.value)

        size.on_update(resize)
        if self._robot is not None:
            robot = self._robot
            toggle = gui.add_checkbox("robot", initial_value=True)
            toggle.on_update(lambda _: robot.show(is_shown=toggle.value))

    def _highlight(self, inside: BoolArray | None) -> None:
        """Let some points of the cloud stand out, shape (n,); None for no more."""
        colors = self._colors["segments"]
        if inside is not None:
            colors = mixed(colors, (1, 1, 1), 0.55)
            colors[inside[self._index]] = CHOSEN_COLOR
        self._paint(colors)

    def _paint(self, colors: FloatArray) -> None:
        self._cloud.colors = np.rint(255 * np.clip(colors, 0, 1)).astype(np.uint8)


def _figures(grasp: Grasp, rank: int) -> str:
    """Everything that is known about a grasp, as Markdown."""
    p, z = grasp.T_base_hand.p, grasp.T_base_hand.R[:, 2]
    down = np.rad2deg(np.arccos(np.clip(-z[2], -1.0, 1.0)))
    rows = [
        ("Q = S C R", f"{grasp.Q:.3f} = {grasp.S:.3f} · {grasp.C:.3f} · {grasp.R:.0f}"),
        ("Score", f"{grasp.score:.3f}, expected {grasp.expected:.3f}"),
        ("Seen", f"{100 * grasp.coverage:.0f} % of the prototype's visible points"),
        ("Hand", f"{grasp.gripper} {grasp.preshape}"),
        (
            "Opens",
            f"{1e3 * grasp.opening:.0f} mm, closes to {1e3 * grasp.width:.0f} mm",
        ),
        ("Approach", f"{1e3 * grasp.approach_distance:.0f} mm, {down:.0f}° from down"),
        ("Arm", grasp.arm or "floating hand"),
        ("Palm", ", ".join(f"{v:.3f}" for v in p) + " m"),
        *load_rows(grasp),
    ]
    table = "\n".join(f"| {name} | {value} |" for name, value in rows)
    return f"**Grasp {rank}: {grasp.prototype}**\n\n| | |\n| --- | --- |\n{table}"
