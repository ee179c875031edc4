r"""Draw the pictures of the documentation: `python docs/pictures.py`.

They change only when frames, robots or hands do, so they are kept beside the text.
`segmentation_time.png` is measured, and so it is drawn by a benchmark:

    python -m tests.benchmarks.segmentation --piles 1 \
        --plot docs/images/segmentation_time.png
"""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import matplotlib as mpl
import numpy as np

from debrisgrasp import Capture, Pipeline
from debrisgrasp.cli import main
from debrisgrasp.geometry import SE3
from debrisgrasp.io import data_path
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.prototypes import GripperModel, PrototypeLibrary
from debrisgrasp.viz.raster import Mesh, Splats, render
from debrisgrasp.viz.scene import hand_mesh, merged, robot_mesh
from debrisgrasp.viz.view import View

mpl.use("agg")

import matplotlib.pyplot as plt

DOCS = Path(__file__).parent
IMAGES = DOCS / "images"
AXES = {"x": "#d1242f", "y": "#1a7f37", "z": "#0969da"}
INK, MUTED, BACK = "#1f2328", "#59636e", np.array([0.965, 0.972, 0.98])
GREY, BLUE, ORANGE = (0.72, 0.74, 0.77), (0.45, 0.6, 0.85), np.array([0.95, 0.55, 0.15])
SCALE = 2  # pixels drawn for each pixel of the page


def canvas(width: int, height: int) -> tuple[plt.Figure, plt.Axes]:
    figure = plt.figure(figsize=(width / 100, height / 100), dpi=100 * SCALE)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    return figure, axes


def show(axes: plt.Axes, view: View, colors: np.ndarray) -> None:
    width, height = view.intrinsics.width, view.intrinsics.height
    axes.imshow(
        np.clip(colors, 0, 1), extent=(0, width, height, 0), interpolation="antialiased"
    )
    axes.set(xlim=(0, width), ylim=(height, 0))


def picture(view: View, splats: list[Splats], meshes: list[Mesh]) -> np.ndarray:
    """Render at twice the size, for smooth edges."""
    return render(view.scaled(SCALE), splats, meshes, background=BACK).colors


def arrow(axes: plt.Axes, view: View, start, end, color: str, text: str = "") -> None:
    (a, b), _ = view.project(np.array([start, end]))
    style = {"arrowstyle": "-|>,head_width=0.25,head_length=0.5", "lw": 2.2}
    axes.annotate("", b, a, arrowprops=style | {"color": color, "shrinkA": 0})
    if text:
        away = (b - a) / max(float(np.linalg.norm(b - a)), 1e-9)
        label(axes, b + 11 * away, text, color)


def label(axes: plt.Axes, at, text: str, color: str = INK, size: int = 11) -> None:
    box = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.75}
    axes.text(
        *at, text, color=color, size=size, weight="bold", ha="center", va="center",
        bbox=box,
    )  # fmt: skip


def frame(axes: plt.Axes, view: View, T: SE3, length: float, name: str, shift) -> None:
    """Draw the axes of a frame, and its name beside the origin."""
    for i, (axis, color) in enumerate(AXES.items()):
        arrow(axes, view, T.p, T.p + length * T.R[:, i], color, axis)
    (origin,), _ = view.project(T.p[None])
    label(axes, origin + shift, name)


def write(figure: plt.Figure, name: str) -> None:
    IMAGES.mkdir(exist_ok=True)
    path = IMAGES / name
    figure.savefig(path, pil_kwargs={"optimize": True, "quality": 85})
    plt.close(figure)
    print(f"{path.relative_to(DOCS)}: {path.stat().st_size // 1024} kB")


def robot_frames() -> None:
    robot = RobotModel.load("roman")
    moved = robot.posture("right", "ready") | robot.posture("left", "ready")
    poses = robot.link_poses(moved)
    mesh = merged([solid for _, solid in robot.links_solids(moved)], GREY)
    ground = np.array([[x, y, 0.0] for x in (-0.6, 0.9) for y in (-0.9, 0.9)])
    view = View.fitted(
        np.concatenate([mesh.vertices, ground]), [-1.0, 0.75, -0.5], (900, 560)
    )
    figure, axes = canvas(900, 560)
    floor = [lines(grid(ground, 0.3))]
    # Seen through, because the base frame is under the robot.
    through = 0.6 * picture(view, floor, [mesh]) + 0.4 * picture(view, floor, [])
    show(axes, view, through)
    frame(axes, view, SE3.identity(), 0.55, "base", np.array([-36, 10]))
    camera = poses["camera_depth_optical_frame"]
    frame(axes, view, camera, 0.28, "camera", np.array([46, -16]))
    for side in ("right", "left"):
        T = poses[f"{side}_hand"]
        frame(axes, view, T, 0.16, "hand", np.array([0, -40]))
    write(figure, "frames_robot.webp")


def grid(corners: np.ndarray, step: float) -> np.ndarray:
    """Points on the lines of a level grid."""
    (x0, y0, _), (x1, y1, _) = corners.min(axis=0), corners.max(axis=0)
    fine = 0.004
    along_x, along_y = np.arange(x0, x1, fine), np.arange(y0, y1, fine)
    parts = [
        *([np.column_stack([along_x, np.full_like(along_x, y), 0 * along_x])]
          for y in np.arange(y0, y1 + 1e-9, step)),
        *([np.column_stack([np.full_like(along_y, x), along_y, 0 * along_y])]
          for x in np.arange(x0, x1 + 1e-9, step)),
    ]  # fmt: skip
    return np.concatenate([part for (part,) in parts])


def lines(points: np.ndarray) -> Splats:
    colors = np.broadcast_to([0.82, 0.84, 0.87], points.shape)
    return Splats(points, colors, np.full(len(points), 0.005))


def hand_frames() -> None:
    hand = GripperModel.load("robotiq_3f")
    (prototype,) = PrototypeLibrary.load().select(names=["cylinder_060_tip"])
    solids = hand.solids(prototype.preshape, prototype.opening)
    down = np.diag([1.0, -1.0, -1.0])
    towards_us = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    figure, axes = canvas(900, 430)
    axes.remove()
    sides = {
        "the hand comes from above": (down, [0.1, 1.0, -0.1]),
        "into the palm": (towards_us, [0.1, 1.0, -0.1]),
    }
    for i, (title, (R, direction)) in enumerate(sides.items()):
        T = SE3.from_parts(R)
        mesh, points = merged(solids, BLUE).moved(T), T.apply(prototype.points)
        colors = np.broadcast_to(ORANGE, points.shape)
        sizes, normals = np.full(len(points), 0.012), T.rotate(prototype.normals)
        shape = Splats(points, colors, sizes, normals)
        axes = figure.add_axes((0.5 * i, 0.0, 0.5, 0.92))
        axes.set_axis_off()
        view = View.fitted(
            np.concatenate([mesh.vertices, points]),
            direction,
            (450, 396),
            field_of_view=0.3,
            margin=1.25,
        )
        show(axes, view, picture(view, [shape] if i == 0 else [], [mesh]))
        frame(axes, view, T, 0.09, "", np.zeros(2))
        for side, name in ((-1, "thumb"), (1, "pair")):
            where = hand.finger_solids(prototype.preshape, prototype.opening, side)
            tip = np.mean([s.bounds.upper + s.bounds.lower for s in where], axis=0) / 2
            (at,), _ = view.project(T.apply(tip)[None])
            label(axes, at, name, INK, 10)
        figure.text(0.5 * i + 0.03, 0.945, title, size=12, color=INK, weight="bold")
    write(figure, "frames_hand.webp")


def transforms() -> None:
    """Draw how T_base_hand is made of T_base_camera and T_camera_hand."""
    figure, axes = canvas(900, 250)
    axes.set(xlim=(0, 900), ylim=(250, 0))
    axes.add_patch(plt.Rectangle((0, 0), 900, 250, color=BACK))
    frames: Mapping[str, tuple[float, float, dict[str, tuple[float, float]]]] = {
        "base": (110, 180, {"x": (55, 0), "z": (0, -55)}),
        "camera": (330, 55, {"z": (48, 27), "y": (-27, 48)}),
        "hand": (740, 165, {"z": (-10, 54), "x": (54, 10)}),
    }
    for name, (x, y, directions) in frames.items():
        for axis, (dx, dy) in directions.items():
            style = {"arrowstyle": "-|>", "lw": 2.2, "color": AXES[axis], "shrinkA": 0}
            axes.annotate("", (x + dx, y + dy), (x, y), arrowprops=style)
            label(axes, (x + 1.22 * dx, y + 1.22 * dy), axis, AXES[axis], 10)
        label(axes, (x - 8, y + 22) if name == "base" else (x + 4, y - 20), name)
    for start, end, text, at, bend in (
        ("base", "camera", "T_base_camera", (205, 88), -0.15),
        ("camera", "hand", "T_camera_hand", (560, 72), -0.2),
        (
            "base",
            "hand",
            "T_base_hand = T_base_camera @ T_camera_hand",
            (430, 206),
            0.08,
        ),
    ):
        style = {
            "arrowstyle": "-|>",
            "lw": 1.6,
            "color": MUTED,
            "shrinkA": 12,
            "shrinkB": 12,
            "connectionstyle": f"arc3,rad={bend}",
            "linestyle": "--",
        }
        axes.annotate("", frames[end][:2], frames[start][:2], arrowprops=style)
        axes.text(*at, text, size=12, family="monospace", color=INK, ha="center",
                  bbox={"fc": BACK, "ec": "none", "pad": 2})  # fmt: skip
    write(figure, "transforms.webp")


def other_arms() -> None:
    examples = DOCS.parent / "examples"
    seen, figure = None, plt.figure(figsize=(9.6, 3.2), dpi=100 * SCALE)
    for i, name in enumerate(("panda", "ur10", "talos")):
        pipeline = Pipeline(
            robot=str(examples / f"robots/{name}.yaml"),
            grippers=examples / "grippers",
            prototypes=examples / "jaw_prototypes",
        )
        capture = Capture.load(data_path("captures", "pile.npz"))
        seen = seen or pipeline.perceive(capture)
        result = pipeline.plan(seen)
        best = result.plan.grasps[0]
        hand = hand_mesh(best, result.grippers, BLUE)
        robot = robot_mesh(result.robot, best)
        labels = result.segmentation.labels
        chosen = np.flatnonzero(labels > 0)[::7]
        points, normals = result.cloud.points[chosen], result.cloud.normals[chosen]
        colors = np.broadcast_to([0.72, 0.68, 0.6], points.shape).copy()
        colors[labels[chosen] == best.object_label] = ORANGE
        pile = Splats(points, colors, np.full(len(points), 0.014), normals)
        corners = np.concatenate([robot.vertices, points])
        view = View.fitted(corners, [-0.9, -1.0, -0.6], (320, 300))
        floor = np.array([[x, y, 0.0] for x in (0.0, 2.1) for y in (-1.2, 0.9)])
        axes = figure.add_axes((i / 3, 0.0, 1 / 3, 0.94))
        axes.set_axis_off()
        show(axes, view, picture(view, [pile, lines(grid(floor, 0.3))], [robot, hand]))
        title = f"{name}: {best.prototype}, Q {best.Q:.2f}"
        figure.text(i / 3 + 0.015, 0.955, title, size=10, color=INK, weight="bold")
    write(figure, "other_arms.webp")


def demo() -> None:
    """Shrink the report of `debrisgrasp demo`."""
    with tempfile.TemporaryDirectory() as folder:
        main(["demo", "--out-dir", folder])
        page = plt.imread(Path(folder) / "report.png")
    height, width = page.shape[:2]
    figure = plt.figure(figsize=(0.8 * width / 100, 0.8 * height / 100), dpi=100)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.imshow(page, interpolation="lanczos")
    write(figure, "demo.webp")


if __name__ == "__main__":
    demo()
    robot_frames()
    hand_frames()
    transforms()
    other_arms()
