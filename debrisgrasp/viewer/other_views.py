"""The views of prototypes, of a calibration, and of the record of a run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from debrisgrasp.geometry import SE3
from debrisgrasp.io import point_colors
from debrisgrasp.io.calibration_json import StoredCalibration
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.prototypes import GraspPrototype, PrototypeLibrary, check, half_turns
from debrisgrasp.viz.colors import CHOSEN_COLOR, HAND_COLORS
from debrisgrasp.viz.scene import point_spacing

from .contents import RunContent
from .stage import RobotFigure, Stage

__all__ = ["CalibrationView", "PrototypesView", "RunView"]

_T_VIEW_HAND = SE3.from_parts(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 0.3])
"""The palm looks down, 30 cm above the ground."""
_MOST_POINTS = 60_000


class PrototypesView:
    """Prototypes, each with its hand, whose fingers a slider closes."""

    def __init__(self, stage: Stage, library: PrototypeLibrary) -> None:
        self.stage, self.library = stage, library
        gui = stage.server.gui
        self._choice = gui.add_dropdown("prototype", library.names)
        self._closed = gui.add_slider("closed [%]", 0, 100, 1, 0)
        self.details = gui.add_markdown("")
        self._choice.on_update(lambda _: self.select(self._choice.value))
        self._closed.on_update(lambda _: self._draw_hand())
        stage.grid(np.array([[-0.15, -0.15, 0.0], [0.15, 0.15, 0.0]]))
        stage.look(np.array([0.0, 0.0, 0.25]), np.array([0.35, -0.6, 0.45]))
        self.select(library.names[0])

    def select(self, name: str) -> None:
        """Show a prototype."""
        self._chosen: GraspPrototype = self.library[name]
        prototype = self._chosen
        points = _T_VIEW_HAND.apply(prototype.points)
        size = float(np.median(point_spacing(points)))
        self.stage.points("/shape", points, CHOSEN_COLOR, size)
        self._draw_hand()
        gripper = self.library.grippers[prototype.gripper]
        findings = check(prototype, gripper)
        rows = [
            ("Hand", f"{prototype.gripper} {prototype.preshape}"),
            ("Opens", f"{1e3 * prototype.opening:.0f} mm"),
            ("Closes", f"to {1e3 * prototype.width:.0f} mm"),
            ("Kind", prototype.kind),
            ("Half turns", ", ".join(half_turns(prototype)) or "none"),
            ("Points", str(len(prototype.points))),
        ]
        text = f"**{name}**\n\n{prototype.definition.description}\n\n{_table(rows)}"
        for finding in findings:
            text += f"\n\n⚠ {finding}"
        self.details.content = text

    def _draw_hand(self) -> None:
        p, share = self._chosen, float(self._closed.value) / 100.0
        opening = p.opening + share * (p.width - p.opening)
        solids = self.library.grippers[p.gripper].solids(p.preshape, opening)
        self.stage.solids("/hand", solids, HAND_COLORS[0], pose=_T_VIEW_HAND)


class CalibrationView:
    """The camera where a calibration has it, and the robot beside it."""

    def __init__(
        self, stage: Stage, calibration: StoredCalibration, robot: RobotModel | None
    ) -> None:
        gui = stage.server.gui
        pose, link = calibration.T_link_camera, calibration.link
        if link is not None and robot is not None:
            pose = robot.link_pose(link) @ pose
        if robot is not None:
            RobotFigure(stage, robot)
            if robot.camera is not None:
                stage.frame("/camera/nominal", robot.T_base_camera(), 0.06)
        stage.frame("/base", SE3.identity(), 0.3)
        stage.frame("/camera/calibrated", pose, 0.15)
        spread = np.sqrt(np.diag(calibration.covariance))
        rows = [
            ("Date", calibration.date),
            ("Carried by", link or "no arm"),
            (
                "Camera",
                ", ".join(f"{v:.4f}" for v in calibration.T_link_camera.p) + " m",
            ),
            ("± position", ", ".join(f"{1e3 * v:.1f}" for v in spread[:3]) + " mm"),
            ("± turn", ", ".join(f"{np.rad2deg(v):.2f}" for v in spread[3:]) + "°"),
        ]
        said = "accepted" if not calibration.problems else "**refused**"
        text = f"**{calibration.path.name}**, {said}\n\n{_table(rows)}"
        for problem in calibration.problems:
            text += f"\n\n⚠ {problem}"
        gui.add_markdown(text)
        gui.add_markdown(
            "Large frame: as calibrated. Small: as the robot's file has it."
        )
        target = pose.p + 0.6 * pose.R[:, 2]
        stage.look(target, pose.p + np.array([1.2, -1.6, 0.6]))


class RunView:
    """What happened in a run, event by event, over what was seen."""

    def __init__(self, stage: Stage, content: RunContent) -> None:
        self.stage, self.run = stage, content.run
        self.events = [e for e in self.run.events if e.get("event") != "trace"]
        if content.robot is not None:
            RobotFigure(stage, content.robot)
        gui = stage.server.gui
        end = self.run.end
        state = "ended" if end is not None else "was cut off"
        gui.add_markdown(
            f"**{self.run.folder.name}** {state}; {len(self.events)} events"
        )
        if end is not None:
            gui.add_markdown(_facts(end))
        names = sorted(path.stem for path in self.run.folder.glob("captures/*.npz"))
        if names:
            seen = gui.add_dropdown("capture", tuple(names))
            seen.on_update(lambda _: self.see(seen.value))
            self.see(names[0])
        if self.events:
            last = max(1, len(self.events) - 1)
            number = gui.add_slider("event", 0, last, 1, 0)
            number.on_update(lambda _: self.select(int(number.value)))
        self.details = gui.add_markdown("")
        self.select(0)

    def see(self, name: str) -> None:
        """Show one of the captures."""
        capture = self.run.capture(name)
        if capture is None:
            return
        cloud = capture.cloud()
        step = max(1, len(cloud) // _MOST_POINTS)
        points = cloud.points[::step]
        colors = point_colors(capture)
        shown = (0.6, 0.62, 0.66) if colors is None else colors[::step]
        size = float(np.median(point_spacing(points)))
        self.stage.points("/cloud", points, shown, size)
        middle = np.median(points, axis=0)
        self.stage.look(middle, middle + np.array([-0.9, -1.2, 0.9]))

    def select(self, number: int) -> None:
        """Show what an event says, by its place from 0."""
        if 0 <= number < len(self.events):
            self.details.content = _facts(self.events[number])


def _table(rows: list[tuple[str, str]]) -> str:
    return "| | |\n| --- | --- |\n" + "\n".join(f"| {a} | {b} |" for a, b in rows)


def _facts(event: Mapping[str, Any]) -> str:
    """Event as Markdown; long values are cut."""
    rows = []
    for name, value in event.items():
        text = value if isinstance(value, str) else json.dumps(value)
        rows.append((name, text.replace("|", "/").replace("\n", " ")[:200]))
    return _table(rows)
