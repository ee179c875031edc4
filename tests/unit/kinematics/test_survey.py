from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, InputError, ShapeError
from debrisgrasp.geometry import SE3, Bounds
from debrisgrasp.kinematics import (
    Approach,
    ArmReach,
    PlacementConfig,
    ReachSurvey,
    RobotModel,
    base_placements,
    grid_places,
    palm_poses,
    survey_reach,
)

KINDS = (
    Approach("top-down", np.array([[0.0, 0.0, -1.0]])),
    Approach.sloped("frontal", 0.0, (0.0,)),
    Approach.sloped("45 deg", np.pi / 4, (0.0,)),
)


@pytest.fixture(scope="module")
def grid() -> np.ndarray:
    return grid_places(Bounds(np.array([0.5, -0.6, 0]), np.array([1.6, 0.6, 1])), 0.1)


def _surveyed(roman: RobotModel, name: str, grid: np.ndarray) -> ReachSurvey:
    still = ArmReach(roman, name, locked={"torso_joint": 0.0})
    return survey_reach(still, grid, KINDS, rng=np.random.default_rng(2))


def test_shares_of_the_workspace_are_those_found_by_other_means(
    roman: RobotModel, grid: np.ndarray
) -> None:
    # Shares of a second implementation with the torso held, over the same grid and
    # with eight turns of the hand; "free" there is a lower bound.
    right = _surveyed(roman, "right", grid)
    left = _surveyed(roman, "left", grid)
    both = right.joined(left)
    reached = {"right": (0.224, 0.477, 0.411), "left": (0.199, 0.513, 0.419)}
    free = {"right": (0.186, 0.329, 0.301), "left": (0.165, 0.346, 0.298)}
    for survey in (right, left):
        want = reached[survey.arm]
        np.testing.assert_allclose(survey.is_reached.mean(axis=0), want, atol=0.005)
        np.testing.assert_allclose(
            survey.is_free.mean(axis=0), free[survey.arm], atol=0.025
        )
    np.testing.assert_allclose(
        both.is_reached.mean(axis=0), (0.332, 0.765, 0.636), atol=0.005
    )
    assert (both.share() >= right.share()).all()


def test_what_is_free_is_also_reached_and_parts_hold_it(
    right_reach: ArmReach, rng: np.random.Generator
) -> None:
    places = rng.uniform((0.5, -0.8, 0.0), (1.4, 0.4, 0.9), (60, 3))
    survey = survey_reach(right_reach, places, rng=rng)
    assert survey.is_free.shape == (60, 11)
    assert not (survey.is_free & ~survey.is_reached).any()
    for k in range(3):
        part, can = survey.part(k), survey.share(k) > 0
        assert part is not None
        assert part.contains(places[can]).all()
    far = survey_reach(right_reach, [[5.0, 0.0, 0.0]], rng=rng)
    assert far.part(0) is None
    assert not far.is_reached.any()


def test_palms_hold_the_place_in_front_of_them(rng: np.random.Generator) -> None:
    places = rng.normal(size=(4, 3))
    directions = rng.normal(size=(5, 3))
    directions[0] = (0.0, 0.0, -1.0)
    T = palm_poses(places, directions, 0.06, 3)
    assert T.batch == (4, 5, 3)
    held = T.apply(np.array([0.0, 0.0, 0.06]))
    np.testing.assert_allclose(
        held, np.broadcast_to(places[:, None, None], (4, 5, 3, 3)), atol=1e-12
    )
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    np.testing.assert_allclose(T.R[0, :, 1, :, 2], unit, atol=1e-12)
    np.testing.assert_allclose(
        T.R.swapaxes(-1, -2) @ T.R, np.broadcast_to(np.eye(3), T.R.shape), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(T.R), 1.0)


def test_places_fill_the_box_and_too_many_are_refused() -> None:
    box = Bounds(np.zeros(3), np.array([1.0, 0.5, 0.1]))
    places = grid_places(box, 0.1)
    assert len(places) == 11 * 6 * 2
    np.testing.assert_allclose(places.min(axis=0), box.lower)
    np.testing.assert_allclose(places.max(axis=0), box.upper)
    with pytest.raises(InputError, match="coarser"):
        grid_places(box, 0.001)
    for step in (0.0, -0.1, np.nan):
        with pytest.raises(InputError, match="step"):
            grid_places(box, step)


def _poses_ahead(rng: np.random.Generator) -> SE3:
    """Palm poses in front of the robot, where the right arm works."""
    places = rng.uniform((0.8, -0.5, 0.3), (1.0, -0.1, 0.5), (12, 3))
    T = palm_poses(places, KINDS[2].directions, 0.06)
    return SE3(T.matrix.reshape(-1, 4, 4))


def test_the_base_goes_back_to_where_the_grasps_came_from(
    right_reach: ArmReach, rng: np.random.Generator
) -> None:
    ahead = _poses_ahead(rng)
    moved = SE3.from_parts(p=(0.8, 0.4, 0.0))
    found = base_placements([right_reach], moved @ ahead, rng=rng)
    best = found[0]
    assert best.share >= 0.9
    here = next(p for p in found if p.travel == 0.0)
    assert here.share <= 0.2
    assert [p.share for p in found] == sorted((p.share for p in found), reverse=True)
    # What it promises holds when the base stands there.
    T = best.T_base_placed.inverse() @ moved @ ahead
    answer = right_reach.reach(T, lambda p: np.full(p.shape[:-1], 0.1), rng=rng)
    assert answer.is_reached.mean() >= best.share - 0.1


def test_the_base_does_not_stand_on_what_it_is_to_grip(
    right_reach: ArmReach, rng: np.random.Generator
) -> None:
    T = _poses_ahead(rng)
    points = T.p
    config = PlacementConfig(reach=1.0)
    for placement in base_placements([right_reach], T, config=config, rng=rng):
        inside = placement.T_base_placed.inverse().apply(points)
        is_on = (np.abs(inside[:, 0]) < 0.43) & (np.abs(inside[:, 1]) < 0.285)
        assert not (is_on & (inside[:, 2] < 0.25)).any()


def test_grasps_are_left_to_arms_that_carry_their_hand(
    right_reach: ArmReach, rng: np.random.Generator
) -> None:
    T = _poses_ahead(rng)
    half = ["robotiq_3f"] * 6 + ["none such"] * 6
    found = base_placements([right_reach], T, grippers=half, rng=rng)
    assert max(p.share for p in found) <= 0.5
    assert not found[0].is_reached[6:].any()
    with pytest.raises(ShapeError, match="grippers"):
        base_placements([right_reach], T, grippers=half[:3], rng=rng)
    with pytest.raises(ShapeError, match="1 or more"):
        base_placements([right_reach], T[:0], rng=rng)
    with pytest.raises(ConfigError, match="step"):
        PlacementConfig(step=0.001)


def test_what_a_plan_reaches_is_gripped_from_where_the_base_stands(
    right_reach: ArmReach,
) -> None:
    rng = np.random.default_rng(0)
    q = right_reach.chain.sampled(60, rng=rng)
    T = right_reach.chain.fk(q[~right_reach.collision.hits_itself(q)])
    answer = right_reach.reach(T, lambda p: np.full(p.shape[:-1], np.inf), rng=rng)
    config = PlacementConfig(reach=0.2, n_headings=1, n_proven=2)
    T = T[answer.is_reached]
    found = base_placements([right_reach], T, config=config, rng=rng)
    (here,) = (p for p in found if p.travel == 0.0)
    assert here.share == 1.0


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"places": [[800.0, -200.0, 200.0]]}, "places: got .*800.*millimetres"),
        ({"places": [0.8, -0.2, 0.2]}, r"places: got \(3,\), expected \(n, 3\)"),
        ({"approaches": ()}, "approaches: got none"),
        ({"approaches": [Approach("none", np.zeros((1, 3)))]}, "without a length"),
        ({"n_turns": 0}, "n_turns: got 0"),
        ({"arm": "right"}, "arm: got 'right'"),
    ],
    ids=str,
)
def test_what_no_arm_could_grip_is_refused(
    right_reach: ArmReach, rng: np.random.Generator, wrong, words: str
) -> None:
    right = {"arm": right_reach, "places": [[0.8, -0.2, 0.2]], "rng": rng}
    with pytest.raises(InputError, match=words):
        survey_reach(**{**right, **wrong})


def test_a_base_is_placed_for_arms_and_poses(
    right_reach: ArmReach, rng: np.random.Generator
) -> None:
    T = right_reach.chain.fk(np.zeros((1, 8)))
    with pytest.raises(InputError, match="arms: got ArmReach, expected a sequence"):
        base_placements(right_reach, T, rng=rng)  # type: ignore[arg-type]  # refused
    with pytest.raises(InputError, match=r"T_base_hand: got ndarray.*from_matrix"):
        base_placements([right_reach], T.matrix, rng=rng)  # type: ignore[arg-type]  # refused
    with pytest.raises(InputError, match=r"bounds: got tuple.*Bounds\("):
        grid_places((0, 1), 0.1)  # type: ignore[arg-type]  # refused before use
