"""The panel on which a prototype is recorded: a piece of the capture, and a hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp.errors import ConfigError, DebrisGraspError
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.io import measured
from debrisgrasp.prototypes import load_grippers, write_new_prototype
from debrisgrasp.viz.colors import HAND_COLORS
from debrisgrasp.workbench import Recording, record

from .contents import PlanContent
from .stage import Stage, place

__all__ = ["RecordPanel"]

_ANY = "all objects"
_FITS = "what fits"
_DRAGGED = "as dragged"
_NEAR = 0.9
"""From which a piece is looked at [m]."""
_HELP = (
    "1. Choose an object, or *cut out* a piece: drag a box over it.\n"
    "2. *Propose* poses of the hand; drag the hand by its arrows and rings to teach "
    "another.\n"
    "3. *Check*, and *save*."
)


class RecordPanel:
    """Makes a prototype of a piece of the capture, with the mouse."""

    def __init__(
        self,
        stage: Stage,
        content: PlanContent,
        before: Callable[[], None],
        highlight: Callable[[BoolArray | None], None],
    ) -> None:
        self.stage, self.content = stage, content
        self._before, self._highlight = before, highlight
        self.grippers = dict(content.grippers) or dict(load_grippers())
        self.made: Recording | None = None
        """What was recorded last."""
        self._poses: tuple[SE3, ...] = ()
        self._gizmo: Any = None
        self._is_used = False
        gui, labels = stage.server.gui, np.asarray(content.segmentation.labels)
        self._inside: BoolArray = labels > 0
        objects = [f"object {s.label}" for s in content.segmentation.segments]
        gui.add_markdown(_HELP)
        self.object = gui.add_dropdown("piece", (_ANY, *objects))
        self._cut = gui.add_button("cut out")
        self.hand = gui.add_dropdown("hand", tuple(self.grippers))
        self.fingers = gui.add_dropdown("fingers", self._preshapes())
        propose = gui.add_button("propose")
        self.pose = gui.add_dropdown("pose", ("none yet",))
        self._closed = gui.add_slider("closed [%]", 0, 100, 1, 0)
        self.name = gui.add_text("name", "my_part")
        self.folder = gui.add_text("folder", "prototypes")
        check, save = gui.add_button("check"), gui.add_button("save")
        self.note = gui.add_markdown("")
        """What came of the last step."""
        self.object.on_update(lambda _: self.choose())
        self._cut.on_click(lambda _: self._await_cut())
        self.hand.on_update(lambda _: self._other_hand())
        self.fingers.on_update(lambda _: self._draw_hand())
        propose.on_click(lambda _: self.propose())
        self.pose.on_update(lambda _: self._take())
        self._closed.on_update(lambda _: self._draw_hand())
        check.on_click(lambda _: self.check())
        save.on_click(lambda _: self.save())

    def choose(self) -> None:
        """Take the object that the panel names as the piece."""
        labels = np.asarray(self.content.segmentation.labels)
        name = self.object.value
        wanted = None if name == _ANY else int(name.split()[1])
        inside: BoolArray = labels > 0 if wanted is None else labels == wanted
        self._take_piece(inside)
        if inside.any():  # from where it was seen
            middle = np.median(self.content.cloud.points[inside], axis=0)
            sight = self.content.cloud.viewpoint - middle
            distance = max(float(np.linalg.norm(sight)), 1e-6)
            self.stage.look(middle, middle + min(1.0, _NEAR / distance) * sight)

    def propose(self) -> None:
        """Propose poses of the hand, and show the best."""
        self._told(self._propose)

    def check(self) -> None:
        """Record with the hand where it is, and say what is wrong."""
        self._told(self._check)

    def save(self) -> None:
        """Record, and write the file."""
        self._told(self._save)

    def clear(self) -> None:
        """Take everything of this panel off the stage."""
        if self._is_used:
            self.stage.remove("/record")
            self._highlight(None)
        self._gizmo, self._is_used = None, False

    # -- steps ---------------------------------------------------------------------

    def _propose(self) -> str:
        made = self._recorded(None)
        turned = [proposal.T_surface_hand for proposal in made.proposals]
        self._poses = tuple(turned)
        names = [
            f"{rank}. {pose.way}, {1e3 * pose.clearance:z.0f} mm clear"
            for rank, pose in enumerate(made.proposals, start=1)
        ]
        self.pose.options = (*names, _DRAGGED)
        if self.fingers.value == _FITS:
            self.fingers.value = made.proposals[0].preshape
        self.pose.value = names[0]
        self._place(turned[0])
        return f"{len(names)} poses; the best is shown."

    def _check(self) -> str:
        self.made = made = self._recorded(self._T_base_hand())
        d = made.definition
        facts = (
            f"{d.preshape}, opens {1e3 * d.opening:.0f} mm, closes to "
            f"{1e3 * d.width:.0f} mm, {made.n_points} points of the piece"
        )
        return "\n\n".join([facts, *(f"⚠ {each}" for each in made.findings)])

    def _save(self) -> str:
        said, folder = self._check(), Path(self.folder.value).expanduser()
        assert self.made is not None
        target = folder / f"{self.name.value}.yaml"
        files = write_new_prototype(self.made.definition, target, force=False)
        wrote = ", ".join(str(file) for file in files)
        then = f"`debrisgrasp plan ... --prototypes {folder}`"
        return "\n\n".join([said, f"wrote {wrote}", then])

    def _recorded(self, T_base_hand: SE3 | None) -> Recording:
        capture = self.content.capture
        is_measured = measured(capture)
        mask = np.zeros(is_measured.shape, dtype=bool)
        mask[is_measured] = self._inside
        fingers = self.fingers.value
        return record(
            replace(capture, mask=mask),
            self.name.value,
            self.grippers[self.hand.value],
            T_base_hand=T_base_hand,
            preshape=None if fingers == _FITS else fingers,
        )

    def _told(self, step: Callable[[], str]) -> None:
        """Do a step, and say what came of it, or why it can't be done."""
        self._before()
        self.note.content = "…"
        try:
            self.note.content = step()
        except DebrisGraspError as error:
            self.note.content = f"⚠ {error}"

    # -- piece ---------------------------------------------------------------------

    def _take_piece(self, inside: BoolArray) -> None:
        self._before()
        self._inside = inside
        points = self.content.cloud.points[inside]
        self._is_used = True
        self._highlight(inside)
        self.note.content = f"{len(points)} points"

    def _await_cut(self) -> None:
        """Let the next drag of the mouse draw a box."""
        scene = self.stage.scene
        scene.remove_rect_select_callback()
        self._cut.label = "cut out: now drag a box"

        def cut(event: Any) -> None:
            scene.remove_rect_select_callback()
            self._cut.label = "cut out"
            self._take_piece(self._inside & self._in_box(event))

        scene.on_rect_select()(cut)

    def _in_box(self, event: Any) -> BoolArray:
        """Which points the camera of a client shows inside a box of its screen."""
        camera = event.client.camera
        R = so3.from_quat_wxyz(np.asarray(camera.wxyz))
        x, y, z = ((self.content.cloud.points - camera.position) @ R).T
        scale = 0.5 / np.tan(camera.fov / 2)
        ahead = np.maximum(z, 1e-6)
        at = np.column_stack([scale / camera.aspect * x, scale * y]) / ahead[:, None]
        inside: BoolArray = (z > 0) & np.all(
            (at + 0.5 >= event.screen_min) & (at + 0.5 <= event.screen_max), axis=1
        )
        return inside

    # -- hand ----------------------------------------------------------------------

    def _preshapes(self) -> tuple[str, ...]:
        return (_FITS, *self.grippers[self.hand.value].preshapes)

    def _other_hand(self) -> None:
        self.fingers.options = self._preshapes()
        self.fingers.value = _FITS
        self._draw_hand()

    def _take(self) -> None:
        number = str(self.pose.value).partition(".")[0]
        if number.isdigit() and int(number) <= len(self._poses):
            self._place(self._poses[int(number) - 1])

    def _place(self, T_base_hand: SE3) -> None:
        """Put the hand, and what it is dragged by, at a pose."""
        self._is_used = True
        if self._gizmo is None:
            self._gizmo = self.stage.scene.add_transform_controls(
                "/record/pose", scale=0.18
            )
            self._gizmo.on_update(self._dragged)
        place(self._gizmo, T_base_hand)
        self._draw_hand()

    def _dragged(self, event: Any) -> None:
        if event.phase == "end" and self._poses:
            self.pose.value = _DRAGGED

    def _draw_hand(self) -> None:
        if self._gizmo is None:
            return
        hand = self.grippers[self.hand.value]
        name = self.fingers.value
        preshape = hand.preshape(next(iter(hand.preshapes)) if name == _FITS else name)
        widest, least = float(preshape.openings[0]), float(preshape.widths[0])
        opening = widest + 1e-2 * float(self._closed.value) * (least - widest)
        self.stage.solids(
            "/record/pose/hand",
            hand.solids(preshape.name, opening),
            HAND_COLORS[0],
            opacity=0.8,
        )

    def _T_base_hand(self) -> SE3:
        if self._gizmo is None:
            raise ConfigError(
                "pose of the hand",
                got="none",
                expected="one that was proposed or taught",
            )
        R: FloatArray = so3.from_quat_wxyz(np.asarray(self._gizmo.wxyz))
        return SE3.from_parts(R, np.asarray(self._gizmo.position))
