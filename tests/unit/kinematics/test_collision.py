from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from debrisgrasp.errors import ConfigError, InputError, ShapeError
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import ArmCollision, RobotModel
from debrisgrasp.kinematics.body import RobotBody
from debrisgrasp.kinematics.exact import ExactSolids

from .example_robots import PANDA, UR10, ExampleArm, loaded_or_skip
from .robots import ROMAN_URDF, JointText, row_robot


@pytest.fixture(scope="module")
def collision(roman: RobotModel) -> ArmCollision:
    return ArmCollision.fit(roman, "right")


def _pinocchio_hits(collision: ArmCollision, roman: RobotModel, q: np.ndarray) -> bool:
    """Self-collision by pinocchio's own geometry model, over the same link pairs."""
    model = pin.buildModelFromUrdf(str(ROMAN_URDF))
    geometry = pin.buildGeomFromUrdf(model, str(ROMAN_URDF), pin.GeometryType.COLLISION)
    parts = collision.body.parts
    links = {frozenset((parts[i].link, parts[j].link)) for i, j in collision.body.pairs}
    objects = geometry.geometryObjects
    names = [model.frames[o.parentFrame].name for o in objects]
    for i in range(len(objects)):
        for j in range(i):
            if frozenset((names[i], names[j])) in links:
                geometry.addCollisionPair(pin.CollisionPair(j, i))
    values = roman.joint_values(collision.body.chain.named(q))
    configuration = pin.neutral(model)
    for name, value in values.items():
        if model.existJointName(name):
            configuration[model.joints[model.getJointId(name)].idx_q] = value
    data, geometry_data = model.createData(), geometry.createData()
    stop_at_first = True
    return bool(
        pin.computeCollisions(
            model, data, geometry, geometry_data, configuration, stop_at_first
        )
    )


def test_exact_self_collision_equals_pinocchio_and_spheres_never_miss_it(
    collision: ArmCollision, roman: RobotModel, rng: np.random.Generator
) -> None:
    q = collision.body.chain.sampled(60, rng=rng)
    hits = collision.hits_itself(q)
    oracle = np.array([_pinocchio_hits(collision, roman, row) for row in q])
    np.testing.assert_array_equal(hits, oracle)
    assert 5 < oracle.sum() < 55
    assert collision.may_hit_itself(q)[hits].all()


def test_a_margin_only_adds_contacts(
    collision: ArmCollision, roman: RobotModel, rng: np.random.Generator
) -> None:
    wide = ArmCollision.fit(roman, "right", self_margin=0.05)
    q = collision.body.chain.sampled(300, rng=rng)
    hits, near = collision.hits_itself(q), wide.hits_itself(q)
    assert near[hits].all()
    assert near.sum() > hits.sum()


def test_the_body_shows_itself_in_a_line(collision: ArmCollision) -> None:
    body = collision.body
    told = f"<RobotBody of {len(body.parts)} parts on {body.chain!r}>"
    assert repr(body) == told
    assert told in repr(collision)


def test_contacts_name_the_links(collision: ArmCollision) -> None:
    # Turned back at the shoulder, the arm runs through the deck.
    q = collision.body.chain.vector({"right_arm_joint2": 3.1})
    contacts = collision.self_contacts(q)
    assert ("right_arm_link6", "chassis_link") in contacts
    assert collision.hits_itself(q)
    assert collision.self_contacts(collision.body.chain.vector({})) == ()


def test_scene_clearance_is_never_larger_than_the_exact_distance(
    collision: ArmCollision, roman: RobotModel, rng: np.random.Generator
) -> None:
    chain, body = collision.body.chain, collision.body
    moving = {p.link for p in body.parts if p.segment > 0 and not p.is_hand}
    for q in chain.sampled(15, rng=rng):
        obstacle = rng.uniform((-0.5, -1, 0), (1.2, 1, 1.3))
        clearance = collision.scene_clearance(
            q, lambda points, at=obstacle: np.linalg.norm(points - at, axis=-1)
        )
        exact = min(
            float(solid.signed_distance(obstacle))
            for link, solid in roman.links_solids(chain.named(q))
            if link in moving
        )
        assert clearance <= exact + 1e-9
        assert clearance >= min(exact, 0.0) - 0.11 if exact < 0 else exact - 0.04


def test_the_hand_is_left_out_of_the_scene_test(
    collision: ArmCollision, roman: RobotModel
) -> None:
    q = collision.body.chain.vector(roman.posture("right", "ready"))
    palm = collision.body.chain.fk(q).p
    clearance = collision.scene_clearance(
        q, lambda points: np.linalg.norm(points - palm, axis=-1)
    )
    assert clearance > 0.03


def test_batches_equal_single_postures(
    collision: ArmCollision, rng: np.random.Generator
) -> None:
    q = collision.body.chain.sampled(6, rng=rng)

    def distance(points: np.ndarray) -> np.ndarray:
        return points[..., 2]

    batch = collision.scene_clearance(q.reshape(2, 3, 8), distance)
    assert batch.shape == (2, 3)
    hits = collision.hits_itself(q.reshape(2, 3, 8)).reshape(6)
    for i, row in enumerate(q):
        assert collision.scene_clearance(row, distance) == pytest.approx(
            batch.reshape(6)[i]
        )
        assert collision.hits_itself(row) == hits[i]
    assert collision.hits_itself(q[:0]).shape == (0,)
    with pytest.raises(ShapeError, match="posture"):
        collision.self_contacts(q)
    for several in (q, q[:1], q[:0]):
        with pytest.raises(ShapeError, match="posture"):
            collision.self_distance(several)


def test_an_idle_arm_counts(roman: RobotModel, rng: np.random.Generator) -> None:
    folded = ArmCollision.fit(roman, "right")
    stretched = ArmCollision.fit(roman, "right", held=roman.posture("left", "ready"))
    q = folded.body.chain.sampled(400, rng=rng)
    differs = folded.hits_itself(q) != stretched.hits_itself(q)
    assert differs.any()


def _meshed_robot(folder: Path, mesh: str, scale: str = "1 1 1") -> RobotModel:
    shape = f'<mesh filename="{mesh}" scale="{scale}"/>'
    collision = f"<collision><geometry>{shape}</geometry></collision>"
    return RobotModel.load(row_robot(folder, collision))


def test_a_collision_mesh_is_taken_as_the_hulls_of_its_pieces(tmp_path: Path) -> None:
    import trimesh

    trimesh.creation.box((0.1, 0.2, 0.3)).export(tmp_path / "part.stl")
    robot = _meshed_robot(tmp_path, "part.stl")
    solids = robot.links_solids()
    assert len(solids) == 7
    np.testing.assert_allclose(solids[0][1].bounds.size, (0.1, 0.2, 0.3))
    mirrored = _meshed_robot(tmp_path, "part.stl", "-2 1 1").links_solids()
    np.testing.assert_allclose(mirrored[0][1].bounds.size, (0.2, 0.2, 0.3))
    ArmCollision.fit(robot, "one")
    two = [trimesh.creation.icosphere(radius=0.05) for _ in range(2)]
    two[1].apply_translation((0.3, 0.0, 0.0))
    trimesh.util.concatenate(two).export(tmp_path / "part.stl")
    pieces = _meshed_robot(tmp_path, "part.stl").links_solids()
    assert len(pieces) == 14
    assert not pieces[0][1].contains([0.15, 0.0, 0.0])


def test_a_missing_collision_mesh_is_named_when_it_is_needed(tmp_path: Path) -> None:
    robot = _meshed_robot(tmp_path, "package://row/meshes/none.stl")
    assert robot.chain("one").n_joints == 6
    with pytest.raises(ConfigError, match=r"none\.stl: no file there"):
        ArmCollision.fit(robot, "one")


def test_a_collision_mesh_in_millimetres_is_refused(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box((100, 200, 300)).export(tmp_path / "part.stl")
    with pytest.raises(ConfigError, match=r"part\.stl times its scale.*millimetres"):
        _meshed_robot(tmp_path, "part.stl").links_solids()
    scaled = _meshed_robot(tmp_path, "part.stl", "0.001 0.001 0.001").links_solids()
    np.testing.assert_allclose(scaled[0][1].bounds.size, (0.1, 0.2, 0.3))


def test_clearance_never_exceeds_the_distance_of_the_exact_solids(
    collision: ArmCollision, rng: np.random.Generator
) -> None:
    q = collision.body.chain.sampled(60, rng=rng)
    clearance = collision.clearance(q)
    exact = np.array([collision.self_distance(row) for row in q])
    is_apart = exact > 0
    assert 10 < is_apart.sum() < 50
    assert (clearance[is_apart] <= exact[is_apart] + 1e-6).all()
    assert (clearance[is_apart] > 0).all()
    assert (clearance[~is_apart] <= 1e-6).all()
    assert (np.minimum(exact, 0.1) - clearance)[is_apart].max() < 0.06
    assert collision.clearance(q, horizon=0.02).max() <= 0.02 + 1e-6


def test_free_postures_keep_clear_of_robot_and_scene(
    collision: ArmCollision, rng: np.random.Generator
) -> None:
    q = collision.body.chain.sampled(300, rng=rng)

    def wall(points: np.ndarray) -> np.ndarray:
        return np.minimum(0.9 - points[..., 0], 0.1)

    free = collision.is_free(q, wall, margin=0.01)
    assert 10 < free.sum() < 200
    np.testing.assert_array_equal(collision.is_free(q), ~collision.hits_itself(q))
    assert not collision.hits_itself(q[free]).any()
    assert collision.scene_clearance(q[free], wall, with_hand=True).min() >= 0.01
    palm = collision.body.chain.fk(q[free]).p
    assert palm[:, 0].max() < 0.9
    without = collision.is_free(q, wall, margin=0.01, with_hand=False)
    assert without.sum() > free.sum()
    assert (without | ~free).all()


@pytest.mark.parametrize("robot_arm", [PANDA, UR10], ids=["panda", "ur10"])
def test_no_contact_of_another_arm_is_missed(
    robot_arm: ExampleArm, tmp_path: Path, rng: np.random.Generator
) -> None:
    robot = loaded_or_skip(robot_arm, tmp_path)
    fitted = ArmCollision.fit(robot, "arm")
    q = fitted.body.chain.sampled(1500, rng=rng)
    may, hits = fitted.may_hit_itself(q), fitted.hits_itself(q)
    exact = np.array([len(fitted.self_contacts(row)) > 0 for row in q[:400]])
    np.testing.assert_array_equal(hits[:400], exact)
    assert may[hits].all()
    assert 50 < hits.sum() < 600
    ready = fitted.body.chain.vector(robot.posture("arm", "ready"))
    assert fitted.is_free(ready)
    assert fitted.clearance(ready) > 0


def test_no_contact_is_missed_in_thousands_of_postures(
    collision: ArmCollision, roman: RobotModel, rng: np.random.Generator
) -> None:
    # All pairs that the robot has, none passed over, decided by the exact checker.
    every = RobotBody.fit(roman, "right", collision.body.chain)
    exact = ExactSolids([part.solid for part in every.parts])
    q = collision.body.chain.sampled(3000, rng=rng)
    free = np.flatnonzero(~collision.may_hit_itself(q))
    assert len(free) > 900
    poses = every.segment_poses(q[free])
    segments = [part.segment for part in every.parts]
    for i, j in every.pairs[:: 1 + len(every.pairs) // 60]:
        for T in poses[:200]:
            assert not exact.touch(i, T[segments[i]], j, T[segments[j]], 0.0)
    assert all(not collision.self_contacts(row) for row in q[free[:200]])


def test_pairs_that_can_never_touch_are_left_out(
    collision: ArmCollision, roman: RobotModel, rng: np.random.Generator
) -> None:
    every = RobotBody.fit(roman, "right", collision.body.chain)
    kept = {tuple(pair) for pair in collision.body.pairs.tolist()}
    dropped = [pair for pair in every.pairs.tolist() if tuple(pair) not in kept]
    assert len(dropped) > 50
    exact = ExactSolids([part.solid for part in every.parts])
    segments = [part.segment for part in every.parts]
    for T in every.segment_poses(every.chain.sampled(60, rng=rng)):
        for i, j in dropped[::3]:
            assert not exact.touch(i, T[segments[i]], j, T[segments[j]], 0.0)


def test_links_that_always_touch_are_named_and_not_tested(tmp_path: Path) -> None:
    # Balls larger than the distance of the joints, so that every other one overlaps.
    shape = '<collision><geometry><sphere radius="0.25"/></geometry></collision>'
    joint = JointText(xyz=(0, 0, 0.2), axis=(0, 1, 0))
    path = row_robot(tmp_path, shape, joint=joint)
    fitted = ArmCollision.fit(RobotModel.load(path), "one")
    assert ("link2", "link0") in fitted.body.always_touching
    assert fitted.is_free(np.zeros(6)) == (len(fitted.self_contacts(np.zeros(6))) == 0)


def test_postures_that_are_no_numbers_are_refused(collision: ArmCollision) -> None:
    q = np.full((2, 8), np.nan)
    for test in (collision.is_free, collision.clearance, collision.hits_itself):
        with pytest.raises(InputError, match="joint values"):
            test(q)
    with pytest.raises(ShapeError, match="joint values"):
        collision.is_free(np.zeros((3, 7)))


def test_the_hull_of_a_moved_mesh_is_not_sought_again(tmp_path, monkeypatch):
    import trimesh

    trimesh.creation.box((0.1, 0.2, 0.3)).export(tmp_path / "part.stl")
    robot = _meshed_robot(tmp_path, "part.stl")
    before = robot.links_solids()

    def sought(*_):
        raise AssertionError("a hull was sought again")

    monkeypatch.setattr("debrisgrasp.kinematics.hull.hull_of", sought)
    away = SE3.from_parts(p=[1.0, 2.0, 3.0])
    for (_, solid), (_, again) in zip(before, robot.links_solids(), strict=True):
        np.testing.assert_allclose(again.mesh()[0], solid.mesh()[0])
        moved = solid.moved(away)
        np.testing.assert_allclose(moved.mesh()[0], solid.mesh()[0] + away.p)
