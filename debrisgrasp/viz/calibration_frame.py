"""The frame in which a calibration is drawn."""

from __future__ import annotations

from dataclasses import dataclass

from debrisgrasp._arrays import FloatArray
from debrisgrasp.calibration import Calibration
from debrisgrasp.geometry import SE3

__all__ = ["Drawn"]


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """What is drawn, all in one frame: base, or that of a camera on an arm."""

    places: FloatArray
    """Of the fiducial [m], shape (n, 3)."""
    gaps: FloatArray
    """Measured less predicted places [m], shape (n, 3)."""
    camera: SE3
    covariance: FloatArray
    """Of the camera's pose, about the origin of the frame, shape (6, 6)."""
    where: str
    """Over what the predicted error is."""
    is_camera_frame: bool

    @classmethod
    def of(cls, c: Calibration) -> Drawn:
        """Take what is drawn of a calibration."""
        if c.link is None:
            places, camera = c.observations.points_base, c.T_link_camera
            return cls(
                places=places,
                gaps=c.gaps,
                camera=camera,
                covariance=c.covariance,
                where="over the workspace",
                is_camera_frame=False,
            )
        return cls(
            places=c.observations.points_camera,
            gaps=c.T_link_camera.inverse().rotate(c.gaps),
            camera=SE3.identity(),
            covariance=c.head_covariance,
            where="before the camera",
            is_camera_frame=True,
        )
