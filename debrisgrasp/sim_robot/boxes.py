"""Boxes of bodies twice: as polytopes for bodies and ground, as boxes for the robot."""

from __future__ import annotations

from xml.etree import ElementTree

from debrisgrasp.geometry import Box
from debrisgrasp.sim.model import numbers, placement
from debrisgrasp.worlds import World

__all__ = ["add_boxes"]

_ROBOT = {"contype": "2", "conaffinity": "5"}
"""The robot meets what is of type 1, and boxes for it, but not itself."""
_FOR_ROBOT = {"contype": "4", "conaffinity": "0"}
_FOR_REST = {"contype": "8", "conaffinity": "9"}


def add_boxes(root: ElementTree.Element, world: World) -> None:
    """Let the robot meet boxes as such, in the tree of a world, in place.

    Of polytopes MuJoCo's general colliders tell, now and then, depths of millimetres
    where they touch by micrometres, far off the normal: a blow of hundreds of newtons
    on a hand that creeps. That of two boxes is exact; but bodies that lie on each other
    do not come to rest with it.
    """
    scene = root.find("worldbody")
    assert scene is not None
    nodes = {node.get("name"): node for node in scene.findall("body")}
    for body in world.bodies:
        node = nodes[body.name]
        for part, geom in zip(body.parts, node.findall("geom"), strict=True):
            if not isinstance(part, Box):
                continue
            geom.attrib.update(_FOR_REST)
            twin = ElementTree.SubElement(node, "geom", type="box", mass="0")
            twin.attrib.update(_FOR_ROBOT, size=numbers(part.half_extents))
            twin.attrib.update(placement(part.T_frame_solid))
    for geom in root.iter("geom"):
        if geom.get("contype") == _ROBOT["contype"]:
            geom.attrib.update(_ROBOT)
