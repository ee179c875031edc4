"""Records copy what others may write to, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp._arrays import as_floats, as_given, finite, frozen, sealed, unmasked
from debrisgrasp.errors import InputError, ShapeError


def test_what_is_sealed_already_is_not_copied():
    array = np.ones((4, 3))
    found = frozen(sealed(array), "points", (3,))
    assert type(found) is np.ndarray
    assert np.shares_memory(found, array)
    with pytest.raises(ValueError, match="WRITEABLE"):
        found.flags.writeable = True


def test_what_is_locked_by_its_owner_is_copied():
    """Who locked it can unlock it, or has a view from before."""
    array = np.ones((4, 3))
    view = array[:]
    array.flags.writeable = False
    copy = frozen(array, "points", (3,))
    view[0] = 2.0
    array.flags.writeable = True
    array[1] = 2.0
    assert (copy == 1.0).all()


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


def test_floats_are_not_copied_and_lists_become_some():
    array = np.ones((4, 3))
    assert as_floats(array, "points", (3,)) is array
    assert as_floats([[1, 2, 3]], "points", (3,)).dtype == np.float64


def test_marks_are_taken_as_they_are_unless_masked():
    assert as_given([True, False], "mark").dtype == np.bool_
    nothing_masked = np.ma.array([1, 2], mask=False)
    np.testing.assert_array_equal(as_given(nothing_masked, "labels"), [1, 2])
    with pytest.raises(InputError, match=r"labels: got a masked array.*filled\(0\)"):
        as_given(np.ma.array([1, 2], mask=[False, True]), "labels")
    with pytest.raises(ShapeError, match=r"mark: .*equal lengths"):
        as_given([[True], [True, False]], "mark")


@pytest.mark.parametrize("convert", [as_floats, frozen])
def test_what_is_masked_becomes_nan(convert):
    array = np.ma.array(np.ones((2, 3)), mask=[[True, False, False], [False] * 3])
    found = convert(array, "points", (3,))
    assert type(found) is np.ndarray
    np.testing.assert_array_equal(found, [[np.nan, 1.0, 1.0], [1.0] * 3])
    assert unmasked(np.ones(3)).tolist() == [1.0] * 3


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "array",
    [
        "abc",
        [[1.0, 2.0], [3.0]],
        {"x": 1.0},
        np.ones(4),
        np.ones(3, dtype=complex),
        np.ma.array([1, 2, 3], mask=[True, False, False]),
    ],
)
def test_what_is_no_array_of_numbers_is_named(array):
    with pytest.raises(ShapeError, match="points"):
        as_floats(array, "points", (3,))


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (np.ones(3), r"shape of points: got \(3,\), expected \(n, 3\)"),
        (np.ones((2, 4)), r"shape of points: got \(2, 4\), expected \(n, 3\)"),
        (np.ones((5, 2, 3)), r"got \(5, 2, 3\), expected \(n, 3\)"),
        ([[1.0, 2.0, np.inf]], "points: got 1 of 3 values NaN or infinite"),
        ("here", "points: got str"),
    ],
)
def test_numbers_of_another_shape_or_not_finite_are_told(array, words):
    with pytest.raises(InputError, match=words):
        finite(array, "points", (None, 3))


def test_finite_numbers_are_copied_and_read_only():
    array = np.ones((2, 3))
    copy = finite(array, "points", (2, 3))
    array[:] = 2.0
    assert (copy == 1.0).all()
    assert not copy.flags.writeable
