"""Records copy what others may write to, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp._arrays import frozen, sealed


def test_what_is_sealed_already_is_not_copied():
    array = sealed(np.ones((4, 3)))
    assert frozen(array, "points", (3,)) is array


@pytest.mark.parametrize(
    "made",
    [
        lambda array: array,
        lambda array: np.broadcast_to(array, array.shape),
        lambda array: sealed(array[:2]),
        lambda array: sealed(array.astype(np.float32)),
    ],
    ids=["writable", "read-only view", "sealed view", "other type"],
)
def test_what_others_can_write_to_is_copied_and_read_only(made):
    array = np.ones((4, 3))
    copy = frozen(made(array), "points", (3,))
    array[:] = 2.0
    assert (copy == 1.0).all()
    assert copy.dtype == np.float64
    assert not copy.flags.writeable
