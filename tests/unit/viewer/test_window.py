"""Views of everything that can be shown, without a browser."""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from urllib.request import urlopen

import numpy as np
import pytest

import debrisgrasp
from debrisgrasp import api
from debrisgrasp.errors import ConfigError, InputError, MissingExtraError
from debrisgrasp.executive.record import RunRecord, load_run
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.io import Capture, data_path
from debrisgrasp.io.calibration_json import calibration_to_dict, save_calibration
from debrisgrasp.io.motion_json import motion_to_dict, save_motion
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.pipeline import PlanningResult
from debrisgrasp.prototypes import PrototypeLibrary
from debrisgrasp.viewer import PlanContent, RunContent, content_of, show
from debrisgrasp.viz.colors import CHOSEN_COLOR

pytest.importorskip("viser")


@pytest.fixture(scope="module")
def pile() -> Path:
    return data_path("captures", "pile.npz")


@pytest.fixture(scope="module")
def result(pile) -> PlanningResult:
    return debrisgrasp.plan(Capture.load(pile), object_label=5)


@pytest.fixture(scope="module")
def window(result):
    motions = api.plan_motion(result)
    assert motions.chosen is not None
    with show(result, motions=motions) as viewer:
        viewer.motions = motions
        yield viewer


def drawn(viewer, name: str):
    return viewer.server.scene.get_handle_by_name(name)


def test_the_page_is_served(window):
    with urlopen(window.url) as answer:
        assert answer.status == 200
        assert b"<html" in answer.read(2000).lower()
    assert window.url in window._repr_html_()


def test_everything_is_on_the_stage(window, result):
    for name in ("/cloud", "/region V", "/ground", "/arrow", "/hands/1"):
        assert drawn(window, name) is not None, name
    arm = result.robot.arm(result.plan.grasps[0].arm)
    chain = result.robot.links_solids()
    links = {link for link, _ in chain}
    assert all(drawn(window, f"/robot/{link}") is not None for link in links)
    hidden = result.robot.tree.links_below(arm.hand)
    for link in links:
        assert drawn(window, f"/robot/{link}").visible == (link not in hidden)


def test_selecting_a_grasp_shows_its_figures_hand_and_posture(window, result):
    for rank in (2, 1):
        grasp = result.plan.grasps[rank - 1]
        window.view.select(rank)
        text = window.view.details.content
        assert f"Grasp {rank}: {grasp.prototype}" in text
        assert f"{grasp.Q:.3f} = {grasp.S:.3f} · {grasp.C:.3f} · {grasp.R:.0f}" in text
        assert drawn(window, f"/hands/{rank}").visible
        assert not drawn(window, f"/hands/{3 - rank}").visible
        assert np.allclose(
            drawn(window, f"/hands/{rank}").position, grasp.T_base_hand.p
        )
        poses = result.robot.link_poses(grasp.joints)
        for link in ("base_link", *result.robot.tree.joints):
            handle = drawn(window, f"/robot/{link}")
            if handle is not None:
                assert np.allclose(handle.position, poses[link].p, atol=1e-9)


def test_each_ruled_out_pose_tells_what_it_would_hit(window, result):
    ruled_out = result.plan.ruled_out
    assert len(ruled_out)
    hits = {"the palm would hit something": "palm at the grasp"}
    hits["an open finger would hit something"] = "side at the grasp"
    for reason, n in ruled_out.counts().items():
        window.view.rejected.select(reason, n - 1)
        text = window.view.rejected.why.content
        assert text.startswith(f"**{reason}**, pose {n} of {n}")
        if reason in hits:  # what it hits was measured, or may hide behind what was
            said = []
            for number in range(n):
                window.view.rejected.select(reason, number)
                said.append(window.view.rejected.why.content)
                has_hits = drawn(window, "/rejected/points") is not None
                assert has_hits == ("In its way" in said[-1])
            assert any(hits[reason] in text for text in said)
        assert drawn(window, "/rejected/hand") is not None
        assert not drawn(window, "/hands/1").visible
    assert drawn(window, "/rejected/pins") is not None
    window.view.select(1)
    assert drawn(window, "/rejected/hand") is None
    assert drawn(window, "/rejected/pins") is None


def test_the_robot_moves_along_its_path(window, result):
    chosen = window.motions.chosen
    reach = chosen.trajectories["reach"]
    for name, seconds in (
        ("reach", 0.0),
        ("approach", reach.duration + 0.1),
        ("lift", 999),
    ):
        window.view.show_motion(seconds)
        assert name in window.view._motion_note.content
    lift = chosen.trajectories["lift"]
    q = dict(zip(lift.joint_names, lift.q[-1].tolist(), strict=True))
    palm = result.robot.chain(chosen.arm).fk(
        [result.robot.joint_values(q)[n] for n in lift.joint_names]
    )
    handle = drawn(window, f"/hands/{chosen.index + 1}")
    assert np.allclose(handle.position, palm.p, atol=1e-6)
    assert np.allclose(np.abs(handle.wxyz @ so3.to_quat_wxyz(palm.R)), 1.0)
    assert drawn(window, "/rejected/hand") is None


def test_saved_plans_are_shown_with_their_capture_and_motions(
    window, result, pile, tmp_path
):
    result.save(tmp_path / "grasps.json")
    chosen = window.motions.chosen
    content = motion_to_dict(
        chosen.trajectories,
        robot="roman",
        arm=chosen.arm,
        index=chosen.index,
        passed_over=(),
    )
    save_motion(content, tmp_path / "motion.json")
    capture = Capture.load(pile)
    opened = content_of(
        tmp_path / "grasps.json", capture=capture, motion=tmp_path / "motion.json"
    )
    assert isinstance(opened, PlanContent)
    assert len(opened.plan.grasps) == len(result.plan.grasps)
    assert opened.motion_arm == chosen.arm
    assert opened.motions["lift"].duration == pytest.approx(
        chosen.trajectories["lift"].duration
    )
    assert opened.robot.name == "roman"
    with pytest.raises(ConfigError, match="--capture"):
        content_of(tmp_path / "grasps.json")
    (tmp_path / "motion.json").write_text('{"schema": "debrisgrasp/motion/2"}')
    with pytest.raises(ConfigError, match="no field 'motions'"):
        content_of(
            tmp_path / "grasps.json", capture=capture, motion=tmp_path / "motion.json"
        )


def test_a_part_is_recorded_on_the_page(window, tmp_path):
    panel = window.view.recording
    panel.check()
    assert "expected one that was proposed" in panel.note.content
    panel.object.value = "object 6"
    panel.choose()
    orange = np.rint(255 * np.array(CHOSEN_COLOR))
    is_orange = (np.array(drawn(window, "/cloud").colors) == orange).all(axis=1)
    labels = np.asarray(window.view.content.segmentation.labels)[window.view._index]
    assert np.array_equal(is_orange, labels == 6)
    panel.propose()
    assert "5 poses" in panel.note.content
    assert not drawn(window, "/hands/1").visible
    taught = SE3.from_parts(p=(0.0, 0.0, 0.005))  # by the mouse, a little closer
    proposed = panel._T_base_hand()
    panel._place(proposed @ taught)
    panel.folder.value, panel.name.value = str(tmp_path / "mine"), "part"
    panel.save()
    assert "wrote" in panel.note.content
    pose = (proposed @ taught).matrix
    assert np.allclose(panel.made.T_base_hand.matrix, pose)
    (made,) = PrototypeLibrary.load(tmp_path / "mine")
    assert made.width == pytest.approx(panel.made.definition.width)
    panel.save()
    assert "it exists" in panel.note.content
    panel.name.value = "No Name"
    panel.save()
    assert "lower-case" in panel.note.content
    window.view.select(1)
    assert drawn(window, "/record/pose") is None


def test_a_capture_is_shown_by_its_objects(pile):
    capture = Capture.load(pile)
    marked = replace(capture, mask=np.isin(capture.labels, (2, 3)))
    with show(marked) as viewer:
        assert drawn(viewer, "/cloud") is not None
        assert drawn(viewer, "/hands/1") is None
        labels = viewer.view.content.segmentation.labels
        np.testing.assert_array_equal(labels, api.segment(marked).labels)


@pytest.mark.parametrize("spacing", [2e-4, 0.04])
def test_dense_and_sparse_clouds_are_shown(spacing):
    across = np.arange(24) * spacing
    x, y = np.meshgrid(1.0 + across, across)
    points = np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.3)], axis=1)
    capture = Capture(
        points=points, viewpoint=[0.0, 0.0, 1.5], T_base_camera=SE3.identity()
    )
    with show(capture) as viewer:
        size = drawn(viewer, "/cloud").point_size
        assert spacing < size < 3 * spacing


def test_prototypes_are_shown_with_hands_that_close(tmp_path):
    library = content_of(data_path("prototypes", "cylinder_060_tip.yaml"))
    assert isinstance(library, PrototypeLibrary)
    with show(library) as viewer:
        assert "cylinder_060_tip" in viewer.view.details.content
        before = np.array(drawn(viewer, "/hand").vertices)
        viewer.view._closed.value = 100
        viewer.view._draw_hand()
        assert not np.allclose(before, drawn(viewer, "/hand").vertices)
    shutil.copy(data_path("prototypes", "bar_4x4.yaml"), tmp_path)
    assert content_of(tmp_path).names == ("bar_4x4",)


def test_a_calibration_is_shown_with_its_spread(tmp_path):
    found = debrisgrasp.calibrate(data_path("calibration", "roman_looks.yaml"))
    when = datetime(2026, 1, 2, tzinfo=UTC)
    save_calibration(tmp_path / "c.json", calibration_to_dict(found, date=when))
    robot = RobotModel.load("roman")
    with show(content_of(tmp_path / "c.json"), robot=robot) as viewer:
        assert drawn(viewer, "/camera/calibrated") is not None
        assert drawn(viewer, "/camera/nominal") is not None


def test_a_run_is_shown_event_by_event(pile, tmp_path):
    record = RunRecord(tmp_path / "run", {"robot": "roman"})
    record.keep(Capture.load(pile), "look_1")
    record.write("state", {"state": "perceive", "time": 0.0})
    record.write("trace", {"rows": [[0.0] * 3]})
    record.write("end", {"end": "done", "removed": 1})
    opened = content_of(tmp_path / "run")
    assert isinstance(opened, RunContent)
    with show(load_run(tmp_path / "run")) as viewer:
        assert drawn(viewer, "/cloud") is not None
        for number, said in enumerate(("look_1", "perceive", "done")):
            viewer.view.select(number)
            assert said in viewer.view.details.content


def test_files_that_can_t_be_shown_are_refused(tmp_path):
    for name, said in (("absent.json", "no such file"), ("x" * 300, "too long")):
        with pytest.raises(ConfigError, match=said):
            content_of(tmp_path / name)
    (tmp_path / "x.json").write_text(json.dumps({"schema": "other/1"}))
    with pytest.raises(ConfigError, match="other/1"):
        content_of(tmp_path / "x.json")


def test_things_that_can_t_be_shown_are_refused():
    with pytest.raises(InputError, match="int"):
        show(3)  # type: ignore[arg-type]


def test_a_taken_port_is_told(window, pile):
    port = int(window.url.rpartition(":")[2])
    with pytest.raises(ConfigError, match=f"{port}.*Port 0 takes any"):
        show(Capture.load(pile), port=port)


def test_a_missing_extra_is_named(monkeypatch, pile):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(MissingExtraError, match=r"debrisgrasp\[viz\]"):
        show(Capture.load(pile))
