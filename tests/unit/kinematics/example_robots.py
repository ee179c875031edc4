"""Arms of the optional package example-robot-data, as robots of this library."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import pytest
import yaml

from debrisgrasp.kinematics import RobotModel

_DATA = "share/example-robot-data/robots"


@dataclass(frozen=True)
class ExampleArm:
    urdf: str
    base: str
    tip: str
    hand: str
    joints: tuple[str, ...]
    posture: tuple[float, ...]


PANDA = ExampleArm(
    urdf="panda_description/urdf/panda.urdf",
    base="panda_link0",
    tip="panda_hand",
    hand="panda_hand",
    joints=tuple(f"panda_joint{i}" for i in range(1, 8)),
    posture=(0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785),
)
UR10 = ExampleArm(
    urdf="ur_description/urdf/ur10_robot.urdf",
    base="base_link",
    tip="tool0",
    hand="ee_link",
    joints=(
        "shoulder_pan_joint",
        "shoulder_lift_joint",
        "elbow_joint",
        "wrist_1_joint",
        "wrist_2_joint",
        "wrist_3_joint",
    ),
    posture=(0.0, -1.2, 1.5, -1.9, -1.57, 0.0),
)


def urdf_of(arm: ExampleArm) -> Path | None:
    """File of an arm, or None where the package is not installed."""
    spec = find_spec("cmeel")
    for root in spec.submodule_search_locations or () if spec else ():
        path = Path(root).parent / "cmeel.prefix" / _DATA / arm.urdf
        if path.is_file():
            return path
    return None


def load(arm: ExampleArm, folder: Path) -> RobotModel | None:
    """Load an arm by a robot file written to a folder; None where there is no URDF."""
    urdf = urdf_of(arm)
    if urdf is None:
        return None
    ready = dict(zip(arm.joints, arm.posture, strict=True))
    content = {
        "name": Path(arm.urdf).stem,
        "urdf": str(urdf),
        "base": arm.base,
        "arms": {
            "arm": {
                "tip": arm.tip,
                "gripper": "none",
                "hand": arm.hand,
                "joints": list(arm.joints),
                "postures": {"ready": ready},
                "present": "ready",
                "idle": "ready",
            }
        },
    }
    path = folder / f"{content['name']}.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return RobotModel.load(path)


def loaded_or_skip(arm: ExampleArm, folder: Path) -> RobotModel:
    robot = load(arm, folder)
    if robot is None:
        pytest.skip("example-robot-data is not installed")
    return robot
