from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, InputError, UnknownNameError
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import (
    ArmCollision,
    ArmReach,
    ReachConfig,
    ReachMap,
    RobotModel,
    cached_reach_map,
    load_reach_map,
    save_reach_map,
)


def _nothing(points: np.ndarray) -> np.ndarray:
    return np.full(points.shape[:-1], 0.1)


def _free_poses(reach: ArmReach, n: int, rng: np.random.Generator) -> SE3:
    """Palm poses of postures that touch nothing."""
    q = reach.chain.sampled(6 * n, rng=rng)
    return reach.chain.fk(q[~reach.collision.hits_itself(q)][:n])


def test_poses_of_free_postures_are_reached_freely(
    right_reach: ArmReach, rng: np.random.Generator
) -> None:
    T = _free_poses(right_reach, 40, rng)
    found = right_reach.reach(T, _nothing, rng=rng)
    assert found.is_reached.mean() >= 0.9
    assert [r == "" for r in found.reasons] == found.is_reached.tolist()
    q = found.joints[found.is_reached]
    chain = right_reach.chain
    np.testing.assert_allclose(
        chain.fk(q).matrix, T.matrix[found.is_reached], atol=2e-3
    )
    assert ((q >= chain.lower) & (q <= chain.upper)).all()
    assert not right_reach.collision.hits_itself(q).any()
    assert np.isnan(found.joints[~found.is_reached]).all()


def test_a_matrix_is_no_pose_and_a_seed_no_generator(
    right_reach: ArmReach, rng: np.random.Generator
) -> None:
    matrix = np.eye(4)[None]
    for ask in (
        right_reach.may_reach,
        right_reach.may_yield,
        lambda T: right_reach.solves(T, rng=rng),
        lambda T: right_reach.reach(T, _nothing, rng=rng),
        lambda T: right_reach.yielding(T, T, _nothing, 0.5, rng=rng),
        lambda T: right_reach.leeway(np.zeros((1, 8)), T, T, rng=rng),
    ):
        with pytest.raises(InputError, match=r"got ndarray.*SE3\.from_matrix"):
            ask(matrix)
    with pytest.raises(InputError, match="default_rng"):
        right_reach.reach(SE3(matrix), _nothing, rng=0)


def test_every_pose_without_posture_has_its_reason(
    right_reach: ArmReach, rng: np.random.Generator
) -> None:
    good = _free_poses(right_reach, 5, rng).matrix
    far = SE3.from_parts(p=(4.0, 0, 0)).matrix
    T = SE3(np.concatenate([good, far[None]]))
    blocked = right_reach.reach(T, lambda p: np.zeros(p.shape[:-1]), rng=rng)
    assert blocked.reasons == ("arm hits the scene",) * 5 + ("out of reach",)
    assert (blocked.clearance[:5] < 0).all()
    assert np.isnan(blocked.clearance[5])
    # A palm inside the chassis can only be reached through the robot.
    inside = SE3.from_parts(p=[(0.33, 0.0, 0.45)])
    assert right_reach.reach(inside, _nothing, rng=rng).reasons == ("arm hits itself",)


def test_what_is_reached_may_be_reached_and_far_poses_may_not(
    right_reach: ArmReach, rng: np.random.Generator
) -> None:
    near = right_reach.chain.fk(right_reach.chain.sampled(500, rng=rng))
    assert right_reach.may_reach(near).all()
    far = SE3.from_parts(p=(3.0, 0.0, 0.0)) @ near
    assert not right_reach.may_reach(far).any()


def test_single_poses_and_grids_of_them_are_answered_like_a_list(
    right_reach: ArmReach, rng: np.random.Generator
) -> None:
    near = right_reach.chain.fk(right_reach.chain.sampled(12, rng=rng))
    far = SE3.from_parts(p=(3.0, 0.0, 0.0)) @ near
    T = SE3(np.concatenate([near.matrix, far.matrix]))
    for ask in (right_reach.may_reach, right_reach.may_yield):
        answers = ask(T)
        assert 0 < answers.sum() < len(answers)
        assert [bool(ask(pose)) for pose in T] == answers.tolist()
        grid = SE3(T.matrix.reshape(4, 6, 4, 4))
        np.testing.assert_array_equal(ask(grid), answers.reshape(4, 6))


def test_an_arm_of_one_joint_is_answered_without_a_map(
    roman: RobotModel, rng: np.random.Generator
) -> None:
    names = ArmReach(roman, "right").joint_names
    arm = ArmReach(roman, "right", locked=dict.fromkeys(names[:-1], 0.0))
    assert arm.reach_map is None
    T = arm.chain.fk(arm.chain.sampled(5, rng=rng))
    assert arm.may_reach(T).all()
    assert arm.may_yield(T).all()
    assert arm.solves(T, rng=rng).all()


def test_at_the_edge_of_its_reach_an_arm_can_not_give_way(
    right_reach: ArmReach, rng: np.random.Generator
) -> None:
    near = right_reach.chain.fk(right_reach.chain.sampled(500, rng=rng))
    yields = right_reach.may_yield(near)
    away = np.linalg.norm(near.p[:, :2], axis=1)
    assert 0.2 < yields.mean() < 1.0
    assert away[yields].max() < away.max()
    assert away[yields].mean() < away[~yields].mean()


def test_a_later_round_only_adds(
    right_reach: ArmReach, roman: RobotModel, rng: np.random.Generator
) -> None:
    T = _free_poses(right_reach, 60, rng)

    def wall(points: np.ndarray) -> np.ndarray:
        return np.minimum(np.abs(points[..., 1] + 0.5), 0.1)

    counts = [
        ArmReach(roman, "right", ReachConfig(n_postures=2, rounds=rounds))
        .reach(T, wall, rng=np.random.default_rng(1))
        .is_reached.sum()
        for rounds in (1, 3)
    ]
    assert counts[1] > counts[0]


def test_links_keep_their_margin(
    right_reach: ArmReach, rng: np.random.Generator
) -> None:
    T = _free_poses(right_reach, 40, rng)

    def above_ground(points: np.ndarray) -> np.ndarray:
        return np.minimum(points[..., 2], 0.1)

    found = right_reach.reach(T, above_ground, rng=rng)
    q = found.joints[found.is_reached]
    clearance = right_reach.collision.scene_clearance(q, above_ground)
    assert clearance.min() >= right_reach.config.margin
    np.testing.assert_allclose(clearance, found.clearance[found.is_reached])


def test_the_present_posture_is_kept_where_it_serves(right_reach: ArmReach) -> None:
    q = right_reach.q_present
    T = SE3(right_reach.chain.fk(q).matrix[None])
    found = right_reach.reach(T, _nothing, rng=np.random.default_rng(0))
    np.testing.assert_allclose(found.joints[0], q, atol=1e-3)


def test_a_known_posture_is_taken_where_no_other_may_be_looked_at(
    right_reach: ArmReach, roman: RobotModel, rng: np.random.Generator
) -> None:
    q = right_reach.chain.sampled(200, rng=rng)
    q = q[~right_reach.collision.hits_itself(q)][:60]
    T = right_reach.chain.fk(q)

    def wall(points: np.ndarray) -> np.ndarray:
        return np.minimum(np.abs(points[..., 1] + 0.5), 0.1)

    is_free = right_reach.collision.scene_clearance(q, wall) >= 0.01
    once = ArmReach(roman, "right", ReachConfig(rounds=1, slides=0))
    alone = once.reach(T, wall, rng=np.random.default_rng(1))
    told = once.reach(T, wall, q_known=q, rng=np.random.default_rng(1))
    np.testing.assert_array_equal(told.is_reached, alone.is_reached | is_free)
    only_known = is_free & ~alone.is_reached
    assert only_known.any()
    np.testing.assert_allclose(told.joints[only_known], q[only_known])
    # What doesn't take its pose, or isn't known, is not believed.
    wrong = np.where(np.arange(len(q))[:, None] % 2 == 0, q + 0.05, np.nan)
    mistold = once.reach(T, wall, q_known=wrong, rng=np.random.default_rng(1))
    np.testing.assert_array_equal(mistold.joints, alone.joints)


def test_equal_generators_give_equal_answers(
    right_reach: ArmReach, rng: np.random.Generator
) -> None:
    T = _free_poses(right_reach, 10, rng)
    once, again = (
        right_reach.reach(T, _nothing, rng=np.random.default_rng(5)) for _ in range(2)
    )
    np.testing.assert_array_equal(once.joints, again.joints)


def test_no_poses_give_an_empty_answer(
    right_reach: ArmReach, rng: np.random.Generator
) -> None:
    none = right_reach.reach(SE3(np.zeros((0, 4, 4))), _nothing, rng=rng)
    assert none.joints.shape == (0, 8)
    assert none.reasons == ()


def test_a_locked_torso_leaves_seven_joints(
    roman: RobotModel, rng: np.random.Generator
) -> None:
    still = ArmReach(roman, "left", locked={"torso_joint": 0.5})
    assert len(still.joint_names) == 7
    assert still.gripper == "camhand"
    T = _free_poses(still, 10, rng)
    assert still.reach(T, _nothing, rng=rng).is_reached.mean() >= 0.8


def test_settings_out_of_range_are_refused() -> None:
    with pytest.raises(ConfigError, match="n_postures"):
        ReachConfig(n_postures=0)
    with pytest.raises(ConfigError, match="margin"):
        ReachConfig(margin=-0.1)


def test_an_arm_that_the_robot_has_not_is_refused_at_once(roman: RobotModel) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'right'"):
        ArmReach(roman, "rigth")
    with pytest.raises(InputError, match=r"robot: got 'roman'.*RobotModel\.load"):
        ArmReach("roman", "right")  # type: ignore[arg-type]  # refused before use


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (ReachMap.build, "chain: got RobotModel, expected a KinematicChain.*chain"),
        (cached_reach_map, "chain: got RobotModel"),
        (lambda robot: load_reach_map("map.npz", robot), "chain: got RobotModel"),
        (lambda robot: save_reach_map("map.npz", robot), "built: got 'map.npz'"),
        (lambda robot: ReachMap.build(robot.chain("left"), {}), "config: got dict"),
        (lambda robot: ArmCollision.fit(robot.name, "left"), "robot: got 'roman'"),
    ],
)
def test_a_robot_is_no_chain_and_its_name_no_robot(
    roman: RobotModel, call, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        call(roman)
