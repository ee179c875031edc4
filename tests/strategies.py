"""Hypothesis strategies for poses, twists and points."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3, so3

__all__ = ["batches", "points", "poses", "rotvecs", "twists", "unit_vectors", "vectors"]

_coordinate = st.floats(-3.0, 3.0, allow_nan=False, width=64)
batches = st.sampled_from([(), (1,), (4,), (2, 3)])


def vectors(size: int = 3) -> st.SearchStrategy[FloatArray]:
    return st.lists(_coordinate, min_size=size, max_size=size).map(np.array)


unit_vectors = (
    vectors()
    .filter(lambda v: np.linalg.norm(v) > 1e-2)
    .map(lambda v: v / np.linalg.norm(v))
)

angles = st.one_of(
    st.floats(0.0, np.pi - 1e-3),
    st.sampled_from([0.0, 1e-300, 1e-12, 1e-8, 9.9e-5, 1.1e-4, 9.9e-3, 1.1e-2]),
    st.sampled_from([1e-3, 1e-6, 1e-9, 1e-12]).map(lambda gap: np.pi - gap),
)
"""Angles in [0, pi), crowded where series take over and where logarithms are hard."""

rotvecs = st.builds(lambda axis, angle: axis * angle, unit_vectors, angles)
twists = st.builds(lambda v, omega: np.concatenate([v, omega]), vectors(), rotvecs)
poses = st.builds(
    lambda omega, p: SE3.from_parts(so3.exp(omega), p), rotvecs, vectors()
)
points = st.integers(1, 6).flatmap(
    lambda n: vectors(3 * n).map(lambda flat: flat.reshape(n, 3))
)
