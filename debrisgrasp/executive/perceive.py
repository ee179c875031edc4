"""From the camera to objects, believing nothing that was not seen."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp._words import arm_called
from debrisgrasp.errors import ConfigError, DebrisGraspError, DriverError
from debrisgrasp.geometry import SE3, DepthSight, Intrinsics
from debrisgrasp.io import Capture
from debrisgrasp.pipeline import mask_notes
from debrisgrasp.pipeline.self_filter import body_at, own_pixels
from debrisgrasp.robot import DepthFrame

from .context import Context
from .gaze import look_of, look_towards, turn_head
from .result import Done, FaultFound, StepResult

__all__ = [
    "capture",
    "image",
    "is_close",
    "segment",
    "sight_of",
]

logger = logging.getLogger(__name__)

_OLDEST = 0.2
"""An image may be so much older than the wish for it [s]."""
_CLOSE = 2.5
"""Ground that is nearer to the robot every camera measures [m]."""
_LEAST_SEEN = 0.02
"""Share of the image of the workspace with depth below which nothing was seen."""
_NOTHING_SEEN = ("empty_cloud", "depth_dropout")
"""Of faults of an image."""
_DROP_ROOM = 0.2
"""Around a drop-off nothing of the pile may lie [m]."""


def capture(context: Context) -> StepResult:
    """Take an image, and refuse what is old, empty or full of holes."""
    look, gaze, head = context.n_looks + 1, context.cycle.gaze, None
    if gaze is None:
        context.shown.clear()
    else:
        head = look_towards(context, context.T_base_way.apply(gaze))
    name = f"capture_{look:03d}"
    taken = image(context, name, head)
    fault = taken.fault if isinstance(taken, FaultFound) else ""
    if head is not None and fault in _NOTHING_SEEN:
        # The robot itself may stand too near before the camera: a look in vain.
        taken = image(context, name)
    if isinstance(taken, FaultFound):
        return taken
    is_own = _own(context, taken)
    if isinstance(is_own, FaultFound):
        return is_own
    taken = replace(taken, depth=np.where(is_own, np.nan, np.asarray(taken.depth)))
    context.shown.append(sight_of(taken))
    taken = _marked(context, taken)
    context.cycle.capture, context.n_looks = taken, look
    context.record.keep(taken, taken.name)
    share = float(np.mean(np.isfinite(np.asarray(taken.depth))))
    facts: dict[str, object] = {"look": look, "measured_share": round(share, 4)}
    n_own = int(np.count_nonzero(is_own))
    return Done({**facts, "removed_points": {"robot": n_own}} if n_own else facts)


def _own(context: Context, taken: Capture) -> BoolArray | FaultFound:
    """Pixels that show the robot itself, shape (h, w), unless they hide too much.

    Of a look at what no other picture showed they may hide all: that counts as missing.
    """
    assert taken.intrinsics is not None
    assert taken.T_base_camera is not None
    camera, T_base_camera = taken.intrinsics, taken.T_base_camera
    body = body_at(context.model, context.joint_values())
    is_own = own_pixels(np.asarray(taken.depth), camera, T_base_camera, body)
    if not is_own.any() or context.cycle.gaze is not None:
        return is_own
    inside = _on_ground(camera, T_base_camera, context.is_in_way)
    hidden = float(is_own[inside].mean())
    if hidden > context.settings.max_dropout:
        words = f"the robot itself hides {100 * hidden:.0f} % of the workspace; its "
        words += "arms must rest (`idle`) where the camera doesn't see them"
        return FaultFound("depth_dropout", words, None, {"hidden_share": hidden})
    return is_own


def sight_of(taken: Capture) -> DepthSight:
    """Lines of sight of an image."""
    assert taken.intrinsics is not None
    assert taken.T_base_camera is not None
    depth = np.asarray(taken.depth, dtype=np.float32)
    return DepthSight(depth, taken.intrinsics, taken.T_base_camera)


def is_close(points: FloatArray) -> BoolArray:
    """Whether points (n, 3) of the ground are where every camera measures."""
    return np.asarray(np.hypot(points[:, 0], points[:, 1]) < _CLOSE)


def image(
    context: Context,
    name: str,
    look: Mapping[str, float] | None = None,
    *,
    is_wanted: Callable[[FloatArray], BoolArray] | None = None,
) -> Capture | FaultFound:
    """Look at the workspace: an image that can be believed, or why it can't.

    Parameters
    ----------
    look
        Joints of the head; None: as for every capture.
    is_wanted
        Which points (n, 3) of the ground the image must show, base frame; None: those
        of the workspace.
    """
    turned = turn_head(context, look_of(context) if look is None else look)
    if turned is not None:
        return turned
    wanted = context.now()
    frame = context.frame()
    T_base_camera = context.model.T_base_camera(context.joint_values())
    is_wanted = is_wanted or context.is_in_way
    wrong = _wrong_image(context, frame, wanted, T_base_camera, is_wanted)
    if wrong is not None:
        return wrong
    try:
        taken = Capture(
            depth=frame.depth,
            intrinsics=frame.intrinsics,
            T_base_camera=T_base_camera,
            rgb=None if frame.rgb is None else np.asarray(frame.rgb, dtype=np.uint8),
            name=name,
        )
    except DriverError:
        raise
    except DebrisGraspError as error:
        return FaultFound("stale_cloud", f"the image can't be used: {error}")
    return taken


def _wrong_image(
    context: Context,
    frame: DepthFrame,
    wanted: float,
    T_base_camera: SE3,
    is_wanted: Callable[[FloatArray], BoolArray],
) -> FaultFound | None:
    """Say why an image can't be believed."""
    known = ("camera", context.model.camera)
    if frame.frame not in known:
        words = f"frame {frame.frame!r}, expected {context.model.camera!r}"
        return FaultFound("stale_cloud", words)
    age = wanted - frame.time
    if not abs(age) <= _OLDEST:
        words = f"the image is {age:.2f} s older than asked for"
        return FaultFound("stale_cloud", words, None, {"age": age})
    depth = np.asarray(frame.depth)
    camera = frame.intrinsics
    if depth.shape != (camera.height, camera.width):
        words = f"{depth.shape} pixels, expected {(camera.height, camera.width)}"
        return FaultFound("stale_cloud", words)
    is_measured = np.isfinite(depth) & (depth > 0.0)
    inside = _on_ground(camera, T_base_camera, is_wanted)
    share = float(is_measured[inside].mean()) if inside.any() else 0.0
    values = {"measured_share": share}
    if not inside.any():
        at, ahead = (
            ", ".join(f"{value:.2f}" for value in vector + 0.0)
            for vector in (T_base_camera.p, T_base_camera.matrix[:3, 2])
        )
        words = "nothing of the workspace is in the picture: by the robot's file the "
        words += f"camera stands at ({at}) m and looks along ({ahead})"
        return FaultFound("empty_cloud", words, None, values)
    if share < _LEAST_SEEN:
        words = f"{100 * share:.1f} % of the workspace was measured"
        return FaultFound("empty_cloud", words, None, values)
    if share < 1.0 - context.settings.max_dropout:
        words = f"{100 * share:.0f} % of the workspace was measured, expected "
        words += f"{100 * (1.0 - context.settings.max_dropout):.0f} % or more "
        words += "(max_dropout)"
        return FaultFound("depth_dropout", words, None, values)
    return None


def _on_ground(
    camera: Intrinsics,
    T_base_camera: SE3,
    is_wanted: Callable[[FloatArray], BoolArray],
) -> BoolArray:
    """Pixels that look at the ground that is wanted, shape (h, w)."""
    rays = camera.deproject(np.ones((camera.height, camera.width)))
    rays = T_base_camera.rotate(rays.reshape(-1, 3))
    eye = T_base_camera.p
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(rays[:, 2] < -1e-6, -eye[2] / rays[:, 2], np.inf)
        ground = (
            eye[:2] + np.where(np.isfinite(reach), reach, 0.0)[:, None] * (rays[:, :2])
        )
    inside = np.isfinite(reach)
    on_ground = np.column_stack([ground[inside], np.zeros(np.count_nonzero(inside))])
    inside[inside] = is_wanted(on_ground)
    found: BoolArray = inside.reshape(camera.height, camera.width)
    return found


def _marked(context: Context, taken: Capture) -> Capture:
    """Add the mask of an object of interest, if one is sought."""
    settings = context.settings
    assert taken.T_base_camera is not None
    # Like the workspace, what is marked stays where it was when the task began.
    T_way_camera = context.T_base_way.inverse() @ taken.T_base_camera
    if settings.mark is not None:
        mask = settings.mark(taken.posed(T_way_camera))
        if mask is None:
            return taken
        if np.asarray(mask).dtype.kind not in "biu":
            raise ConfigError(
                "mark of the task",
                got=f"a mask of type {np.asarray(mask).dtype}",
                expected="one of bool, or of whole numbers",
            )
        return replace(taken, mask=np.asarray(mask, bool))
    if settings.region is None or taken.depth is None or taken.intrinsics is None:
        return taken
    points = taken.intrinsics.deproject(np.nan_to_num(taken.depth))
    places = T_way_camera.apply(points.reshape(-1, 3)).reshape(points.shape)
    inside = settings.region.contains(places) & np.isfinite(taken.depth)
    return replace(taken, mask=inside)


def segment(context: Context) -> StepResult:
    """Divide what was seen into objects; see that the ground and the drop-off are."""
    taken = context.cycle.capture
    assert taken is not None
    seen = context.pipeline.perceive(taken)
    notes: tuple[str, ...] = ()
    if context.settings.mark is not None and context.last_seen is None:
        notes = mask_notes(seen.is_marked, seen.segmentation)
    context.cycle.seen = context.last_seen = seen
    context.memory.refresh()
    ground = seen.segmentation.ground
    if ground.pose_doubt:
        return FaultFound("calibration_off", ground.pose_doubt)
    taken_place = _drop_off_in_pile(context)
    if taken_place is not None:
        return taken_place
    facts: dict[str, object] = {
        "objects": len(seen.segmentation.segments),
        "ground": ground.status,
        "centroids": [
            np.round(s.centroid, 3).tolist() for s in seen.segmentation.segments
        ],
    }
    if notes:
        facts["notes"] = list(notes)
    if ground.status == "skipped" and not _is_bare(context):
        return FaultFound("plane_eats_pile", ground.reason)
    for note in notes:
        logger.warning("%s", note)
    return Done(facts)


def _is_bare(context: Context) -> bool:
    """Whether the ground was left in the cloud because there is nothing else."""
    seen = context.cycle.seen
    assert seen is not None
    ground = seen.segmentation.ground
    config = context.pipeline.config.segmentation.ground
    return (
        ground.plane is not None
        and ground.inlier_share > 0.8
        and ground.tilt <= config.max_tilt
        and abs(ground.height) <= config.max_height
    )


def _drop_off_in_pile(context: Context) -> FaultFound | None:
    """Say that the pile reaches where things are to be put down."""
    seen = context.cycle.seen
    assert seen is not None
    if context.n_changes:
        return None  # what lies there now was put or pushed there, or driven to
    ground = seen.segmentation.ground
    points = seen.cloud.points[seen.segmentation.labels > 0]
    if ground.plane is not None and _is_bare(context):
        high = np.abs(points @ ground.plane[:3] + ground.plane[3])
        points = points[high > context.pipeline.config.segmentation.ground.clearance]
    for arm in context.limbs:
        place = np.array(context.settings.drop_off[arm])
        away = np.linalg.norm(points[:, :2] - place, axis=1)
        n = int(np.count_nonzero(away < _DROP_ROOM))
        if n > 50:
            words = f"the drop-off of the {arm_called(arm)} at ({place[0]:g}, "
            words += f"{place[1]:g}) lies in the pile: {n} points within "
            words += f"{_DROP_ROOM:g} m of it. Give a place beside the pile."
            return FaultFound("plan_collision", words, arm)
    return None
