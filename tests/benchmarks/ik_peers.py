"""Other solvers, each asked one pose at a time, which is how they work.

All belong to the extra ``bench``; one that is not installed is skipped by name. Every
answer is judged by our forward kinematics, tolerances and limits, not by the peer.
"""

from __future__ import annotations

import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import KinematicChain
from tests.benchmarks.ik_robots import Arm

__all__ = ["PeerFigures", "measured_peers"]

Solver = Callable[[np.ndarray, np.ndarray], np.ndarray | None]
"""From a target (4, 4) and a seed (d,) to a posture, or None."""


@dataclass(frozen=True)
class PeerFigures:
    name: str
    microseconds: float
    """CPU time per pose of all its threads, mean; NaN where it is not installed."""
    solved: float
    """Share of the poses solved."""


def robotics_toolbox(chain: KinematicChain, _: Arm) -> Solver:
    """Levenberg-Marquardt in C++, Chan's damping, up to a hundred restarts."""
    from roboticstoolbox import ET, ETS
    from spatialmath import SE3 as Pose

    form = chain.form
    parts = [ET.SE3(Pose(form.T_base_first, check=False))]
    for i in range(chain.n_joints):
        if not chain.is_revolute[i]:
            raise ImportError("sliding joints are left out")
        T = np.eye(4)
        c, s = np.cos(form.offsets[i]), np.sin(form.offsets[i])
        T[:2, :2] = (c, -s), (s, c)
        limits = (float(chain.lower[i]), float(chain.upper[i]))
        parts.append(ET.Rz(jindex=i, qlim=limits))
        if i + 1 < chain.n_joints:
            M = np.eye(4)
            M[:3, :3], M[:3, 3] = form.rotations[i], form.shifts[i]
            T = T @ M
        else:
            T = T @ form.T_last_tip
        parts.append(ET.SE3(Pose(T, check=False)))
    ets = ETS(parts)

    def solve(T: np.ndarray, seed: np.ndarray) -> np.ndarray | None:
        # Its tolerance is half the squared error, in metres and radians.
        found = ets.ik_LM(T, q0=seed, tol=2e-9)
        return np.asarray(found.q).ravel() if found.success else None

    return solve


def trac_ik(chain: KinematicChain, *, timeout: float) -> Solver:
    """TRAC-IK, which runs KDL and a quadratic programme in two threads."""
    from trac_ik import TracIK

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "chain.urdf")
        path.write_text(bare_urdf(chain), encoding="utf-8")
        solver = TracIK(
            base_link_name="link0",
            tip_link_name="tip",
            urdf_path=str(path),
            timeout=timeout,
            epsilon=1e-5,
        )

    def solve(T: np.ndarray, seed: np.ndarray) -> np.ndarray | None:
        found = solver.ik(T[:3, 3], T[:3, :3], seed_jnt_values=seed)
        return None if found is None else np.asarray(found)

    return solve


def bare_urdf(chain: KinematicChain) -> str:
    """Write a chain as a URDF without anything that a solver might stumble over."""
    d = chain.n_joints
    links = "".join(f'<link name="link{i}"/>' for i in range(d + 1))
    T_last_tip = SE3.from_parts(p=-chain.points[-1]) @ chain.T_base_tip_at_zero
    previous = np.zeros(3)
    joints = ""
    for i in range(d):
        xyz, previous = chain.points[i] - previous, chain.points[i]
        kind = "revolute" if chain.is_revolute[i] else "prismatic"
        limits = ""
        if np.isfinite(chain.lower[i]):
            limits = (
                f'<limit lower="{chain.lower[i]}" upper="{chain.upper[i]}" '
                'effort="1" velocity="1"/>'
            )
        else:
            kind = "continuous"
        joints += (
            f'<joint name="joint{i}" type="{kind}"><parent link="link{i}"/>'
            f'<child link="link{i + 1}"/><origin xyz="{numbers(xyz)}"/>'
            f'<axis xyz="{numbers(chain.axes[i])}"/>{limits}</joint>'
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # any of the angles of a gimbal lock will do
        roll_pitch_yaw = Rotation.from_matrix(T_last_tip.R).as_euler("xyz")
    joints += (
        f'<link name="tip"/><joint name="end" type="fixed"><parent link="link{d}"/>'
        f'<child link="tip"/><origin xyz="{numbers(T_last_tip.p)}" '
        f'rpy="{numbers(roll_pitch_yaw)}"/></joint>'
    )
    return f'<robot name="bare">{links}{joints}</robot>'


def numbers(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)


def pinocchio_loop(chain: KinematicChain, arm: Arm) -> Solver:
    """The closed loop of pinocchio's documentation, a thousand damped steps."""
    import pinocchio as pin

    whole = pin.buildModelFromUrdf(str(arm.path))
    still = [
        whole.getJointId(name)
        for name in list(whole.names)[1:]
        if name not in chain.joint_names
    ]
    model = pin.buildReducedModel(whole, still, pin.neutral(whole))
    data = model.createData()
    tip, base = model.getFrameId(arm.tip), model.getFrameId(arm.base)
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    in_root = data.oMf[base].copy()

    def solve(T: np.ndarray, seed: np.ndarray) -> np.ndarray | None:
        goal, q = in_root * pin.SE3(T), seed.copy()
        for _ in range(1000):
            pin.framesForwardKinematics(model, data, q)
            gap = data.oMf[tip].actInv(goal)
            error = pin.log(gap).vector
            if np.linalg.norm(error) < 1e-4:
                return chain.clipped(q)
            J = pin.computeFrameJacobian(model, data, q, tip)
            J = -pin.Jlog6(gap.inverse()) @ J
            v = -J.T @ np.linalg.solve(J @ J.T + 1e-12 * np.eye(6), error)
            q = pin.integrate(model, q, 0.1 * v)
        return None

    return solve


_PEERS: dict[str, tuple[int, Callable[[KinematicChain, Arm], Solver]]] = {
    "Robotics Toolbox, C++": (500, robotics_toolbox),
    "TRAC-IK, 5 ms": (200, lambda chain, _: trac_ik(chain, timeout=0.005)),
    "TRAC-IK, 50 ms": (200, lambda chain, _: trac_ik(chain, timeout=0.05)),
    "pinocchio, documented loop": (20, pinocchio_loop),
}
"""How many poses each is asked, and what makes it."""


def measured_peers(
    arm: Arm, chain: KinematicChain, *, seed: int
) -> Iterator[PeerFigures]:
    """Figures of every peer; its reason instead where it can't take part."""
    for name, (n, make) in _PEERS.items():
        rng = np.random.default_rng(seed)
        targets = chain.fk(chain.sampled(n, rng=rng))
        seeds = chain.sampled(n, rng=rng)
        try:
            solve = make(chain, arm)
            solve(targets.matrix[0], seeds[0])
        except (ImportError, AttributeError, ValueError, RuntimeError) as error:
            yield PeerFigures(f"{name}: skipped, {error}", np.nan, np.nan)
            continue
        start = time.process_time()
        answers = [solve(T, q) for T, q in zip(targets.matrix, seeds, strict=True)]
        seconds = time.process_time() - start
        solved = [
            _is_right(chain, target, q)
            for target, q in zip(targets.matrix, answers, strict=True)
        ]
        yield PeerFigures(name, 1e6 * seconds / n, float(np.mean(solved)))


def _is_right(chain: KinematicChain, target: np.ndarray, q: np.ndarray | None) -> bool:
    if q is None or ((q < chain.lower - 1e-6) | (q > chain.upper + 1e-6)).any():
        return False
    error = (chain.fk(q).inverse() @ SE3(target)).log()
    return bool(np.linalg.norm(error[:3]) <= 1e-4 and np.linalg.norm(error[3:]) <= 1e-3)
