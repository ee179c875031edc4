"""Fingers meet bodies where, and as deep as, geometry has it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

pytest.importorskip("mujoco")

import mujoco

from debrisgrasp.worlds import make_body
from tests.unit.robot.rigs import FAR

from ._rig import made

PLATE = make_body("board", {"length": 0.8, "width": 0.2, "height": 0.02}, 4.0)
BLOCK = make_body("brick", {"length": 0.25, "width": 0.12, "height": 0.08}, 3.0)
DEPTH, SURE = 3e-4, 1.5e-4


def corners(model, data, geom):
    """Of a box, or a polytope, frame of the world [m], shape (n, 3)."""
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first = model.mesh_vertadr[mesh]
        own = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
    else:
        signs = np.stack(np.meshgrid(*[(-1, 1)] * 3), axis=-1).reshape(-1, 3)
        own = signs * model.geom_size[geom]
    return own @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]


def touching(model, data, finger, solid, rng):
    """Turn the first body at random, and let a solid of it enter a finger by DEPTH."""
    data.qpos[3:7] = Rotation.random(random_state=int(rng.integers(2**31))).as_quat()
    mujoco.mj_kinematics(model, data)
    data.qpos[:3] += data.geom_xpos[finger] - data.geom_xpos[solid]
    mujoco.mj_kinematics(model, data)
    ways = corners(model, data, finger)[:, None] - corners(model, data, solid)
    hull = ConvexHull(ways.reshape(-1, 3))
    normals, offsets = hull.equations[:, :3], hull.equations[:, 3]
    way = rng.normal(size=3)
    rates = normals @ way
    far = np.where(rates > 0.0, (-DEPTH - offsets) / np.maximum(rates, 1e-12), np.inf)
    data.qpos[:3] += far.min() * way
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_collision(model, data)


def overlap(model, data, contact):
    """How far a contact's solids must move along its normal to be apart [m]."""
    one, other = (corners(model, data, geom) for geom in contact.geom)
    normal = contact.frame[:3]
    return (one @ normal).max() - (other @ normal).min()


@pytest.mark.parametrize("body", [PLATE, BLOCK], ids=["plate", "block"])
def test_a_touch_is_as_deep_as_it_is_and_pushes_the_short_way_out(body, rng):
    stage = made([body, FAR])._stage
    model, data = stage._model, stage.data
    owner = [model.body(i).name for i in model.geom_bodyid]
    fingers = [i for i, name in enumerate(owner) if name.startswith("right/finger")]
    solids = [i for i, name in enumerate(owner) if name == body.name]
    n_met = 0
    for _ in range(400):
        finger, solid = int(rng.choice(fingers)), int(rng.choice(solids))
        touching(model, data, finger, solid, rng)
        met = [c for c in data.contact if finger in c.geom and {*c.geom} & {*solids}]
        n_met += bool(met)
        for contact in met:
            assert -contact.dist < DEPTH + SURE
            assert overlap(model, data, contact) < DEPTH + SURE
    assert n_met > 390
