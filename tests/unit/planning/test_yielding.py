"""Grasps whose arm can't give way make room for others, unless there are none."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from debrisgrasp._stopwatch import Stopwatch
from debrisgrasp.geometry import SE3, Bounds, DepthSight
from debrisgrasp.planning import (
    Grasp,
    GraspPlanner,
    GraspScene,
    LoadForecast,
    PlannerConfig,
    SceneConfig,
)
from debrisgrasp.planning.choice import is_half_turn_symmetric
from debrisgrasp.planning.easing import Easing
from debrisgrasp.planning.ledger import Ledger
from debrisgrasp.planning.offers import Offers
from debrisgrasp.prototypes import PrototypeLibrary
from tests.grasps import grasp_at
from tests.scenes import CAMERA, capture_of, lying_pipe


class Arm:
    """Gives way in each posture by what its only joint says."""

    joint_names = ("j",)

    def __init__(self, name: str) -> None:
        self.name = name
        self.seen: list[np.ndarray] = []

    def leeway(self, joints, T_base_hand, Ts_base_away, **_) -> np.ndarray:
        assert T_base_hand.matrix.shape == (len(joints), 4, 4)
        self.seen.append(Ts_base_away.matrix[..., 2, 3])
        return joints[:, 0]


def grasp(arm: str, share: float, score: float) -> Grasp:
    return grasp_at(
        SE3.from_parts(p=(share, 0.0, 0.3)),
        SE3.from_parts(p=(share, 0.0, 0.35)),
        preshape="pinch",
        score=score,
        arm=arm,
        joints={"j": share},
    )


def approached(grasps) -> list[Grasp]:
    """The hand comes from 10 cm above."""
    up = SE3.from_parts(p=(0.0, 0.0, 0.1))
    return [replace(one, T_base_pregrasp=up @ one.T_base_hand) for one in grasps]


def offers(most: int, eased=lambda _: {}) -> tuple[Offers, list[Arm]]:
    """Offers of two arms: at most so many."""
    arms = [Arm("left"), Arm("right")]

    def best(grasps) -> np.ndarray:
        scores = np.array([one.score for one in grasps])
        return np.argsort(-scores, kind="stable")[:most]

    return Offers(arms, best, approached, eased, rng=np.random.default_rng(0)), arms


def given(shares) -> list[Grasp]:
    """Grasps that give way so much, of two arms in turn, the best first."""
    return [
        grasp(("left", "right")[i % 2], share, 0.9 - 0.1 * i)
        for i, share in enumerate(shares)
    ]


def shares(grasps) -> list[float]:
    return [one.joints["j"] for one in grasps]


def test_grasps_that_cannot_give_way_are_left_out():
    found, arms = offers(20)
    found.take(given([1.0, 0.5, 0.95, 0.97, 0.2]))
    assert shares(found.offered) == [1.0, 0.95, 0.97]
    assert shares(found.left_out) == [0.5, 0.2]
    # At the pre-grasp, and lifted by 15 cm.
    assert arms[0].seen[0] == pytest.approx(np.array([[0.4, 0.45]] * 3))


def test_a_grasp_that_gives_way_takes_the_place_of_one_that_does_not():
    found, arms = offers(2)
    found.take(given([0.5, 0.2, 0.1, 0.95, 0.97, 1.0]))
    assert shares(found.offered) == [0.95, 0.97]
    assert sum(map(len, arms[0].seen)) + sum(map(len, arms[1].seen)) == 5
    assert [one.T_base_pregrasp.p[2] for one in found.offered] == pytest.approx(
        [0.4] * 2
    )


def test_grasps_taken_later_are_offered_if_they_are_better():
    found, _ = offers(2)
    found.take(given([0.5, 0.95, 0.97]))
    found.take([grasp("left", 0.3, 0.99), grasp("left", 0.98, 0.95)])
    assert shares(found.offered) == [0.98, 0.95]
    assert shares(found.left_out) == [0.5, 0.3]


def test_where_no_grasp_gives_way_the_best_stay():
    found, _ = offers(2)
    found.take(given([0.5, 0.1, 0.2]))
    assert shares(found.offered) == [0.5, 0.1]
    assert found.yielding == ()
    assert found.left_out == ()
    nothing, _ = offers(2)
    nothing.take([])
    assert nothing.offered == ()


def test_a_stiff_grasp_better_than_all_others_takes_another_posture():
    asked = []

    def eased(grasps) -> dict[int, Grasp]:
        asked.extend(shares(grasps))
        return {len(grasps) - 1: replace(grasps[-1], joints={"j": 0.99})}

    found, _ = offers(20, eased)
    found.take(given([0.5, 0.4, 0.95, 0.2]))
    # What is no better than another one that gives way isn't worth the search.
    assert asked == [0.5, 0.4]
    assert shares(found.offered) == [0.99, 0.95]
    assert shares(found.left_out) == [0.5, 0.2]


class Yielding(Arm):
    """Finds the posture 0.99 wherever the hand is not too far out."""

    def yielding(self, T_base_hand, *_, **__) -> np.ndarray:
        far = T_base_hand.p[:, 0] > 0.6
        return np.where(far, np.nan, 0.99)[:, None]

    def effort(self, joints, wrench) -> np.ndarray:
        return np.where(np.isnan(joints[:, 0]), np.nan, wrench[:, 0])


@pytest.mark.parametrize(("share", "is_eased"), [(0.4, True), (0.6, False)])
def test_another_posture_must_bear_the_load_as_forecast(share, is_eased):
    load = LoadForecast(
        build="solid",
        mass=(1.0, 4.0),
        force=(10.0, 40.0),
        torque=(0.0, 0.0),
        grip=(0.0, 0.0),
        lever=0.0,
        lever_error=0.0,
        tilt=0.0,
        margin=2.0,
        margins=(1.0, 4.0),
        limit="grip",
    )
    loads = SimpleNamespace(
        mass=np.array([1.0, 2.0, 4.0]), wrench=np.full((2, 6), share)
    )
    easing = Easing(
        [Yielding("left")],
        lambda _: np.inf,
        lambda _: loads,
        rng=np.random.default_rng(0),
    )
    far, near = (replace(grasp("left", j, 0.9), load=load) for j in (0.7, 0.5))
    found = easing([far, near])
    assert list(found) == ([1] if is_eased else [])
    assert shares(found.values()) == ([0.99] if is_eased else [])
    # Where nothing was forecast, nothing is known to be borne.
    assert not easing([replace(far, load=None), replace(near, load=None)])


@pytest.fixture(scope="module")
def planner() -> GraspPlanner:
    library = PrototypeLibrary.load().select(names=["claw_bar_4x4", "cylinder_060_tip"])
    claw = library["claw_bar_4x4"]
    assert is_half_turn_symmetric(library.grippers[claw.gripper], claw.preshape)
    return GraspPlanner(library, PlannerConfig())


def test_the_hand_turned_by_half_is_offered_where_the_better_one_is_stiff(planner):
    claw = {p.name: p for p in planner.prototypes}["claw_bar_4x4"]
    stiff = replace(
        grasp("left", 0.5, 0.9),
        gripper=claw.gripper,
        preshape=claw.preshape,
        prototype=claw.name,
    )
    turn = SE3.exp(np.array([0.0, 0.0, 0.0, 0.0, 0.0, np.pi]))
    turned = replace(
        stiff, T_base_hand=stiff.T_base_hand @ turn, score=0.8, joints={"j": 1.0}
    )
    rng = np.random.default_rng(0)
    both = Offers(
        [Arm("left")], planner._ranking._chosen, approached, lambda _: {}, rng=rng
    )
    both.take([stiff, turned])
    assert [one.score for one in both.offered] == [0.8]
    assert [one.score for one in both.left_out] == [0.9]


def loaded(score: float, margin: float, mass: tuple[float, float]) -> Grasp:
    load = LoadForecast(
        build="solid",
        mass=mass,
        force=(9.8, 98.0),
        torque=(1.0, 10.0),
        grip=(10.0, 100.0),
        lever=0.1,
        lever_error=0.05,
        tilt=0.0,
        margin=margin,
        margins=(margin, margin),
        limit="grip",
    )
    return replace(grasp("left", score, score), load=load)


def test_what_is_overloaded_for_certain_comes_after_what_is_not(planner):
    def scores(mass):
        offered = (
            loaded(0.6, 0.12, mass),
            loaded(0.5, 1.3, mass),
            loaded(0.4, 0.9, mass),
        )
        return [offered[row].score for row in planner._ranking._chosen(offered)]

    assert scores((12.0, 12.0)) == [0.5, 0.6, 0.4]
    # Of a mass that is guessed, the score is all that is known.
    assert scores((1.0, 12.0)) == [0.6, 0.5, 0.4]


@pytest.mark.parametrize(
    ("mass", "expected"),
    [
        # What is overloaded for certain comes last, however likely it holds.
        ((12.0, 12.0), [0.7]),
        ((1.0, 12.0), [0.8, 0.7]),
    ],
)
def test_only_what_would_be_offered_first_is_eased(mass, expected):
    asked = []

    def eased(grasps) -> dict[int, Grasp]:
        asked.extend(one.score for one in grasps)
        return {}

    heavy, light = loaded(0.8, 0.12, mass), loaded(0.7, 1.3, mass)
    giving = replace(loaded(0.6, 1.3, mass), joints={"j": 0.95})
    found, _ = offers(20, eased)
    found.take([heavy, light, giving])
    assert asked == expected


def test_what_is_overloaded_is_eased_where_nothing_else_is():
    asked = []

    def eased(grasps) -> dict[int, Grasp]:
        asked.extend(one.score for one in grasps)
        return {}

    found, _ = offers(20, eased)
    found.take([loaded(0.6, 0.12, (12.0, 12.0))])
    assert asked == [0.6]


def test_those_left_out_are_counted_with_their_reason(planner):
    ledger = Ledger()
    planner._ranking._note_stiff(given([0.5, 0.2, 0.1]), ledger)
    assert ledger.closed().counts() == {
        "left arm: no room to give way to a push": 2,
        "right arm: no room to give way to a push": 1,
    }


class Nowhere:
    """Gets nowhere; remembers about which places it was asked."""

    name, gripper, joint_names = "right", "robotiq_3f", ("j",)
    wrench_limits = (100.0, 100.0)

    def __init__(self) -> None:
        self.may_yield_at: list[np.ndarray] = []
        self.may_reach_at: list[np.ndarray] = []

    def may_yield(self, T_base_hand: SE3) -> np.ndarray:
        self.may_yield_at.append(T_base_hand.matrix)
        return np.zeros(len(T_base_hand.matrix), dtype=bool)

    def may_reach(self, T_base_hand: SE3) -> np.ndarray:
        self.may_reach_at.append(T_base_hand.matrix)
        return np.zeros(len(T_base_hand.matrix), dtype=bool)

    def follow(self, _: SE3, q_before: np.ndarray, **__) -> np.ndarray:
        return np.full_like(q_before, np.nan)


def test_the_search_asks_for_room_where_the_object_is_lifted():
    capture, arm = capture_of([lying_pipe()]), Nowhere()
    cloud = capture.cloud()
    is_object = cloud.points[:, 2] > 0.02
    scene = GraspScene.build(
        cloud,
        is_object,
        Bounds.around(cloud.points[is_object], 0.05),
        DepthSight(capture.depth, CAMERA, capture.T_base_camera),
        SceneConfig(),
    )
    library = PrototypeLibrary.load().select(names=["cylinder_060_tip"])
    found = GraspPlanner(library, PlannerConfig()).plan(
        scene,
        [arm],
        lambda points: np.full(points.shape[:-1], 0.1),
        rng=np.random.default_rng(0),
        watch=Stopwatch(None, lambda _stage, _share: None),
    )
    assert not found.grasps
    assert arm.may_yield_at
    up = SE3.from_parts(p=(0.0, 0.0, 0.15)).matrix
    for asked, place in zip(arm.may_yield_at, arm.may_reach_at, strict=True):
        assert asked == pytest.approx(up @ place)
