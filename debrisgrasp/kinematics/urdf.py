"""What the kinematics needs from a URDF file: links, joints, collision primitives.

Only the tree is read here. Meshes are named but not opened, so a robot whose meshes are
missing still moves; collision checks, which need them, open them later.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from debrisgrasp._arrays import FloatArray, require_metres
from debrisgrasp._fields import require_distinct
from debrisgrasp._unreadable import is_device
from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.geometry import SE3, so3

from .packages import file_at

__all__ = ["MOVABLE_KINDS", "UrdfJoint", "UrdfShape", "UrdfTree"]

MOVABLE_KINDS = ("revolute", "continuous", "prismatic")
"""Joint types a chain may move."""

_EXPAND = "A xacro file must be expanded first: xacro FILE > robot.urdf."
_ARITY = {"box": 3, "sphere": 1, "cylinder": 2, "capsule": 2, "mesh": 3}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class UrdfJoint:
    """One joint, as the file states it."""

    name: str
    kind: str
    """URDF type, for instance ``"revolute"``."""
    parent: str
    child: str
    T_parent_joint: SE3
    """Pose of the child link in the parent link at joint value zero."""
    axis: FloatArray
    """Unit axis in the child link's frame, shape (3,)."""
    lower: float
    """Smallest value [rad or m]; minus infinity for a continuous joint."""
    upper: float
    velocity: float
    """Largest speed [rad/s or m/s]; infinity if the file gives none."""
    effort: float
    """Largest torque or force [N m or N]; infinity if the file gives none, or zero."""
    mimics: str | None
    """Name of the joint that drives this one, if it is a mimic joint."""

    @classmethod
    def fixed(cls, parent: str, child: str, T_parent_child: SE3) -> UrdfJoint:
        """Joint that holds one link fast on another."""
        return cls(
            name=f"{child}_joint",
            kind="fixed",
            parent=parent,
            child=child,
            T_parent_joint=T_parent_child,
            axis=np.array([1.0, 0.0, 0.0]),
            lower=0.0,
            upper=0.0,
            velocity=np.inf,
            effort=np.inf,
            mimics=None,
        )

    def T_parent_child(self, value: float) -> SE3:
        """Pose of the child link in the parent link at a joint value [rad or m]."""
        if self.kind == "prismatic":
            return self.T_parent_joint @ SE3.from_parts(p=value * self.axis)
        if self.kind in MOVABLE_KINDS:
            return self.T_parent_joint @ SE3.from_parts(so3.exp(value * self.axis))
        return self.T_parent_joint


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class UrdfShape:
    """One collision geometry of a link."""

    kind: str
    """``box``, ``sphere``, ``cylinder``, ``capsule`` or ``mesh``."""
    size: tuple[float, ...]
    """Box: three edge lengths; sphere: radius; cylinder and capsule: radius, length;
    mesh: scale along each axis [m]."""
    T_link_shape: SE3
    file: str = ""
    """Mesh file as written in the URDF; empty for a primitive."""


@dataclass(frozen=True, eq=False, kw_only=True)
class UrdfTree:
    """The links and joints of one robot."""

    name: str
    path: Path
    shapes: Mapping[str, tuple[UrdfShape, ...]]
    """Collision geometries by link; every link is a key."""
    joints: Mapping[str, UrdfJoint]

    @classmethod
    def load(cls, path: str | Path) -> UrdfTree:
        """Read a URDF file; ``package://NAME/...`` is sought as ROS does.

        Raises
        ------
        ConfigError
            If it can't be read, isn't a URDF, or its links don't form one tree.
        """
        path = file_at(path)
        if is_device(path):
            raise ConfigError("URDF", got=f"{path}: a device", expected="a file")
        try:
            content = path.read_bytes()
        except OSError as error:
            raise ConfigError(
                "URDF", got=f"{path}: {error.strerror}", expected="a readable file"
            ) from error
        try:
            root = ElementTree.fromstring(content)
        # The others tell of encodings that are unknown, or that XML may not have.
        except (ElementTree.ParseError, LookupError, ValueError) as error:
            raise ConfigError(
                "URDF",
                got=f"{path}: {error}",
                expected="well-formed XML",
                mend=_mend_of_xml(content),
            ) from error
        if root.tag != "robot":
            raise ConfigError(
                "URDF", got=f"{path} with root <{root.tag}>", expected="<robot>"
            )
        if any(map(_is_xacro, root.iter())):
            raise ConfigError(
                "URDF", got=f"{path}, a xacro file", expected="plain URDF", mend=_EXPAND
            )
        links = [
            (_attribute(link, "name", path), link.findall("collision"))
            for link in root.findall("link")
        ]
        joints = [_joint(element, path) for element in root.findall("joint")]
        require_distinct(f"names of links in {path}", [name for name, _ in links])
        require_distinct(f"names of joints in {path}", [j.name for j in joints])
        tree = cls(
            name=root.get("name", path.stem),
            path=path,
            shapes={
                name: tuple(_shape(e, f"link {name!r} in {path}") for e in solids)
                for name, solids in links
            },
            joints={joint.name: joint for joint in joints},
        )
        tree._require_one_tree()
        return tree

    def _require_one_tree(self) -> None:
        for joint in self.joints.values():
            for link in (joint.parent, joint.child):
                if link not in self.shapes:
                    raise UnknownNameError(
                        f"link of joint {joint.name!r} in {self.path}",
                        link,
                        self.shapes,
                    )
        if not len(self.joints) == len(self.parent_joint) == len(self.shapes) - 1:
            raise ConfigError(
                f"joints of {self.path}",
                got=f"{len(self.joints)} joints over {len(self.shapes)} links",
                expected="one tree: one parent joint for every link but the root",
            )

    @cached_property
    def parent_joint(self) -> dict[str, UrdfJoint]:
        """The joint above each link, by link; the root has none."""
        return {joint.child: joint for joint in self.joints.values()}

    def joints_above(self, link: str) -> list[UrdfJoint]:
        """Joints from a link up to the root, nearest first."""
        self.require_link(link, "link")
        found = []
        while (joint := self.parent_joint.get(link)) is not None:
            found.append(joint)
            link = joint.parent
            if len(found) > len(self.joints):
                raise ConfigError(
                    f"joints of {self.path}", got="a closed loop", expected="a tree"
                )
        return found

    def require_link(self, link: str, kind: str) -> None:
        """Raise `UnknownNameError`, which names near ones, unless the link exists."""
        if link not in self.shapes:
            raise UnknownNameError(f"{kind} of {self.name}", link, self.shapes)

    def links_below(self, link: str) -> frozenset[str]:
        """Return a link and all links that hang on it."""
        self.require_link(link, "link")
        return frozenset(
            name
            for name in self.shapes
            if name == link or any(j.parent == link for j in self.joints_above(name))
        )

    def body_of(self, link: str) -> str:
        """Topmost link that is joined to this one by fixed joints only."""
        for joint in self.joints_above(link):
            if joint.kind != "fixed":
                return joint.child
            link = joint.parent
        return link

    def link_pose(self, link: str, values: Mapping[str, float]) -> SE3:
        """Pose of one link, as `link_poses` has it, without that of all others."""
        pose = SE3.identity()
        for joint in reversed(self.joints_above(link)):
            pose = pose @ joint.T_parent_child(values.get(joint.name, 0.0))
        return pose

    def link_poses(self, values: Mapping[str, float]) -> dict[str, SE3]:
        """Pose of every link in the root link's frame.

        Parameters
        ----------
        values
            Joint values [rad or m] by joint name; joints not named stand at zero.
        """
        children: dict[str, list[UrdfJoint]] = {}
        for joint in self.joints.values():
            children.setdefault(joint.parent, []).append(joint)
        roots = [link for link in self.shapes if link not in self.parent_joint]
        poses = {root: SE3.identity() for root in roots}
        waiting = list(roots)
        while waiting:
            link = waiting.pop()
            for joint in children.get(link, ()):
                step = joint.T_parent_child(values.get(joint.name, 0.0))
                poses[joint.child] = poses[link] @ step
                waiting.append(joint.child)
        return poses


def _is_xacro(element: ElementTree.Element) -> bool:
    """Whether an element stands for others, or one of its values for another."""
    values = element.attrib.values()
    return "xacro" in element.tag or any("${" in v or "$(" in v for v in values)


def _mend_of_xml(content: bytes) -> str:
    """Say what to do about a file that could not be parsed."""
    if b"<robot" not in content.replace(b"\0", b""):  # UTF-16 has zeros between
        return "There is no <robot> in it: is it a URDF?"
    if b"xacro" in content:
        return _EXPAND
    try:
        content.decode()
    except UnicodeDecodeError:
        return (
            "Save it as UTF-8, or let its first line name its encoding: "
            "<?xml version='1.0' encoding='ISO-8859-1'?>."
        )
    return ""


def _attribute(element: ElementTree.Element, name: str, where: str | Path) -> str:
    value = element.get(name)
    if value is None:
        raise ConfigError(
            f"<{element.tag}> in {where}", got=f"no {name}", expected=f'{name}="..."'
        )
    return value


def _numbers(
    element: ElementTree.Element | None,
    name: str,
    default: tuple[float, ...],
    where: str,
) -> FloatArray:
    """Numbers of an attribute of a part of a link or joint, which ``where`` names."""
    if element is None or (text := element.get(name)) is None:
        return np.array(default)
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.array([np.nan])
    n = len(default)
    if len(values) != n or not np.isfinite(values).all():
        raise ConfigError(
            f"{name} in <{element.tag}> of {where}",
            got=repr(text),
            expected="a finite number" if n == 1 else f"{n} numbers, all finite",
        )
    return values


def _origin(element: ElementTree.Element, where: str) -> SE3:
    origin = element.find("origin")
    p = _numbers(origin, "xyz", (0.0, 0.0, 0.0), where)
    require_metres(f"xyz in <origin> of {where}", p)
    rpy = _numbers(origin, "rpy", (0.0, 0.0, 0.0), where)
    return SE3.from_parts(so3.from_rpy(rpy), p)


def _shape(collision: ElementTree.Element, where: str) -> UrdfShape:
    geometry = collision.find("geometry")
    shape = next(iter(geometry), None) if geometry is not None else None
    if shape is None or shape.tag not in _ARITY:
        raise ConfigError(
            f"collision geometry of {where}",
            got="none" if shape is None else f"<{shape.tag}>",
            expected="one of " + ", ".join(_ARITY),
        )
    if shape.tag in ("cylinder", "capsule"):
        sizes = [_numbers(shape, n, (np.nan,), where)[0] for n in ("radius", "length")]
    else:
        name = {"box": "size", "sphere": "radius", "mesh": "scale"}[shape.tag]
        default = 1.0 if shape.tag == "mesh" else np.nan
        sizes = list(_numbers(shape, name, (default,) * _ARITY[shape.tag], where))
    # A negative scale mirrors a mesh; a negative size means nothing.
    if not all(size > 0 or (shape.tag == "mesh" and size < 0) for size in sizes):
        raise ConfigError(
            f"<{shape.tag}> of {where}", got=sizes, expected="sizes above zero"
        )
    file = _attribute(shape, "filename", where) if shape.tag == "mesh" else ""
    return UrdfShape(
        kind=shape.tag,
        size=tuple(float(size) for size in sizes),
        T_link_shape=_origin(collision, where),
        file=file,
    )


def _end(joint: ElementTree.Element, tag: str, path: Path) -> str:
    """Link at one end of a joint."""
    end = joint.find(tag)
    if end is None:
        raise ConfigError(
            f"joint {joint.get('name')!r} in {path}",
            got=f"no <{tag}>",
            expected=f'<{tag} link="..."/>',
        )
    return _attribute(end, "link", path)


def _joint(element: ElementTree.Element, path: Path) -> UrdfJoint:
    name = _attribute(element, "name", path)
    kind = _attribute(element, "type", path)
    where = f"joint {name!r} in {path}"
    axis = _numbers(element.find("axis"), "xyz", (1.0, 0.0, 0.0), where)
    length = float(np.linalg.norm(axis))
    if length < 1e-9 and kind in MOVABLE_KINDS:
        raise ConfigError(
            f"axis of {where}",
            got=axis.tolist(),
            expected="a direction",
        )
    limit, mimic = element.find("limit"), element.find("mimic")
    # A revolute or prismatic joint without limits would be fixed at zero; that is what
    # the format says, and what the zero-width check of a chain then reports.
    lower, upper = (
        float(_numbers(limit, end, (0.0,), where)[0]) for end in ("lower", "upper")
    )
    if kind == "continuous":
        lower, upper = -np.inf, np.inf
    return UrdfJoint(
        name=name,
        kind=kind,
        parent=_end(element, "parent", path),
        child=_end(element, "child", path),
        T_parent_joint=_origin(element, where),
        axis=axis / max(length, 1e-9),
        lower=lower,
        upper=upper,
        velocity=float(_numbers(limit, "velocity", (np.inf,), where)[0]),
        effort=float(_numbers(limit, "effort", (np.inf,), where)[0]) or np.inf,
        mimics=None if mimic is None else _attribute(mimic, "joint", where),
    )
