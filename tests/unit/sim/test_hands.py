from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.geometry import SE3, Box, Cylinder, so3
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.sim import HandPhysics, Physics
from debrisgrasp.sim.flight import FlightConfig
from debrisgrasp.sim.flying import _Flight
from debrisgrasp.sim.hands import Grip, add_hand
from debrisgrasp.sim.model import compiled, world_tree
from debrisgrasp.sim.touch import touches
from debrisgrasp.worlds import Body, World

from ._grasps import TIP, box, downwards

mujoco = pytest.importorskip("mujoco")

CASES = [
    (name, preshape, opening)
    for name in ("robotiq_3f", "camhand")
    for preshape in GripperModel.load(name).preshapes
    for opening in (0.085, 0.13)
]


def posed(name, preshape, opening):
    """A hand alone in the air at some pose, with its fingers at an opening."""
    hand = GripperModel.load(name)
    pose = SE3.from_parts(so3.exp(np.array([0.3, -0.5, 0.9])), [0.2, -0.1, 1.0])
    world = World((box("far", (0.1, 0.1, 0.1), 1.0, (5.0, 0.0)),))
    root = world_tree(world, Physics())
    drives = add_hand(
        root, hand, preshape=preshape, opening=opening, width=0.08,
        T_base_hand=pose, physics=HandPhysics(), time_step=0.002,
    )  # fmt: skip
    model = compiled(root, world)
    data = mujoco.MjData(model)
    for drive in drives:
        for joint, value in drive.joints.items():
            data.joint(joint).qpos[0] = value
    mujoco.mj_forward(model, data)
    return hand, pose, model, data, drives


@pytest.mark.parametrize(("name", "preshape", "opening"), CASES)
def test_the_solids_are_those_that_the_planner_uses(name, preshape, opening):
    hand, pose, model, data, _ = posed(name, preshape, opening)
    geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] > 1]
    solids = [s.moved(pose) for s in hand.solids(preshape, opening)]
    assert len(geoms) == len(solids)
    kinds = mujoco.mjtGeom
    for g, solid in zip(geoms, solids, strict=True):
        np.testing.assert_allclose(data.geom_xpos[g], solid.T_frame_solid.p, atol=1e-6)
        turn = data.geom_xmat[g].reshape(3, 3)
        np.testing.assert_allclose(turn, solid.T_frame_solid.R, atol=1e-6)
        size = model.geom_size[g]
        if isinstance(solid, Box):
            assert model.geom_type[g] == kinds.mjGEOM_BOX
            np.testing.assert_allclose(size, solid.half_extents)
        else:
            assert isinstance(solid, Cylinder)
            assert model.geom_type[g] == kinds.mjGEOM_CYLINDER
            np.testing.assert_allclose(size[:2], [solid.radius, solid.length / 2])


@pytest.mark.parametrize("name", ["robotiq_3f", "camhand"])
def test_the_hand_weighs_what_its_file_says(name):
    hand, _, model, _, _ = posed(
        name, CASES[0][1] if name != "camhand" else "claw", 0.1
    )
    carrier = model.body("wrist").mass[0]
    total = model.body_subtreemass[model.body("wrist").id]
    assert total - carrier == pytest.approx(hand.mass, rel=1e-6)


def test_constraints_are_factorised_densely():
    _, _, model, _, _ = posed("robotiq_3f", "basic", 0.1)
    assert model.opt.jacobian == mujoco.mjtJacobian.mjJAC_DENSE


@pytest.mark.parametrize(
    ("name", "preshape"), [("robotiq_3f", "basic"), ("camhand", "claw")]
)
def test_free_fingers_close_as_the_table_says(name, preshape):
    hand, _, model, data, drives = posed(name, preshape, 0.13)
    grip = Grip(model, drives, HandPhysics())
    grip.reset(data)
    for _ in range(200):
        grip.advance(data, 0.3, 0.002)
        mujoco.mj_step(model, data)
    shape = hand.preshape(preshape)
    first = drives[0]
    reached = {joint: data.joint(joint).qpos[0] for joint in first.joints}
    leader = next(iter(reached))
    variable = next(
        link.joint.variable
        for k, link in enumerate(hand.fingers[0].links)
        if f"{hand.fingers[0].name}_{k}" == leader
    )
    table = shape.joints[variable]
    command = np.interp(reached[leader], table, shape.commands)
    assert command > shape.commands[0]
    for k, link in enumerate(hand.fingers[0].links):
        joint = f"{hand.fingers[0].name}_{k}"
        if joint in reached:
            wanted = shape.values(float(command))[link.joint.variable]
            assert reached[joint] == pytest.approx(wanted, abs=0.03)


def gripping(body, at, preshape="basic", opening=0.1, width=0.06):
    """A flight at the end of its squeeze."""
    grasp = downwards(at, preshape=preshape, opening=opening, width=width)
    flight = _Flight(
        World((body,)), GripperModel.load("robotiq_3f"), grasp, FlightConfig()
    )
    flight.approach()
    flight.close()
    return flight


def test_each_side_presses_with_the_grip_force():
    flight = gripping(box("it", (0.06, 0.2, 0.06), 2.0), [0.0, 0.0, 0.03 + TIP])
    sums = dict.fromkeys(("finger_a", "finger_b", "finger_c"), 0.0)
    wrench = np.zeros(6)
    for number in range(flight.data.ncon):
        contact = flight.data.contact[number]
        owners = flight.model.geom_bodyid[[contact.geom1, contact.geom2]]
        part = flight.model.body(int(owners.max())).name.split("/")[0]
        if part in sums and owners.min() == 1:
            mujoco.mj_contactForce(flight.model, flight.data, number, wrench)
            sums[part] += wrench[0]
    assert sums["finger_a"] == pytest.approx(60.0, rel=0.15)
    assert sums["finger_b"] + sums["finger_c"] == pytest.approx(60.0, rel=0.15)
    assert sums["finger_b"] == pytest.approx(sums["finger_c"], rel=0.1)


def test_gripped_at_the_pads_the_phalanges_stay_in_line():
    flight = gripping(box("it", (0.06, 0.2, 0.06), 2.0), [0.0, 0.0, 0.03 + TIP])
    for finger in ("finger_a", "finger_b", "finger_c"):
        assert abs(flight.data.joint(f"{finger}_2").qpos[0]) < 0.05


def test_a_pipe_at_the_palm_is_wrapped():
    lying = SE3.from_parts(so3.exp(np.array([np.pi / 2, 0.0, 0.0])), [0.0, 0.0, 0.3])
    pipe = Body("it", "pipe", (Cylinder(0.04, 0.3),), 1.5, lying)
    stand = box("stand", (0.02, 0.2, 0.26), 5.0)
    grasp = downwards([0.0, 0.0, 0.3 + 0.045], opening=0.13, width=0.08)
    world = World((pipe, stand))
    flight = _Flight(world, GripperModel.load("robotiq_3f"), grasp, FlightConfig())
    flight.approach()
    flight.close()
    curls = [flight.data.joint(f"finger_{f}_2").qpos[0] for f in "abc"]
    assert max(curls) > 0.2
    found = touches(flight.model, flight.data, 2)
    assert found[0].sides >= {"finger_a", "finger_b", "finger_c"}


def test_an_edge_on_a_pipe_presses_along_the_radius():
    lying = SE3.from_parts(so3.exp(np.array([np.pi / 2, 0.0, 0.0])), [0.0, 0.0, 0.05])
    pipe = Body("it", "pipe", (Cylinder(0.05, 0.5),), 2.0, lying)
    grasp = downwards([0.0, 0.0, 0.11], preshape="claw", opening=0.15, width=0.112)
    flight = _Flight(
        World((pipe,)), GripperModel.load("camhand"), grasp, FlightConfig()
    )
    flight.approach()
    flight.close()
    center, n_seen = flight.centers()[0], 0
    for number in range(flight.data.ncon):
        contact = flight.data.contact[number]
        if max(flight.model.geom_bodyid[[contact.geom1, contact.geom2]]) < 3:
            continue
        radius = contact.pos - center
        radius[1] = 0.0
        cosine = abs(contact.frame[:3] @ radius) / np.linalg.norm(radius)
        assert cosine > 0.98
        n_seen += 1
    assert n_seen >= 2
