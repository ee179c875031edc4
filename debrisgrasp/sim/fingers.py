"""Fingers as MuJoCo bodies with one drive each.

Phalanges carry the collision solids of the `GripperModel`. Each finger has one drive
that pulls all its moving joints, as a tendon over pulleys does: an underactuated
finger. Along its chain

- a joint at the root whose value the preshape fixes is rigid: the spread,
- the first joint that the closing table moves is driven with the full effort,
- later joints that the table moves are held to the first one by a stop and a weak
  spring, as a parallel linkage does, and may curl beyond it,
- later joints that the table leaves alone rest at a stop, held by a weak spring, and
  curl once the phalanx before them is blocked.

A later joint gets three quarters of the torque that would balance a force at the pad:
gripped at the pads the phalanges stay on their stops, and what touches nearer to the
palm is wrapped.

The drive doesn't yield when pushed back (a worm gear): it holds up to `break_away`
times its own effort.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from debrisgrasp._arrays import FloatArray, require_range
from debrisgrasp.geometry import Box, Solid
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.prototypes.hand_kinematics import Finger, Preshape
from debrisgrasp.worlds import volume_and_centroid
from debrisgrasp.worlds.body import as_part

from .model import numbers, placement, primitive

__all__ = ["FingerDrive", "HandPhysics", "Mechanism", "Skin"]

_CURL_RANGE = np.pi / 2
"""How far a joint turns that closes only when blocked [rad]."""
_CURL_SHARE = 0.75
_PRELOAD = 0.05
"""Effort of the springs that hold later joints at their stops, over the most."""
_WINDUP = 0.004
"""Travel of the pad over which a stalled drive builds up its effort [m]."""
_LEAST_MOTION = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class HandPhysics:
    """Contact and force of a hand; docs/physics.md gives the sources."""

    friction: float = 0.7
    """Coefficient between a pad and debris: rubber on wood, steel or concrete."""
    torsion: float = 0.005
    """Coefficient of torsional friction of a pad [m]."""
    grip_force: float | None = None
    """Force of all fingers of one side together [N]; None: the most the hand has."""
    break_away: float = 1.67
    """Force that pushes a stalled finger open, over its own."""
    closing_time: float = 3.5
    """Time from fully open to fully closed [s]."""
    spring_time: float = 0.006
    """Time constant of the contact springs [s]."""

    def __post_init__(self) -> None:
        require_range("friction", self.friction, 0.0, 5.0)
        require_range("torsion", self.torsion, 0.0, 1.0)
        if self.grip_force is not None:
            require_range("grip_force", self.grip_force, 0.1, 1e5)
        require_range("break_away", self.break_away, 1.0, 100.0)
        require_range("closing_time", self.closing_time, 0.05)
        require_range("spring_time", self.spring_time, 0.004)

    def force_of(self, hand: GripperModel) -> float:
        """Force of all fingers of one side together [N]."""
        return hand.max_force if self.grip_force is None else self.grip_force


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FingerDrive:
    """What closes one finger."""

    name: str
    """Of the finger, and of its tendon and actuator."""
    pulls: Mapping[str, float]
    """Torque on each joint for an effort of 1, by the joint's name."""
    span: tuple[float, float]
    """Travel of the drive from open to closed."""
    joints: Mapping[str, float]
    """Value of each joint at the opening of the approach [rad or m]."""
    start: float
    """Travel of the drive there."""
    effort: float
    """At which the pad presses with its share of the hand's force."""
    stiffness: float
    """Effort over travel of a stalled drive."""


class Skin:
    """Makes geometries of solids; of one density."""

    def __init__(self, density: float, physics: HandPhysics) -> None:
        self.density = density
        self.contact = {
            # Against the world only: fingers are kept apart by their own stops.
            "contype": "2",
            "conaffinity": "1",
            "priority": "1",
            "condim": "4",
            "friction": f"{physics.friction:g} {physics.torsion:g} 0.0001",
            "solref": f"{physics.spring_time:g} 1",
            "solimp": "0.95 0.99 0.001",
        }

    @classmethod
    def on(
        cls, palm: ElementTree.Element, hand: GripperModel, physics: HandPhysics
    ) -> Skin:
        """Cover a palm; the density is that of the whole hand."""
        links = [link for finger in hand.fingers for link in finger.links]
        solids = [*hand.palm, *(solid for link in links for solid in link.solids)]
        volume = sum(volume_and_centroid(as_part(solid))[0] for solid in solids)
        skin = cls(hand.mass / volume, physics)
        for solid in hand.palm:
            skin.cover(palm, solid)
        return skin

    def cover(self, node: ElementTree.Element, solid: Solid) -> None:
        """Give a body the geometry of a solid in its frame."""
        part = as_part(solid)
        mass = self.density * volume_and_centroid(part)[0]
        if isinstance(part, Box):
            form = {"type": "box", "size": numbers(part.half_extents)}
            form |= placement(part.T_frame_solid)
        else:
            form = primitive(part)  # type: ignore[arg-type]
        geom = ElementTree.SubElement(node, "geom", mass=f"{mass:.9g}")
        geom.attrib.update(self.contact | form)


class Mechanism:
    """One finger: which joints move, how they are coupled, and what drives them."""

    def __init__(
        self,
        hand: GripperModel,
        finger: Finger,
        shape: Preshape,
        width: float,
        physics: HandPhysics,
        time_step: float,
    ) -> None:
        self.finger, self.shape, self.time_step = finger, shape, time_step
        self.break_away = physics.break_away
        tables = [
            None if link.joint is None else shape.joints[link.joint.variable]
            for link in finger.links
        ]
        moved = [k for k, t in enumerate(tables) if t is not None and np.ptp(t) > 1e-9]
        self.leader = moved[0] if moved else None
        first = moved[0] if moved else len(tables)
        self.tables = {k: t for k, t in enumerate(tables) if t is not None}
        self.active = [k for k in self.tables if k >= first]
        if self.leader is None:
            return
        self.sense = self._senses()
        self.pull = self._pulls()
        travel = self._travel()
        peers = sum(other.side == finger.side for other in hand.fingers)
        force = physics.force_of(hand) / peers
        pad = -finger.side * finger.pad_position(shape.joints)[..., 0]
        command = float(np.interp(-width, -shape.openings, shape.commands))
        reach = 0.1 * np.ptp(shape.commands) * np.array([-1.0, 1.0])
        around = np.clip(command + reach, shape.commands[0], shape.commands[-1])
        gain = np.ptp(np.interp(around, shape.commands, pad)) / max(
            float(np.ptp(np.interp(around, shape.commands, travel))), _LEAST_MOTION
        )
        self.span = (float(travel[0]), float(travel[-1]))
        self.effort = force * float(gain)
        self.preload = _PRELOAD * hand.max_force / peers * float(gain)
        self.stiffness = self.effort * float(gain) / _WINDUP
        # Reflected inertia of the motor: what the time step can integrate.
        self.armature = self.stiffness * (4.0 * time_step) ** 2

    def name(self, k: int) -> str:
        """Name of the joint before a link."""
        return f"{self.finger.name}_{k}"

    def drive(self, command: float) -> FingerDrive:
        """Return what closes the finger, at a command of the approach."""
        return FingerDrive(
            name=self.finger.name,
            pulls={self.name(k): pull for k, pull in self.pull.items()},
            joints={
                self.name(k): float(np.interp(command, self.shape.commands, table))
                for k, table in self.tables.items()
                if k in self.active
            },
            span=self.span,
            start=float(np.interp(command, self.shape.commands, self._travel())),
            effort=self.effort,
            stiffness=self.stiffness,
        )

    def add(
        self,
        root: ElementTree.Element,
        palm: ElementTree.Element,
        skin: Skin,
        command: float,
    ) -> None:
        """Append bodies, joints and drive."""
        node = palm
        values = self.shape.values(command)
        for k, link in enumerate(self.finger.links):
            pose = link.T_parent_link
            is_active = k in self.active
            if link.joint is not None and not is_active:
                pose = pose @ link.joint.motion(values[link.joint.variable])
            node = ElementTree.SubElement(node, "body", gravcomp="1")
            node.attrib.update({"name": f"{self.finger.name}/{k}"} | placement(pose))
            if is_active:
                self._add_joint(node, k)
            for solid in link.solids:
                skin.cover(node, solid)
        if self.leader is not None:
            self._add_tendons(root)

    def _senses(self) -> dict[int, float]:
        """+1 where a rising joint value curls the finger like its first joint."""
        links = self.finger.links
        opened = {name: table[0] for name, table in self.shape.joints.items()}
        poses = self.finger.link_poses(opened)
        axes = {}
        for k in self.active:
            joint = links[k].joint
            assert joint is not None
            axes[k] = joint.sign * poses[k].rotate(joint.axis)
        assert self.leader is not None
        table = self.tables[self.leader]
        lead = np.sign(table[-1] - table[0]) * axes[self.leader]
        return {k: -1.0 if axis @ lead < 0 else 1.0 for k, axis in axes.items()}

    def _pulls(self) -> dict[int, float]:
        """Torque on each joint for an effort of 1."""
        assert self.leader is not None
        poses = self.finger.link_poses(self.shape.values(self.shape.commands[-1]))
        pad = poses[-1].apply(self.finger.pad)
        far = max(float(np.linalg.norm(pad - poses[self.leader].p)), 1e-6)
        pulls = {}
        for k in self.active:
            share = _CURL_SHARE * float(np.linalg.norm(pad - poses[k].p)) / far
            pulls[k] = self.sense[k] * (1.0 if k == self.leader else share)
        return pulls

    def _travel(self) -> FloatArray:
        """Travel of the drive over the commands of the closing table."""
        travel = sum(pull * self.tables[k] for k, pull in self.pull.items())
        return np.asarray(travel)

    def _add_joint(self, node: ElementTree.Element, k: int) -> None:
        joint, table = self.finger.links[k].joint, self.tables[k]
        assert joint is not None
        low, high = float(table.min()), float(table.max())
        element = ElementTree.SubElement(node, "joint", name=self.name(k))
        element.set("type", "slide" if joint.is_prismatic else "hinge")
        element.set("axis", numbers(joint.sign * joint.axis))
        element.set("armature", f"{self.armature:.6g}")
        element.set("damping", f"{0.02 * self.effort:.6g}")
        if k != self.leader and high - low < _LEAST_MOTION:
            curl = self.sense[k] * _CURL_RANGE
            low, high = min(low, low + curl), max(high, high + curl)
            stiffness = 0.3 * self.preload
            rest = float(table[0]) - self.sense[k] * self.preload / stiffness
            element.set("stiffness", f"{stiffness:.6g}")
            element.set("springref", f"{rest:.6g}")
        element.set("range", numbers([low - 1e-4, high + 1e-4]))
        element.set("limited", "true")

    def _add_tendons(self, root: ElementTree.Element) -> None:
        tendons = _section(root, "tendon")
        for k in self.active:
            if k != self.leader and np.ptp(self.tables[k]) > _LEAST_MOTION:
                self._couple(tendons, k)
        cable = ElementTree.SubElement(tendons, "fixed", name=self.finger.name)
        for k, pull in self.pull.items():
            ElementTree.SubElement(
                cable, "joint", joint=self.name(k), coef=f"{pull:.6g}"
            )
        limit = self.break_away * self.effort
        damping = np.sqrt(self.stiffness * self.armature)
        ElementTree.SubElement(
            _section(root, "actuator"),
            "general",
            name=self.finger.name,
            tendon=self.finger.name,
            gainprm=f"{self.stiffness:.6g}",
            biastype="affine",
            biasprm=f"0 {-self.stiffness:.6g} {-damping:.6g}",
            forcerange=numbers([-limit, limit]),
        )

    def _couple(self, tendons: ElementTree.Element, k: int) -> None:
        """Hold a later joint to the first one; it may curl, but not yield."""
        assert self.leader is not None
        lead, table = self.tables[self.leader], self.tables[k]
        slope = float((table[-1] - table[0]) / (lead[-1] - lead[0]))
        length = self.sense[k] * (table - slope * lead)
        # Preload over a spring so soft that it hardly changes with the curl.
        stiffness = 0.3 * self.preload
        link = ElementTree.SubElement(
            tendons,
            "fixed",
            name=f"{self.name(k)}_stop",
            limited="true",
            range=numbers([float(length.min()) - 1e-4, 10.0]),
            stiffness=f"{stiffness:.6g}",
            springlength=f"{float(length.min()) - 1.0 / 0.3:.6g}",
        )
        for joint, coefficient in (
            (self.name(k), self.sense[k]),
            (self.name(self.leader), -self.sense[k] * slope),
        ):
            ElementTree.SubElement(
                link, "joint", joint=joint, coef=f"{coefficient:.6g}"
            )


def _section(root: ElementTree.Element, name: str) -> ElementTree.Element:
    found = root.find(name)
    return ElementTree.SubElement(root, name) if found is None else found
