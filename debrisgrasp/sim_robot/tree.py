"""Links and joints of a robot as MuJoCo bodies, from its URDF."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from xml.etree import ElementTree

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import Box, Capsule, Cylinder, Sphere, so3
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.kinematics.solids import solids_of_shape
from debrisgrasp.kinematics.urdf import UrdfJoint
from debrisgrasp.sim.model import numbers, placement, primitive

__all__ = ["BASE_JOINTS", "RobotTree"]

BASE_JOINTS = ("base_x", "base_y", "base_yaw")
"""Joints on which the base drives; x and y are those of the odometry."""
_AXES = ("1 0 0", "0 1 0", "0 0 1")
_BESIDE = {"contype": "2", "conaffinity": "1"}
"""Robots meet the world only: what they do to themselves is up to the planner."""


class RobotTree:
    """Adds the links of a robot to the tree of a world.

    Parameters
    ----------
    model
        Which robot. Its base gets three joints, `BASE_JOINTS`, and the joints of its
        arms their own; all others are fixed at rest.
    armature
        Reflected inertia of the drives [kg m^2].
    """

    def __init__(self, model: RobotModel, armature: float) -> None:
        self.model, self.armature = model, armature
        self.joints = tuple(
            dict.fromkeys(j for arm in model.arms.values() for j in arm.joints)
        )
        """Joints that the arms move, each once."""
        self._inertials = _inertials(model)
        self._below: dict[str, list[UrdfJoint]] = {}
        for joint in model.tree.joints.values():
            self._below.setdefault(joint.parent, []).append(joint)
        self._hands = {spec.hand: name for name, spec in model.arms.items()}
        self._rest = model.joint_values()

    def add(self, root: ElementTree.Element) -> Mapping[str, ElementTree.Element]:
        """Append all links but those of hands; return the links that carry hands.

        They are by arm; each has a body ``<arm>/hand`` where the arm's tip is.
        """
        scene = root.find("worldbody")
        assert scene is not None
        self._assets = root.find("asset")
        self._palms: dict[str, ElementTree.Element] = {}
        base = ElementTree.SubElement(scene, "body", name=self.model.base)
        for name, axis in zip(BASE_JOINTS, _AXES, strict=True):
            kind = "hinge" if name == BASE_JOINTS[-1] else "slide"
            ElementTree.SubElement(base, "joint", name=name, type=kind, axis=axis)
        self._fill(base, self.model.base)
        self._spare_the_ground(root)
        return self._palms

    def links_of_arms(self) -> dict[str, list[str]]:
        """Bodies between the first joint that is an arm's own and its hand, by arm."""
        arms, tree = self.model.arms, self.model.tree
        shared = Counter(joint for arm in arms.values() for joint in arm.joints)
        found = {}
        for name, arm in arms.items():
            own = next(joint for joint in arm.joints if shared[joint] == 1)
            below = tree.links_below(tree.joints[own].child)
            found[name] = sorted(below - tree.links_below(arm.hand))
        return found

    def _spare_the_ground(self, root: ElementTree.Element) -> None:
        """Let what drives not touch the ground that it drives on."""
        section = ElementTree.SubElement(root, "contact")
        for link in self.model.tree.shapes:
            on_base = self.model.tree.body_of(link)
            if on_base == self.model.tree.body_of(self.model.base):
                ElementTree.SubElement(section, "exclude", body1="world", body2=link)

    def _fill(self, node: ElementTree.Element, link: str) -> None:
        """Give a body its mass and solids, and append what hangs on it."""
        inertial = self._inertials.get(link)
        if inertial is not None:
            node.append(inertial)
        tree = self.model.tree
        for i, shape in enumerate(tree.shapes[link]):
            for k, solid in enumerate(solids_of_shape(shape, link, tree.path.parent)):
                geom = ElementTree.SubElement(node, "geom", _BESIDE)
                if isinstance(solid, Box):
                    geom.attrib.update(type="box", size=numbers(solid.half_extents))
                    geom.attrib.update(placement(solid.T_frame_solid))
                elif isinstance(solid, Cylinder | Capsule | Sphere):
                    geom.attrib.update(primitive(solid))
                else:
                    self._mesh(geom, f"{link}/{i}/{k}", solid.mesh()[0])
        for joint in self._below.get(link, ()):
            if joint.child in self._hands:
                self._add_palm(node, joint)
            else:
                self._add_link(node, joint)

    def _add_link(self, parent: ElementTree.Element, joint: UrdfJoint) -> None:
        node = ElementTree.SubElement(parent, "body", name=joint.child)
        is_moved = joint.name in self.joints
        pose = joint.T_parent_joint
        if not is_moved:
            pose = joint.T_parent_child(self._rest[joint.name])
        node.attrib.update(placement(pose))
        if is_moved:
            element = ElementTree.SubElement(
                node, "joint", name=joint.name, axis=numbers(joint.axis)
            )
            element.set("type", "slide" if joint.kind == "prismatic" else "hinge")
            element.set("armature", f"{self.armature:.6g}")
            if np.isfinite([joint.lower, joint.upper]).all():
                element.set("limited", "true")
                element.set("range", numbers([joint.lower, joint.upper]))
        self._fill(node, joint.child)

    def _add_palm(self, parent: ElementTree.Element, joint: UrdfJoint) -> None:
        """Leave a place for the hand that the planner knows, where the tip is."""
        arm = self._hands[joint.child]
        poses = self.model.link_poses()
        tip = self.model.arm(arm).tip
        T_parent_tip = poses[joint.parent].inverse() @ poses[tip]
        node = ElementTree.SubElement(parent, "body", name=f"{arm}/hand")
        node.attrib.update(placement(T_parent_tip))
        self._palms[arm] = node

    def _mesh(self, geom: ElementTree.Element, name: str, vertices: FloatArray) -> None:
        assert self._assets is not None
        ElementTree.SubElement(
            self._assets, "mesh", name=name, vertex=numbers(vertices.ravel())
        )
        geom.attrib.update(type="mesh", mesh=name)


def _inertials(model: RobotModel) -> dict[str, ElementTree.Element]:
    """Masses of the links, as MuJoCo has them.

    Raises
    ------
    ConfigError
        If the URDF gives a moving link of an arm no mass.
    """
    found = {}
    root = ElementTree.fromstring(model.tree.path.read_bytes())
    for link in root.findall("link"):
        inertial = link.find("inertial")
        if inertial is not None:
            found[str(link.get("name"))] = _inertial(inertial)
    for arm in model.arms.values():
        for name in arm.joints:
            body = model.tree.joints[name].child
            fixed_to_it = [
                link for link in model.tree.shapes if model.tree.body_of(link) == body
            ]
            if not any(link in found for link in fixed_to_it):
                raise ConfigError(
                    f"mass of link {body} of robot {model.name}",
                    got="none",
                    expected="an <inertial> in the URDF",
                    mend="Physics needs mass and inertia of every moving link.",
                )
    return found


def _inertial(element: ElementTree.Element) -> ElementTree.Element:
    def read(tag: str, name: str, default: str) -> FloatArray:
        found = element.find(tag)
        text = default if found is None else found.get(name, default)
        return np.array([float(word) for word in text.split()])

    turn = so3.from_rpy(read("origin", "rpy", "0 0 0"))
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    xx, xy, xz, yy, yz, zz = (float(read("inertia", n, "0")[0]) for n in names)
    own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    about = turn @ own @ turn.T
    rows = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    return ElementTree.Element(
        "inertial",
        pos=numbers(read("origin", "xyz", "0 0 0")),
        mass=f"{float(read('mass', 'value', '0')[0]):.9g}",
        fullinertia=numbers([float(about[row]) for row in rows]),
    )
