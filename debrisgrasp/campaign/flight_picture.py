"""One trial as a picture: what the planner saw, the approach, the grip, the end."""

from __future__ import annotations

import io
from pathlib import Path
from textwrap import fill

import numpy as np
from matplotlib.figure import Figure

from debrisgrasp._files import write_atomic
from debrisgrasp.geometry import Solid
from debrisgrasp.sim import Moment
from debrisgrasp.trials import Trial
from debrisgrasp.viz.raster import Mesh, Splats, render
from debrisgrasp.viz.scene import merged
from debrisgrasp.viz.view import View
from debrisgrasp.worlds import World

__all__ = ["save_flight"]

SIZE = (520, 400)
HAND = (0.15, 0.45, 0.85)
PLANNED = (0.95, 0.55, 0.1)
BACKGROUND = np.array([0.97, 0.97, 0.98])
NEAR = 0.28
PHASES = ("approach", "squeeze", "lift", "hold", "pull")
PER_COLUMN = 48
"""Letters of the caption."""


def save_flight(path: Path, done: Trial) -> None:
    """Draw a trial from two sides: the plan, then each phase of the flight, as PNG.

    Raises
    ------
    OutputError
        If the file can't be written.
    """
    shown = _shown(done)
    focus, across = _focus(done)
    views = [np.array([0.8, 0.25, -0.6]), across]
    n_columns = len(shown) + 1
    lines = [fill(line, PER_COLUMN * n_columns) for line in _caption(done).split("\n")]
    caption = "\n".join(lines)
    height = 8.0 + 0.25 * (caption.count("\n") + 1)
    figure = Figure(figsize=(5.2 * n_columns, height), dpi=60, layout="constrained")
    figure.suptitle(caption, fontsize=13)
    for row, direction in enumerate(views):
        view = View.fitted(focus, direction, SIZE)
        pictures = {"planned": _planned(done, view)}
        pictures |= {title: _drawn(moment, view) for title, moment in shown.items()}
        for column, (title, picture) in enumerate(pictures.items()):
            axes = figure.add_subplot(2, n_columns, row * n_columns + column + 1)
            axes.imshow(picture)
            axes.set_axis_off()
            if row == 0:
                axes.set_title(title)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", metadata={"Software": ""})
    write_atomic(path, stream.getvalue())


def _shown(done: Trial) -> dict[str, Moment]:
    """Choose what shows what was there: the end of each phase, or the scene."""
    if done.flight is None:
        return {"there": Moment(phase="start", world=done.scene.world, hand=())}
    moments = {moment.phase: moment for moment in done.flight.moments}
    kept = {phase: moments[phase] for phase in PHASES if phase in moments}
    return kept or {"start": moments["start"]}


def _focus(done: Trial) -> tuple[np.ndarray, np.ndarray]:
    """Corners of what must be in the picture, and a direction along the hand's y."""
    if done.grasp is None:
        places = [body.T_base_body.p for body in done.scene.world.bodies]
        middle, along = np.mean(places, axis=0), np.array([0.0, 1.0, -0.3])
    else:
        pose = done.grasp.T_base_hand
        middle, along = pose.apply(np.array([0.0, 0.0, 0.08])), pose.R[:, 1].copy()
        along = along if along[0] > 0 else -along
        along[2] = -0.25
    steps = np.array(list(np.ndindex(2, 2, 2))) * 2.0 - 1.0
    return middle + NEAR * steps + np.array([0.0, 0.0, 0.08]), along


def _bodies(world: World) -> list[Mesh]:
    return [
        merged(body.solids, tuple(c / 255 for c in body.color))  # type: ignore[arg-type]
        for body in world.bodies
    ]


def _drawn(moment: Moment, view: View) -> np.ndarray:
    meshes = [*_bodies(moment.world), merged(moment.hand, HAND)]
    floor = _floor(moment.world)
    return render(view, [floor], meshes, background=BACKGROUND).colors


def _planned(done: Trial, view: View) -> np.ndarray:
    """Draw what was measured, where the planner thinks it is, with its hand."""
    cloud = done.planned.cloud
    labels = done.planned.segmentation.labels
    palette = np.random.default_rng(3).uniform(0.35, 0.85, (labels.max() + 1, 3))
    palette[0] = 0.75
    chosen = done.planned.plan.object_label
    if chosen:
        palette[chosen] = (0.9, 0.25, 0.2)
    splats = Splats(cloud.points, palette[labels], np.full(len(cloud), 0.004))
    solids: tuple[Solid, ...] = ()
    if done.grasp is not None:
        hand = done.planned.grippers[done.grasp.gripper]
        solids = hand.solids(done.grasp.preshape, done.grasp.opening)
        solids = tuple(s.moved(done.grasp.T_base_hand) for s in solids)
    return render(
        view, [splats], [merged(solids, PLANNED)], background=BACKGROUND
    ).colors


def _floor(world: World) -> Splats:
    middle = np.mean([body.T_base_body.p[:2] for body in world.bodies], axis=0)
    line = np.arange(-1.2, 1.2, 0.05)
    xy = np.stack(np.meshgrid(line, line), -1).reshape(-1, 2) + middle
    points = np.column_stack([xy, world.ground.height(xy)])
    return Splats(points, np.full((len(xy), 3), 0.6), np.full(len(xy), 0.006))


def _caption(done: Trial) -> str:
    r = done.record
    if done.grasp is None:
        return f"{r.tier} {r.seed}: no grasp. {r.why_empty}"
    return (
        f"{r.tier} {r.seed}: {r.outcome}, {r.kind} {r.mass:.1f} kg, {r.prototype} "
        f"(score {r.score:.2f} Q {r.Q:.2f} S {r.S:.2f} C {r.C:.2f} expected "
        f"{r.expected:.2f} coverage {r.coverage:.2f})\n"
        f"rise {100 * r.rise:.0f} cm, turn "
        f"{np.degrees(r.turn):.0f} deg, slide {1e3 * r.slide:.0f} mm, short "
        f"{1e3 * r.short_of_goal:.0f} mm, shift {1e3 * r.shift_before:.0f} mm, lever "
        f"{r.lever:.2f} m, peak {r.peak_force:.0f} N {r.peak_torque:.1f} N m, deepest "
        f"{1e3 * r.deepest:.1f} mm, intended: {r.is_as_intended}, steep "
        f"{r.steepness:.2f}"
    )
