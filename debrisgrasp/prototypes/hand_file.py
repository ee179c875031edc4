"""The YAML file of a hand: read, checked, and turned into chains."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TypedDict

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._fields import MAX_LENGTH, Fields
from debrisgrasp._files import read_yaml
from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.geometry import SE3
from debrisgrasp.geometry.solids import Box, Capsule, Cylinder, Solid, Sphere

from .hand_joints import require_joints, require_pads, require_units
from .hand_kinematics import Finger, HandJoint, HandLink, Preshape
from .pose_fields import read_pose

__all__ = ["HandContent", "read_hand"]

_SIDES = {"thumb": -1, "pair": 1}
_COMMAND_STEPS = 401
"""Commands at which the opening is tabulated: the error of interpolating in between
stays below a micrometre for fingers of 20 cm."""
_OPENING_SLACK = 1e-5
"""How far pads may move apart between two commands [m]: rounded tables."""
_LEAST_MASS = 1e-3
"""No hand is lighter [kg]; a mass of 0 is one that nobody has filled in ..."""
_LEAST_FORCE = 0.01
"""... and so is a largest force of 0: loads are divided by it [N]."""
_KILOGRAMS = "It is the mass of the whole hand in kilograms: 800 g is 0.8."
_NEWTONS = (
    "It is what the fingers of one side press with together, in newtons; a data sheet "
    "calls it grip force."
)


class HandContent(TypedDict):
    """What the file of a hand says; the fields are those of `GripperModel`."""

    name: str
    description: str
    mass: float
    max_force: float
    palm: tuple[Solid, ...]
    fingers: tuple[Finger, ...]
    preshapes: Mapping[str, Preshape]


def read_hand(path: str | os.PathLike[str]) -> HandContent:
    """Read and check the file of a hand.

    Raises
    ------
    ConfigError
        Naming file, field and range.
    """
    fields = Fields(read_yaml(path), str(path))
    base = fields.child("base")
    T_hand_base = read_pose(base)
    base.finish()
    chains = _chains(fields.child("chains"))
    fingers = _fingers(fields, chains, T_hand_base)
    if {finger.side for finger in fingers} != set(_SIDES.values()):
        raise ConfigError(
            fields.where("fingers"),
            got=[finger.name for finger in fingers],
            expected="at least one finger on each side: thumb and pair",
        )
    content = HandContent(
        name=fields.text("name"),
        description=fields.text("description", "-"),
        mass=fields.number("mass", _LEAST_MASS, 100.0, mend=_KILOGRAMS),
        max_force=fields.number("max_force", _LEAST_FORCE, 1e5, mend=_NEWTONS),
        palm=tuple(solid.moved(T_hand_base) for solid in _palm(fields)),
        fingers=fingers,
        preshapes=_preshapes(fields.child("preshapes"), fingers),
    )
    fields.finish()
    return content


def _palm(fields: Fields) -> tuple[Solid, ...]:
    """Read the solids of the palm; without any it would go through what lies there."""
    fields.raw("palm")
    palm = _solids(fields, "palm")
    if not palm:
        raise ConfigError(
            fields.where("palm"),
            got="no solid",
            expected="at least one: without it the palm would touch nothing",
            mend="A box a little larger than the body of the hand will do.",
        )
    return palm


def _solids(fields: Fields, name: str) -> tuple[Solid, ...]:
    return tuple(_solid(child) for child in fields.children(name))


def _solid(fields: Fields) -> Solid:
    kind = fields.choice("type", ("box", "cylinder", "capsule", "sphere"))
    T_link_solid = read_pose(fields)
    solid: Solid
    if kind == "box":
        size = fields.numbers("size", 3)
        if not ((size > 0) & (size <= MAX_LENGTH)).all():
            raise ConfigError(
                fields.where("size"),
                got=size.tolist(),
                expected=f"three edge lengths above 0 and up to {MAX_LENGTH:g} m",
            )
        solid = Box(size / 2, T_link_solid)
    elif kind == "sphere":
        solid = Sphere(fields.length("radius", 1e-4), T_link_solid.p)
    else:
        round_solid = Cylinder if kind == "cylinder" else Capsule
        solid = round_solid(
            fields.length("radius", 1e-4), fields.length("length", 1e-4), T_link_solid
        )
    fields.finish()
    return solid


def _joint(fields: Fields) -> HandJoint | None:
    if "joint" not in fields:
        return None
    joint = fields.child("joint")
    axis = joint.numbers("axis", 3)
    norm = float(np.linalg.norm(axis))
    if norm < 1e-6:
        raise ConfigError(
            joint.where("axis"), got=axis.tolist(), expected="an axis of some length"
        )
    kind = joint.choice("type", ("revolute", "prismatic"), "revolute")
    sign = joint.number("sign", -1.0, 1.0, default=1.0)
    if not sign:
        raise ConfigError(
            joint.where("sign"),
            got=0,
            expected="1, or -1 where the finger mirrors the value",
            mend="A joint that does not move is none: leave it out.",
        )
    result = HandJoint(joint.text("name"), axis / norm, sign, kind == "prismatic")
    joint.finish()
    return result


def _link(fields: Fields) -> tuple[HandLink, FloatArray | None]:
    pad = fields.position("pad") if "pad" in fields else None
    fields.text("name", "link")
    link = HandLink(read_pose(fields), _joint(fields), _solids(fields, "solids"))
    fields.finish()
    return link, pad


def _chains(fields: Fields) -> dict[str, tuple[tuple[HandLink, ...], FloatArray]]:
    chains = {}
    for name in fields.names():
        links_and_pads = [_link(child) for child in fields.children(name)]
        pad = links_and_pads[-1][1] if links_and_pads else None
        if pad is None:
            raise ConfigError(
                fields.where(name),
                got="no pad in the last link" if links_and_pads else "no link",
                expected="links, the last with pad: [x, y, z], where it meets objects",
            )
        links = tuple(link for link, _ in links_and_pads)
        _require_tip(fields, name, links)
        chains[name] = (links, pad)
    return chains


def _require_tip(fields: Fields, name: str, links: tuple[HandLink, ...]) -> None:
    """Refuse a chain whose pad moves without a solid that could meet an object."""
    moved = [index for index, link in enumerate(links) if link.joint is not None]
    if moved and not any(link.solids for link in links[moved[-1] :]):
        raise ConfigError(
            fields.where(f"{name}[{moved[-1]}].solids"),
            got="no solid from the last joint to the pad",
            expected="at least one, to meet objects",
            mend="Give the link a box, cylinder, capsule or sphere about as large as "
            "the finger is there.",
        )


def _fingers(
    fields: Fields,
    chains: Mapping[str, tuple[tuple[HandLink, ...], FloatArray]],
    T_hand_base: SE3,
) -> tuple[Finger, ...]:
    fingers: dict[str, Finger] = {}
    for child in fields.children("fingers"):
        finger = _finger(child, chains, T_hand_base)
        if finger.name in fingers:
            raise ConfigError(
                child.where("name"),
                got=f"{finger.name!r} a second time",
                expected="a name that no other finger of the hand has",
                mend="Joint values are told apart by it: <finger>_<joint>.",
            )
        fingers[finger.name] = finger
    _require_own_names(fields, fingers.values())
    return tuple(fingers.values())


def _require_own_names(fields: Fields, fingers: Iterable[Finger]) -> None:
    """Refuse joints that the robot could not tell apart."""
    names = Counter(name for finger in fingers for name in finger.joint_names)
    if twice := [name for name, count in names.items() if count > 1]:
        raise ConfigError(
            fields.where("fingers"),
            got=f"{', '.join(twice)} more than once, as <finger>_<joint>",
            expected="names of fingers and joints that tell all joints apart",
            mend="Joints of one finger that move together are two in the table of "
            "closing, too.",
        )


def _finger(
    fields: Fields,
    chains: Mapping[str, tuple[tuple[HandLink, ...], FloatArray]],
    T_hand_base: SE3,
) -> Finger:
    chain = fields.text("chain")
    if chain not in chains:
        raise UnknownNameError(f"chain in {fields.where('chain')}", chain, chains)
    links, pad = chains[chain]
    root = HandLink(
        T_hand_base @ read_pose(fields), _joint(fields), _solids(fields, "solids")
    )
    finger = Finger(
        fields.text("name"),
        _SIDES[fields.choice("side", _SIDES)],
        (root, *links),
        pad,
    )
    fields.finish()
    if not any(link.solids for link in finger.links):
        raise ConfigError(
            fields.where("solids"),
            got=f"no solid, here or in chain {chain!r}",
            expected="at least one, to meet objects",
            mend=f"Give them to the finger, or to a link of chains.{chain}.",
        )
    return finger


def _preshapes(fields: Fields, fingers: tuple[Finger, ...]) -> dict[str, Preshape]:
    preshapes = {
        name: _preshape(name, fields.child(name), fingers) for name in fields.names()
    }
    if not preshapes:
        raise ConfigError(fields.where(), got="none", expected="at least one preshape")
    return preshapes


def _preshape(name: str, fields: Fields, fingers: tuple[Finger, ...]) -> Preshape:
    commands, joints = _closing_table(fields.child("closing"))
    if "fixed" in fields:
        fixed = fields.child("fixed")
        for joint in fixed.names():
            value = fixed.number(joint, -np.inf, np.inf)
            if joint in joints:
                raise ConfigError(
                    fields.where(f"fixed.{joint}"),
                    got=f"{value:g} for a joint that closing lists, too",
                    expected="each joint among closing or fixed",
                )
            joints[joint] = np.full_like(commands, value)
    require_joints(fields, fingers, joints)
    require_units(fields, fingers, joints)
    require_pads(fields, fingers, joints)
    openings = np.broadcast_to(_openings(fingers, joints), commands.shape)
    if not (np.diff(openings) <= _OPENING_SLACK).all():
        raise ConfigError(
            fields.where("closing"),
            got="pads that move apart on the way",
            expected="joint values that close the hand from the first command on",
        )
    largest, least = float(openings[0]), float(openings.min())
    widths = fields.numbers("widths", 2)
    is_far = least > max(widths[0], 0.0) + 1e-3
    if is_far or largest - least < 1e-3:
        raise ConfigError(
            fields.where("closing"),
            got=f"pads that come no nearer than {least:.3f} m along x"
            if is_far
            else f"pads that come no nearer, {abs(least):.3f} m apart along x",
            expected=f"{widths[0]:.3f} m, the smallest of its widths"
            if is_far
            else "pads that come together along it",
            mend="Fingers close along x of the hand: check axis, sign and rpy of each, "
            "and the joint values.",
        )
    if not 0 < widths[0] < widths[1] <= largest + 1e-3:
        raise ConfigError(
            fields.where("widths"),
            got=widths.tolist(),
            expected=f"0 < smallest < largest <= {largest:.3f} m, the full opening",
        )
    fields.finish()
    return Preshape(
        name,
        (float(widths[0]), float(widths[1])),
        commands,
        joints,
        np.minimum.accumulate(openings),
    )


def _closing_table(fields: Fields) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Commands, with all that the file lists among them, and joint values at each."""
    listed = fields.numbers("command")
    if len(listed) < 2 or not (np.diff(listed) > 0).all():
        raise ConfigError(
            fields.where("command"),
            got=listed.tolist(),
            expected="at least two commands, rising",
        )
    commands = np.union1d(listed, np.linspace(listed[0], listed[-1], _COMMAND_STEPS))
    joints = {
        name: np.interp(commands, listed, fields.numbers(name, len(listed)))
        for name in fields.names()
        if name != "command"
    }
    return commands, joints


def _openings(
    fingers: tuple[Finger, ...], joints: Mapping[str, FloatArray]
) -> FloatArray:
    """Distance along x between the mean pads of both sides, shape (c,)."""
    x = {
        side: np.mean(
            [f.pad_position(joints)[..., 0] for f in fingers if f.side == side], axis=0
        )
        for side in _SIDES.values()
    }
    openings: FloatArray = np.asarray(x[1] - x[-1])
    return openings
