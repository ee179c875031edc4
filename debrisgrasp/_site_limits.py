"""What a site allows of what its robot could do."""

from __future__ import annotations

from dataclasses import dataclass, replace

from debrisgrasp._arrays import require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp._words import arm_called
from debrisgrasp.errors import ConfigError
from debrisgrasp.kinematics import ArmSpec, RobotModel

__all__ = ["SiteLimits"]


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class SiteLimits:
    """What this site allows of what the robot could do; None: all of it."""

    force: float | None = None
    """Largest force at the hand, absolute [N]."""
    torque: float | None = None
    """Largest torque at the hand, absolute [N m]."""
    joint_speed: float = 1.0
    """Share of the speed of each joint, in [0.001, 1]."""
    acceleration: float = 1.0
    """Share of the acceleration of each joint, in [0.001, 1]."""
    hand_speed: float = 0.1
    """Of the hand on approach and lift [m/s], in [0.001, 2]."""

    def __post_init__(self) -> None:
        for name in ("force", "torque"):
            if (value := getattr(self, name)) is not None:
                require_range(f"limits.{name}", value, 1e-3, 1e5)
        for name in ("joint_speed", "acceleration"):
            require_range(f"limits.{name}", getattr(self, name), 1e-3, 1.0)
        require_range("limits.hand_speed [m/s]", self.hand_speed, 1e-3, 2.0)

    def sets(self, what: str) -> bool:
        """Whether ``limits.force`` or ``limits.torque`` is this site's own."""
        own = {"limits.force": self.force, "limits.torque": self.torque}
        return own.get(what) is not None

    def of_robot(self, robot: RobotModel) -> RobotModel:
        """Return a robot that allows no more than this.

        Raises
        ------
        ConfigError
            If more force or torque is asked for than the robot's file allows.
        """
        joints = {
            name: replace(joint, velocity=self.joint_speed * joint.velocity)
            for name, joint in robot.tree.joints.items()
        }
        arms = {name: self._of_arm(spec, robot) for name, spec in robot.arms.items()}
        return replace(robot, tree=replace(robot.tree, joints=joints), arms=arms)

    def _of_arm(self, spec: ArmSpec, robot: RobotModel) -> ArmSpec:
        limits = dict(spec.limits)
        limits["acceleration"] *= self.acceleration
        for name in ("force", "torque"):
            if (value := getattr(self, name)) is None:
                continue
            if value > limits[name]:
                raise ConfigError(
                    f"limits.{name}",
                    got=value,
                    expected=f"at most {limits[name]:g}, the limit of the "
                    f"{arm_called(spec.name)} of {robot.name}",
                    mend="A site may only lower limits; those of the robot are in its "
                    "own file.",
                )
            limits[name] = value
        own = {j: self.acceleration * most for j, most in spec.accelerations.items()}
        return replace(spec, limits=limits, accelerations=own)
