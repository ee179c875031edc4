"""Depth PNG with a camera file: alone, as a pair, in a folder."""

from __future__ import annotations

import json

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

from debrisgrasp.errors import CaptureError, ConfigError
from debrisgrasp.io import Capture
from debrisgrasp.io.depth_images import files_read, load_camera

from .conftest import HEIGHT, WIDTH, K


@pytest.fixture
def info(T_base_camera):
    return {
        "width": WIDTH,
        "height": HEIGHT,
        "K": K.ravel().tolist(),
        "D": [0.0] * 5,
        "T_base_camera": T_base_camera.matrix.tolist(),
    }


@pytest.fixture
def folder(tmp_path, depth, info):
    Image.fromarray(np.round(depth * 1000).astype(np.uint16)).save(
        tmp_path / "depth.png"
    )
    (tmp_path / "camera.json").write_text(json.dumps(info))
    return tmp_path


def rewrite(folder, info, **changes):
    merged = {**info, **changes}
    kept = {name: value for name, value in merged.items() if value is not None}
    (folder / "camera.json").write_text(json.dumps(kept))


def test_folder_and_image_and_pair_give_the_same_capture(
    folder, depth, T_base_camera, info
):
    (folder / "elsewhere").mkdir()
    other = folder / "elsewhere" / "left.yaml"
    other.write_text(yaml.safe_dump(info))
    captures = [
        Capture.load(folder),
        Capture.load(folder / "depth.png"),
        Capture.load(folder / "depth.png", camera_file=other),
    ]
    expected = np.where(depth > 0, np.round(depth * 1000) / 1000, np.nan)
    for capture in captures:
        assert_allclose(capture.depth, expected, atol=1e-9)
        assert_allclose(capture.T_base_camera.matrix, T_base_camera.matrix, atol=1e-12)
        assert_allclose(capture.intrinsics.matrix, K)


def test_colours_mask_and_labels_of_a_folder_are_read(folder, rng):
    rgb = rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    mask = rng.random((HEIGHT, WIDTH)) < 0.3
    labels = rng.integers(0, 7, (HEIGHT, WIDTH), dtype=np.uint8)
    Image.fromarray(rgb).save(folder / "rgb.png")
    Image.fromarray((mask * 255).astype(np.uint8)).save(folder / "mask.png")
    Image.fromarray(labels).save(folder / "labels.png")
    capture = Capture.load(folder)
    assert_array_equal(capture.rgb, rgb)
    assert_array_equal(capture.mask, mask)
    assert_array_equal(capture.labels, labels)


def test_a_palette_that_swaps_black_and_white_makes_no_mask(folder, rng):
    marked = rng.random((HEIGHT, WIDTH)) < 0.3
    for colors, numbers in (((0, 255), marked), ((255, 0), ~marked)):
        mask = Image.fromarray(numbers.astype(np.uint8))
        mask.putpalette([level for level in colors for _ in "rgb"])
        assert_array_equal(np.array(mask.convert("L")) > 0, marked)
        mask.save(folder / "mask.png")
        if colors[0] == 0:
            assert_array_equal(Capture.load(folder).mask, marked)
            continue
        with pytest.raises(CaptureError, match=r"mask\.png: got a palette .* grey"):
            Capture.load(folder)


def test_the_scale_of_the_camera_file_and_lower_case_keys_count(folder, info, depth):
    rewrite(folder, info, K=None, k=K.tolist(), depth_scale=0.0005)
    capture = Capture.load(folder)
    assert_allclose(np.nanmax(capture.depth), depth.max() / 2, atol=1e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"K": None}, "width, height, D, T_base_camera"),
        ({"K": [1.0, 2.0]}, r"2 numbers.*9 numbers.*\[fx, 0, cx, 0, fy, cy, 0, 0, 1\]"),
        ({"K": {"fx": 600.0, "fy": 600.0}}, r"fx, fy.*9 numbers.*\[fx, 0, cx"),
        ({"K": ["a"] * 9}, "numbers"),
        ({"K": [0.0] * 9}, "K"),
        ({"k": [700.0, 0, 320, 0, 700.0, 240, 0, 0, 1]}, "K and k .*two that differ"),
        ({"D": [0.1, 0, 0, 0, 0]}, "Rectify"),
        ({"D": ["nan"] * 5}, "no distortion"),
        (
            {"D": None, "distortion_coefficients": {"rows": 1, "data": [0.1, 0.0]}},
            "Rectify",
        ),
        ({"depth_scale": 0}, "depth_scale"),
        ({"depth_scale": "mm"}, "depth_scale"),
        ({"depth_scale": 1}, "millimetres"),
        ({"depthscale": 0.001}, "depthscale, expected depth_scale"),
        ({"width": 640, "height": 480}, "Scale K"),
        ({"width": "wide"}, "height, width in .*numbers"),
        ({"width": 20.5}, "whole numbers of pixels"),
        ({"T_base_camera": [1, 2, 3]}, "4x4"),
        ({"T_base_camera": np.diag([1, 1, -1, 1]).tolist()}, "left-handed"),
        ({"T_base_camera": "here"}, "4x4"),
    ],
    ids=str,
)
def test_camera_files_that_do_not_fit_are_refused(folder, info, changes, message):
    rewrite(folder, info, **changes)
    with pytest.raises((CaptureError, ConfigError), match=message):
        Capture.load(folder)


def test_a_camera_is_read_without_an_image(folder, info):
    place = folder / "camera.json"
    assert_allclose(load_camera(place).matrix, K)
    rewrite(folder, info, width=None, height=None)
    assert_allclose(load_camera(place).matrix, K)


@pytest.mark.parametrize(
    "changes",
    [
        {"K": None},
        {"K": [0.0] * 9},
        {"K": [float("nan")] * 9, "width": None},
        {"K": [0.0] * 9, "width": None},
        {"width": 6400, "height": 4800},
        {"depth_scale": 0},
    ],
    ids=str,
)
def test_a_camera_that_no_image_fits_names_its_file(folder, info, changes):
    rewrite(folder, info, **changes)
    with pytest.raises(ConfigError, match=r"camera\.json"):
        load_camera(folder / "camera.json")


@pytest.mark.parametrize("text", ["{", "[1, 2]", ""])
def test_malformed_camera_files_are_named(folder, text):
    (folder / "camera.json").write_text(text)
    with pytest.raises(ConfigError, match=r"camera\.json"):
        Capture.load(folder)


def test_missing_files_are_listed(folder):
    (folder / "camera.json").unlink()
    with pytest.raises(CaptureError, match=r"camera\.yaml"):
        Capture.load(folder)
    (folder / "depth.png").unlink()
    with pytest.raises(CaptureError, match="nothing"):
        Capture.load(folder)
    Image.new("I;16", (WIDTH, HEIGHT)).save(folder / "depth.png")
    with pytest.raises(ConfigError, match=r"none\.json"):
        Capture.load(folder, camera_file=folder / "none.json")


@pytest.mark.parametrize("share", [0.0, 0.1, 0.4, 0.8])
def test_truncated_images_are_refused(folder, share):
    path = folder / "depth.png"
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(CaptureError, match=r"depth\.png"):
        Capture.load(folder)


@pytest.mark.parametrize("mode", ["L", "RGB", "P", "1"])
def test_images_for_viewing_are_no_depth(folder, mode):
    Image.new(mode, (WIDTH, HEIGHT)).save(folder / "depth.png")
    with pytest.raises(CaptureError, match="16 bits"):
        Capture.load(folder)


def test_a_camera_file_without_k_says_what_k_is(folder):
    (folder / "camera.json").write_text(json.dumps({"fx": 600.0, "fy": 600.0}))
    with pytest.raises(ConfigError, match=r"fx, fy, expected K.*row by row.*camera_m"):
        Capture.load(folder)


def test_an_empty_depth_image_is_refused(folder):
    Image.new("I;16", (WIDTH, HEIGHT)).save(folder / "depth.png")
    with pytest.raises(CaptureError, match="measured"):
        Capture.load(folder)


def test_the_files_that_a_capture_is_read_from_are_listed(folder):
    (folder / "depth.png").rename(folder / "my_depth.png")
    (folder / "camera.json").rename(folder / "my_depth.json")
    of_folder, of_image = files_read(folder), files_read(folder / "my_depth.png")
    for found in (of_folder, of_image):
        assert {folder / "my_depth.png", folder / "my_depth.json"} <= set(found)
    assert folder / "labels.png" in of_folder
    assert files_read(folder / "a.npz") == (folder / "a.npz",)
