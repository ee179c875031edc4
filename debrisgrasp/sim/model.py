"""A world as a MuJoCo model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import numpy as np

from debrisgrasp._arrays import FloatArray, require_range
from debrisgrasp.geometry import SE3, Box, Capsule, Cylinder, Sphere, so3
from debrisgrasp.worlds import Body, Ground, Hull, World, volume_and_centroid

from ._mujoco import mujoco

__all__ = [
    "Physics",
    "build_model",
    "compiled",
    "for_grips",
    "numbers",
    "placement",
    "pose_of",
    "primitive",
    "world_tree",
]


_FRICTION_STIFFNESS = 100.0
"""Of friction over pressure where something is gripped. At 10 what is held between
slanted pads creeps by 1 mm/s and is lost within seconds; at 100 by a twentieth of that,
at no cost."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Physics:
    """Contact and integration."""

    time_step: float = 0.002
    """Step of the integration [s]."""
    friction: float = 0.6
    """Coefficient of sliding friction; wood, steel and concrete pair at 0.4 to 0.7."""
    torsion: float = 0.01
    """Coefficient of torsional friction [m]."""
    rolling: float = 0.002
    """Coefficient of rolling friction [m]; it stops pipes on a floor."""
    stiffness_time: float = 0.01
    """Time constant of the contact springs [s]; at least twice the step."""

    def __post_init__(self) -> None:
        require_range("time_step", self.time_step, 1e-5, 0.01)
        for name in ("friction", "torsion", "rolling"):
            require_range(name, getattr(self, name), 0.0, 10.0)
        require_range("stiffness_time", self.stiffness_time, 2 * self.time_step)


def build_model(world: World, physics: Physics) -> Any:
    """Compile a world: body i is MuJoCo's body i + 1, its seven coordinates at 7 i.

    Raises
    ------
    MissingExtraError
        If MuJoCo is not installed.
    """
    return compiled(world_tree(world, physics), world)


def world_tree(world: World, physics: Physics) -> ElementTree.Element:
    """Describe a world in MuJoCo's language; ``worldbody`` takes further bodies."""
    root = ElementTree.Element("mujoco")
    ElementTree.SubElement(root, "compiler", angle="radian")
    # Version 4.0.0 factorises sparse constraint Jacobians wrongly; dense is right in
    # all versions, and faster for piles of this size.
    option = ElementTree.SubElement(root, "option")
    option.attrib.update(
        timestep=f"{physics.time_step:g}",
        jacobian="dense",
        cone="elliptic",
        impratio="10",
        integrator="implicitfast",
    )
    ElementTree.SubElement(option, "flag", multiccd="enable")
    default = ElementTree.SubElement(ElementTree.SubElement(root, "default"), "geom")
    default.attrib.update(
        friction=f"{physics.friction:g} {physics.torsion:g} {physics.rolling:g}",
        solref=f"{physics.stiffness_time:g} 1",
        solimp="0.95 0.99 0.001",
        condim="4",
    )
    assets = ElementTree.SubElement(root, "asset")
    scene = ElementTree.SubElement(root, "worldbody")
    _add_ground(world.ground, assets, scene)
    for body in world.bodies:
        _add_body(body, assets, scene)
    return root


def for_grips(root: ElementTree.Element) -> None:
    """Set what a world needs in which hands hold bodies."""
    option = root.find("option")
    assert option is not None
    option.set("impratio", f"{_FRICTION_STIFFNESS:g}")
    flag = option.find("flag")
    assert flag is not None
    # The native collider of 4.0 takes the end face of a fingertip for the normal
    # where its edge meets something round, and pops the hand off.
    flag.set("nativeccd", "disable")


def compiled(root: ElementTree.Element, world: World) -> Any:
    """Compile a world, and what was added to its tree."""
    model = mujoco().MjModel.from_xml_string(ElementTree.tostring(root, "unicode"))
    if not world.ground.is_level:
        low, span = world.ground.heights.min(), np.ptp(world.ground.heights)
        model.hfield_data[:] = ((world.ground.heights - low) / span).ravel()
    return model


def pose_of(data: Any, index: int) -> SE3:
    """Pose ``T_base_body`` of a body, by its position in the world."""
    values = data.qpos[7 * index : 7 * index + 7]
    return SE3.from_parts(so3.from_quat_wxyz(values[3:]), values[:3])


def _add_ground(
    ground: Ground, assets: ElementTree.Element, scene: ElementTree.Element
) -> None:
    geom = ElementTree.SubElement(scene, "geom", name="ground")
    if ground.is_level:
        geom.attrib.update(
            type="plane", size="0 0 1", pos=f"0 0 {ground.heights[0, 0]:.9g}"
        )
        return
    rows, columns = ground.heights.shape
    half = np.array([columns - 1, rows - 1]) * ground.spacing / 2
    center = np.array(ground.origin) + half
    low, span = ground.heights.min(), np.ptp(ground.heights)
    sizes = numbers([*half, span, 0.5])
    ElementTree.SubElement(
        assets, "hfield", name="ground", nrow=str(rows), ncol=str(columns), size=sizes
    )
    geom.attrib.update(type="hfield", hfield="ground", pos=numbers([*center, low]))


def _add_body(
    body: Body, assets: ElementTree.Element, scene: ElementTree.Element
) -> None:
    node = ElementTree.SubElement(scene, "body", name=body.name)
    node.attrib.update(placement(body.T_base_body))
    ElementTree.SubElement(node, "freejoint")
    for number, part in enumerate(body.parts):
        volume, _ = volume_and_centroid(part)
        geom = ElementTree.SubElement(node, "geom", mass=f"{volume * body.density:.9g}")
        if isinstance(part, (Hull, Box)):
            # Boxes go in as polytopes: between box primitives the set of contacts of an
            # edge flickers from step to step, and what lies there never comes to rest.
            name = f"{body.name}/{number}"
            vertices, _ = part.mesh()
            ElementTree.SubElement(
                assets,
                "mesh",
                name=name,
                vertex=numbers(vertices.ravel()),
                inertia="convex",
            )
            geom.attrib.update(type="mesh", mesh=name)
        else:
            geom.attrib.update(primitive(part))
        # Rolling friction costs two more constraints per contact; boxes don't roll.
        geom.set("condim", "4" if isinstance(part, Box) else "6")


def primitive(part: Cylinder | Capsule | Sphere) -> dict[str, str]:
    """Attributes of a geometry that MuJoCo has."""
    if isinstance(part, Sphere):
        return {
            "type": "sphere", "size": f"{part.radius:.9g}", "pos": numbers(part.center)
        }  # fmt: skip
    return {
        "type": "cylinder" if isinstance(part, Cylinder) else "capsule",
        "size": numbers([part.radius, part.length / 2]),
        **placement(part.T_frame_solid),
    }


def placement(pose: SE3) -> dict[str, str]:
    """Attributes that put a body or a geometry at a pose."""
    return {"pos": numbers(pose.p), "quat": numbers(so3.to_quat_wxyz(pose.R))}


def numbers(values: FloatArray | list[float]) -> str:
    """Numbers in MuJoCo's notation."""
    return " ".join(f"{value:.9g}" for value in values)
