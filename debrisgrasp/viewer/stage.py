"""The three-dimensional scene of a viewer: clouds, hands, robot, lines."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.geometry import SE3, Solid, so3
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.viz.colors import ROBOT_COLOR
from debrisgrasp.viz.scene import ground_grid, merged

__all__ = ["Color", "RobotFigure", "Stage", "place"]

Color = tuple[float, float, float]


def place(handle: Any, T_base_own: SE3) -> None:
    """Move something that is drawn."""
    handle.wxyz = so3.to_quat_wxyz(T_base_own.R)
    handle.position = T_base_own.p


class Stage:
    """Draws into the scene of a server; things are known by their names."""

    def __init__(self, server: Any) -> None:
        self.server = server
        self.scene = server.scene
        self.scene.set_up_direction("+z")

    def points(
        self, name: str, points: FloatArray, colors: FloatArray | Color, size: float
    ) -> Any:
        """Draw points [m], shape (n, 3), in colours (n, 3) or one for all."""
        return self.scene.add_point_cloud(
            name,
            points=points.astype(np.float32),
            colors=_bytes(colors, len(points)),
            point_size=size,
            point_shape="rounded",
            precision="float32",
        )

    def solids(
        self,
        name: str,
        solids: Iterable[Solid],
        color: Color,
        *,
        pose: SE3 | None = None,
        opacity: float | None = None,
        visible: bool = True,
    ) -> Any:
        """Draw solids as one mesh, in a frame at a pose in base."""
        mesh = merged(solids, color)
        return self.mesh(
            name,
            mesh.vertices,
            mesh.faces,
            color,
            pose=pose,
            opacity=opacity,
            visible=visible,
        )

    def mesh(
        self,
        name: str,
        vertices: FloatArray,
        faces: IntArray,
        color: Color,
        *,
        pose: SE3 | None = None,
        opacity: float | None = None,
        visible: bool = True,
    ) -> Any:
        """Draw a mesh [m] in a frame at a pose in base."""
        T = SE3.identity() if pose is None else pose
        return self.scene.add_mesh_simple(
            name,
            vertices=vertices.astype(np.float32),
            faces=faces.astype(np.uint32),
            color=tuple(int(v) for v in _bytes(color, 1)[0]),
            flat_shading=True,
            side="double",
            opacity=opacity,
            wxyz=so3.to_quat_wxyz(T.R),
            position=T.p,
            visible=visible,
        )

    def lines(self, name: str, segments: FloatArray, color: Color) -> Any:
        """Draw straight lines between pairs of points (l, 2, 3) [m]."""
        colors = np.broadcast_to(_bytes(color, 1)[0], segments.shape)
        return self.scene.add_line_segments(
            name, points=segments.astype(np.float32), colors=colors, thickness=0.002
        )

    def grid(self, around: FloatArray) -> None:
        """Draw the ground below points, a line each 10 cm."""
        if len(around):
            span = np.percentile(around, [1, 99], axis=0)
            self.lines("/ground", ground_grid(span, 0.1), (0.75, 0.78, 0.82))

    def frame(self, name: str, pose: SE3, length: float = 0.1) -> Any:
        """Draw the axes of a frame."""
        return self.scene.add_frame(
            name,
            axes_length=length,
            axes_radius=length / 25,
            wxyz=so3.to_quat_wxyz(pose.R),
            position=pose.p,
        )

    def look(self, target: FloatArray, eye: FloatArray) -> None:
        """Let all who have or open the page look from a place at another, base [m]."""
        self.server.initial_camera.up = (0.0, 0.0, 1.0)
        clients = self.server.get_clients().values()
        cameras = [client.camera for client in clients]
        for camera in (self.server.initial_camera, *cameras):
            camera.position = tuple(float(v) for v in eye)
            camera.look_at = tuple(float(v) for v in target)

    def remove(self, name: str) -> None:
        """Take something off the stage, and all below it."""
        self.scene.remove_by_name(name)


class RobotFigure:
    """A robot whose links are moved, not drawn anew."""

    def __init__(self, stage: Stage, robot: RobotModel) -> None:
        self.robot = robot
        rest = robot.link_poses()
        by_link: dict[str, list[Solid]] = {}
        for link, solid in robot.links_solids():
            by_link.setdefault(link, []).append(solid.moved(rest[link].inverse()))
        self._links = {
            link: stage.solids(f"/robot/{link}", solids, ROBOT_COLOR, pose=rest[link])
            for link, solids in by_link.items()
        }
        self._is_shown = True
        self._hidden: frozenset[str] = frozenset()

    def stand(
        self, joints: Mapping[str, float] | None = None, hides: str | None = None
    ) -> None:
        """Take a posture; the hand of the arm ``hides`` is left to be drawn apart."""
        poses = self.robot.link_poses(joints)
        self._hidden = frozenset()
        if hides is not None:
            arm = self.robot.arm(hides)
            self._hidden = self.robot.tree.links_below(arm.hand)
        for link, handle in self._links.items():
            place(handle, poses[link])
            handle.visible = self._is_shown and link not in self._hidden

    def show(self, *, is_shown: bool) -> None:
        """Show or hide all of it."""
        self._is_shown = is_shown
        for link, handle in self._links.items():
            handle.visible = is_shown and link not in self._hidden


def _bytes(colors: FloatArray | Color, n: int) -> np.ndarray[Any, np.dtype[np.uint8]]:
    wide = np.broadcast_to(np.asarray(colors, dtype=np.float64), (n, 3))
    return np.rint(np.clip(wide, 0.0, 1.0) * 255.0).astype(np.uint8)
