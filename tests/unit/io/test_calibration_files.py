"""Observations and calibrations survive the disk, and nothing old is lost there."""

from __future__ import annotations

import json
from datetime import UTC, datetime

import numpy as np
import pytest

from debrisgrasp.calibration import Known, calibrate
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3
from debrisgrasp.io.calibration_json import (
    calibration_to_dict,
    load_calibration,
    save_calibration,
)
from debrisgrasp.io.observations_file import (
    ObservationFile,
    ObservationRow,
    load_observations,
    save_observations,
)
from tests.unit.calibration.looks import CAMERA, PLACES, head, head_looks, looks

NOON = datetime(2024, 5, 1, 12, 0, tzinfo=UTC)
ROWS = ObservationFile(
    rows=(
        ObservationRow(name="a", joints={"j1": 0.5}, point=(0.1, 0.2, 1.0)),
        ObservationRow(
            name="b", position=(0.9, 0.0, 0.3), point=(0.0, 0.1, 0.9), sigma=(0.002,)
        ),
        ObservationRow(name="c", joints={"j1": 1.0}),
    ),
    robot="roman",
    fiducial="led",
    sigma=0.003,
)


def test_observations_come_back_as_they_were(tmp_path):
    save_observations(ROWS, tmp_path / "o.json")
    assert load_observations(tmp_path / "o.json") == ROWS
    (tmp_path / "o.yaml").write_text((tmp_path / "o.json").read_text())
    assert load_observations(tmp_path / "o.yaml") == ROWS


def test_a_table_says_the_same(tmp_path):
    path = tmp_path / "o.csv"
    path.write_text(
        "name, camera_x, camera_y, camera_z, sigma, base_x, base_y, base_z, j1\n"
        "a, 0.1, 0.2, 1.0, , , , , 0.5\n"
        "b, 0.0, 0.1, 0.9, 0.002, 0.9, 0.0, 0.3,\n"
        "\n"
        "c, , , , , , , , 1.0\n"
    )
    assert load_observations(path).rows == ROWS.rows


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("[]", "mapping"),
        ("{}", "no list"),
        ("observations: [1]", "mapping of fields"),
        ("observations: [{point: [0, 0, 1]}]", "neither joints nor position"),
        ("observations: [{point: [0, 1], position: [0, 0, 1]}]", "3 numbers"),
        ("observations: [{point: [0, .nan, 1], position: [0, 0, 1]}]", "finite"),
        ("observations: [{point: [0, yes, 1], position: [0, 0, 1]}]", "finite"),
        ("observations: [{pont: [0, 0, 1]}]", "unknown field"),
        ("observations: [{joints: [1], point: [0, 0, 1]}]", "joint names"),
        ("observations: []", "got none, expected at least 3"),
        ("observations: []\nrobot: 3", "a name"),
        ("observations: []\nschema: other", "debrisgrasp/observations/1"),
        (
            "observations: [{name: a, position: [0, 0, 1]}, "
            "{name: a, position: [0, 0, 1]}]",
            "each once",
        ),
    ],
)
def test_a_malformed_file_is_refused_by_field(tmp_path, text, word):
    path = tmp_path / "o.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=word):
        load_observations(path)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "name,x\na,1\n",
        "camera_x,camera_y,camera_z,j\n1,2,3\n",
        "camera_x,camera_x\n",
    ],
)
def test_a_malformed_table_is_refused(tmp_path, text):
    path = tmp_path / "o.csv"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"o\.csv"):
        load_observations(path)


def test_a_table_of_a_spreadsheet_is_read_or_told_how_to_export(tmp_path):
    path = tmp_path / "a.csv"
    text = "name,camera_x,camera_y,camera_z,j1\na,0.1,0.2,1.0,0.5\n"
    path.write_text(text, encoding="utf-8-sig")
    (row,) = load_observations(path).rows
    assert (row.name, row.point) == ("a", (0.1, 0.2, 1.0))
    path.write_text(text.replace(",", ";").replace(".", ","))
    with pytest.raises(ConfigError, match=r"semicolons .* expected commas"):
        load_observations(path)


def test_another_kind_of_file_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="suffix"):
        load_observations(tmp_path / "o.txt")


def test_a_calibration_comes_back(tmp_path, rng):
    readings = np.array([0.0, 0.75])
    given = head_looks(head(), PLACES, readings, noise=0.002, rng=rng)
    found = calibrate(given, Known(head=head()))
    content = calibration_to_dict(found, date=NOON, T_base_shoulder=SE3.identity())
    assert save_calibration(tmp_path / "c.json", content) == (None, None)
    stored = load_calibration(tmp_path / "c.json")
    stored.require_accepted()
    assert repr(stored) == f"<StoredCalibration {tmp_path / 'c.json'}, accepted>"
    assert stored.date == "2024-05-01T12:00:00+00:00"
    assert stored.T_base_camera.matrix == pytest.approx(found.T_base_camera.matrix)
    assert stored.covariance == pytest.approx(found.covariance, abs=1e-15)
    assert stored.head.T_base_camera([0.1, 0.2]).matrix == pytest.approx(
        found.head.T_base_camera([0.1, 0.2]).matrix
    )
    again = calibrate(given.selected([0, 1, 2]), stored.known)
    assert again.model == "as before"
    facts = json.loads((tmp_path / "c.json").read_text())
    assert facts["versions"]["numpy"] == np.__version__
    assert len(facts["observations"]) == len(PLACES)
    assert "exp(twist) @ T_base_camera" in facts["covariance_convention"]


def test_an_old_calibration_is_kept_beside_with_the_difference(tmp_path, rng):
    path = tmp_path / "c.json"
    old = calibration_to_dict(calibrate(looks(noise=0.002, rng=rng)), date=NOON)
    moved = SE3.exp([0.03, 0, 0, 0, 0, 0]) @ CAMERA
    new = calibration_to_dict(
        calibrate(looks(T_base_camera=moved, noise=0.002, rng=rng)), date=NOON
    )
    save_calibration(path, old)
    first = path.read_text()
    change, kept = save_calibration(path, new)
    assert kept == tmp_path / "c.2024-05-01T12-00-00.json"
    assert kept.read_text() == first
    assert change["workspace_rms"] == pytest.approx(0.03, abs=0.006)
    assert change["in_standard_deviations"] > 3
    assert json.loads(path.read_text())["previous"]["file"] == kept.name
    _, third = save_calibration(path, old)
    assert third is not None
    assert third != kept
    assert len(list(tmp_path.iterdir())) == 3


def test_something_else_is_never_replaced(tmp_path, rng):
    path = tmp_path / "c.json"
    path.write_text('{"mine": 1}')
    content = calibration_to_dict(calibrate(looks(noise=0.002, rng=rng)), date=NOON)
    with pytest.raises(ConfigError, match="schema"):
        save_calibration(path, content)
    assert path.read_text() == '{"mine": 1}'


def test_another_file_is_told_from_a_calibration(tmp_path):
    np.savez(tmp_path / "pile.npz", depth=np.ones((4, 4)))
    (tmp_path / "site.yaml").write_text("schema: debrisgrasp/site/1\n")
    (tmp_path / "grasps.json").write_text('{"schema": "debrisgrasp/grasps/1"}')
    told = {
        "pile.npz": "such as a capture",
        "site.yaml": "in column 1",
        "grasps.json": "debrisgrasp/grasps/1",
        "none.json": "No such file",
    }
    for name, words in told.items():
        with pytest.raises(ConfigError, match=words) as refused:
            load_calibration(tmp_path / name)
        assert name in str(refused.value)
        assert "a calibration: the JSON file" in str(refused.value)


def test_a_refused_calibration_is_not_used_unnoticed(tmp_path):
    content = calibration_to_dict(calibrate(looks(PLACES[:4])), date=NOON)
    save_calibration(tmp_path / "c.json", content)
    stored = load_calibration(tmp_path / "c.json")
    with pytest.raises(ConfigError, match="4 different places"):
        stored.require_accepted()


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("T_base_camera", [[1, 0], [0, 1]]),
        ("covariance", [[1.0]]),
        ("covariance", np.zeros((6, 6)).tolist()),
        ("covariance", (np.eye(6) - 0.9 * np.eye(6)[::-1] - np.ones(6)).tolist()),
        ("head", {}),
        ("findings", 3),
        ("fiducial_shift", "x"),
    ],
)
def test_a_damaged_calibration_is_refused(tmp_path, field, value):
    content = calibration_to_dict(calibrate(looks()), date=NOON)
    path = tmp_path / "c.json"
    path.write_text(json.dumps({**content, field: value}))
    with pytest.raises(ConfigError, match=r"c\.json"):
        load_calibration(path)


def test_a_head_without_uncertainty_is_refused(tmp_path):
    content = calibration_to_dict(calibrate(looks()), date=NOON)
    content["head"]["covariance"] = np.zeros((6, 6)).tolist()
    path = tmp_path / "c.json"
    path.write_text(json.dumps(content))
    with pytest.raises(ConfigError, match="covariance"):
        load_calibration(path)


@pytest.mark.parametrize("accepted", ["no", 1, None])
def test_only_what_says_so_is_accepted(tmp_path, accepted):
    content = calibration_to_dict(calibrate(looks()), date=NOON)
    path = tmp_path / "c.json"
    path.write_text(json.dumps({**content, "accepted": accepted}))
    with pytest.raises(ConfigError, match="no reason given"):
        load_calibration(path).require_accepted()


def test_a_calibration_is_no_list_of_observations(tmp_path):
    path = tmp_path / "c.json"
    save_calibration(path, calibration_to_dict(calibrate(looks()), date=NOON))
    with pytest.raises(ConfigError, match="schema of"):
        load_observations(path)
