"""Arms with their hands, as the task uses them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations, permutations

import numpy as np

from debrisgrasp._arrays import BoolArray, require_metres
from debrisgrasp._words import arm_called, shortened
from debrisgrasp.control import PostureKinematics, require_sensor_range
from debrisgrasp.errors import InputError, UnknownNameError
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.kinematics import ArmReach, RobotModel
from debrisgrasp.kinematics.urdf import UrdfJoint
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.robot import Robot

from .grasping import require_room
from .limb_state import LimbState
from .reposition import FARTHEST
from .settings import TaskSettings

__all__ = [
    "limbs_of",
    "require_devices",
    "require_drop_off",
    "require_own_joints",
    "require_own_sides",
    "require_watching",
]

_BESIDE_ANOTHER = 0.2
"""What is so much nearer to another hand than to the own is on the other's side [m]."""
_HEIGHT = 0.35
"""Of the palm over a drop-off at which it must be able to be [m]."""
_HAND = 0.2
"""Of the palm over the lowest of what it holds, about [m]."""
_TILTS, _YAWS = (0.0, np.pi / 4.0), 8


def require_devices(robot: Robot, look: Mapping[str, float]) -> None:
    """Raise `InputError` if a robot lacks what no task goes without.

    Parameters
    ----------
    look
        Joints of the head for a capture [rad or m].

    Raises
    ------
    UnknownNameError
        If a joint of its head is not the model's, or one of the look is not the head's.
    """
    if robot.camera is None:
        raise InputError(
            "camera of the robot",
            got="none",
            expected="a DepthCamera",
            mend="Nothing is moved that is not seen; give it to Robot(camera=...).",
        )
    model = robot.model
    for name, limb in robot.limbs.items():
        said, expected = limb.arm.joint_names, model.chain(name).joint_names
        if not isinstance(said, (tuple, list)) or tuple(said) != expected:
            raise InputError(
                f"joint_names of the {arm_called(name)}",
                got=shortened(repr(said)),
                expected=", ".join(expected),
                mend="A driver names the joints of the model, from the base on.",
            )
        if limb.gripper.name != model.arm(name).gripper:
            raise InputError(
                f"gripper of the {arm_called(name)}",
                got=shortened(repr(limb.gripper.name)),
                expected=repr(model.arm(name).gripper),
                mend="A driver has the name of the hand in the file of the robot.",
            )
    if robot.head is not None:
        turned = robot.head.joint_names
        for name in turned if isinstance(turned, (tuple, list)) else (turned,):
            if name not in model.tree.joints:
                raise UnknownNameError("joint of the head", name, model.tree.joints)
        for name in look:
            if name not in turned:
                raise UnknownNameError("joint of the head in look", name, turned)
    above = require_watching(model, robot.limbs)
    for joint in above:
        value = look.get(joint.name, 0.0)
        if joint.name in look and not joint.lower <= value <= joint.upper:
            raise InputError(
                f"look of {joint.name}",
                got=value,
                expected=f"{joint.lower:g} to {joint.upper:g} rad or m",
                mend="Angles are in radians.",
            )


def require_own_joints(model: RobotModel, arms: Iterable[str]) -> None:
    """Raise `InputError` if one of two arms moves all joints of the other, or its tip.

    As alternatives that is well for a plan; a task would send each its own way.
    """
    for one, other in combinations(arms, 2):
        joints, others = (set(model.arm(name).joints) for name in (one, other))
        is_same = model.arm(one).tip == model.arm(other).tip
        if is_same or joints <= others or others <= joints:
            what = "tip" if is_same else "joints"
            raise InputError(
                f"{what} of the {arm_called(one)} of {model.name}",
                got=f"those of the {arm_called(other)}, too",
                expected="its own",
                mend="If they are one arm with another hand, take one of them: --arm.",
            )


def require_watching(model: RobotModel, arms: Iterable[str]) -> list[UrdfJoint]:
    """Refuse a robot without a camera above the ground that no arm carries.

    Returns the joints that carry it.

    Raises
    ------
    ConfigError, InputError
        Saying where the camera is.
    """
    p = model.T_base_camera().p
    assert model.camera is not None
    require_metres(f"camera of {model.name}", p)
    if p[2] <= 0.0:
        raise InputError(
            f"camera of {model.name}",
            got=f"{model.camera}, {-p[2]:.2f} m below the ground",
            expected=f"one above z = 0 of the base {model.base!r}, where the ground is",
            mend="Look at where the URDF, or `frames` in the robot's file, has it.",
        )
    above = model.tree.joints_above(model.camera)
    carried_by = {joint.name for joint in above}
    for name in arms:
        if carried_by.issuperset(model.chain(name).joint_names):
            raise InputError(
                f"camera of {model.name}",
                got=f"{model.camera}, which the {arm_called(name)} carries",
                expected="one on the body, or on a head",
                mend="The task watches its own hands; plans and motions take captures "
                "of any camera whose pose they have.",
            )
    return above


def limbs_of(
    robot: Robot,
    settings: TaskSettings,
    model: RobotModel,
    hands: Mapping[str, GripperModel],
) -> dict[str, LimbState]:
    """Prepare the arms that the settings name.

    Parameters
    ----------
    model
        Of the robot, with its hands on it.
    hands
        By their names.

    Raises
    ------
    UnknownNameError, InputError
        If an arm is not the robot's, or is another one too; if it has no drop-off
        beside the robot and within its reach, or that of another arm, no posture of the
        name at which it is to rest, or one below the ground, or limits too low to feel
        a touch by, or beyond the range of its sensor.
    """
    names = settings.arms or tuple(robot.limbs)
    if not names:
        raise InputError(
            f"limbs of {model.name}",
            got="none",
            expected=f"one or more of {', '.join(model.arms)}",
            mend="Give Robot(limbs=...) a Limb for each arm that there is.",
        )
    for name in names:
        if name not in robot.limbs:
            raise UnknownNameError("arm", name, robot.limbs)
    require_own_joints(model, names)
    for name in names:
        if name not in settings.drop_off:
            raise InputError(
                f"drop-off of the {arm_called(name)}",
                got=f"places of {', '.join(settings.drop_off) or 'no arm'}",
                expected="a place (x, y) in the base frame [m]",
                mend="Give one as drop_off of the site, or of TaskSettings.",
            )
    limbs = {}
    for name in names:
        limb = robot.limbs[name]
        require_above_ground(model, name, settings.rest or model.arm(name).idle)
        reach = ArmReach(model, name)
        require_drop_off(reach, settings.drop_off[name], settings.drop_height)
        _require_lift(reach, settings)
        limits = model.limits(name, reach.chain)
        require_room(limits.controller, settings.load_share)
        require_sensor_range(limb.loads, limits.controller)
        limbs[name] = LimbState(
            name=name,
            limb=limb,
            reach=reach,
            limits=limits,
            hand=hands[model.arm(name).gripper],
            kinematics=PostureKinematics(reach.chain),
            loads=limb.loads,
            is_own_joint=_own_joints(robot, name),
        )
    require_own_sides({n: limb.reach for n, limb in limbs.items()}, settings.drop_off)
    return limbs


def require_above_ground(model: RobotModel, arm: str, rest: str) -> None:
    """Raise `InputError` if an arm rests below z = 0, where the ground is taken to be.

    There is nothing that it could be moved by: each way begins in the ground.
    """
    above = model.tree.joints_above
    moved = frozenset(model.arm(arm).joints)
    z, lowest = min(
        (float(solid.mesh()[0][:, 2].min()), link)
        for link, solid in model.links_solids(model.posture(arm, rest))
        if not moved.isdisjoint(joint.name for joint in above(link))
    )
    if z < 0.0:
        raise InputError(
            f"base of {model.name}",
            got=f"{model.base!r}, a frame {-z:.2f} m above {lowest} of the "
            f"{arm_called(arm)} at rest ({rest!r})",
            expected="one on the ground, x forward, y left, z up: there is z = 0",
            mend="Name one as `base` in the robot's file, and add it under `frames` if "
            "the URDF has none; captures and settings are in that frame. Or let the "
            "arm rest higher.",
        )


def require_own_sides(
    reaches: Mapping[str, ArmReach], drop_off: Mapping[str, tuple[float, float]]
) -> None:
    """Raise `InputError` if an arm is to put things down beside another one.

    Arms that reach across each other get in their way.

    Parameters
    ----------
    reaches
        Arms in use by name, as they stand.
    drop_off
        Places (x, y) by arm [m]; an arm without one is left out.
    """
    hands = {
        name: arm.chain.fk(arm.q_present).p[:2]
        for name, arm in reaches.items()
        if name in drop_off
    }
    for name, other in permutations(hands, 2):
        place = np.array(drop_off[name])
        own, others = (
            float(np.linalg.norm(hands[each] - place)) for each in (name, other)
        )
        if own > others + _BESIDE_ANOTHER:
            raise InputError(
                f"drop-off of the {arm_called(name)}",
                got=f"({place[0]:g}, {place[1]:g}), beside the {arm_called(other)}",
                expected=f"a place on the side of the {arm_called(name)}",
                mend="Were left and right confused? Arms that reach across each other "
                "get in their way; else use one arm only.",
            )


def _own_joints(robot: Robot, name: str) -> BoolArray:
    """Which joints of an arm no other arm has, shape (d,)."""
    others = {
        joint
        for other, limb in robot.limbs.items()
        if other != name
        for joint in limb.arm.joint_names
    }
    names = robot.limbs[name].arm.joint_names
    return np.array([joint not in others for joint in names])


def require_drop_off(
    reach: ArmReach, place: tuple[float, float], drop_height: float = 0.0
) -> None:
    """Raise `InputError` unless an arm can put things down at a place, base frame [m].

    The robot may not stand there, and a palm that faces down must get above it.

    Parameters
    ----------
    drop_height
        Of what it holds, over the ground [m].
    """
    back = FARTHEST if reach.robot.drives else 0.0
    height = max(_HEIGHT, drop_height + _HAND)
    for way in np.linspace(0.0, back, 8):
        if reach.robot.stands_at((place[0] + float(way), place[1]), height):
            where = "stands" if not way else "may drive back to"
            raise InputError(
                f"drop-off of the {arm_called(reach.name)}",
                got=f"({place[0]:g}, {place[1]:g}), where the robot {where}",
                expected="a place beside the robot",
                mend="Put things down on the side of the arm, clear of the robot.",
            )
    if not _reaches(reach, (*place, height), _TILTS):
        mend = "Give one nearer to the robot, on the side of the arm"
        if height > _HEIGHT:
            mend += f", or lower drop_height, which is {drop_height:g} m"
        raise InputError(
            f"drop-off of the {arm_called(reach.name)}",
            got=f"({place[0]:g}, {place[1]:g})",
            expected=f"a place that the hand reaches {height:g} m above the ground",
            mend=f"{mend}.",
        )


def _require_lift(reach: ArmReach, settings: TaskSettings) -> None:
    """Raise `InputError` if nothing that lies in the way can be lifted so far."""
    (x0, y0, _), (x1, y1, _) = settings.workspace
    places = [(x, y) for x in np.linspace(x0, x1, 6) for y in np.linspace(y0, y1, 5)]
    # Where an arm reaches farthest up is mostly near to it.
    own = reach.chain.fk(reach.q_present).p[:2]
    places.sort(key=lambda place: float(np.linalg.norm(own - place)))
    tilts = (*_TILTS, np.pi / 2.0)

    def reaches(height: float) -> bool:
        return any(_reaches(reach, (*place, height), tilts) for place in places)

    if reaches(settings.lift):
        return
    lower = settings.lift * np.array([0.75, 0.5, 0.25, 0.1])
    low = next((height for height in lower.tolist() if reaches(height)), None)
    hand = f"the hand of the {arm_called(reach.name)}"
    raise InputError(
        "TaskSettings.lift",
        got=f"{settings.lift:g} m",
        expected=f"a height at which {hand} still reaches a place in the workspace",
        mend=f"It reaches one {low:.2g} m high: lower it, or give the arm a workspace "
        "nearer to it."
        if low
        else f"At none below does {hand} face down or ahead there: give the arm a "
        "workspace nearer to it.",
    )


def _reaches(
    reach: ArmReach, place: tuple[float, float, float], tilts: Sequence[float]
) -> bool:
    """Whether a palm that faces down, or is tilted by so much, gets to a place."""
    Rs = [
        so3.from_rpy(np.array([np.pi, tilt, yaw]))
        for tilt in tilts
        for yaw in np.linspace(0.0, 2.0 * np.pi, _YAWS, endpoint=False)
    ]
    poses = SE3.from_parts(np.array(Rs), np.tile(place, (len(Rs), 1)))
    rng = np.random.default_rng(0)  # only whether there is a posture is asked
    return bool(reach.solves(poses, rng=rng).any())
