"""What the page for the browser is given, as plain JSON.

Coordinates are sent as 16-bit steps of their bounding box, in base64: a pile a few
metres wide keeps a tenth of a millimetre, at a tenth of the size of written numbers.
"""

from __future__ import annotations

import base64
import io
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from debrisgrasp._arrays import FloatArray, IntArray, rounded
from debrisgrasp.planning import Grasp

from .colors import (
    CHOSEN_COLOR,
    GROUND_COLOR,
    HAND_COLORS,
    ROBOT_COLOR,
    hex_color,
    label_colors,
    mixed,
)
from .outline import reach_outline, sampled_reach
from .overlay import LabelImage, label_anchors, label_image, painted
from .raster import Mesh
from .report import Report
from .scene import (
    approach_arrow,
    box_edges,
    ground_grid,
    merged,
    point_spacing,
    thinned,
)
from .words import (
    doubt_line,
    headline,
    load_rows,
    object_reason,
    rejection_rows,
    remarks,
    summary,
)

__all__ = ["packed_bytes", "packed_points", "payload"]

_POINT_LIMIT = 90_000
_GROUND, _OBSTACLE, _CHOSEN = 0, 1, 2
_rounded = partial(rounded, digits=6)


def payload(report: Report) -> dict[str, Any]:
    """Everything the page shows, ready for `json.dumps`."""
    plan = report.plan
    image = label_image(report.cloud, report.labels, report.capture)
    return {
        "title": report.title,
        "summary": summary(report),
        "doubt": doubt_line(report.segmentation),
        "headline": headline(report),
        "reason": object_reason(report),
        "passedOver": remarks(report),
        "rejections": [list(row) for row in rejection_rows(plan)],
        "advice": [advice.text for advice in plan.advice],
        "order": [[item.label, item.reason] for item in report.order],
        "chosen": plan.object_label,
        "grasps": [_grasp(grasp, rank) for rank, grasp in enumerate(plan.grasps)],
        "hands": _hands(report),
        "robot": _robot(report),
        "cloud": _cloud(report, image),
        "lines": _lines(report),
        "image": _image(image, report),
        "viewpoint": _rounded(report.cloud.viewpoint),
    }


def _grasp(grasp: Grasp, rank: int) -> dict[str, Any]:
    arrow = approach_arrow(grasp, HAND_COLORS[0])
    joints = grasp.joints or {}
    return {
        "rank": rank + 1,
        "prototype": grasp.prototype,
        "gripper": grasp.gripper,
        "preshape": grasp.preshape,
        "arm": grasp.arm,
        "S": round(grasp.S, 4),
        "C": round(grasp.C, 4),
        "R": round(grasp.R, 4),
        "Q": round(grasp.Q, 4),
        "score": round(grasp.score, 4),
        "opening": round(grasp.opening, 5),
        "width": round(grasp.width, 5),
        "approach": round(grasp.approach_distance, 4),
        "pose": _rounded(grasp.T_base_hand.matrix),
        "joints": [[name, round(value, 5)] for name, value in joints.items()],
        "hand": _hand_key(grasp),
        "arrow": _mesh(arrow),
        "load": [list(row) for row in load_rows(grasp)],
    }


def _hand_key(grasp: Grasp) -> str:
    return f"{grasp.gripper}/{grasp.preshape}/{1000 * grasp.opening:.2f}"


def _hands(report: Report) -> dict[str, Any]:
    """Meshes in the hand frame; grasps of the same opening share one."""
    hands = {}
    for grasp in report.plan.grasps:
        gripper = report.grippers.get(grasp.gripper)
        if gripper is None or _hand_key(grasp) in hands:
            continue
        solids = gripper.solids(grasp.preshape, grasp.opening)
        hands[_hand_key(grasp)] = _mesh(merged(solids, HAND_COLORS[0]))
    return hands


def _robot(report: Report) -> dict[str, Any] | None:
    """Robot as rigid parts, and where the parts are in each posture.

    The first posture is rest, the others are those of the grasps in their order. Parts
    of the hand that grips have a pose of zeros there, which makes them vanish.
    """
    robot = report.robot
    if robot is None:
        return None
    rest = robot.link_poses()
    solids = robot.links_solids()
    links = sorted({link for link, _ in solids})
    owners: list[IntArray] = []
    parts: list[FloatArray] = []
    faces: list[IntArray] = []
    n_vertices = 0
    for link, solid in solids:
        vertices, triangles = solid.mesh()
        parts.append(rest[link].inverse().apply(vertices))
        faces.append(np.asarray(triangles) + n_vertices)
        owners.append(np.full(len(vertices), links.index(link)))
        n_vertices += len(vertices)
    postures = [[rest[link].matrix for link in links]]
    for grasp in report.plan.grasps:
        poses, hidden = rest, frozenset[str]()
        if grasp.joints is not None and grasp.arm is not None:
            poses = robot.link_poses(grasp.joints)
            hidden = robot.tree.links_below(robot.arm(grasp.arm).hand)
        blank = np.zeros((4, 4))
        postures.append([blank if k in hidden else poses[k].matrix for k in links])
    mesh = Mesh(np.concatenate(parts), np.concatenate(faces), ROBOT_COLOR)
    return {
        **_mesh(mesh),
        "owners": packed_bytes(np.concatenate(owners).astype("<u2")),
        "nLinks": len(links),
        "postures": packed_bytes(np.array(postures)[:, :, :3].astype("<f4")),
        "color": hex_color(ROBOT_COLOR),
    }


def _cloud(report: Report, image: LabelImage) -> dict[str, Any]:
    """Points with two sets of colours: by segment, and as the camera saw them."""
    chosen = report.plan.object_label
    labels = report.labels
    keep = np.flatnonzero((labels > 0) & (labels == chosen))
    index = thinned(report.cloud, _POINT_LIMIT, keep)
    points, labels = report.cloud.points[index], labels[index]
    shade = _baked_light(report.cloud.normals[index])
    kinds = np.where(labels > 0, _OBSTACLE, _GROUND)
    kinds[(labels > 0) & (labels == chosen)] = _CHOSEN
    by_label = mixed(label_colors(labels, chosen), GROUND_COLOR, 0.15) * shade[:, None]
    by_label[kinds == _CHOSEN] = CHOSEN_COLOR * shade[kinds == _CHOSEN, None]
    if report.cloud.pixels is not None and image.from_camera:
        seen = image.base.reshape(-1, 3)[report.cloud.pixels[index]]
    else:
        seen = np.full((len(points), 3), 0.75) * shade[:, None]
    spacing = point_spacing(points)
    size_step = max(float(spacing.max(initial=0.0)), 1e-6) / 255.0
    return {
        **packed_points(points),
        "colors": packed_bytes(_bytes(by_label)),
        "seen": packed_bytes(_bytes(seen)),
        "kinds": packed_bytes(kinds.astype(np.uint8)),
        "sizes": packed_bytes(np.rint(spacing / size_step).astype(np.uint8)),
        "sizeStep": round(size_step, 9),
    }


def _baked_light(normals: FloatArray) -> FloatArray:
    """Brightness under a fixed sky and lamp, so that the page need not know normals."""
    lamp = np.array([-0.35, 0.45, 0.82])
    lit = np.maximum(np.nan_to_num(normals) @ (lamp / np.linalg.norm(lamp)), 0.0)
    shade = 0.5 + 0.14 * (1.0 + np.nan_to_num(normals[:, 2])) + 0.3 * lit
    return np.where(np.isfinite(normals).all(axis=1), np.minimum(shade, 1.0), 0.85)


def _lines(report: Report) -> dict[str, Any]:
    """Straight lines as pairs of ends: region V, grid on the ground, reach of arms."""
    plan, points = report.plan, report.cloud.points
    region = np.zeros((0, 2, 3)) if plan.region is None else box_edges(plan.region)
    focus = points[report.labels > 0] if np.any(report.labels > 0) else points
    grid = np.zeros((0, 2, 3))
    if len(focus):
        grid = ground_grid(np.percentile(focus, [1, 99], axis=0), 0.1)
    reach = {}
    for grasp in plan.grasps:
        if report.robot is None or grasp.arm is None or grasp.arm in reach:
            continue
        height = float(grasp.T_base_hand.p[2])
        outline = reach_outline(sampled_reach(report.robot, grasp.arm), height)
        pairs = [np.stack([line[:-1], line[1:]], axis=1) for line in outline]
        reach[grasp.arm] = packed_points(np.concatenate([np.zeros((0, 2, 3)), *pairs]))
    return {
        "region": packed_points(region),
        "grid": packed_points(grid),
        "reach": reach,
    }


def _image(image: LabelImage, report: Report) -> dict[str, Any]:
    chosen = report.plan.object_label
    height, width = image.labels.shape
    place = {item.label: number for number, item in enumerate(report.order, start=1)}
    anchors = label_anchors(image.labels)
    stream = io.BytesIO()
    picture = Image.fromarray(_bytes(painted(image, chosen)))
    picture.save(stream, format="JPEG", quality=90, subsampling=0)
    return {
        "jpeg": base64.b64encode(stream.getvalue()).decode(),
        "width": width,
        "height": height,
        "fromCamera": image.from_camera,
        "labels": [
            [label, place.get(label, 0), round(u / width, 4), round(v / height, 4)]
            for label, (u, v) in anchors.items()
        ],
    }


def _mesh(mesh: Mesh) -> dict[str, Any]:
    return {
        **packed_points(mesh.vertices),
        "faces": packed_bytes(mesh.faces.astype("<u4")),
    }


def packed_points(points: FloatArray) -> dict[str, Any]:
    """Points (..., 3) as ``low + step * integer``."""
    flat = points.reshape(-1, 3)
    low = flat.min(axis=0) if len(flat) else np.zeros(3)
    step = max(float((flat - low).max(initial=0.0)), 1e-6) / 65535.0
    steps = np.rint((flat - low) / step).astype("<u2")
    return {
        "low": _rounded(low),
        "step": float(f"{step:.9g}"),
        "at": packed_bytes(steps),
    }


def packed_bytes(array: NDArray[Any]) -> str:
    """Bytes of an array in base64."""
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()


def _bytes(colors: FloatArray) -> NDArray[np.uint8]:
    return np.rint(np.clip(colors, 0.0, 1.0) * 255.0).astype(np.uint8)
