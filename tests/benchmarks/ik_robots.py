"""Arms on which inverse kinematics is measured."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from debrisgrasp._files import data_path
from debrisgrasp.kinematics import KinematicChain

__all__ = ["ARMS", "Arm"]


@dataclass(frozen=True)
class Arm:
    """A chain of a URDF; files of example-robot-data are skipped where absent."""

    suffix: str
    """What the names of its figures end with; the first arm's with nothing."""
    urdf: str
    base: str
    tip: str

    @property
    def path(self) -> Path | None:
        """URDF file, None if the package that has it is not installed."""
        if "/" not in self.urdf:
            return data_path("robots", self.urdf)
        spec = find_spec("cmeel")
        for root in spec.submodule_search_locations or () if spec else ():
            share = Path(root).parent / "cmeel.prefix/share/example-robot-data/robots"
            if (share / self.urdf).is_file():
                return share / self.urdf
        return None

    def chain(self) -> KinematicChain:
        return KinematicChain.from_urdf(self.path or self.urdf, self.base, self.tip)


ARMS = (
    Arm("", "roman.urdf", "torso_link", "right_hand"),
    Arm("_torso", "roman.urdf", "base_link", "right_hand"),
    Arm("_panda", "panda_description/urdf/panda.urdf", "panda_link0", "panda_link8"),
    Arm("_ur10", "ur_description/urdf/ur10_robot.urdf", "base_link", "tool0"),
    Arm(
        "_tiago",
        "tiago_description/robots/tiago.urdf",
        "torso_lift_link",
        "arm_7_link",
    ),
    Arm(
        "_talos",
        "talos_data/robots/talos_full_v2.urdf",
        "torso_2_link",
        "gripper_right_base_link",
    ),
    Arm("_xarm7", "xarm_description/urdf/xarm7.urdf", "link_base", "link7"),
)
"""RoMan's right arm without and with its torso joint, and arms of other makers."""
