"""Pairs of parts that need no test, because they always or never touch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray

from .body import RobotBody
from .exact import ExactSolids
from .self_gaps import SelfModel
from .spheres import covering_spheres

__all__ = ["without_idle_pairs"]

_SEED = 3_405_691_582
_N_SAMPLES = 64
"""Postures in all of which two parts overlap if they are built that way."""
_EXCESS = 0.02


def without_idle_pairs(body: RobotBody, margin: float) -> RobotBody:
    """Leave out the pairs whose test would tell nothing.

    *Never*: parts that a single joint turns past one another, if the rings that their
    covering spheres sweep about its axis stay apart by the margin [m]. That is a proof.
    *Always*: parts that overlap in every one of 64 random postures, as neighbours do
    whose drawings were made so. Their links are listed in `RobotBody.always_touching`.
    """
    body = replace(body, pairs=body.pairs[~_never(body, margin)])
    always = _always(body)
    links = [(body.parts[i].link, body.parts[j].link) for i, j in body.pairs[always]]
    return replace(
        body, pairs=body.pairs[~always], always_touching=tuple(dict.fromkeys(links))
    )


def _never(body: RobotBody, margin: float) -> BoolArray:
    chain, parts = body.chain, body.parts
    at_zero = body.segment_poses(np.zeros((1, chain.n_joints)))[0]
    covers: dict[int, tuple[FloatArray, FloatArray]] = {}

    def rings(part: int, joint: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Height, radius and thickness of what the spheres sweep about an axis."""
        if part not in covers:
            covers[part] = covering_spheres(parts[part].solid, _EXCESS)
        centers, radii = covers[part]
        T = at_zero[parts[part].segment]
        offset = centers @ T[:3, :3].T + T[:3, 3] - chain.points[joint]
        height = offset @ chain.axes[joint]
        across = offset - height[:, None] * chain.axes[joint]
        return height, np.linalg.norm(across, axis=1), radii

    is_never = np.zeros(len(body.pairs), dtype=bool)
    for row, (i, j) in enumerate(body.pairs):
        joint = parts[i].segment - 1
        if parts[j].segment != joint or not chain.is_revolute[joint]:
            continue
        one, other = rings(i, joint), rings(j, joint)
        height, radius, thickness = (
            a[:, None] + sign * b
            for a, b, sign in zip(one, other, (-1.0, -1.0, 1.0), strict=True)
        )
        gap = np.hypot(height, radius) - thickness
        is_never[row] = gap.min() > margin + 1e-6
    return is_never


def _always(body: RobotBody) -> BoolArray:
    is_always = np.zeros(len(body.pairs), dtype=bool)
    # A property of the body, so its generator is a constant.
    q = body.chain.sampled(_N_SAMPLES, rng=np.random.default_rng(_SEED))
    gaps = SelfModel.fit(body, _EXCESS).gaps(q, 0.0, 0.0)
    counts = np.bincount(gaps.pair, minlength=len(body.pairs))
    suspects = np.flatnonzero(counts == _N_SAMPLES)
    if not len(suspects):
        return is_always
    exact = ExactSolids([part.solid for part in body.parts])
    poses = body.segment_poses(q)
    for row in suspects:
        i, j = body.pairs[row]
        a, b = body.parts[i].segment, body.parts[j].segment
        is_always[row] = all(exact.touch(i, T[a], j, T[b], 0.0) for T in poses)
    return is_always
