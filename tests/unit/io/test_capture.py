"""The capture record: its checks, its poses, its cloud, saving and loading."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from debrisgrasp.errors import CaptureError, InputError, OutputError
from debrisgrasp.geometry import SE3
from debrisgrasp.io import Capture, measured, save_labels


def test_the_cloud_lies_where_the_camera_says(depth, camera, T_base_camera):
    cloud = Capture(depth=depth, intrinsics=camera, T_base_camera=T_base_camera).cloud()
    assert cloud.frame == "base"
    assert cloud.image_shape == depth.shape
    assert len(cloud) == np.count_nonzero(depth)
    assert_allclose(cloud.viewpoint, T_base_camera.p)
    v, u = np.divmod(cloud.pixels, depth.shape[1])
    uv, z = camera.project(T_base_camera.inverse().apply(cloud.points))
    assert_allclose(uv, np.stack([u, v], axis=-1), atol=1e-9)
    assert_allclose(z, depth[v, u])
    towards = ((cloud.viewpoint - cloud.points) * cloud.normals).sum(axis=1)
    assert (towards[np.isfinite(towards)] > 0).all()
    assert np.isfinite(towards).mean() > 0.98


@pytest.mark.parametrize("nothing", [0.0, np.nan, np.inf, -np.inf])
def test_nothing_measured_becomes_nan(depth, camera, nothing):
    depth = depth.copy()
    depth[depth == 0] = nothing
    if nothing < 0:
        with pytest.raises(CaptureError, match="negative"):
            Capture(depth=depth, intrinsics=camera)
        return
    capture = Capture(depth=depth, intrinsics=camera)
    assert np.isnan(capture.depth[:5, :5]).all()
    assert np.isnan(capture.depth).sum() == 25


def test_what_is_masked_was_not_measured(depth, camera):
    behind = np.zeros(depth.shape, dtype=bool)
    behind[10:14, 20:30] = True
    taken = Capture(depth=np.ma.array(depth, mask=behind), intrinsics=camera).depth
    plain = Capture(depth=np.where(behind, np.nan, depth), intrinsics=camera).depth
    assert_array_equal(taken, plain)
    cloud = np.random.default_rng(0).uniform(1.0, 2.0, (50, 3))
    masked = np.ma.array(cloud, mask=np.arange(50)[:, None].repeat(3, axis=1) < 10)
    points = Capture(points=masked, viewpoint=np.zeros(3)).points
    assert_array_equal(np.isnan(points).all(axis=1), np.arange(50) < 10)


@pytest.mark.parametrize("name", ["mask", "labels"])
def test_masked_labels_are_refused(depth, camera, name):
    image = np.ma.array(np.ones(depth.shape, dtype=int), mask=depth == 0)
    with pytest.raises(CaptureError, match=rf"{name}: got a masked array.*filled"):
        Capture(depth=depth, intrinsics=camera, **{name: image})


def test_labels_that_no_int32_holds_are_refused(depth, camera):
    labels = np.zeros(depth.shape, dtype=np.int64)
    labels[3, 4] = 2**32 + 1  # would be 1
    with pytest.raises(CaptureError, match=r"labels: .*4294967297.*at most"):
        Capture(depth=depth, intrinsics=camera, labels=labels)


def test_arrays_are_copied_and_read_only(depth, camera):
    capture = Capture(depth=depth, intrinsics=camera)
    depth[20, 20] = 9.0
    assert capture.depth[20, 20] < 9.0
    with pytest.raises(ValueError, match="read-only"):
        capture.depth[0, 0] = 1.0


def test_bad_depth_is_refused(depth, camera):
    cases = [
        (np.zeros_like(depth), "measured pixels"),
        (np.full_like(depth, np.nan), "measured pixels"),
        (np.where(np.arange(64) == 3, -1.0, depth), "negative"),
        (np.where(np.arange(64) == 3, 1e30, depth), "depth: got 48 values .* up to 1e"),
        ((depth * 1000).astype(np.uint16), "Divide by 1000"),
        (depth * 1000, "divide by 1000"),
        (depth > 0, "dtype of depth"),
        (depth.astype(str), "dtype of depth"),
        (depth[:24], "shape"),
        (depth[None], "image"),
    ]
    for bad, message in cases:
        with pytest.raises(CaptureError, match=message):
            Capture(depth=bad, intrinsics=camera)
    with pytest.raises(CaptureError, match="K"):
        Capture(depth=depth)


def test_lists_of_unequal_lengths_are_refused(depth, camera, points):
    ragged = [[1.0, 2.0, 3.0], [1.0]]
    for name in ("depth", "rgb", "mask", "labels"):
        given = {"depth": depth, "intrinsics": camera, name: ragged}
        with pytest.raises(CaptureError, match=rf"{name}: .*lists of equal lengths"):
            Capture(**given)
    for name in ("points", "viewpoint"):
        given = {"points": points, "viewpoint": [0.0, 0.0, 2.0], name: ragged}
        with pytest.raises(CaptureError, match=rf"{name}: .*lists of equal lengths"):
            Capture(**given)


@pytest.mark.parametrize("wrong", [{"cx": 1600.0}, {"fx": 1.0}, {"fy": 6e4}])
def test_intrinsics_that_a_file_may_not_have_make_no_capture(depth, camera, wrong):
    with pytest.raises(CaptureError, match=r"K: got fx .* Scale K together"):
        Capture(depth=depth, intrinsics=replace(camera, **wrong))


def test_a_capture_shows_itself_in_a_line(depth, camera, points, T_base_camera):
    image = Capture(depth=depth, intrinsics=camera, T_base_camera=T_base_camera)
    height, width = depth.shape
    assert repr(image) == (
        f"<Capture capture: depth of {width} x {height} pixels, T_base_camera>"
    )
    cloud = Capture(points=points, viewpoint=np.zeros(3), name="lidar")
    assert repr(cloud) == f"<Capture lidar: {len(points)} points>"


@pytest.mark.parametrize("pose", [np.eye(4), None, "tilted", [0, 0, 1]])
def test_only_a_transform_is_a_pose(depth, camera, pose):
    with pytest.raises(InputError, match="SE3"):
        Capture(depth=depth, intrinsics=camera).posed(pose)


def test_bad_points_are_refused(points):
    view = np.array([0.0, 0.0, 2.0])
    two = np.full((10, 3), np.nan)
    two[:2] = 1.0
    cases = [
        (points, None, "viewpoint"),
        (points, [0.0, 1.0], "viewpoint"),
        (points, ["a", "b", "c"], "viewpoint"),
        (points, [0.0, 0.0, np.nan], "viewpoint"),
        (points[:, :2], view, "points"),
        (points[:2], view, "at least 3"),
        (np.empty((0, 3)), view, "at least 3"),
        (two, view, "2 finite of 10"),
        ((points * 1000).astype(np.int32), view, "Divide by 1000"),
        (points * 1000, view, "divide by 1000"),
    ]
    for bad, viewpoint, message in cases:
        with pytest.raises(CaptureError, match=message):
            Capture(points=bad, viewpoint=viewpoint)


def test_depth_or_points_but_not_both(depth, camera, points):
    with pytest.raises(CaptureError, match="both"):
        Capture(depth=depth, intrinsics=camera, points=points, viewpoint=np.ones(3))
    with pytest.raises(CaptureError, match="neither"):
        Capture()


def test_images_that_do_not_match_are_refused(depth, camera):
    shape = depth.shape
    for field, bad, message in [
        ("rgb", np.zeros(shape, np.uint8), "rgb"),
        ("rgb", np.zeros((*shape, 3), np.float32), "uint8"),
        ("rgb", np.zeros((24, 64, 3), np.uint8), "rgb"),
        ("mask", np.zeros((64, 48), bool), "mask"),
        ("mask", np.zeros(shape), "bool"),
        ("labels", np.zeros((*shape, 1), int), "labels"),
        ("labels", np.zeros(shape), "integers"),
    ]:
        with pytest.raises(CaptureError, match=message):
            Capture(depth=depth, intrinsics=camera, **{field: bad})


@pytest.mark.parametrize("pose", ["T_base_camera", "T_level_camera"])
def test_poses_that_are_not_one_rigid_transform_are_refused(depth, camera, pose):
    for bad in (np.eye(4), SE3(np.tile(np.eye(4), (2, 1, 1)))):
        with pytest.raises(InputError, match=pose):
            Capture(depth=depth, intrinsics=camera, **{pose: bad})
    with pytest.raises(ValueError, match=pose):
        Capture(depth=depth, intrinsics=camera, **{pose: SE3(np.diag([1.0, 1, 2, 1]))})


@pytest.mark.parametrize("values", [(1, 2, 3), (-1,), (-1, 1)])
def test_a_mask_that_looks_like_labels_is_doubted(depth, camera, caplog, values):
    mask = np.zeros(depth.shape, dtype=np.int16)
    mask[0, : len(values)] = values
    taken = Capture(depth=depth, intrinsics=camera, mask=mask)
    assert taken.mask.sum() == len(values)
    assert f"values from {min(values)} to {max(values)}" in caplog.text


@pytest.mark.parametrize("value", [0, 1, 255])
def test_a_mask_of_one_value_is_not_doubted(depth, camera, caplog, value):
    Capture(depth=depth, intrinsics=camera, mask=np.full(depth.shape, value, np.uint8))
    assert not caplog.text


def test_without_a_pose_there_is_no_cloud_and_the_remedies_are_named(depth, camera):
    capture = Capture(depth=depth, intrinsics=camera)
    with pytest.raises(CaptureError, match="camera-pose") as caught:
        capture.cloud()
    assert "T_base_camera" in str(caught.value)
    assert "level" not in str(caught.value)
    level = Capture(depth=depth, intrinsics=camera, T_level_camera=SE3.identity())
    with pytest.raises(CaptureError, match="'level' takes"):
        level.cloud()


def test_the_level_frame_is_taken_only_when_asked_for(depth, camera, T_base_camera):
    capture = Capture(depth=depth, intrinsics=camera, T_level_camera=T_base_camera)
    with pytest.raises(CaptureError, match="only T_level_camera"):
        capture.cloud()
    assert_allclose(capture.posed("level").cloud().viewpoint, T_base_camera.p)
    with pytest.raises(CaptureError, match="no T_level_camera"):
        Capture(depth=depth, intrinsics=camera).posed("level")


def test_points_are_mapped_to_base_and_gaps_dropped(points, T_base_camera):
    holed = points.copy()
    holed[5] = np.nan
    capture = Capture(
        points=holed, viewpoint=np.array([0, 0, 2.0]), T_base_camera=T_base_camera
    )
    cloud = capture.cloud()
    assert len(cloud) == len(points) - 1
    assert cloud.pixels is None
    assert_allclose(cloud.points, T_base_camera.apply(np.delete(points, 5, axis=0)))
    assert_allclose(cloud.viewpoint, T_base_camera.apply([0, 0, 2.0]))
    normal = T_base_camera.rotate(np.array([-0.2, 0, 1]) / np.hypot(0.2, 1))
    assert_allclose(cloud.normals @ normal, 1.0, atol=1e-9)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_points_at_the_viewpoint_were_not_measured(points, T_base_camera, dtype):
    sight = np.array([0.1, 0.0, 1.5])  # 0.1 is another number in single precision
    points = points.astype(dtype)
    none = np.concatenate([points, np.repeat([sight], 5, axis=0).astype(dtype)])
    capture = Capture(points=none, viewpoint=sight, T_base_camera=T_base_camera)
    bare = Capture(points=points, viewpoint=sight, T_base_camera=T_base_camera)
    assert_array_equal(capture.cloud().points, bare.cloud().points)
    assert not measured(capture)[-5:].any()


def test_a_depth_capture_survives_saving(depth, camera, T_base_camera, rng, tmp_path):
    shape = depth.shape
    capture = Capture(
        depth=depth,
        intrinsics=camera,
        T_base_camera=T_base_camera,
        T_level_camera=SE3.identity(),
        rgb=rng.integers(0, 256, (*shape, 3), dtype=np.uint8),
        mask=rng.random(shape) < 0.5,
        labels=rng.integers(-1, 5, shape),
    )
    capture.save(tmp_path / "scene.npz")
    loaded = Capture.load(tmp_path / "scene.npz")
    assert loaded.name == "scene"
    assert loaded.intrinsics == camera
    for field in ("depth", "rgb", "mask", "labels"):
        assert_array_equal(getattr(loaded, field), getattr(capture, field))
    for field in ("T_base_camera", "T_level_camera"):
        assert_allclose(
            getattr(loaded, field).matrix, getattr(capture, field).matrix, atol=1e-15
        )
    assert loaded.mask.dtype == np.bool_


@pytest.mark.parametrize("offset", [0.0, 1e-9])
def test_points_survive_saving_to_the_last_digit(points, offset, tmp_path):
    capture = Capture(points=points + offset, viewpoint=np.array([0, 0, 2.0]))
    capture.save(tmp_path / "cloud.npz")
    loaded = Capture.load(tmp_path / "cloud.npz", camera_pose=SE3.identity())
    assert_array_equal(loaded.points, capture.points)
    assert_array_equal(loaded.viewpoint, capture.viewpoint)
    assert loaded.cloud().frame == "base"


def test_saving_elsewhere_than_to_npz_or_a_folder_that_exists_is_refused(
    depth, camera, tmp_path
):
    capture = Capture(depth=depth, intrinsics=camera)
    with pytest.raises(CaptureError, match="npz"):
        capture.save(tmp_path / "scene.png")
    with pytest.raises(OutputError):
        capture.save(tmp_path / "none" / "scene.npz")


@pytest.mark.parametrize("name", ["none.npz", "none", "scene.txt"])
def test_paths_that_lead_nowhere_are_refused(tmp_path, name):
    (tmp_path / "scene.txt").write_text("x")
    with pytest.raises(CaptureError, match=name):
        Capture.load(tmp_path / name)


def test_of_a_name_that_no_file_can_have_the_beginning_is_told(tmp_path):
    with pytest.raises(CaptureError, match=r"/x{77}\.\.\.: .*File name too long"):
        Capture.load(tmp_path / ("x" * 300))


def test_shared_captures_give_clouds_with_normals(shared_data):
    paths = sorted(shared_data.glob("*/*.npz"))
    assert paths
    for path in paths[::4]:
        capture = Capture.load(path)
        if capture.T_base_camera is None:
            has_level = capture.T_level_camera is not None
            capture = capture.posed("level" if has_level else SE3.identity())
        cloud = capture.cloud()
        assert np.isfinite(cloud.normals[:, 0]).mean() > 0.95


def test_points_too_far_for_single_precision_are_refused():
    points = np.random.default_rng(0).uniform(0, 1, (100, 3))
    points[7, 0] = 1e30
    with pytest.raises(CaptureError, match="1 value of 300 up to 1e"):
        Capture(points=points, viewpoint=np.zeros(3))


@pytest.mark.parametrize("name", ["a.npz", "a.ply", "a.pcd", "a.png"])
def test_what_git_lfs_left_in_the_place_of_a_file_is_named(tmp_path, name):
    path = tmp_path / name
    path.write_text(
        "version https://git-lfs.github.com/spec/v1\noid sha256:4d\nsize 9\n"
    )
    with pytest.raises(CaptureError, match=r"Git LFS.*git lfs pull"):
        Capture.load(path)


def test_labels_that_are_not_of_the_cloud_are_not_saved(depth, camera, tmp_path):
    capture, path = Capture(depth=depth, intrinsics=camera), tmp_path / "labels.npz"
    with pytest.raises(CaptureError, match=r"labels: got shape \(5,\)"):
        save_labels(capture, np.zeros(5, dtype=int), path)
    n_points = np.count_nonzero(measured(capture))
    with pytest.raises(CaptureError, match="labels: got dtype float64"):
        save_labels(capture, np.full(n_points, 1.7), path)
    assert not path.exists()
