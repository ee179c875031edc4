"""The file of a site: what it means, and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from debrisgrasp import Pipeline, PipelineConfig, PlannerConfig, Settings
from debrisgrasp._files import data_path
from debrisgrasp.errors import CaptureError, ChoiceError, ConfigError, UnknownNameError
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.segmentation import PriorityPoint, SupportAware
from tests.scenes import capture_of

HEAD = "schema: debrisgrasp/site/1\n"


@pytest.fixture
def written(tmp_path: Path):
    def write(text: str) -> Path:
        path = tmp_path / "site.yaml"
        path.write_text(HEAD + text, encoding="utf-8")
        return path

    return write


def test_an_empty_file_means_the_defaults(written):
    settings = Settings.load(written(""))
    assert settings.robot == "roman"
    assert not settings.drop_off
    assert settings.pose_of_camera() is None
    assert isinstance(settings.selection(), SupportAware)


def test_every_field_arrives(written, tmp_path):
    (tmp_path / "hands").mkdir()
    settings = Settings.load(
        written(
            "robot: none\ngripper: camhand\ngrippers: hands\n"
            "camera: {pose: [0.2, 0, 1.2, -2.2, 0, -1.5]}\n"
            "selection: {policy: priority, priority_point: [1, 2, 3]}\n"
            "drop_off: {right: [0.6, -0.8]}\ndeadline: 3\nseed: 7\n"
            "limits: {force: 90, hand_speed: 0.05}\n"
            "workspace: [0.5, -0.5, -0.1, 1.2, 0.5, 1]\n"
        )
    )
    assert settings.workspace == ((0.5, -0.5, -0.1), (1.2, 0.5, 1.0))
    assert settings.grippers == tmp_path / "hands"
    np.testing.assert_allclose(settings.pose_of_camera().p, (0.2, 0, 1.2))
    policy = settings.selection()
    assert isinstance(policy, PriorityPoint)
    np.testing.assert_array_equal(policy.point, (1, 2, 3))
    assert settings.drop_off == {"right": (0.6, -0.8)}
    assert (settings.seed, settings.deadline, settings.limits.force) == (7, 3, 90)
    assert settings.robot_model() is None


def test_limits_are_in_force_on_the_robot(written):
    site = Settings.load(
        written("limits: {force: 90, joint_speed: 0.5, acceleration: 0.25}")
    )
    limited = site.robot_model().limits("right").hardware
    own = RobotModel.load("roman").limits("right").hardware
    assert limited.force == 90
    assert limited.torque == own.torque
    np.testing.assert_allclose(limited.velocity, 0.5 * own.velocity)
    np.testing.assert_allclose(limited.acceleration, 0.25 * own.acceleration)
    np.testing.assert_array_equal(limited.upper, own.upper)


def test_a_site_may_not_raise_limits(written):
    with pytest.raises(ConfigError, match=r"limits.force.*at most 150.*right arm"):
        Settings.load(written("limits: {force: 200}")).robot_model()


def test_the_pipeline_of_a_site_uses_its_arm_and_the_opening_of_its_hand(written):
    pipeline = Pipeline.from_settings(
        Settings.load(written("arm: left\nselection: {priority_point: [0.7, 0, 1]}"))
    )
    assert [arm.name for arm in pipeline.arms] == ["left"]
    (hand,) = {prototype.gripper for prototype in pipeline.library}
    assert pipeline.policy.openings == (pipeline.grippers[hand].opening_range[1],)
    np.testing.assert_array_equal(pipeline.policy.point, (0.7, 0, 1))


def test_the_coefficients_of_a_site_score_unless_others_are_given(written, tmp_path):
    content = json.loads(data_path("planning", "success.json").read_text())
    own = tmp_path / "own.json"
    own.write_text(json.dumps(content | {"intercept": 1.25}))
    settings = Settings.load(written("robot: none\nsuccess: own.json"))
    assert settings.success == own
    success = Pipeline.from_settings(settings).config.planner.success
    assert success.intercept == 1.25
    other = replace(success, intercept=-2.0)
    config = PipelineConfig(planner=PlannerConfig(success=other))
    assert Pipeline.from_settings(settings, config).config is config
    with pytest.raises(ConfigError, match=r"SuccessModel\.load\(path\) reads one"):
        PlannerConfig(success=str(own))
    own.write_text("{}")
    with pytest.raises(ConfigError, match=r"own\.json: got none, expected debrisgrasp"):
        Pipeline.from_settings(settings)


def test_paths_are_relative_to_the_file(written, monkeypatch, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "protos").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    path = written("prototypes: protos")
    assert Settings.load(path).prototypes == tmp_path / "protos"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("robt: roman", "unknown field in .*site.yaml.*Did you mean 'robot'"),
        ("robot: MINE.YML", r"field robot: .*MINE.YML, expected an existing file"),
        ("robot: mine.yaml", r"field robot: .*mine.yaml, expected an existing file"),
        ("prototypes: nowhere", r"field prototypes: .*an existing folder"),
        ("success: no.json", r"field success: .*no.json, expected an existing file"),
        ("drop_off: [1, 2]", r"field drop_off.*a mapping"),
        ("drop_off: {left: [1]}", r"field drop_off.left.*a list of 2 numbers"),
        ("drop_off: {left: [600, 0]}", r"site.yaml, field drop_off.left.*metres"),
        ("drop_off: {left: [.nan, 0]}", r"field drop_off.left.*finite"),
        ("workspace: [0, 1]", r"field workspace.*a list of 6 numbers"),
        ("workspace: [1, 0, 0, 0, 1, 1]", r"field workspace.*a lower corner"),
        ("workspace: [0, 0, 0, 900, 1, 1]", r"field workspace.*metres"),
        ("seed: 1.5", r"field seed.*an integer"),
        ("seed: -1", r"field seed.*0 or more"),
        ("seed: x", r"field seed: got 'x', expected an integer"),
        ("deadline: 0", r"field deadline"),
        ("limits: {force: -3}", r"site.yaml, field limits.force.*0.001"),
        ("limits: {joint_speed: 0}", r"field limits.joint_speed.*0.001 to 1\.$"),
        ("limits: {joint_speed: fast}", r"limits.joint_speed.*a finite number\.$"),
        ("limits: {hand_speed: 1.0e-9}", r"field limits.hand_speed.*0.001 to 2\.$"),
        (f"prototypes: {'x' * 300}", r"field prototypes: got File name too long: "),
        (f"robot: {'x' * 300}.yaml", r"field robot: got File name too long: "),
        ("limits: {joint_speed: 1.2}", r"field limits.joint_speed.*0.001 to 1"),
        ("limits: {hand_speed: 80}", r"field limits.hand_speed.*millim.*divide"),
        ("limits: {speed: 1}", r"unknown field.*limits.*hand_speed"),
        ("selection: {policy: nearest}", r"field selection.policy.*support, priority"),
        ("camera: {pose: [0, 0, 1, 180, 0, 0]}", r"field camera.pose.*radians"),
        ("camera: {pose: [0, 0, 1]}", r"field camera.pose.*a list of 6"),
        ("camera: {calibration: gone.json}", r"field camera.calibration.*existing"),
        ("camera: {pose: [200, 0, 1200, -2.2, 0, -1.5]}", "camera.pose.*millimetres"),
        ("limits: {force: 1e9}", r"^[^,]+, field limits.force: got"),
        ("deadline: 1e9", r"field deadline: got '1e9'.*text in YAML.*1.0e\+9"),
        ("camera: 3", r"field camera.*a mapping"),
    ],
)
def test_a_mistake_is_named_with_file_and_field(written, text, message):
    with pytest.raises((ConfigError, UnknownNameError), match=message) as caught:
        Settings.load(written(text))
    assert "site.yaml" in str(caught.value)


@pytest.mark.parametrize(
    "text",
    ["arm: rihgt", "gripper: camhnd", "robot: romam", "drop_off: {lfet: [1, 1]}"],
)
def test_a_name_that_the_robot_does_not_know_is_told_with_the_file(written, text):
    settings = Settings.load(written(text))
    with pytest.raises(UnknownNameError, match=r"site\.yaml.*Did you mean"):
        Pipeline.from_settings(settings)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("arm: right\ngripper: camhand", r"gripper of the right arm, in \S+site\.yaml"),
        ("robot: none\narm: right", r"^arm, in \S+site\.yaml"),
        ("limits: {force: 900}", r"site\.yaml, field limits\.force: .*at most 150"),
    ],
)
def test_what_does_not_go_together_is_told_with_the_file(written, text, message):
    settings = Settings.load(written(text))
    with pytest.raises(ConfigError, match=message):
        Pipeline.from_settings(settings)


@pytest.mark.parametrize(
    ("kind", "is_told"), [(ChoiceError, True), (ConfigError, False)]
)
def test_only_a_choice_is_told_with_the_file_whatever_it_is_called(
    written, kind, is_told
):
    settings = Settings.load(written("arm: right"))
    with pytest.raises(ConfigError) as caught, settings.named():
        raise kind("arm", got="a", expected="b")
    assert ("site.yaml" in str(caught.value)) == is_told


@pytest.mark.parametrize(
    "text", ["robot: romam", "arm: lfet\ndrop_off: {lfet: [1, 1]}"]
)
def test_a_robot_that_is_not_had_names_the_file_once(written, text):
    settings = Settings.load(written(text))
    with pytest.raises(UnknownNameError) as caught:
        settings.robot_model()
    assert str(caught.value).count("site.yaml") == 1
    with pytest.raises(UnknownNameError) as caught:
        Pipeline.from_settings(settings)
    assert str(caught.value).count("site.yaml") == 1


def test_the_camera_of_a_site_is_for_images_without_one_beside_them(
    written, tmp_path, pngs
):
    settings = Settings.load(written("camera: {file: lens.json}"))
    alone, with_camera, folder, stored = pngs
    assert settings.capture(alone).intrinsics.fx == 200
    assert settings.capture(folder).intrinsics.fx == 200
    assert settings.capture(with_camera).intrinsics.fx == 240
    assert settings.capture(stored).intrinsics.fx == 240
    own = tmp_path / "beside" / "camera.json"
    assert settings.capture(alone, camera_file=own).intrinsics.fx == 240
    with pytest.raises(CaptureError, match=r"camera file.*\.npz file"):
        settings.capture(stored, camera_file=own)


@pytest.fixture
def pngs(tmp_path):
    """One depth image: alone, with its camera, in a folder without one, as .npz."""
    capture = capture_of([])
    image = Image.fromarray((1000 * np.nan_to_num(capture.depth)).astype(np.uint16))
    paths = [tmp_path / name / "depth.png" for name in ("alone", "beside", "folder")]
    for path in paths:
        path.parent.mkdir()
        image.save(path)
    K = capture.intrinsics.matrix
    camera = {"K": K.tolist(), "width": 320, "height": 240}
    (tmp_path / "beside" / "camera.json").write_text(json.dumps(camera))
    K[0, 0] = K[1, 1] = 200
    (tmp_path / "lens.json").write_text(json.dumps({**camera, "K": K.tolist()}))
    capture.save(tmp_path / "stored.npz")
    return paths[0], paths[1], paths[2].parent, tmp_path / "stored.npz"


def test_a_file_of_something_else_is_refused(tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_text("name: roman\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"robot.yaml, field schema"):
        Settings.load(path)


def test_calibration_and_pose_exclude_each_other(written, tmp_path):
    (tmp_path / "c.json").write_text("{}", encoding="utf-8")
    text = "camera: {calibration: c.json, pose: [0, 0, 1, 0, 0, 0]}"
    with pytest.raises(ConfigError, match="both a calibration and a pose"):
        Settings.load(written(text))
