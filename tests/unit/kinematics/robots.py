"""Small robots written as URDF text, and the facts of the shipped one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml

from debrisgrasp._files import data_path
from debrisgrasp.kinematics import KinematicChain

ROMAN_URDF = data_path("robots", "roman.urdf")


@dataclass(frozen=True)
class JointText:
    """One joint of a serial chain, as it stands in a URDF."""

    kind: str = "revolute"
    xyz: Sequence[float] = (0.0, 0.0, 0.2)
    rpy: Sequence[float] = (0.0, 0.0, 0.0)
    axis: Sequence[float] = (0.0, 0.0, 1.0)
    lower: float = -2.0
    upper: float = 2.0
    extra: str = ""


def urdf_text(joints: Sequence[JointText], collision: str = "") -> str:
    """Links link0 to linkN in a row, joined by the joints joint1 to jointN."""

    def numbers(values: Sequence[float]) -> str:
        return " ".join(repr(float(value)) for value in values)

    links = "".join(
        f'<link name="link{i}">{collision}</link>' for i in range(len(joints) + 1)
    )
    parts = [
        f'<joint name="joint{i + 1}" type="{j.kind}">'
        f'<parent link="link{i}"/><child link="link{i + 1}"/>'
        f'<origin xyz="{numbers(j.xyz)}" rpy="{numbers(j.rpy)}"/>'
        f'<axis xyz="{numbers(j.axis)}"/>'
        f'<limit lower="{j.lower}" upper="{j.upper}" effort="1" velocity="1"/>'
        f"{j.extra}</joint>"
        for i, j in enumerate(joints)
    ]
    return f'<robot name="row">{links}{"".join(parts)}</robot>'


def written(folder: Path, joints: Sequence[JointText], collision: str = "") -> Path:
    path = folder / "row.urdf"
    path.write_text(urdf_text(joints, collision), encoding="utf-8")
    return path


def row_robot(
    folder: Path,
    collision: str,
    frames: Any = None,
    joint: JointText | None = None,
    **arm: Any,
) -> Path:
    """Write a robot of six joints in a row whose links have a collision element."""
    written(folder, [joint or JointText()] * 6, collision)
    content: dict[str, Any] = {"name": "row", "urdf": "row.urdf", "base": "link0"}
    if frames is not None:
        content["frames"] = frames
    content["arms"] = {
        "one": {
            "tip": "link6",
            "gripper": "none",
            "hand": "link6",
            "joints": [f"joint{i}" for i in range(1, 7)],
            "postures": {"zero": {}},
            "present": "zero",
            "idle": "zero",
            **arm,
        }
    }
    path = folder / "row.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


class PinocchioOracle:
    """Forward kinematics and body Jacobian of a chain by pinocchio."""

    def __init__(self, urdf: Path, chain: KinematicChain) -> None:
        self._model = pin.buildModelFromUrdf(str(urdf))
        self._data = self._model.createData()
        self._chain = chain

    def __call__(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        model, data, chain = self._model, self._data, self._chain
        configuration = pin.neutral(model)
        columns = []
        for name, value in zip(chain.joint_names, q, strict=True):
            joint = model.joints[model.getJointId(name)]
            columns.append(joint.idx_v)
            if joint.nq == 2:
                at = joint.idx_q
                configuration[at : at + 2] = np.cos(value), np.sin(value)
            else:
                configuration[joint.idx_q] = value
        pin.computeJointJacobians(model, data, configuration)
        pin.updateFramePlacements(model, data)
        base = data.oMf[model.getFrameId(chain.base)]
        tip_id = model.getFrameId(chain.tip)
        jacobian = pin.getFrameJacobian(model, data, tip_id, pin.LOCAL)
        pose = base.inverse() * data.oMf[tip_id]
        return pose.homogeneous, jacobian[:, columns]
