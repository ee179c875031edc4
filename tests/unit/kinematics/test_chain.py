from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from debrisgrasp.errors import (
    ConfigError,
    DebrisGraspError,
    ShapeError,
    UnknownNameError,
)
from debrisgrasp.kinematics import KinematicChain, RobotModel
from debrisgrasp.kinematics.urdf import UrdfTree

from .robots import ROMAN_URDF, JointText, PinocchioOracle, written

ARM = RobotModel.load("roman").chain("left")

MIXED = (
    JointText("continuous", axis=(0, 0, 1)),
    JointText("revolute", rpy=(0.3, -0.2, 0.9), axis=(0, 1, 0.2), lower=-1, upper=2),
    JointText("prismatic", xyz=(0.1, 0, 0), axis=(1, 1, 0), lower=-0.1, upper=0.4),
    JointText("fixed", xyz=(0, 0.3, 0.1), rpy=(1, 2, 3)),
    JointText("revolute", axis=(0, 0, 1)),
    JointText("revolute", xyz=(0.3, 0, 0), axis=(0, 0, 1)),
    JointText("revolute", xyz=(0.2, 0, 0), rpy=(1e-6, 0, 0), axis=(0, 0, 1)),
    JointText("continuous", axis=(1, 0, 0)),
)


@pytest.mark.parametrize("q", ["abc", [["a"] * 7], np.zeros(3), None])
def test_what_is_no_posture_is_refused_by_name(q: object) -> None:
    zero = np.zeros(ARM.n_joints)
    for ask in (ARM.fk, ARM.jacobian, ARM.named, ARM.wrapped, ARM.clipped):
        with pytest.raises(ShapeError, match="joint values"):
            ask(q)
    for compare in (ARM.difference, ARM.way, ARM.travel, ARM.unwound):
        with pytest.raises(ShapeError, match="joint values"):
            compare(zero, q)


def test_a_chain_keeps_no_array_of_others(rng: np.random.Generator) -> None:
    is_revolute = ARM.is_revolute.copy()
    chain = replace(ARM, is_revolute=is_revolute)
    is_revolute[:] = False
    q = ARM.sampled(3, rng=rng)
    np.testing.assert_array_equal(chain.fk(q).matrix, ARM.fk(q).matrix)


def test_only_one_posture_has_names(rng: np.random.Generator) -> None:
    q = ARM.sampled(2, rng=rng)
    assert list(ARM.named(q[0]).values()) == q[0].tolist()
    with pytest.raises(ShapeError, match="one posture"):
        ARM.named(q)


@pytest.mark.parametrize("tip", ["right_hand", "left_hand", "right_arm_link5"])
@pytest.mark.parametrize("base", ["base_link", "torso_link", "left_arm_link3"])
def test_forward_kinematics_and_jacobian_equal_pinocchio_on_roman(
    base: str, tip: str, rng: np.random.Generator
) -> None:
    chain = KinematicChain.from_urdf(ROMAN_URDF, base, tip)
    q = chain.sampled(20, rng=rng)
    oracle = PinocchioOracle(ROMAN_URDF, chain)
    for row, T in zip(q, chain.fk(q).matrix, strict=True):
        np.testing.assert_allclose(T, oracle(row)[0], atol=1e-9)
    if base == "base_link":
        for row, J in zip(q, chain.jacobian(q), strict=True):
            np.testing.assert_allclose(J, oracle(row)[1], atol=1e-9)


def test_mixed_joints_and_parallel_axes_equal_pinocchio(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    path = written(tmp_path, MIXED)
    chain = KinematicChain.from_urdf(path, "link0", "link8")
    assert chain.n_joints == 7
    oracle = PinocchioOracle(path, chain)
    q = chain.sampled(20, rng=rng)
    T, J = chain.fk(q).matrix, chain.jacobian(q)
    for i, row in enumerate(q):
        np.testing.assert_allclose(T[i], oracle(row)[0], atol=1e-9)
        np.testing.assert_allclose(J[i], oracle(row)[1], atol=1e-9)


def test_single_precision_form_is_close_to_double(
    arm: KinematicChain, rng: np.random.Generator
) -> None:
    q = arm.sampled(50, rng=rng).T
    exact = arm.form.frames(q)
    rough = arm.single_form.frames(q.astype(np.float32))
    np.testing.assert_allclose(rough.p, exact.p, atol=1e-5)


def test_swapping_base_and_tip_inverts_the_pose(rng: np.random.Generator) -> None:
    there = KinematicChain.from_urdf(ROMAN_URDF, "torso_link", "left_hand")
    back = KinematicChain.from_urdf(ROMAN_URDF, "left_hand", "torso_link")
    assert back.joint_names == there.joint_names[::-1]
    q = there.sampled(10, rng=rng)
    product = there.fk(q) @ back.fk(q[:, ::-1])
    np.testing.assert_allclose(
        product.matrix, np.tile(np.eye(4), (10, 1, 1)), atol=1e-12
    )


def test_batches_of_any_shape_equal_single_postures(
    arm: KinematicChain, rng: np.random.Generator
) -> None:
    q = arm.sampled(6, rng=rng)
    T, J = arm.fk(q.reshape(2, 3, 8)), arm.jacobian(q.reshape(2, 3, 8))
    assert T.batch == (2, 3)
    assert J.shape == (2, 3, 6, 8)
    for i, row in enumerate(q):
        np.testing.assert_allclose(T.matrix.reshape(6, 4, 4)[i], arm.fk(row).matrix)
        np.testing.assert_allclose(J.reshape(6, 6, 8)[i], arm.jacobian(row), atol=1e-12)
    assert arm.fk(np.zeros((0, 8))).batch == (0,)


def test_joint_frames_carry_the_links(
    arm: KinematicChain, rng: np.random.Generator
) -> None:
    q = arm.sampled(5, rng=rng)
    frames = arm.joint_frames(q)
    tip_in_last = np.linalg.inv(arm.joint_frames(np.zeros(8)).matrix[-1]) @ (
        arm.T_base_tip_at_zero.matrix
    )
    np.testing.assert_allclose(
        frames.matrix[:, -1] @ tip_in_last, arm.fk(q).matrix, atol=1e-12
    )


def test_a_locked_joint_leaves_the_chain_at_its_value(
    arm: KinematicChain, rng: np.random.Generator
) -> None:
    still = KinematicChain.from_urdf(
        ROMAN_URDF, "base_link", "right_hand", {"torso_joint": 0.4}
    )
    q = still.sampled(5, rng=rng)
    whole = np.concatenate([np.full((5, 1), 0.4), q], axis=1)
    assert "torso_joint" not in still.joint_names
    np.testing.assert_allclose(still.fk(q).matrix, arm.fk(whole).matrix, atol=1e-12)


def test_hash_changes_with_limits_and_geometry_only(arm: KinematicChain) -> None:
    again = KinematicChain.from_urdf(ROMAN_URDF, "base_link", "right_hand")
    other = KinematicChain.from_urdf(ROMAN_URDF, "base_link", "left_hand")
    assert arm.hash == again.hash != other.hash


def test_a_tip_that_does_not_exist_names_a_near_one() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'right_hand'"):
        KinematicChain.from_urdf(ROMAN_URDF, "base_link", "right_hnd")


def test_an_unknown_locked_joint_is_named() -> None:
    with pytest.raises(UnknownNameError, match="torso_joint"):
        KinematicChain.from_urdf(
            ROMAN_URDF, "base_link", "right_hand", {"torso_jont": 0.0}
        )


@pytest.mark.parametrize("kind", ["floating", "planar", "spherical"])
def test_an_unsupported_joint_says_what_is_supported(tmp_path: Path, kind: str) -> None:
    path = written(tmp_path, [JointText(), JointText(kind), JointText()])
    with pytest.raises(ConfigError, match=f"a {kind} joint.*revolute, continuous"):
        KinematicChain.from_urdf(path, "link0", "link3")
    # Outside the chain it does no harm.
    assert KinematicChain.from_urdf(path, "link2", "link3").n_joints == 1


def test_a_mimic_joint_in_the_chain_names_its_driver(tmp_path: Path) -> None:
    mimic = JointText(extra='<mimic joint="joint1" multiplier="2"/>')
    path = written(tmp_path, [JointText(), mimic])
    with pytest.raises(ConfigError, match="mimic joint, driven by 'joint1'"):
        KinematicChain.from_urdf(path, "link0", "link2")
    locked = KinematicChain.from_urdf(path, "link0", "link2", {"joint2": 0.1})
    assert locked.joint_names == ("joint1",)


def test_zero_width_limits_are_refused_with_a_mend(tmp_path: Path) -> None:
    path = written(tmp_path, [JointText(), JointText(lower=0.3, upper=0.3)])
    with pytest.raises(ConfigError, match=r"joint2.*locked=\{'joint2'"):
        KinematicChain.from_urdf(path, "link0", "link2")


def test_limits_in_degrees_are_refused_with_a_mend(tmp_path: Path) -> None:
    path = written(tmp_path, [JointText(), JointText(lower=-90, upper=90)])
    with pytest.raises(ConfigError, match=r"joint2.*-90 to 90.*pi / 180"):
        KinematicChain.from_urdf(path, "link0", "link2")
    far = [JointText("prismatic", upper=19), JointText("continuous", upper=90)]
    path = written(tmp_path, [*far, JointText(lower=-25, upper=25)])
    assert KinematicChain.from_urdf(path, "link0", "link3").n_joints == 3


def test_limits_in_millimetres_are_refused_with_a_mend(tmp_path: Path) -> None:
    path = written(tmp_path, [JointText("prismatic", lower=-900, upper=900)])
    with pytest.raises(ConfigError, match=r"joint1.*900.*metres.*divide by 1000"):
        KinematicChain.from_urdf(path, "link0", "link1")


def test_a_slide_without_a_range_is_not_told_to_turn(tmp_path: Path) -> None:
    path = written(tmp_path, [JointText("prismatic", lower=0.9, upper=-0.9)])
    with pytest.raises(ConfigError, match=r"joint1.*0\.9 to -0\.9") as refused:
        KinematicChain.from_urdf(path, "link0", "link1")
    assert "metres" in str(refused.value)
    assert "continuous" not in str(refused.value)


def test_a_chain_without_moving_joints_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, [JointText("fixed")])
    with pytest.raises(ConfigError, match="no joint that moves"):
        KinematicChain.from_urdf(path, "link0", "link1")


def test_missing_meshes_do_not_matter(tmp_path: Path) -> None:
    mesh = (
        '<collision><geometry><mesh filename="package://no/where.stl"/>'
        "</geometry></collision>"
    )
    path = written(tmp_path, [JointText()] * 6, collision=mesh)
    assert KinematicChain.from_urdf(path, "link0", "link6").n_joints == 6


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<robot name='r'><link name='a'>", "well-formed XML"),
        ("<sdf/>", "<robot>"),
        ("<robot><link name='a'/><link name='b'/></robot>", "one tree"),
        ("<robot><link name='a'/><link name='a'/></robot>", "links in .*'a' 2 times"),
        (
            "<robot><link name='a'/><link name='b'/><link name='c'/>"
            "<joint name='j' type='fixed'><parent link='a'/><child link='b'/></joint>"
            "<joint name='j' type='fixed'><parent link='a'/><child link='c'/></joint>"
            "</robot>",
            "joints in .*'j' 2 times",
        ),
        (
            "<robot><link name='a'/><joint name='j' type='fixed'>"
            "<parent link='a'/><child link='z'/></joint></robot>",
            "unknown link",
        ),
        (
            "<robot><link name='a'/><link name='b'/><joint name='j' type='fixed'>"
            "<parent link='a'/></joint></robot>",
            "no <child>",
        ),
        (
            "<robot><link name='a'/><link name='b'/><joint name='j' type='revolute'>"
            "<parent link='a'/><child link='b'/><origin xyz='1 2'/></joint></robot>",
            "xyz in <origin> of joint 'j'.*3 numbers",
        ),
        (
            "<robot><link name='a'/><link name='b'/><joint name='j' type='revolute'>"
            "<parent link='a'/><child link='b'/><origin xyz='0 0 430'/></joint>"
            "</robot>",
            "xyz in .*metres.*millimetres",
        ),
        (
            "<robot><link name='a'/><link name='b'/><joint name='j' type='revolute'>"
            "<parent link='a'/><child link='b'/><limit lower='nan'/></joint></robot>",
            "lower in <limit> of joint 'j'.*'nan'.*a finite number",
        ),
        (
            "<robot><link name='a'/><link name='b'/><joint name='j' type='revolute'>"
            "<parent link='a'/><child link='b'/><axis xyz='0 0 0'/></joint></robot>",
            "a direction",
        ),
        (
            "<robot><link name='a'><collision><geometry><box size='1 1 -1'/>"
            "</geometry></collision></link></robot>",
            "box.* of link 'a'.*above zero",
        ),
        (
            "<robot><link name='a'><collision><geometry><cone radius='1'/>"
            "</geometry></collision></link></robot>",
            "<cone>",
        ),
    ],
)
def test_a_malformed_urdf_is_refused_in_words(
    tmp_path: Path, text: str, words: str
) -> None:
    path = tmp_path / "bad.urdf"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DebrisGraspError, match=words):
        KinematicChain.from_urdf(path, "a", "b")


NAMED = "<?xml version='1.0' encoding='{0}'?>"
XACRO = b"<robot xmlns:xacro='http://www.ros.org/wiki/xacro'><link name='a'/>"
LATIN = "<robot name='é'><link name='a'/></robot>"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (LATIN.encode("latin-1"), "line 1.*Save it as UTF-8"),
        (NAMED.format("klingon").encode() + LATIN.encode(), "unknown encoding: kl"),
        (NAMED.format("big5").encode() + LATIN.encode(), "multi-byte encodings"),
        (bytes(range(256)), "no <robot> in it"),
        (b"<robot><xacro:arm/></robot>", r"xacro FILE > robot\.urdf"),
        (
            XACRO + b"<xacro:include filename='b'/></robot>",
            r"a xacro file.* xacro FILE",
        ),
        (XACRO + b"<link name='${a}'/></robot>", r"a xacro file.* xacro FILE"),
    ],
    ids=["latin", "unknown", "multi-byte", "binary", "xacro", "include", "property"],
)
def test_a_urdf_that_is_no_text_of_xml_is_refused_with_its_mend(
    tmp_path: Path, content: bytes, words: str
) -> None:
    path = tmp_path / "bad.urdf"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=rf"bad\.urdf.*{words}") as caught:
        UrdfTree.load(path)
    assert ("xacro" in str(caught.value)) == (b"xacro" in content)


def test_a_device_is_no_urdf_and_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "endless.urdf"
    path.symlink_to("/dev/zero")
    with pytest.raises(ConfigError, match=r"endless\.urdf: a device"):
        UrdfTree.load(path)


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16", "utf-8-sig"])
def test_a_urdf_may_be_in_the_encoding_that_it_names(
    tmp_path: Path, encoding: str
) -> None:
    path = tmp_path / "good.urdf"
    path.write_bytes(
        (NAMED.format(encoding.removesuffix("-sig")) + LATIN).encode(encoding)
    )
    assert UrdfTree.load(path).name == "é"


def test_a_closed_loop_of_links_is_refused(tmp_path: Path) -> None:
    joint = (
        "<joint name='{0}' type='fixed'><parent link='{1}'/><child link='{2}'/></joint>"
    )
    loop = joint.format("j", "a", "b") + joint.format("k", "b", "a")
    path = tmp_path / "loop.urdf"
    links = "<link name='a'/><link name='b'/><link name='c'/>"
    path.write_text(f"<robot>{links}{loop}</robot>", encoding="utf-8")
    with pytest.raises(ConfigError, match="closed loop"):
        KinematicChain.from_urdf(path, "a", "b")


def test_a_urdf_that_does_not_exist_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.urdf"):
        KinematicChain.from_urdf(tmp_path / "none.urdf", "a", "b")


@given(
    st.floats(-20.0, 20.0), st.floats(-7.0, 7.0), st.floats(0.05, 7.0) | st.just(np.inf)
)
def test_postures_unwind_to_the_nearest_whole_turn_within_the_limits(
    q: float, near: float, most: float
) -> None:
    n = ARM.n_joints
    chain = replace(ARM, lower=np.full(n, -most), upper=np.full(n, most))
    found = chain.unwound(np.full(n, q), np.full(n, near))
    turns = q + 2.0 * np.pi * np.arange(-5, 6)
    within = turns[np.abs(turns) <= most]
    nearest = np.abs(within - near).min() if len(within) else abs(q - near)
    np.testing.assert_allclose(np.abs(found - near), nearest, atol=1e-9)


def test_wrong_number_of_joint_values_is_refused(arm: KinematicChain) -> None:
    with pytest.raises(DebrisGraspError, match="joint values"):
        arm.fk(np.zeros(7))


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 99.0, -1.6, "up"])
def test_a_locked_joint_can_only_stand_within_its_limits(value: float) -> None:
    with pytest.raises(ConfigError, match=r"'torso_joint'.*-1\.57.* to 1\.57"):
        KinematicChain.from_urdf(
            ROMAN_URDF, "base_link", "right_hand", {"torso_joint": value}
        )


def test_a_chain_of_numbers_that_are_none_is_refused(arm: KinematicChain) -> None:
    with pytest.raises(DebrisGraspError, match="points of a chain"):
        replace(arm, points=np.full_like(arm.points, np.nan))
