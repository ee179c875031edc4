"""Camera poses as one word of a command line."""

from __future__ import annotations

import json

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import so3
from debrisgrasp.io import parse_camera_pose


def test_level_stays_a_word():
    assert parse_camera_pose("level") == "level"


def test_six_numbers_are_position_and_roll_pitch_yaw():
    pose = parse_camera_pose("0.4,-0.1, 0.95,-2.3,0.1,-1.5")
    assert_allclose(pose.p, [0.4, -0.1, 0.95])
    assert_allclose(pose.R, so3.from_rpy(np.array([-2.3, 0.1, -1.5])))


@pytest.mark.parametrize("between", [" ", ",", ", "])
def test_a_matrix_as_text_has_blanks_or_commas(tmp_path, T_base_camera, between):
    path = tmp_path / "a.txt"
    np.savetxt(path, T_base_camera.matrix, delimiter=between)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    pose = parse_camera_pose(str(path))
    assert_allclose(pose.matrix, T_base_camera.matrix)


def test_every_kind_of_file_gives_the_same_pose(tmp_path, T_base_camera):
    matrix = T_base_camera.matrix
    np.save(tmp_path / "a.npy", matrix)
    np.savetxt(tmp_path / "a.txt", matrix)
    (tmp_path / "a.json").write_text(json.dumps(matrix.tolist()))
    (tmp_path / "b.json").write_text(json.dumps(matrix.ravel().tolist()))
    (tmp_path / "a.yaml").write_text(
        yaml.safe_dump({"T_base_camera": matrix.tolist(), "note": "tilt 0.7"})
    )
    np.savetxt(tmp_path / "b.txt", matrix.reshape(1, 16))
    for name in ("a.npy", "a.txt", "b.txt", "a.json", "b.json", "a.yaml"):
        pose = parse_camera_pose(str(tmp_path / name))
        assert_allclose(pose.matrix, matrix, atol=1e-12)


@pytest.mark.parametrize("text", ["", "here", "1,2,3", "a,b,c,d,e,f"])
def test_other_words_are_refused_with_all_forms(text):
    with pytest.raises(ConfigError, match="roll,pitch,yaw"):
        parse_camera_pose(text)


def test_the_angles_of_a_quaternion_are_told(T_base_camera):
    quaternion = Rotation.from_matrix(T_base_camera.R)
    with pytest.raises(ConfigError, match=r"Rotation.*as_euler\('xyz'\)"):
        parse_camera_pose("0,0,1," + ",".join(map(str, quaternion.as_quat())))
    text = ",".join(map(str, [0.0, 0.0, 1.0, *quaternion.as_euler("xyz")]))
    assert_allclose(parse_camera_pose(text).R, T_base_camera.R, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("1,2,3,4,5,nan", "finite"),
        ("100,200,1500,0,0,0", "millimetres"),
        ("0,0,1,-126,0,-90", "radians"),
    ],
)
def test_six_numbers_that_make_no_pose_are_refused_for_what_they_are(text, why):
    with pytest.raises(ConfigError, match=why):
        parse_camera_pose(text)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.json", "[[1, 0], [0, 1]]"),
        ("a.json", '{"pose": 1}'),
        ("a.json", "[[2,0,0,0],[0,2,0,0],[0,0,2,0],[0,0,0,1]]"),
        ("a.json", '[["a"]]'),
        ("a.yaml", "T_base_camera: [1, 2"),
        ("a.txt", "1 2 3\n4 5\n"),
        ("a.txt", "one two"),
        ("a.txt", "# 4x4\n"),
        ("a.npy", "no array"),
    ],
)
def test_files_without_a_rigid_transform_are_refused(tmp_path, name, content):
    (tmp_path / name).write_text(content)
    with pytest.raises(ConfigError, match=name):
        parse_camera_pose(str(tmp_path / name))


@pytest.mark.parametrize("suffix", ["npy", "txt", "json", "yaml"])
def test_missing_files_are_refused(tmp_path, suffix):
    with pytest.raises(ConfigError, match=f"none.{suffix}"):
        parse_camera_pose(str(tmp_path / f"none.{suffix}"))
