"""Prototypes from a capture: a piece of what the camera saw, and a hand pose on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from debrisgrasp._arrays import BoolArray
from debrisgrasp._checked import checked
from debrisgrasp._joints import require_joints
from debrisgrasp._words import arm_called
from debrisgrasp.errors import CaptureError, ConfigError, InputError, UnknownNameError
from debrisgrasp.geometry import SE3, Bounds, PointCloud, fibonacci_sphere
from debrisgrasp.io import Capture, measured, point_colors
from debrisgrasp.io.camera_pose import parse_pose
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.prototypes import (
    GraspPrototype,
    GripperModel,
    HandPose,
    PrototypeDefinition,
    SurfaceShape,
    around_grip,
    check,
    propose_hand_poses,
    settled,
)
from debrisgrasp.segmentation import segment_cloud

__all__ = ["Recording", "parse_hand_pose", "record", "taught_by_joints"]

_NEIGHBORS, _CLOSE = 8, 0.018
"""A point of a surface has so many others, itself included, so near [m]."""
_FEWEST = 60
"""Measured points with normals that a piece needs."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Recording:
    """A prototype that was recorded, and where the hand was."""

    definition: PrototypeDefinition
    T_base_hand: SE3
    """The taught or chosen pose of the palm, base frame."""
    n_points: int
    """Measured points of the piece that was cut out of the capture."""
    proposals: tuple[HandPose, ...] = ()
    """The poses that were proposed, best first; empty if one was taught."""
    findings: tuple[str, ...] = ()
    """What `check` says against the prototype."""

    def __repr__(self) -> str:
        made, fits = self.definition, "; ".join(self.findings) or "fits"
        hand = f"{made.gripper}, preshape {made.preshape}"
        return f"<Recording {made.name} for {hand}: {self.n_points} points, {fits}>"


@checked
def record(
    capture: Capture,
    name: str,
    gripper: GripperModel,
    *,
    object_label: int | None = None,
    region: Bounds | None = None,
    T_base_hand: SE3 | None = None,
    preshape: str | None = None,
    width: float | None = None,
    choice: int = 1,
    kind: str = "generic",
    tags: tuple[str, ...] = (),
    description: str = "",
) -> Recording:
    """Make a prototype from a piece of a capture.

    The piece is an object of the segmentation, a box, or what the mask of the capture
    marks; label and box together are their intersection. Its points around the grip
    become the shape of the prototype.

    Parameters
    ----------
    object_label
        Label of the object in the segmentation (``debrisgrasp segment``).
    region
        Box in the base frame [m].
    T_base_hand
        Pose of the palm where the fingers close. Without it poses are proposed along
        the principal axes, from the side of the camera, ranked by clearance.
    preshape
        Of the fingers; by default the best of those that fit.
    width
        Distance between the pads when closed [m]; by default where they touch.
    choice
        Which proposal to take, 1 for the best.

    Raises
    ------
    CaptureError
        If the capture has no pose, or the piece has too few points.
    UnknownNameError
        If there is no such object or preshape.
    ConfigError
        If nothing says which piece to take.
    InputError
        If the taught pose has nothing of it between the fingers, or no proposal fits.
    """
    cloud = capture.cloud()
    inside = _piece(capture, cloud, object_label, region)
    surface = _surface(cloud, inside)
    proposals: tuple[HandPose, ...] = ()
    whole: SurfaceShape | None = None
    if T_base_hand is None:
        sight = surface.points.mean(axis=0) - cloud.viewpoint
        proposals = propose_hand_poses(
            surface,
            gripper,
            preshape=preshape,
            towards=sight / np.linalg.norm(sight),
            obstacles=cloud.points[~inside],
        )
        chosen = _chosen(proposals, choice, gripper)
        T_base_hand, preshape = chosen.T_surface_hand, chosen.preshape
    else:
        # Where a pose was proposed, the hand is known to be clear of all of it.
        whole = surface.moved(T_base_hand.inverse())
    names = list(gripper.preshapes) if preshape is None else [preshape]
    taught = [
        _defined(name, surface, T_base_hand, gripper, each, width, whole)
        for each in names
    ]
    definition, findings = min(taught, key=lambda pair: len(pair[1]))
    return Recording(
        definition=replace(
            definition, kind=kind, tags=tags, description=description or _note(capture)
        ),
        T_base_hand=T_base_hand,
        n_points=int(inside.sum()),
        proposals=proposals,
        findings=findings,
    )


def taught_by_joints(
    robot: RobotModel, arm: str | None, joints: Mapping[str, float], gripper: str
) -> SE3:
    """Pose of the palm in the base frame when the arm stands at joint values.

    Parameters
    ----------
    arm
        Name of the arm; by default the one that carries the hand.
    joints
        Value of each joint of the arm [rad or m]; others stay at rest.

    Raises
    ------
    UnknownNameError
        If robot, arm or a joint is not known.
    ConfigError
        If the arm carries another hand, a value is beyond the limits of its joint, or
        the joint is fixed.
    """
    carriers = robot.arms_with(gripper)
    name = arm or (carriers[0] if carriers else None)
    if name is None:
        carried = sorted(spec.gripper for spec in robot.arms.values())
        raise UnknownNameError(f"gripper of {robot.name}", gripper, carried)
    spec = robot.arm(name)
    if spec.gripper != gripper:
        raise ConfigError(
            f"gripper of the {arm_called(name)}",
            got=repr(gripper),
            expected=f"{spec.gripper!r}, which it carries",
        )
    require_joints(robot, joints)
    return robot.link_poses(joints)[spec.tip]


def parse_hand_pose(text: str) -> SE3:
    """Read a palm pose: ``x,y,z,roll,pitch,yaw`` [m, rad], or a file with a 4x4.

    Raises
    ------
    ConfigError
        If it is neither, or no rigid transform.
    """
    return parse_pose(text, "pose of the hand")


def _piece(
    capture: Capture,
    cloud: PointCloud,
    object_label: int | None,
    region: Bounds | None,
) -> BoolArray:
    """Which points of the cloud to take, shape (n,)."""
    marked = None if capture.mask is None else capture.mask[measured(capture)]
    if object_label is None and region is None and marked is None:
        raise ConfigError(
            "piece of the capture",
            got="no object, region or mask",
            expected="one of them",
            mend="`debrisgrasp segment CAPTURE` lists the objects; then give "
            "object_label (--object N).",
        )
    inside = np.ones(len(cloud), dtype=bool)
    if region is not None:
        inside &= region.contains(cloud.points)
    if object_label is not None:
        found = segment_cloud(cloud, colors=point_colors(capture), of_interest=marked)
        found.points_of(object_label)  # raises for a label that is none
        inside &= found.labels == object_label
    elif marked is not None:
        inside &= marked
    return inside


def _surface(cloud: PointCloud, inside: BoolArray) -> SurfaceShape:
    piece = cloud.selected(inside)
    has_normal = np.isfinite(piece.normals).all(axis=1)
    n = int(has_normal.sum())
    if n < _FEWEST:
        raise CaptureError(
            "piece of the capture",
            got=f"{len(piece)} points, {n} with a normal",
            expected=f"at least {_FEWEST} with a normal",
            mend="Take a larger piece; coordinates are metres in the base frame.",
        )
    size = float(np.ptp(piece.points[has_normal], axis=0).max())
    if size > 1.0:
        raise CaptureError(
            "piece of the capture",
            got=f"{size:.2f} m long",
            expected="at most 1 m",
            mend="Cut it down with a region (--region) around the grip.",
        )
    shape = SurfaceShape.thinned(piece.points[has_normal], piece.normals[has_normal])
    # Single points in the air are flying pixels of the sensor.
    distance = np.asarray(cKDTree(shape.points).query(shape.points, k=_NEIGHBORS)[0])
    is_dense = distance[:, -1] < _CLOSE
    return SurfaceShape.thinned(shape.points[is_dense], shape.normals[is_dense])


def _chosen(
    proposals: tuple[HandPose, ...], choice: int, gripper: GripperModel
) -> HandPose:
    if not proposals:
        low, high = gripper.opening_range
        raise InputError(
            "piece of the capture",
            got=f"one that {gripper.name} can't take across any of its axes",
            expected=f"something {1e3 * low:.0f} to {1e3 * high:.0f} mm thick",
            mend="Cut it down with a region, or teach the pose of the hand.",
        )
    if not 1 <= choice <= len(proposals):
        raise ConfigError(
            "choice of pose", got=choice, expected=f"1 to {len(proposals)}"
        )
    return proposals[choice - 1]


def _defined(
    name: str,
    surface: SurfaceShape,
    T_base_hand: SE3,
    gripper: GripperModel,
    preshape: str,
    width: float | None,
    whole: SurfaceShape | None,
) -> tuple[PrototypeDefinition, tuple[str, ...]]:
    """Prototype at a pose, and what is wrong with it; ``whole`` as in `check`."""
    shape = gripper.preshape(preshape)
    low, high = shape.widths
    if width is not None and not low <= width <= high:
        raise ConfigError(
            f"width of preshape {preshape}",
            got=width,
            expected=f"{low:g} to {high:g} m",
        )
    definition = PrototypeDefinition(
        name=name,
        gripper=gripper.name,
        preshape=preshape,
        width=low if width is None else width,
        opening=min((low if width is None else width) + 0.04, float(shape.openings[0])),
        shape=around_grip(surface, T_base_hand, gripper, preshape),
        T_hand_shape=SE3.identity(),
    )
    if width is None:
        definition = settled(definition, gripper)
    prototype = GraspPrototype.build(definition, fibonacci_sphere(1))
    found = check(prototype, gripper, whole)
    return definition, tuple(str(finding) for finding in found)


def _note(capture: Capture) -> str:
    return f"recorded from {capture.name}"
