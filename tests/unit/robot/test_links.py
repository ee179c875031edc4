from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.geometry import SE3, Box
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.robot.links import LinkSpheres
from debrisgrasp.robot.shapes import BodyShape
from debrisgrasp.worlds import Body


@pytest.fixture(scope="module")
def model():
    return RobotModel.load("roman")


def cubes(*places):
    cube = (Box([0.1, 0.1, 0.1]),)
    bodies = [
        Body(f"cube {i}", "part", cube, 1.0, SE3.from_parts(p=place))
        for i, place in enumerate(places)
    ]
    return [BodyShape(body) for body in bodies]


def overlaps(links, q, shapes, T_odom_base):
    links.has_moved(q)
    return dict(links.overlaps(q, T_odom_base, shapes))


def test_looks_that_are_passed_over_would_have_found_nothing(model, rng):
    chain = model.chain("right")
    watched = LinkSpheres(model, "right", chain)
    forearm = chain.joint_frames(np.zeros(chain.n_joints)).p[4]
    shapes = cubes(*(forearm + np.array([[0, 0, 0], [0.3, 0, 0], [0, 0, 0.4]])))
    T, q, n_met = SE3.identity(), np.zeros(chain.n_joints), 0
    for k in range(400):
        q = chain.clipped(q + 0.02 * rng.standard_normal(chain.n_joints))
        if k % 50 == 49:  # a body is moved, and at last the base
            shapes[k // 50 % 3].place(np.eye(3), forearm + 0.3 * rng.random(3))
            T = SE3.from_parts(p=[0.1, 0.0, 0.0]) if k == 349 else T
        posture = tuple(q.tolist())
        fresh = LinkSpheres(model, "right", chain)
        expected = overlaps(fresh, posture, shapes, T)
        assert overlaps(watched, posture, shapes, T) == expected
        n_met += bool(expected)
    assert 0 < n_met < 400


def test_links_that_are_far_away_are_not_looked_at_again(model, monkeypatch):
    chain = model.chain("right")
    links, shapes = LinkSpheres(model, "right", chain), cubes([5.0, 0.0, 0.0])
    q = np.zeros(chain.n_joints)
    overlaps(links, tuple(q.tolist()), shapes, T := SE3.identity())
    monkeypatch.setattr(BodyShape, "depths", None)
    monkeypatch.setattr(type(chain), "joint_frames", None)
    assert overlaps(links, tuple((q + 0.1).tolist()), shapes, T) == {}
