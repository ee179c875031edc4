"""Learning from grasps whose surfaces and chances are known."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.cli.program import run
from debrisgrasp.errors import ConfigError, InputError, OutputError, UnknownNameError
from debrisgrasp.geometry import SE3, PointCloud, perturbed
from debrisgrasp.prototypes import PrototypeLibrary, SurfaceShape, shape_distance
from debrisgrasp.prototypes.surfaces import sample
from debrisgrasp.workbench import (
    GraspRecord,
    LearnConfig,
    learn,
    load_records,
    recorded,
    save_records,
)
from tests.grasps import grasp_at

LIBRARY = PrototypeLibrary.load()
CHANCES = {"cylinder_040_tip": 0.8, "bar_4x4": 0.5, "edge_019": 0.0}


def grasped(name: str, rng: np.random.Generator, *, held: bool = True) -> GraspRecord:
    """A grasp on the shape of a prototype, seen from above with noise, a bit off."""
    prototype = LIBRARY[name]
    definition = prototype.definition
    points, normals = sample(definition.shape.patches(), definition.shape.parts(), 4e4)
    T_off = perturbed(SE3.identity(), 0.002, 0.02, rng=rng)
    T = T_off @ definition.T_hand_shape
    points, normals = T.apply(points), T.rotate(normals)
    seen = normals[:, 2] < 0.2
    noisy = points[seen] + rng.normal(scale=0.001, size=(seen.sum(), 3))
    return GraspRecord(
        surface=SurfaceShape.thinned(noisy, normals[seen]),
        gripper=prototype.gripper,
        preshape=prototype.preshape,
        opening=prototype.opening,
        width=prototype.width,
        held=held,
        prototype=name,
        source="made up",
    )


@pytest.fixture(scope="module")
def records() -> tuple[GraspRecord, ...]:
    rng = np.random.default_rng(5)
    return tuple(
        grasped(name, rng, held=number < 10 * chance)
        for name, chance in CHANCES.items()
        for number in range(10)
    )


def test_there_is_a_prototype_for_each_kind_that_held(records):
    learned = learn(records, LIBRARY.grippers)
    assert len(learned.clusters) == 3
    assert learned.covered == 1.0
    found = {}
    for cluster in learned.clusters:
        kinds = {records[i].prototype for i in cluster.members}
        assert len(kinds) == 1
        found[kinds.pop()] = (cluster.rate, bool(cluster.name))
    assert found == {
        "cylinder_040_tip": (0.8, True),
        "bar_4x4": (0.5, True),
        "edge_019": (0.0, False),
    }
    assert learned.library.names == ("learned_01", "learned_02")
    for cluster in learned.clusters:
        if not cluster.name:
            continue
        original = LIBRARY[records[cluster.medoid].prototype]
        prototype = learned.library[cluster.name]
        assert records[cluster.medoid].held
        assert prototype.width == original.width
        assert prototype.preshape == original.preshape
        assert f"{cluster.held} held" in prototype.definition.description
        facing = original.normals[:, 2] < 0.2
        distance = shape_distance(
            prototype.points,
            prototype.normals,
            original.points[facing],
            original.normals[facing],
        )
        assert distance < 0.009


def test_the_order_of_the_records_does_not_matter(records, rng):
    ours = learn(records, LIBRARY.grippers)
    order = rng.permutation(len(records))
    theirs = learn([records[i] for i in order], LIBRARY.grippers)
    kinds = [
        {frozenset(index[c.members].tolist()) for c in learned.clusters}
        for learned, index in ((ours, np.arange(len(records))), (theirs, order))
    ]
    assert kinds[0] == kinds[1]


def test_a_wider_radius_gives_fewer_kinds(records):
    counts = [
        len(learn(records, LIBRARY.grippers, LearnConfig(radius=radius)).clusters)
        for radius in (0.005, 0.012, 0.1)
    ]
    assert counts[0] > counts[1] > counts[2]


def test_other_hands_are_other_kinds(records):
    other = [replace(records[0], preshape="wide"), replace(records[1], preshape="wide")]
    learned = learn([*records[:4], *other], LIBRARY.grippers)
    assert sorted(len(c.members) for c in learned.clusters) == [2, 4]


def test_failures_alone_teach_nothing(records):
    failed = [replace(record, held=False) for record in records]
    with pytest.raises(ConfigError, match="at best 0 of"):
        learn(failed, LIBRARY.grippers)
    with pytest.raises(ConfigError, match="none"):
        learn([], LIBRARY.grippers)
    with pytest.raises(UnknownNameError, match="tongs"):
        learn([replace(records[0], gripper="tongs")], LIBRARY.grippers)


def test_records_come_back_as_they_were_saved(records, tmp_path):
    save_records(records[:3], tmp_path / "run")
    again = load_records(tmp_path / "run")
    for ours, theirs in zip(records, again, strict=False):
        assert np.allclose(ours.surface.points, theirs.surface.points, atol=1e-6)
        assert (ours.held, ours.width, ours.prototype) == (
            theirs.held,
            theirs.width,
            theirs.prototype,
        )
    with pytest.raises(OutputError, match="other records"):
        save_records(records[:1], tmp_path / "run")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"held": "yes"}, "true or false"),
        ({"schema": "other"}, "other"),
        ({"surface": "../secret.ply"}, "inside the folder"),
        ({"surface": "surfaces/none.ply"}, "none.ply"),
        ({"width": None}, "line 1"),
    ],
)
def test_damaged_records_are_refused(records, tmp_path, change, said):
    save_records(records[:1], tmp_path / "run")
    path = tmp_path / "run" / "grasps.jsonl"
    path.write_text(json.dumps(json.loads(path.read_text()) | change) + "\n")
    with pytest.raises(ConfigError, match=said):
        load_records(tmp_path / "run")


def test_a_record_is_made_of_what_was_seen_around_the_grip(rng):
    truth = grasped("cylinder_040_tip", rng).surface
    T = SE3.from_parts(p=(1.0, 0.2, 0.5))
    other = truth.points + np.array([0.0, 0.0, 0.02])
    cloud = PointCloud(
        T.apply(np.vstack([truth.points, other])),
        np.vstack([truth.normals, truth.normals]),
        np.zeros(3),
    )
    grasp = grasp_at(T, opening=0.08, width=0.04)
    is_object = np.arange(len(cloud)) < len(truth.points)
    made = recorded(cloud, is_object, grasp, LIBRARY.grippers["robotiq_3f"], held=True)
    distance = shape_distance(
        made.surface.points, made.surface.normals, truth.points, truth.normals
    )
    assert distance < 0.002
    for wrong, words in (
        ({"is_object": is_object.astype(int)}, "is_object: got int64"),
        ({"is_object": is_object[:5]}, r"is_object: got bool \(5,\)"),
        ({"held": "yes"}, "held: got 'yes'"),
        ({"cloud": cloud.points}, "cloud: got ndarray"),
        ({"gripper": LIBRARY.grippers["camhand"]}, "gripper: got camhand"),
    ):
        right = {"cloud": cloud, "is_object": is_object, "grasp": grasp, "held": True}
        right["gripper"] = LIBRARY.grippers["robotiq_3f"]
        with pytest.raises(InputError, match=words):
            recorded(**{**right, **wrong})


def test_the_command_writes_a_dictionary_that_loads(records, tmp_path, capsys):
    save_records(records, tmp_path / "run")
    out = tmp_path / "learned"
    words = ["prototype", "learn", str(tmp_path / "run"), "--out", str(out)]
    assert run(words) == 0
    assert "2 prototypes from 30 grasps" in capsys.readouterr().out
    assert PrototypeLibrary.load(out).names == ("learned_01", "learned_02")
    assert run(words) == 2
    assert "not empty" in capsys.readouterr().err
    assert run([*words[:-1], str(tmp_path / "b"), "--radius", "9"]) == 2


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("[" * 100_000, "line 1.*too many brackets"),
        ('{"width": NaN}', "line 1.*NaN"),
        ("{", "line 1"),
    ],
)
def test_lines_that_are_no_json_are_refused(tmp_path, line, said):
    (tmp_path / "grasps.jsonl").write_text(line + "\n")
    with pytest.raises(ConfigError, match=said):
        load_records(tmp_path)


def test_records_have_no_name_that_no_folder_can_have(records, tmp_path):
    folder = tmp_path / ("x" * 300)
    with pytest.raises(ConfigError, match="too long"):
        load_records(folder)
    with pytest.raises(OutputError, match="too long"):
        save_records(records[:1], folder)


def test_a_file_is_no_folder_of_records(tmp_path):
    path = tmp_path / "pile.npz"
    np.savez(path, depth=np.ones((4, 4)))
    with pytest.raises(ConfigError, match="a folder of records"):
        load_records(path)
