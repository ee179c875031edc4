"""Robots as files alone: frames that the URDF lacks, URDFs of packages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from debrisgrasp._files import data_path
from debrisgrasp._site_limits import SiteLimits
from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.kinematics import KinematicChain, RobotModel

from .robots import JointText, row_robot, urdf_text, written

POSITION, RPY = (0.1, -0.2, 0.3), (0.4, -0.5, 0.6)
BOX = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'


@pytest.fixture
def described(tmp_path: Path):
    """Write a row of six joints with settings beside it; returns the robot's file."""
    (tmp_path / "row.urdf").write_text(urdf_text([JointText()] * 6, BOX))
    joints = [f"joint{i}" for i in range(1, 7)]
    arm = {
        "tip": "palm",
        "gripper": "none",
        "hand": "link6",
        "joints": joints,
        "postures": {"zero": {}},
        "present": "zero",
        "idle": "zero",
    }

    def write(frames: object, **changes: object) -> Path:
        content = {
            "name": "row",
            "urdf": "row.urdf",
            "base": "ground",
            "frames": frames,
            "arms": {"arm": arm},
        }
        path = tmp_path / "row.yaml"
        path.write_text(yaml.safe_dump(content | changes))
        return path

    return write


def frames() -> dict[str, dict[str, object]]:
    return {
        "palm": {"parent": "link6", "position": list(POSITION), "rpy": list(RPY)},
        "ground": {"parent": "link0", "position": [-1.0, 0.5, -0.4]},
    }


def test_frames_serve_as_base_and_tip(described):
    robot = RobotModel.load(described(frames()))
    chain = robot.chain("arm")
    T_ground_root = SE3.from_parts(p=[1.0, -0.5, 0.4])
    T_root_flange = SE3.from_parts(p=[0.0, 0.0, 1.2])  # six joints, 0.2 m apart
    T_flange_palm = SE3.from_parts(so3.from_rpy(np.array(RPY)), POSITION)
    expected = T_ground_root @ T_root_flange @ T_flange_palm
    np.testing.assert_allclose(
        chain.fk(np.zeros(6)).matrix, expected.matrix, atol=1e-12
    )
    np.testing.assert_allclose(
        robot.link_poses()["palm"].matrix, expected.matrix, atol=1e-12
    )


def test_a_frame_may_hang_on_another_frame(described):
    more = frames()
    more["finger"] = {"parent": "palm", "position": [0.0, 0.0, 0.1]}
    poses = RobotModel.load(described(more)).link_poses()
    between = poses["palm"].inverse() @ poses["finger"]
    np.testing.assert_allclose(between.p, (0.0, 0.0, 0.1), atol=1e-12)


def test_a_frame_has_no_body(described):
    robot = RobotModel.load(described(frames()))
    assert robot.tree.shapes["palm"] == ()
    assert robot.tree.body_of("palm") == robot.tree.body_of("link6")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"parent": "link7"}, "link7.*Did you mean"),
        ({"position": [0, 0]}, "position in .*frame palm.*three numbers"),
        ({"position": [0, 0, "a"]}, "position in .*frame palm.*three numbers"),
        (
            {"position": [0, 0, 90]},
            "position in .*frame palm.*If these are millimetres",
        ),
        ({"rpy": [0, 0, 90]}, "rpy in .*frame palm.*radians"),
        ({"xyz": [0, 0, 0]}, "unknown field in .*frame palm: got 'xyz'"),
        ({"parent": "palm"}, "frames of .*: got a loop: palm on palm"),
    ],
)
def test_a_wrong_frame_is_refused(described, change, message):
    wrong = frames()
    wrong["palm"] = {"parent": "link6"} | change
    with pytest.raises((ConfigError, UnknownNameError), match=message):
        RobotModel.load(described(wrong))


def test_a_loop_of_frames_is_named_by_its_frames(described):
    wrong = frames()
    wrong["palm"] = {"parent": "wrist"}
    wrong["wrist"] = {"parent": "thumb"}
    wrong["thumb"] = {"parent": "palm"}
    with pytest.raises(ConfigError, match="palm on wrist on thumb on palm") as caught:
        RobotModel.load(described(wrong))
    assert caught.value.what.startswith("frames of ")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"limits": {"acceleration": 170.0}}, "If these are degrees, 170 is 2.97 rad"),
        ({"limits": {"force": 0.0}}, "limits.force"),
        ({"limits": {"force": "80"}}, r"limits.force .*'80'.*\[rad/s\^2 or m/s\^2, N,"),
        (
            {"limits": {"acceleration": {"joint2": 0.0}}},
            "limits.acceleration.joint2 in .*above zero",
        ),
        ({"limits": {"acceleration": {"joint2": True}}}, "acceleration.joint2 in"),
        ({"postures": {"zero": {"joint2": 90.0}}}, r"joint2 in posture.*degrees"),
        ({"hand": "link3"}, r"hand of arm arm.*'link3', which carries joint joint4"),
        (
            {"hand": "ground"},
            "hand of arm arm.*'ground', which is not carried by joint joint1",
        ),
        ({"joints": ["joint1", "joint2", "joint1"]}, "joints of .*joint1, twice"),
        (
            {"joints": ["joint1", "palm_joint"]},
            "joints of .*palm_joint, which is fixed",
        ),
        ({"tip": "link3"}, "joints of .*joint4, not between.*'ground' and tip 'link3'"),
    ],
)
def test_a_wrong_arm_is_refused(described, change, message):
    right = yaml.safe_load(described(frames()).read_text())["arms"]["arm"]
    with pytest.raises(ConfigError, match=message):
        RobotModel.load(described(frames(), arms={"arm": right | change}))


def test_a_posture_names_joints_that_can_not_stand_at_zero(tmp_path):
    path = row_robot(tmp_path, "", joint=JointText("prismatic", lower=0.2))
    with pytest.raises(
        ConfigError, match=r"joint1 in posture 'zero'.*0\.2 to 2 m.*nam"
    ):
        RobotModel.load(path)
    named = {"zero": {f"joint{i}": 0.5 for i in range(1, 7)}}
    path = row_robot(
        tmp_path, "", joint=JointText("prismatic", lower=0.2), postures=named
    )
    assert RobotModel.load(path).posture("one", "zero") == named["zero"]


def test_an_endless_joint_of_a_posture_is_not_in_degrees(tmp_path):
    endless = JointText("continuous")
    turned = {"zero": {"joint2": -6.28}}
    path = row_robot(tmp_path, "", joint=endless, postures=turned)
    assert RobotModel.load(path).posture("one", "zero") == turned["zero"]
    far = {"zero": {"joint2": 90.0}}
    path = row_robot(tmp_path, "", joint=endless, postures=far)
    with pytest.raises(ConfigError, match=r"joint2 in posture.*90.*a turn.*degrees"):
        RobotModel.load(path)


def test_accelerations_may_be_given_by_joint(described):
    arm = yaml.safe_load(described(frames()).read_text())["arms"]["arm"]
    own = {"joint1": 0.5, "joint3": 4.0}
    path = described(frames(), arms={"arm": arm | {"limits": {"acceleration": own}}})
    robot = RobotModel.load(path)
    assert robot.limits("arm").planner.acceleration.tolist() == [0.5, 2, 4, 2, 2, 2]
    slower = SiteLimits(acceleration=0.5).of_robot(robot)
    assert slower.limits("arm").planner.acceleration.tolist() == [0.25, 1, 2, 1, 1, 1]
    wrong = arm | {"limits": {"acceleration": {"joint7": 1.0}}}
    with pytest.raises(UnknownNameError, match=r"acceleration of .*'joint7'"):
        RobotModel.load(described(frames(), arms={"arm": wrong}))


def test_a_joint_that_drives_another_of_the_arm_cannot_move_alone(tmp_path):
    """Left out of the joints as it has no value of its own, the other would stand."""
    mimic = JointText(extra='<mimic joint="joint1" multiplier="-1"/>')
    joints = {"joints": [f"joint{i}" for i in range(1, 6)]}
    path = row_robot(tmp_path, "", **joints)
    written(tmp_path, [*[JointText()] * 5, mimic])
    with pytest.raises(ConfigError, match="joint1, which drives joint6 between"):
        RobotModel.load(path)
    path = row_robot(tmp_path, "", joints=joints["joints"][1:])
    written(tmp_path, [*[JointText()] * 5, mimic])
    assert RobotModel.load(path).chain("one").n_joints == 4


def test_what_an_arm_calls_its_own_must_not_be_of_another(tmp_path):
    """As where the entry of one arm was copied for the other."""
    arms = yaml.safe_load(data_path("robots", "roman.yaml").read_text("utf-8"))["arms"]
    right, left = arms["right"], arms["left"]
    ready = r"posture 'ready' of arm left .*right_arm_joint1, a joint of another arm"
    for copied, message in (
        ("joints", r"joints of arm left .*right_arm_joint1, not between"),
        ("hand", r"hand of arm left .*palm_link', which is not carried by .*left_arm"),
        ("postures", ready),
    ):
        content = yaml.safe_load(data_path("robots", "roman.yaml").read_text("utf-8"))
        content["urdf"] = str(data_path("robots", "roman.urdf"))
        content["arms"] = {"right": right, "left": left | {copied: right[copied]}}
        path = tmp_path / "copied.yaml"
        path.write_text(yaml.safe_dump(content), "utf-8")
        with pytest.raises(ConfigError, match=message):
            RobotModel.load(path)


def test_no_joint_of_an_arm_may_move_the_base(described):
    with pytest.raises(ConfigError, match="joint1, not between them"):
        RobotModel.load(described(frames(), base="link1"))


def test_a_robot_stands_only_where_it_is_low(described):
    """The box of the lowest link is 0.35 m above the ground, as a gantry's beam is."""
    robot = RobotModel.load(described(frames()))
    assert not robot.stands_at((1.0, -0.5), 0.34)
    assert robot.stands_at((1.0, -0.5), 0.36)
    assert not robot.stands_at((0.9, -0.5), 0.36)


def test_names_may_be_numbers(described):
    """YAML reads 1 as a number; where names meet, each has to be text."""
    arm = yaml.safe_load(described(frames()).read_text())["arms"]["arm"]
    numbered = arm | {"postures": {0: {}, 1: {}}, "present": "0", "idle": "1"}
    robot = RobotModel.load(described(frames(), arms={1: numbered, 2: numbered}))
    assert tuple(robot.arms) == tuple(arm.name for arm in robot.arms.values())
    with pytest.raises(UnknownNameError, match="one of 1, 2"):
        robot.arm("port")
    with pytest.raises(ConfigError, match="one of its postures: 0, 1"):
        RobotModel.load(described(frames(), arms={1: numbered | {"idle": "2"}}))


def test_a_joint_that_rests_beyond_its_limits_is_refused(described):
    with pytest.raises(ConfigError, match=r"joint1 in rest of robot row.*degrees"):
        RobotModel.load(described(frames(), rest={"joint1": 90.0}))


def test_a_frame_must_not_take_the_name_of_a_link(described):
    wrong = frames() | {"link3": {"parent": "link0"}}
    with pytest.raises(ConfigError, match="a name that no link and no joint has"):
        RobotModel.load(described(wrong))


@pytest.mark.parametrize("variable", ["ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"])
def test_urdf_and_meshes_of_a_package_are_found(
    described, monkeypatch, tmp_path, variable
):
    share = tmp_path / "ws" / "share"
    (share / "row_description").mkdir(parents=True)
    (share / "row_shapes").mkdir()
    (share / "row_shapes" / "tet.stl").write_text(STL)
    mesh = (
        '<collision><geometry><mesh filename="package://row_shapes/tet.stl"/>'
        "</geometry></collision>"
    )
    (share / "row_description" / "row.urdf").write_text(
        urdf_text([JointText()] * 6, mesh)
    )
    is_ros1 = variable == "ROS_PACKAGE_PATH"
    monkeypatch.setenv(variable, str(share if is_ros1 else share.parent))
    robot = RobotModel.load(
        described(frames(), urdf="package://row_description/row.urdf")
    )
    assert len(robot.links_solids()) == 7
    for path in (
        "package://row_description/row.urdf",
        Path("package://row_description/row.urdf"),
    ):
        chain = KinematicChain.from_urdf(path, "link0", "link6")
        assert chain.n_joints == 6


def test_a_package_that_is_not_there_is_named_with_the_folders(described, monkeypatch):
    monkeypatch.setenv("ROS_PACKAGE_PATH", "/nowhere/at/all")
    path = described(frames(), urdf="package://row_description/row.urdf")
    with pytest.raises(ConfigError, match="/nowhere/at/all"):
        RobotModel.load(path)
    with pytest.raises(ConfigError, match=r"package://none/a\.urdf.*/nowhere"):
        KinematicChain.from_urdf("package://none/a.urdf", "link0", "link6")


def _facet(*corners: tuple[int, int, int]) -> str:
    lines = "".join("vertex {} {} {}\n".format(*corner) for corner in corners)
    return f"facet normal 0 0 0\nouter loop\n{lines}endloop\nendfacet\n"


STL = (
    "solid tet\n"
    + _facet((0, 0, 0), (0, 1, 0), (1, 0, 0))
    + _facet((0, 0, 0), (1, 0, 0), (0, 0, 1))
    + _facet((0, 0, 0), (0, 0, 1), (0, 1, 0))
    + _facet((1, 0, 0), (0, 1, 0), (0, 0, 1))
    + "endsolid tet\n"
)
