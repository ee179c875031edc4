"""Poses of the segments of a chain for thousands of postures, lanes last.

The solids of a segment are carried by the frame of its joint, in which the pose comes
out of the forward kinematics at no further cost.
"""

from __future__ import annotations

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3

from .chain import KinematicChain
from .serial import Lanes

__all__ = ["SegmentLanes", "carried", "joint_frames_of_segments"]


class SegmentLanes:
    """Frames of the joints that carry the segments, in single precision."""

    def __init__(self, chain: KinematicChain, q: FloatArray) -> None:
        lanes = np.ascontiguousarray(q.T, dtype=np.float32)
        self.n_postures = len(q)
        self._frames = chain.single_form.frames(lanes)
        self._known: dict[int, tuple[Lanes, Lanes]] = {}

    def pose(self, segment: int) -> tuple[Lanes, Lanes]:
        """Rotation (3, 3, n) and origin (3, n) of segment 1 to d.

        They are in the frame of the first joint at zero, which is that of segment 0.
        """
        if segment not in self._known:
            frames, i = self._frames, segment - 1
            turn = frames.turns[i]
            R = np.empty((3, *turn.shape), dtype=np.float32)
            R[:, 0], R[:, 1], R[:, 2] = turn.real, turn.imag, frames.axes[:, i]
            self._known[segment] = R, frames.origins[:, i]
        return self._known[segment]

    def relative(self, segment: int, other: int) -> tuple[Lanes, Lanes]:
        """Pose of a segment in the frame of an earlier one."""
        R, p = self.pose(segment)
        if other == 0:
            return R, p
        R_other, p_other = self.pose(other)
        gap = p - p_other
        turned = (R_other[:, :, None] * R[:, None]).sum(axis=0)
        return turned, (R_other * gap[:, None]).sum(axis=0)


def carried(R: Lanes, p: Lanes, points: Lanes) -> Lanes:
    """Points (3, s) moved by rotations (3, 3, n) and (3, n), shape (3, s, n)."""
    out = np.empty((3, points.shape[1], p.shape[1]), dtype=np.float32)
    for axis in range(3):
        np.matmul(points.T, R[axis], out=out[axis])
        out[axis] += p[axis]
    return out


def joint_frames_of_segments(chain: KinematicChain) -> list[SE3]:
    """Pose of every segment's own frame (see `BodyPart`) in that of its joint."""
    form = chain.form
    poses = [np.linalg.inv(form.T_base_first)]
    for at_zero, point in zip(form.frames_at_zero, chain.points, strict=True):
        poses.append(np.linalg.inv(at_zero) @ SE3.from_parts(p=point).matrix)
    return [SE3.from_matrix(pose) for pose in poses]
