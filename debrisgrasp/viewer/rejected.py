"""The panel of the poses that were ruled out, and what the hand would hit in each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.planning import Rejections

from .contents import PlanContent
from .stage import Stage
from .touching import touches

__all__ = ["RejectedPanel"]

_HITS_COLOR = (0.86, 0.08, 0.16)
_GHOST_COLOR = (0.55, 0.58, 0.64)
_PIN_COLOR = (150, 60, 70)
_PIN = np.array(
    [
        [0.0, 0.0, 0.0],
        [0.005, 0.005, -0.035],
        [-0.005, 0.005, -0.035],
        [-0.005, -0.005, -0.035],
        [0.005, -0.005, -0.035],
    ]
)
"""Corners of a pin [m] whose point is where the palm would be, palm frame."""
_PIN_FACES = np.array(
    [[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 1, 4], [1, 2, 3], [1, 3, 4]]
)


class RejectedPanel:
    """A list of reasons; the poses of one are pins in the scene, to be clicked."""

    def __init__(
        self,
        stage: Stage,
        content: PlanContent,
        ruled_out: Rejections,
        points: FloatArray,
        size: float,
        before: Callable[[], None],
    ) -> None:
        self.stage, self.content, self.ruled_out = stage, content, ruled_out
        self._points, self._size, self._before = points, size, before
        self._reason = ""
        gui = stage.server.gui
        counts = sorted(ruled_out.counts().items(), key=lambda item: -item[1])
        names = {f"{n} × {reason}": (reason, n) for reason, n in counts}
        choice = gui.add_dropdown("reason", tuple(names))
        most = max(n for _, n in counts)
        number = gui.add_slider("pose", 1, max(2, most), 1, 1)
        gui.add_button("show").on_click(lambda _: update())
        self.why = gui.add_markdown(
            "*show* draws a pin for each pose. Click one to see what the hand hits."
        )
        """What is known about the pose that is shown."""

        def update() -> None:
            reason, n = names[choice.value]
            self.select(reason, min(int(number.value), n) - 1)

        choice.on_update(lambda _: update())
        number.on_update(lambda _: update())

    def select(self, reason: str, number: int) -> None:
        """Show the pose ``number`` (from 0) of those that a reason ruled out."""
        ruled_out = self.ruled_out
        if reason not in ruled_out.reasons:
            return
        rows = np.flatnonzero(ruled_out.code == ruled_out.reasons.index(reason))
        number = min(max(number, 0), len(rows) - 1)
        row = int(rows[number])
        with self.stage.server.atomic():
            self._before()
            if reason != self._reason:
                self._reason = reason
                self._pin(rows)
            text = [f"**{reason}**, pose {number + 1} of {len(rows)}", ""]
            index = int(ruled_out.prototype[row])
            if index < len(self.content.dictionary):
                text += self._draw(SE3(ruled_out.Ts[row]), index)
            self.why.content = "\n".join(text)

    def clear(self) -> None:
        """Take the pose and the pins off the stage."""
        self._reason = ""
        for name in ("hand", "points", "solids", "pins"):
            self.stage.remove(f"/rejected/{name}")

    def _pin(self, rows: IntArray) -> None:
        Ts = SE3(self.ruled_out.Ts[rows])
        pins: Any = self.stage.scene.add_batched_meshes_simple(
            "/rejected/pins",
            vertices=_PIN.astype(np.float32),
            faces=_PIN_FACES.astype(np.uint32),
            batched_wxyzs=so3.to_quat_wxyz(Ts.R),
            batched_positions=Ts.p,
            batched_colors=_PIN_COLOR,
            flat_shading=True,
            side="double",
        )
        reason = self._reason
        pins.on_click(lambda event: self.select(reason, event.instance_index or 0))

    def _draw(self, T: SE3, index: int) -> list[str]:
        """Draw the hand and what it hits; lines of Markdown that say so."""
        wanted = self.content.dictionary[index]
        hand = self.content.grippers[wanted.gripper]
        found = touches(
            hand, wanted.preshape, wanted.opening, wanted.width, T, self._points
        )
        solids = [s.moved(T) for s in hand.solids(wanted.preshape, wanted.opening)]
        self.stage.solids("/rejected/hand", solids, _GHOST_COLOR, opacity=0.45)
        lines = [f"{wanted.name}, {wanted.gripper} {wanted.preshape}", ""]
        if not found:
            for name in ("points", "solids"):
                self.stage.remove(f"/rejected/{name}")
            return [*lines, "The hand touches no measured point on its way."]
        hit = np.unique(np.concatenate([touch.points for touch in found]))
        self.stage.points(
            "/rejected/points", self._points[hit], _HITS_COLOR, 2.2 * self._size
        )
        touching = [touch.solid for touch in found]
        self.stage.solids("/rejected/solids", touching, _HITS_COLOR, opacity=0.55)
        return [*lines, "In its way:", "", *(f"- {touch}" for touch in found[:8])]
