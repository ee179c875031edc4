"""See that the camera is where it is said to be, by a look at the robot's own hand."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from debrisgrasp._arrays import FloatArray
from debrisgrasp._words import arm_called
from debrisgrasp.calibration import DriftMonitor, DriftReport, Head, Observations
from debrisgrasp.errors import CaptureError, InputError
from debrisgrasp.geometry import SE3, Solid, sight_points
from debrisgrasp.io import Capture
from debrisgrasp.kinematics import KinematicChain, Trajectory
from debrisgrasp.motion import MotionSpace, UnknownSpace
from debrisgrasp.pipeline.self_filter import body_at, own_pixels
from debrisgrasp.robot import DepthFrame

from .context import Context
from .drive import Drive
from .gaze import look_of, turn_head
from .limb_state import LimbState
from .moves import planned, reversed_motion
from .obstacles import BARE
from .perceive import sight_of
from .result import Done, FaultFound, StepResult
from .seen_hand import LEAST, NEARER, REACH, end_of_arm, links_of_end, seen_shift

__all__ = ["calib_check", "is_held_where_it_rests"]

logger = logging.getLogger(__name__)

_ASIDE = 0.12
"""How far the head turns between the two looks [rad]."""
_TURNED = 0.03
"""A head that is farther than this from where it was sent does not turn [rad]."""
_ALONE = 2
"""Pixels that show about the same side by side: no more are flying ones."""
_LEAST_SHARE = 0.25
"""Of the corners of what is compared that lie in the picture. Of less, mostly fingers
are seen, which look like a hand that is elsewhere."""
_NOISE = 0.003
"""Of one look at the hand, in each coordinate [m]."""
_SIGMAS = 8.0
"""Mount and joints of the head are each known to this part of the shift allowed: what
they do to the hand together is then an alarm from about that shift on."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _AsBuilt:
    """The camera as the robot's file has it, for `DriftMonitor`."""

    head: Head
    fit_covariance: FloatArray
    fiducial: FloatArray
    link: None = None

    @classmethod
    def of(cls, context: Context) -> _AsBuilt:
        """Take it that a shift of the hand as large as allowed is an alarm."""
        model, names, values = context.model, _turning(context), context.joint_values()
        camera = model.camera or model.base
        if names:
            known = {**model.rest, **values}
            held = {name: known[name] for name in known.keys() - names}
            chain = KinematicChain.from_tree(model.tree, model.base, camera, held)
            head = Head(
                T_base_camera_at_zero=chain.T_base_tip_at_zero,
                axes=chain.axes,
                points=chain.points,
                joint_names=chain.joint_names,
            )
        else:
            head = Head.fixed(model.T_base_camera(values))
        sigma = context.settings.camera_shift / _SIGMAS
        # The hand is where its joints say.
        variances = np.append(np.full(6 + head.n_joints, sigma * sigma), np.zeros(3))
        covariance = np.diag(variances)
        return cls(head=head, fit_covariance=covariance, fiducial=np.zeros(3))


@dataclass(frozen=True, slots=True, eq=False)
class _Look:
    """An image before the hand is held into it."""

    taken: DepthFrame
    depth: FloatArray
    """The same [m], infinite where it shows the robot itself, shape (h, w)."""


def calib_check(context: Context) -> StepResult:
    """Hold a hand before the camera, and compare where it is seen with where it is.

    It is seen from two attitudes of the head, and the looks of all checks of a run are
    judged together. Without a free way for the hand, or where it is hardly in the
    picture, this is left out, and said so; the ground, which every capture is held
    against, still tells a camera that tilted or sank.
    """
    limb = next(iter(context.limbs.values()))
    empty = _looked(context)
    if isinstance(empty, FaultFound):
        return empty
    motion = _way_into_view(context, limb, empty[-1].taken)
    if isinstance(motion, FaultFound):
        return _left_out(motion.message)
    drive = Drive(context, limb.name)
    fault = drive.follow(motion)
    if fault is not None:
        return fault
    report = _compared(context, limb, empty)
    back = drive.follow(reversed_motion(motion))
    if back is not None:
        return back
    limb.limb.arm.disengage()
    if isinstance(report, FaultFound):
        return report
    if report is None:
        return _left_out("hardly any of it is to be seen in the picture")
    size = float(np.linalg.norm(report.shift))
    facts = {
        "hand_seen": True,
        "shift_mm": np.round(1e3 * report.shift, 1).tolist(),
        "camera": report.status.value,
    }
    if report.blocks_grasps or size > context.settings.camera_shift:
        words = f"the hand is seen {1e3 * size:.0f} mm from where it is, expected at "
        words += f"most {1e3 * context.settings.camera_shift:.0f}: calibrate first"
        words += f" ({report})"
        return FaultFound("calibration_off", words, limb.name, {"shift": size})
    return Done(facts)


def _left_out(why: str) -> Done:
    """Go on without the check, and say so: a camera that is off is not found."""
    logger.warning("no hand was held before the camera to check it: %s", why)
    return Done({"hand_seen": False, "why": why})


def _turning(context: Context) -> tuple[str, ...]:
    """Joints of the head that turn; those that slide keep their places in a check."""
    head, joints = context.robot.head, context.model.tree.joints
    names = () if head is None else head.joint_names
    return tuple(name for name in names if joints[name].kind != "prismatic")


def _looks(context: Context) -> list[Mapping[str, float]]:
    """Attitudes of the head: aside, and as for captures."""
    look, turning = look_of(context), _turning(context)
    aside = {name: look.get(name, 0.0) - _ASIDE for name in turning}
    return [{**look, **aside}, look] if turning else [look]


def _looked(context: Context) -> list[_Look] | FaultFound:
    """Take an image from each attitude; looks that are all alike tell nothing."""
    looks = []
    for target in _looks(context):
        fault = _turned(context, target)
        if fault is not None:
            return fault
        frame, values = context.frame(), context.joint_values()
        T, body = context.model.T_base_camera(values), _body(context, values, REACH)
        depth = np.nan_to_num(frame.depth)
        is_own = own_pixels(depth, frame.intrinsics, T, body)
        looks.append(_Look(frame, np.where(is_own, np.inf, depth)))
    return looks


def _body(
    context: Context, values: Mapping[str, float], beside: float
) -> list[tuple[Solid, float]]:
    """Solids of the robot, and how far what is it may be seen from each, at least."""
    body = body_at(context.model, values)
    return [(solid, max(near, beside)) for solid, near in body]


def _turned(context: Context, target: Mapping[str, float]) -> FaultFound | None:
    fault, head = turn_head(context, target), context.robot.head
    if fault is not None or head is None:
        return fault
    wanted = np.array([target.get(name, 0.0) for name in head.joint_names])
    away = float(np.abs(np.asarray(head.read().q) - wanted).max())
    if away <= _TURNED:
        return None
    words = f"the head is {away:.2f} rad from where it was sent: all looks are alike"
    return FaultFound("calibration_poses", words)


def _compared(
    context: Context, limb: LimbState, empty: Sequence[_Look]
) -> DriftReport | FaultFound | None:
    """Judge where the hand is seen, by all looks of the run; None: it can't be."""
    monitor = context.camera_watch or DriftMonitor(calibration=_AsBuilt.of(context))
    joints = monitor.calibration.head.joint_names
    hand = limb.pose(context.posture(limb)).p
    seen, readings, is_lost = [], [], False
    for target, before in zip(_looks(context), empty, strict=True):
        fault = _turned(context, target)
        if fault is not None:
            return fault
        if not _is_in_picture(context, limb, before.taken):
            continue
        found = seen_shift(context, limb, before.depth)
        is_lost = found is None  # as captures are taken, if it can be seen then
        if found is not None:
            values = context.joint_values()
            T_base_camera = context.model.T_base_camera(values)
            seen.append(T_base_camera.inverse().apply(hand + found))
            readings.append([values.get(name, 0.0) for name in joints])
    if is_lost:
        words = f"the hand of the {arm_called(limb.name)} is not seen where it must be"
        return FaultFound("fiducial_lost", words, limb.name)
    if not seen:
        return None
    looks = Observations(
        points_base=np.tile(hand, (len(seen), 1)),
        points_camera=np.array(seen),
        sigmas=_NOISE,
        head=np.array(readings),
    )
    context.camera_watch, report = monitor.seen(looks)
    return report


def _way_into_view(
    context: Context, limb: LimbState, frame: DepthFrame
) -> Trajectory | FaultFound:
    """Plan to the posture before the pile, around what the image shows.

    The robot itself is left out. A camera that is off shows it beside where it is: what
    lies as near as that to where it stands is left out where no way is found else.
    """
    name = context.model.arm(limb.name).present
    q = limb.reach.chain.vector(context.model.posture(limb.name, name))
    if is_held_where_it_rests(limb.pose(q), limb.pose(context.posture(limb))):
        words = f"the {arm_called(limb.name)} rests where it would be held before the "
        words += f"camera ({name!r}): `present` must lead its hand into view, `idle` "
        return FaultFound("plan_collision", words + "out of it", limb.name)
    values = context.joint_values()
    T_base_camera = context.model.T_base_camera(values)
    held = values | dict(zip(limb.reach.chain.joint_names, q.tolist(), strict=True))
    turned = (T_base_camera.inverse() @ context.model.T_base_camera(held)).log()
    if np.abs(turned).max() > _TURNED:
        words = f"the way to where it would be held ({name!r}) turns the camera"
        return FaultFound("plan_collision", words, limb.name)
    try:
        taken = Capture(
            depth=frame.depth, intrinsics=frame.intrinsics, T_base_camera=T_base_camera
        )
    except (CaptureError, InputError) as error:  # the next capture tells
        return FaultFound("plan_collision", f"nothing was seen: {error}", limb.name)
    fault = FaultFound("plan_collision", "nothing was seen around it", limb.name)
    for beside in (0.0, REACH):
        around = _without(taken, _body(context, values, beside))
        cloud = around.cloud()
        if len(cloud) < LEAST:
            break
        for unknown in (UnknownSpace.HIDDEN, UnknownSpace.IGNORED):
            space = MotionSpace.build(cloud, sight_of(around), BARE, unknown=unknown)
            found = planned(context, limb, q, space)
            if not isinstance(found, FaultFound):
                assert found.trajectory is not None
                return found.trajectory
            fault = found
    return fault


def is_held_where_it_rests(T_base_shown: SE3, T_base_resting: SE3) -> bool:
    """Whether a hand is too near to where it rests to be told from it in a picture."""
    return bool(np.linalg.norm(T_base_shown.p - T_base_resting.p) < REACH)


def _without(taken: Capture, body: Sequence[tuple[Solid, float]]) -> Capture:
    """Leave out of an image what is as near to solids as is given with each [m].

    So are flying pixels, which hang beside the edges of what is left out.
    """
    assert taken.intrinsics is not None
    assert taken.T_base_camera is not None
    depth = np.asarray(taken.depth)
    is_own = own_pixels(depth, taken.intrinsics, taken.T_base_camera, body)
    depth = np.where(is_own, np.nan, depth)
    around = sliding_window_view(np.pad(depth, 1, constant_values=np.nan), (3, 3))
    is_like = np.abs(around - depth[..., None, None]) < NEARER  # itself, too
    is_flying = np.count_nonzero(is_like, axis=(-2, -1)) <= _ALONE
    return replace(taken, depth=np.where(is_flying, np.nan, depth))


def _is_in_picture(context: Context, limb: LimbState, frame: DepthFrame) -> bool:
    """Tell whether enough of the hand is what the camera sees, if it is all right."""
    values = context.joint_values()
    corners = np.concatenate(
        [solid.mesh()[0] for solid in end_of_arm(context, limb, values)]
    )
    camera, T_base_camera = frame.intrinsics, context.model.T_base_camera(values)
    uv, _ = camera.project(T_base_camera.inverse().apply(corners))
    # Behind the camera they are NaN, which is in no picture.
    is_in = ((uv >= 0.0) & (uv <= (camera.width - 1, camera.height - 1))).all(axis=1)
    rays = sight_points(T_base_camera.p, corners[is_in])
    is_hidden, end = np.zeros(len(rays), dtype=bool), links_of_end(context, limb)
    for link, solid in context.model.links_solids(values):
        if link not in end:
            is_hidden |= solid.contains(rays).any(axis=1)
    return bool(np.count_nonzero(~is_hidden) >= _LEAST_SHARE * len(corners))
