"""Arms with weight and limited torque, hands that press, objects that resist."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco")

from debrisgrasp.control import GripCommand
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.executive import TaskSettings
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.robot import Injection, inject
from debrisgrasp.sim import Physics
from debrisgrasp.sim_robot import RobotPhysics
from debrisgrasp.sim_robot.tree import RobotTree
from debrisgrasp.worlds import make_body
from tests.unit.robot.rigs import FAR, PERIOD, ROMAN, beam, drive

from ._rig import SimRig, made

GRAVITY = 9.81
BAR = beam("bar", 2.5, (0.8, -0.3, 0.0445))


@pytest.fixture(scope="module")
def lifted():
    """Bar of 2.5 kg, gripped in the middle and lifted by 10 cm."""
    rig = SimRig([BAR, FAR], place=(0.8, -0.3, 0.16))  # the pads are 11 cm lower
    assert rig.grip(squeeze=50.0) == "HOLDING"
    rig.wait(0.5)
    rig.move(0.0, 0.0, 0.1, speed=0.05)
    rig.wait(1.0)
    return rig


def test_masses_and_torques_are_those_of_the_urdf():
    robot = made([FAR])
    model = robot._stage._model
    masses = np.array(model.body_mass)[2:]  # after the ground and the far body
    assert masses.sum() == pytest.approx(131.6, abs=0.1)
    for name in ROMAN.arm("left").joints:
        effort = ROMAN.tree.joints[name].effort
        actuator = model.actuator(name)
        assert actuator.forcerange.tolist() == [-effort, effort]


@pytest.mark.parametrize("arm", ["right", "left"])
def test_fingers_are_the_solids_that_the_planner_knows(arm):
    hand = made([FAR]).hands[arm]
    planned = hand.model.solids(hand.shape, hand.openings[0])
    simulated = hand.solids()
    assert len(planned) == len(simulated)
    for a, b in zip(planned, simulated, strict=True):
        assert type(a) is type(b)
        assert np.allclose(a.bounds.lower, b.bounds.lower, atol=3e-4)
        assert np.allclose(a.bounds.upper, b.bounds.upper, atol=3e-4)


def test_joints_follow_a_smooth_motion_within_two_milliradians():
    robot = made([FAR], start={"left": "ready"})
    arm, clock = robot.robot.limbs["left"].arm, robot.robot.clock
    arm.engage()
    clock.wait_until(0.2)
    start = np.array(arm.read().q)
    way = np.array([0.2, -0.3, 0.2, 0.3, -0.3, 0.2, 0.3, 0.4])
    worst = 0.0
    for k in range(1, 501):
        u = min(k / 450, 1.0)
        goal = start + u**3 * (10 - 15 * u + 6 * u * u) * way
        arm.command(goal.tolist())
        clock.wait_until(clock.now() + PERIOD)
        worst = max(worst, float(np.abs(np.array(arm.read().q) - goal).max()))
    assert worst < 2e-3
    assert not robot.violations


def test_an_idle_wrist_reads_bias_and_tool_alone():
    robot = made([FAR], sensor_noise=(0.0, 0.0), drift=(0.0, 0.0))
    robot.robot.clock.wait_until(1.0)
    for name, limb in robot.robot.limbs.items():
        R = tuple(robot.arms[name].pose()[0])
        load = np.array(limb.loads.load_ee(limb.sensor.read().wrench_ft, R))
        assert np.abs(load).max() < 0.05


def test_a_wrist_feels_the_weight_of_what_it_lifts(lifted):
    rig = lifted
    assert rig.body("bar").p[2] == pytest.approx(0.0445 + 0.1, abs=0.01)
    down = rig.chain.fk(rig.arm.read().q).R @ rig.load[:3]
    assert down == pytest.approx([0.0, 0.0, -2.5 * GRAVITY], abs=1.0)
    truth = rig.fake.truth()
    assert truth.held == {"right": "bar"}
    assert truth.removed == ()
    assert truth.overloads == ()
    assert 0.0 < truth.deepest["right"] < 0.002
    # Until the other side holds against it, one pushes the hand with all its 50 N.
    assert 2.4 * GRAVITY < truth.peak_force["right"] < 1.05 * 50.0


def test_each_side_presses_with_what_was_asked_for(lifted):
    assert lifted.hand.read().forces == pytest.approx((50.0, 25.0, 25.0), rel=0.1)
    pressure = lifted.fake._stage.touches["right"].pressure
    sides = [sum(f for (_, s), f in pressure.items() if s == side) for side in (-1, 1)]
    assert sides == pytest.approx([50.0, 50.0], rel=0.25)


def test_what_is_put_down_elsewhere_counts_as_removed():
    rig = SimRig([BAR, FAR], removed_beyond=0.1)
    assert rig.grip(squeeze=50.0) == "HOLDING"
    rig.wait(0.3)
    for way in ((0.0, 0.0, 0.05), (0.0, -0.15, 0.0), (0.0, 0.0, -0.045)):
        rig.move(*way, speed=0.15)
    rig.open()
    rig.wait(0.5)
    truth = rig.fake.truth()
    assert truth.held == {}
    assert truth.removed == ("bar",)


def test_pressing_on_the_ground_pushes_the_hand_up():
    rig = SimRig([FAR], place=(0.8, -0.3, 0.16))
    speed = TaskSettings().approach_speed
    rig.move(0.0, 0.0, -0.06, speed=speed, until=lambda: np.abs(rig.load).max() > 30.0)
    push = rig.chain.fk(rig.arm.read().q).R @ rig.load[:3]
    assert push[2] > 20.0
    assert rig.fake.truth().peak_force["right"] < 150.0


def test_a_link_that_meets_a_body_is_stopped_by_it_and_that_is_known():
    clear = SimRig([FAR], place=(0.8, -0.3, 0.3))
    elbow = clear.chain.joint_frames(np.array(clear.arm.read().q)).p[5]
    pillar = make_body(
        "lumber_4x4", {"length": 0.9, "width": 0.2, "height": 0.2}, 20.0, name="pillar"
    )
    upright = so3.from_rpy(np.array([0.0, -np.pi / 2, 0.0]))
    beside = [elbow[0] - 0.08, elbow[1] - 0.2, 0.45]
    rig = SimRig([pillar.at(SE3.from_parts(upright, beside)), FAR], (0.8, -0.3, 0.3))
    q = np.array(rig.arm.read().q)
    for k in range(300):
        q[0] = -0.2 * min(k / 200, 1.0)
        rig.arm.command(q.tolist())
        rig.wait(PERIOD)
    assert ("right", "pillar") in rig.fake.truth().scrapes


def test_what_begins_inside_the_robot_is_refused_and_named():
    with pytest.raises(InputError, match=r"bar \d+ mm inside chassis_link.*ahead"):
        made([beam("bar", 2.5, (0.4, -0.2, 0.1)), FAR])


def test_another_preshape_moves_the_roots_of_fingers_and_nothing_else():
    rig = SimRig([BAR, FAR], place=(0.8, -0.3, 0.3))
    before, q = rig.body("bar"), np.array(rig.arm.read().q)
    basic = rig.hand.solids()
    rig.hand.preshape("wide", 0.1)
    rig.wait(1.5)
    assert rig.hand.read().openings == pytest.approx((0.1,) * 3, abs=2e-3)
    wide = rig.hand.solids()
    shifts = [
        abs(a.bounds.lower[1] - b.bounds.lower[1])
        for a, b in zip(basic, wide, strict=True)
    ]
    assert max(shifts) > 0.01
    assert np.allclose(rig.body("bar").matrix, before.matrix, atol=1e-4)
    assert np.allclose(rig.arm.read().q, q, atol=3e-4)


def test_another_preshape_of_one_hand_leaves_the_drives_of_the_other():
    robot = made([FAR]).robot
    right, left = (robot.limbs[name].gripper for name in ("right", "left"))

    def wait(seconds):
        robot.clock.wait_until(robot.clock.now() + seconds)

    left.command(GripCommand((0.15,) * 4, 10.0))
    wait(0.2)
    right.preshape("wide", 0.1)  # while the fingers of the left one are on their way
    wait(2.0)
    assert left.read().openings == pytest.approx((0.15,) * 4, abs=1e-3)
    right.preshape("basic", 0.1)
    wait(1.0)
    assert left.read().openings == pytest.approx((0.15,) * 4, abs=1e-3)


def test_the_same_seed_gives_the_same_run():
    readings = []
    for _ in range(2):
        rig = SimRig([BAR, FAR])
        rig.grip()
        readings.append(np.array(rig.limb.sensor.read().wrench_ft))
    assert (readings[0] == readings[1]).all()


def test_what_begins_where_the_arm_is_measured_is_no_jump():
    rig = SimRig([BAR, FAR])
    rig.arm.command(rig.arm.read().q)
    rig.fake._stage._servo.error += 1e-3  # weight that the servo doesn't know
    rig.wait(0.04)
    for _ in range(5):
        rig.arm.command(rig.arm.read().q)
        rig.wait(PERIOD)
    assert not rig.fake.violations


def test_the_base_takes_its_arms_along():
    robot = made([FAR])
    base, clock = robot.robot.base, robot.robot.clock
    drive(robot.robot, 0.3, 0.2, 1.0)
    base.stop()
    clock.wait_until(2.5)
    T_odom_base = base.read()
    assert T_odom_base.p[0] > 0.15
    assert T_odom_base.R[1, 0] > 0.1
    palm = robot._stage.data.body("right/hand")
    expected = T_odom_base @ robot.arms["right"].chain.fk(
        np.array(robot.arms["right"].q)
    )
    assert np.allclose(palm.xpos, expected.p, atol=2e-3)


def test_devices_can_be_struck_by_faults():
    robot = made([FAR])
    frozen = Injection(fault="wrench_frozen")
    rng = np.random.default_rng(0)
    injected = inject(robot.robot, (frozen,), states=("lift",), rng=rng, world=robot)
    injected.on_state("lift")
    sensor, clock = injected.robot.limbs["right"].sensor, robot.robot.clock
    first = np.array(sensor.read().wrench_ft)
    clock.wait_until(0.1)
    assert (np.array(sensor.read().wrench_ft) == first).all()


def test_of_the_changes_of_a_world_only_friction_is_taken():
    robot = made([FAR])
    assert not robot.change_world(lambda world: world)
    with pytest.raises(InputError, match="fake_robot"):
        robot.stick(1.0)
    with pytest.raises(InputError, match="fake_robot"):
        robot.misplace(0.01)


def test_what_becomes_slick_slips_out_of_the_hand():
    rig = SimRig([BAR, FAR])
    assert rig.grip(squeeze=50.0) == "HOLDING"
    rig.move(0.0, 0.0, 0.05, speed=0.1)
    rig.fake.change_friction(0.02)
    rig.wait(1.0)
    assert rig.body("bar").p[2] == pytest.approx(0.0445, abs=0.01)


def test_a_period_is_a_whole_number_of_steps():
    with pytest.raises(ConfigError, match="time_step"):
        made([FAR], physics=RobotPhysics(physics=Physics(time_step=0.003)))


@pytest.mark.parametrize(
    "bad",
    [{"natural_frequency": 0.0}, {"rotor_inertia": -1.0}, {"integral_time": np.nan}],
)
def test_bad_settings_are_refused_by_name(bad):
    with pytest.raises(ConfigError, match=next(iter(bad))):
        RobotPhysics(**bad)


def test_a_moving_link_without_mass_is_named(tmp_path):
    text = ROMAN.tree.path.read_text(encoding="utf-8")
    start = text.index("<inertial>", text.index('<link name="left_arm_link4">'))
    end = text.index("</inertial>", start) + len("</inertial>")
    (tmp_path / "roman.urdf").write_text(text[:start] + text[end:], encoding="utf-8")
    yaml = ROMAN.tree.path.with_suffix(".yaml").read_text(encoding="utf-8")
    (tmp_path / "roman.yaml").write_text(yaml, encoding="utf-8")
    with pytest.raises(ConfigError, match="left_arm_link4"):
        RobotTree(RobotModel.load(tmp_path / "roman.yaml"), 1.0)
