"""A hand from a text file: what it may say, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, DebrisGraspError
from debrisgrasp.prototypes import GripperModel, known_grippers, load_grippers

JAW = """\
name: jaw
mass: 1.0
max_force: 100
base: {}
palm:
  - {type: box, size: [0.2, 0.04, 0.06], position: [0, 0, -0.03]}
chains:
  jaw:
    - joint: {name: slide, type: prismatic, axis: [1, 0, 0]}
      solids: [{type: box, size: [0.01, 0.02, 0.08], position: [0.005, 0, 0.04]}]
      pad: [0, 0, 0.07]
fingers:
  - {name: left, side: thumb, chain: jaw, rpy_deg: [0, 0, 180]}
  - {name: right, side: pair, chain: jaw}
preshapes:
  parallel:
    widths: [0.001, 0.08]
    closing: {command: [0, 255], slide: [0.04, 0]}
"""


def load_text(folder: Path, text: str) -> GripperModel:
    (folder / "jaw.yaml").write_text(text)
    return GripperModel.load(folder / "jaw.yaml")


def test_a_parallel_jaw_is_a_text_file(tmp_path: Path) -> None:
    jaw = load_text(tmp_path, JAW)
    assert jaw.opening_range == pytest.approx((0.0, 0.08))
    assert jaw.opening_to_command("parallel", 0.06) == pytest.approx(63.75)
    pads = jaw.pad_positions("parallel", 0.06)
    assert np.allclose(pads, [[-0.03, 0, 0.07], [0.03, 0, 0.07]])
    assert jaw.fingertip_reach("parallel", 0.06) == pytest.approx(0.08)
    assert jaw.joint_values("parallel", 0.06) == pytest.approx(
        {"left_slide": 0.03, "right_slide": 0.03}
    )


def test_degrees_may_turn_more_than_once(tmp_path: Path) -> None:
    turned = load_text(tmp_path, JAW.replace("[0, 0, 180]", "[0, 0, 540]"))
    pads = turned.pad_positions("parallel", 0.06)
    assert np.allclose(pads, [[-0.03, 0, 0.07], [0.03, 0, 0.07]])


def test_round_solids_are_understood(tmp_path: Path) -> None:
    rounded = JAW.replace(
        "palm:\n",
        "palm:\n"
        "  - {type: sphere, radius: 0.01, position: [0, 0, -0.2]}\n"
        "  - {type: capsule, radius: 0.01, length: 0.1, position: [0, 0, -0.1]}\n",
    )
    palm = load_text(tmp_path, rounded).palm
    assert len(palm) == 3
    assert palm[0].bounds.lower[2] == pytest.approx(-0.21)


@pytest.mark.parametrize(
    ("found", "replacement", "message"),
    [
        ("size: [0.01, 0.02, 0.08]", "size: [10, 20, 80]", r"solids\[0\].size.*1 m"),
        ("size: [0.01, 0.02, 0.08]", "size: [0, 0.02, 0.08]", r"size.*above 0"),
        ("type: box", "type: cone", r"palm\[0\].type.*box, cylinder"),
        ("chain: jaw", "chain: claw", r"chain.*'claw'.*jaw"),
        ("side: pair", "side: thumb", r"fingers.*each side"),
        ("side: pair", "side: left", r"side.*thumb, pair"),
        ("      pad: [0, 0, 0.07]\n", "", r"chains.jaw.*no pad"),
        ("pad: [0, 0, 0.07]", "pad: [0, 0, 0.12]", r"pad of finger left.* 40 mm from"),
        ("[0.04, 0]", "[0, 0.04]", r"parallel.closing.*move apart"),
        ("[0.04, 0]", "[0.04, 0, 0]", r"closing.slide.*list of 2"),
        ("[0, 255]", "[255, 0]", r"closing.command.*rising"),
        ("slide: [0.04, 0]", "glide: [0.04, 0]", r"joint.*'glide'.*slide"),
        (", slide: [0.04, 0]", "", r"no values of slide"),
        ("[0.001, 0.08]", "[-0.01, 0.08]", r"parallel.widths.*0 < smallest"),
        ("[0.001, 0.08]", "[0.001, 0.2]", r"parallel.widths.*0.080 m"),
        (", rpy_deg: [0, 0, 180]", "", r"parallel.closing.*no nearer.*rpy of each"),
        ("[0.04, 0]", "[0.04, 0.01]", r"parallel.closing.*no nearer than 0.020 m"),
        ("axis: [1, 0, 0]", "axis: [0, 1, 0]", r"no nearer, 0.000 m apart along x"),
        ("rpy_deg", "rpy", r"fingers\[0\].rpy.*radians.*rpy_deg"),
        ("[0, 0, 180]", "[0, 1.57, -3.1416]", r"fingers\[0\].rpy_deg.*say rpy instead"),
        ("[0, 0, 180]", "[0, 0, 900000]", r"rpy_deg.*900000.*degrees, at most 720"),
        ("axis: [1, 0, 0]", "axis: [0, 0, 0]", r"joint.axis"),
        ("mass: 1.0", "mass: heavy", r"field mass.*finite number"),
        ("mass: 1.0\n", "", r"field mass.*missing"),
        ("name: jaw\n", "name: jaw\nweight: 3\n", r"field.*'weight'.*mass"),
        ("  jaw:\n", "  jaw: []\n  other:\n", r"chains.jaw.*no link"),
        (JAW, "", r"jaw.yaml.*mapping"),
    ],
)
def test_bad_hands_are_refused_with_file_field_and_range(
    tmp_path: Path, found: str, replacement: str, message: str
) -> None:
    assert found in JAW
    with pytest.raises(DebrisGraspError, match=f"(?s){message}"):
        load_text(tmp_path, JAW.replace(found, replacement, 1))


HOOKS = """\
name: hooks
mass: 1.0
max_force: 100
base: {}
palm:
  - {type: box, size: [0.2, 0.04, 0.06], position: [0, 0, -0.03]}
chains:
  hook:
    - joint: {name: root, axis: [0, 1, 0]}
      solids: [{type: box, size: [0.01, 0.02, 0.04], position: [0, 0, 0.02]}]
    - position: [0, 0, 0.04]
      joint: {name: tip, axis: [0, 1, 0]}
      solids: [{type: box, size: [0.01, 0.02, 0.04], position: [0, 0, 0.02]}]
    - pad: [0, 0, 0.04]
fingers:
  - {name: left, side: thumb, chain: hook, position: [-0.04, 0, 0]}
  - {name: right, side: pair, chain: hook, position: [0.04, 0, 0], rpy_deg: [0, 0, 180]}
preshapes:
  fist:
    widths: [0.001, 0.08]
    fixed: {tip: 0.0}
    closing: {command: [0, 1], root: [0, 0.7]}
"""
SOLIDS = (
    "      solids: [{type: box, size: [0.01, 0.02, 0.04], position: [0, 0, 0.02]}]\n"
)


def test_a_link_without_solids_may_carry_the_pad(tmp_path: Path) -> None:
    hooks = load_text(tmp_path, HOOKS)
    assert len(hooks.finger_solids("fist", 0.05)) == 4
    assert hooks.joint_values("fist", 0.08)["left_root"] == pytest.approx(0.0)


def test_a_finger_without_joint_takes_its_solids_from_anywhere(tmp_path: Path) -> None:
    """A fixed jaw: the one of the finger itself does for a chain without any."""
    jaw = JAW.replace("chain: jaw}", "chain: anvil, position: [0.0, 0, 0]}")
    jaw = jaw.replace("fingers:\n", "  anvil: [{pad: [0, 0, 0.07]}]\nfingers:\n")
    jaw = jaw.replace("[0.001, 0.08]", "[0.001, 0.04]")
    with pytest.raises(ConfigError, match=r"fingers\[1\]\.solids.*chains\.anvil"):
        load_text(tmp_path, jaw)
    solid = "solids: [{type: sphere, radius: 0.01, position: [0.01, 0, 0.07]}]}"
    fixed = jaw.replace("position: [0.0, 0, 0]}", solid)
    hand = load_text(tmp_path, fixed)
    assert len(hand.finger_solids("parallel", 0.03, 1)) == 1
    poses = hand.link_poses("parallel", np.array([0.01, 0.02, 0.03]))
    assert {link.batch for finger in poses for link in finger} == {(3,)}


@pytest.mark.parametrize(
    ("found", "replacement", "message"),
    [
        (
            "[0, 0, 0.04]\n      joint: {name: tip, axis: [0, 1, 0]}\n" + SOLIDS,
            "[0, 0, 0.04]\n      joint: {name: tip, axis: [0, 1, 0]}\n",
            r"field chains\.hook\[1\]\.solids: got no solid.*Give the link",
        ),
        (
            "root: [0, 0.7]",
            "root: [0, 40]",
            r"fist\.closing\.root: got 40\.0, .*2 pi.*degrees, 40 degrees is 0\.6981",
        ),
        ("root: [0, 0.7]", "root: [-45, 0]", r"closing\.root: got -45.*is -0\.7854"),
        ("tip: 0.0", "tip: 9", r"fist\.fixed\.tip: got 9\.0, .*9 degrees is 0\.1571"),
        ("tip: 0.0", "tip: 30", r"fist\.fixed\.tip: got 30.*30 degrees is 0\.5236"),
        ("{tip: 0.0}", "{tip: 0.0, root: 1}", r"fixed\.root: got 1 .*closing lists"),
        ("{name: tip,", "{name: root,", r"fingers: got left_root, right_root more"),
    ],
)
def test_hooks_that_cannot_be_are_refused(
    tmp_path: Path, found: str, replacement: str, message: str
) -> None:
    assert found in HOOKS
    with pytest.raises(ConfigError, match=f"(?s){message}"):
        load_text(tmp_path, HOOKS.replace(found, replacement, 1))


PALM = "  - {type: box, size: [0.2, 0.04, 0.06], position: [0, 0, -0.03]}\n"
FINGER = JAW[JAW.index("      solids") : JAW.index("      pad")]


@pytest.mark.parametrize(
    ("found", "replacement", "message"),
    [
        (FINGER, "", r"field chains\.jaw\[0\]\.solids: got no solid.*Give the link"),
        (FINGER, "      solids: []\n", r"field chains\.jaw\[0\]\.solids: got no solid"),
        ("max_force: 100", "max_force: 0", r"max_force: got 0\.0, .*0\.01 to.*newtons"),
        ("max_force: 100", "max_force: -5", r"max_force: got -5\.0, .*0\.01 to"),
        ("max_force: 100", "max_force: .nan", r"max_force: got nan, .*0\.01 to"),
        ("mass: 1.0", "mass: 0", r"field mass: got 0\.0, .*0\.001 to 100.*kilograms"),
        ("mass: 1.0", "mass: -1", r"field mass: got -1\.0, .*0\.001 to 100"),
        ("mass: 1.0", "mass: 800", r"field mass: got 800\.0, .*800 g is 0\.8"),
        ("name: right", "name: left", r"fingers\[1\]\.name: got 'left' a second time"),
        ("palm:\n" + PALM, "palm: []\n", r"field palm: got no solid.*A box"),
        ("palm:\n" + PALM, "", r"field palm: got nothing: it is missing"),
        (
            "[0.04, 0]}",
            "[42.5, 0]}",
            r"closing\.slide: got 42\.5, .*metres.*42\.5 mm is 0\.0425",
        ),
        (
            "axis: [1, 0, 0]",
            "axis: [1, 0, 0], sign: 0",
            r"joint\.sign: got 0, .*leave it out",
        ),
        ("[0.04, 0]}", "[-2, -42]}", r"closing\.slide: got -42\.0, .*is -0\.042"),
    ],
)
def test_hands_that_cannot_be_are_refused_with_what_mends_them(
    tmp_path: Path, found: str, replacement: str, message: str
) -> None:
    assert found in JAW
    with pytest.raises(ConfigError, match=rf"(?s)jaw\.yaml.*{message}"):
        load_text(tmp_path, JAW.replace(found, replacement, 1))


def test_a_hand_without_a_joint_cannot_close(tmp_path: Path) -> None:
    joint = "joint: {name: slide, type: prismatic, axis: [1, 0, 0]}\n      "
    still = JAW.replace(joint, "").replace(", slide: [0.04, 0]", "")
    with pytest.raises(ConfigError, match=r"closing: got pads that come no nearer"):
        load_text(tmp_path, still)


def test_shipped_and_example_hands_can_be() -> None:
    example = Path(__file__).parents[3] / "examples" / "grippers" / "jaw_140.yaml"
    for hand in (*known_grippers(), str(example)):
        assert GripperModel.load(hand).fingers


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.yaml"):
        GripperModel.load(tmp_path / "nowhere.yaml")


def test_a_name_that_ships_is_refused_with_the_whole_path(tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(JAW.replace("name: jaw", "name: camhand"))
    with pytest.raises(ConfigError, match=r"camhand.*shipped") as refused:
        load_grippers(tmp_path)
    assert str(tmp_path / "own.yaml") in str(refused.value)


def test_hands_are_found_in_yml_files_too(tmp_path: Path) -> None:
    (tmp_path / "own.yml").write_text(JAW)
    (tmp_path / "._own.yml").write_bytes(b"\0\5\x16\7Mac OS X")
    assert "jaw" in load_grippers(tmp_path)
