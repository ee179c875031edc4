"""Where a calibrated camera is, whether it was fitted just now or read from a file."""

from __future__ import annotations

from dataclasses import dataclass

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3

from .head import Head
from .observations import require_in_base
from .uncertainty import checked_covariance

__all__ = ["CalibratedCamera", "Known"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Known:
    """What is known about the camera before it is calibrated."""

    head: Head
    """As the robot's model, or an earlier calibration, has it."""
    mount_covariance: FloatArray | None = None
    """Of the twist of the camera in its own frame that corrects the mount of ``head``,
    from an earlier calibration, shape (6, 6); None if ``head`` is only nominal."""

    def __post_init__(self) -> None:
        if self.mount_covariance is not None:
            covariance = checked_covariance(
                self.mount_covariance, "covariance of the mount", 6
            )
            object.__setattr__(self, "mount_covariance", covariance)

    def __repr__(self) -> str:
        mount = "nominal" if self.mount_covariance is None else "calibrated"
        return f"<Known {mount} mount of {self.head}>"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CalibratedCamera:
    """Pose of a camera, what carries it, and how well both are known."""

    T_link_camera: SE3
    """Pose of the optical frame in `link` while the head reads `reference`."""
    link: str | None
    """Link of the arm that carries the camera; None for base, where none does."""
    covariance: FloatArray
    """Of that pose, shape (6, 6): twist (v, omega) [m, rad] about the origin of the
    link, in its axes, ``T_true = exp(twist) @ T_link_camera``."""
    head: Head
    """What carries the camera, with mount and offsets as fitted."""
    reference: FloatArray
    """Readings of the head's joints that `T_base_camera` belongs to [rad], (k,)."""
    fit_covariance: FloatArray
    """Of the twist of the mount in the camera frame, of the head's k offsets and of
    `fiducial`, shape (9 + k, 9 + k); zero for what was not fitted."""
    fiducial: FloatArray
    """Shift of the fiducial from where the model has it, frame of its link [m]."""

    @property
    def head_covariance(self) -> FloatArray:
        """Of the mount and the offsets, shape (6 + k, 6 + k)."""
        return self.fit_covariance[:-3, :-3]

    @property
    def T_base_camera(self) -> SE3:
        """Pose of the camera in base.

        Raises
        ------
        ConfigError
            If an arm carries the camera: where it is then depends on the joints.
        """
        require_in_base(self._called, self.link)
        return self.T_link_camera

    @property
    def known(self) -> Known:
        """What the next calibration may start from."""
        return Known(head=self.head, mount_covariance=self.head_covariance[:6, :6])

    @property
    def _called(self) -> str:
        """What errors call it."""
        return "calibration"
