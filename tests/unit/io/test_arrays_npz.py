"""NumPy archives: what is read, and how damaged ones are refused."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from debrisgrasp.errors import CaptureError
from debrisgrasp.geometry import SE3
from debrisgrasp.io import Capture, arrays_npz


@pytest.fixture
def saved(tmp_path):
    def save(**arrays):
        path = tmp_path / "scene.npz"
        np.savez_compressed(path, **arrays)
        return path

    return save


def test_unknown_arrays_are_ignored(saved, arrays):
    capture = Capture.load(saved(**arrays, names=np.array(["a", "b"])))
    assert capture.cloud().frame == "base"


def test_a_viewpoint_that_is_not_stored_may_be_given(saved, points):
    path = saved(points=points, T_base_camera=np.eye(4))
    capture = Capture.load(path, viewpoint=(0.47, 0.08, 1.19))
    assert_allclose(capture.viewpoint, [0.47, 0.08, 1.19])
    with pytest.raises(CaptureError, match="--viewpoint X Y Z"):
        Capture.load(path)


def test_a_given_pose_replaces_the_stored_one(saved, arrays):
    capture = Capture.load(saved(**arrays), camera_pose=SE3.identity())
    assert_allclose(capture.T_base_camera.matrix, np.eye(4))


def changed(arrays, **changes):
    merged = {**arrays, **changes}
    return {name: value for name, value in merged.items() if value is not None}


def pose_with(place, value):
    pose = np.eye(4)
    pose[place] = value
    return pose


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"K": None}, r"no 'K' beside 'depth' among depth, T_base_camera"),
        ({"depth": None}, "K, T_base_camera"),
        ({"depth": None, "points": np.ones((9, 3))}, "viewpoint"),
        ({"depth": np.full((48, 64), 1500, np.uint16)}, "Divide by 1000"),
        ({"depth": np.full((48, 64), 1500.0)}, "divide by 1000"),
        ({"depth": np.zeros((48, 64))}, "measured"),
        ({"depth": np.full((48, 64), np.nan)}, "measured"),
        ({"depth": np.full((48, 64), -1.0)}, "negative"),
        ({"depth": np.ones((48, 64, 1))}, "depth"),
        ({"depth": np.ones((480, 640))}, "Scale K"),
        ({"K": np.eye(3)}, "K"),
        ({"K": np.eye(4)}, "K"),
        ({"K": np.array([["a"] * 3] * 3)}, "K"),
        ({"T_base_camera": np.eye(3)}, "T_base_camera"),
        ({"T_base_camera": np.tile(np.eye(4), (2, 1, 1))}, "T_base_camera"),
        ({"T_base_camera": pose_with((0, 0), 1.5)}, "orthonormality"),
        ({"T_base_camera": pose_with((2, 2), -1.0)}, "left-handed"),
        ({"T_base_camera": pose_with((0, 3), np.nan)}, "NaN"),
        ({"T_base_camera": np.array("pose")}, "real numbers"),
        ({"T_level_camera": pose_with((0, 0), 1.5)}, "T_level_camera"),
        ({"rgb": np.zeros((48, 64), np.uint8)}, "rgb"),
        ({"mask": np.zeros((64, 48), bool)}, "mask"),
        ({"labels": np.zeros((48, 64))}, "labels"),
        ({"points": np.ones((9, 3)), "viewpoint": np.zeros(3)}, "both"),
        ({"labels": np.array([[None] * 64] * 48)}, "objects rather than numbers"),
    ],
    ids=str,
)
def test_arrays_that_make_no_capture_are_refused(saved, arrays, changes, message):
    path = saved(**changed(arrays, **changes))
    with pytest.raises(CaptureError, match=message) as caught:
        Capture.load(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("kept", [0, 10, 200, 0.3, 0.9, 0.99])
def test_truncated_archives_are_refused(saved, arrays, kept):
    path = saved(**arrays)
    content = path.read_bytes()
    size = kept if isinstance(kept, int) else int(kept * len(content))
    path.write_bytes(content[:size])
    with pytest.raises(CaptureError, match="archive"):
        Capture.load(path)


@pytest.mark.parametrize("kept", [10, 0.5, 0.99])
def test_of_a_truncated_archive_it_is_said_that_its_end_is_cut_off(saved, arrays, kept):
    path = saved(**arrays)
    content = path.read_bytes()
    size = kept if isinstance(kept, int) else int(kept * len(content))
    path.write_bytes(content[:size])
    with pytest.raises(CaptureError, match=r"cut off.*[Cc]opy it again") as caught:
        Capture.load(path)
    assert str(path) in str(caught.value)


def test_of_a_spoilt_archive_it_is_said_that_it_is_damaged(saved, arrays):
    path = saved(**arrays)
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(CaptureError, match=r"damaged.*[Cc]opy it again"):
        Capture.load(path)


def test_damaged_archives_are_refused_or_read_as_they_were(saved, arrays, rng):
    content = saved(**arrays).read_bytes()
    path = saved(**arrays)
    for place in rng.integers(0, len(content), 60):
        damaged = bytearray(content)
        damaged[place] ^= 0xFF
        path.write_bytes(damaged)
        try:
            capture = Capture.load(path)
        except CaptureError:
            continue
        assert capture.depth.shape == (48, 64)


def test_pickles_and_other_files_are_refused(tmp_path, arrays):
    import pickle

    for content in (pickle.dumps(arrays), b"not an archive", b"\x93NUMPY"):
        path = tmp_path / "scene.npz"
        path.write_bytes(content)
        with pytest.raises(CaptureError, match="archive"):
            Capture.load(path)


def test_an_archive_that_is_small_on_disk_alone_is_refused(saved, arrays, monkeypatch):
    path = saved(**arrays)
    size = sum(np.asarray(array).nbytes for array in arrays.values())
    monkeypatch.setattr(arrays_npz, "_MOST_BYTES", size)
    with pytest.raises(CaptureError, match=r"once unpacked.*every second pixel"):
        Capture.load(path)
    monkeypatch.setattr(arrays_npz, "_MOST_BYTES", 2 * size)
    assert Capture.load(path).depth.shape == (48, 64)


def test_a_single_array_under_the_name_of_an_archive_is_refused(tmp_path, depth):
    path = tmp_path / "scene.npz"
    with path.open("wb") as stream:
        np.save(stream, depth)
    with pytest.raises(CaptureError, match="archive"):
        Capture.load(path)
