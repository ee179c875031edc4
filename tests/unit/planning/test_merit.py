"""What the search climbs is what the list is sorted by, whatever is left out."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.geometry import SE3
from debrisgrasp.planning import PlannerConfig
from debrisgrasp.planning.annealing import Walkers
from debrisgrasp.planning.clearance import SPHERE_RADIUS, ClearanceConfig
from debrisgrasp.planning.exploration import exchanged
from debrisgrasp.planning.ledger import Ledger
from debrisgrasp.planning.levers import GripLevers
from debrisgrasp.planning.load import LoadModel
from debrisgrasp.planning.mass import LoadConfig, ObjectMass
from debrisgrasp.planning.merit import Looks, Merit
from debrisgrasp.planning.postures import Postures
from debrisgrasp.planning.quality import STIFF, Reach
from debrisgrasp.planning.robustness import PoseUncertainty
from debrisgrasp.planning.tools import Burden, Tools, blurred
from debrisgrasp.prototypes import PrototypeLibrary
from tests.scenes import capture_of
from tests.unit.planning.test_search_terms import PIPE, TOP_DOWN, scene_of

NAMES = ["cylinder_060_tip", "cylinder_080_tip"]
WHICH = np.zeros(60, dtype=int)
NOTHING = np.full(60, -np.inf)


@pytest.fixture(scope="module")
def tools() -> Tools:
    library = PrototypeLibrary.load().select(names=NAMES)
    return Tools.of(library, PlannerConfig())


@pytest.fixture(scope="module")
def merit(tools) -> Merit:
    return merit_of(tools)


def everywhere(Ts: np.ndarray, _prototype: np.ndarray) -> np.ndarray:
    """All that an arm with endless reach says."""
    return np.ones(len(Ts))


def merit_of(
    tools: Tools, mass: float | None = None, reach: Reach = everywhere
) -> Merit:
    """Return the merit of grasps of a pipe that weighs so much [kg]."""
    scene = scene_of(capture_of([PIPE]))
    cloud, config = scene.cloud, tools.config
    what = ObjectMass.from_surface(
        cloud.points[scene.is_target],
        cloud.normals[scene.is_target],
        cloud.viewpoint,
        config.load,
        spacing=0.01,
        mass=mass,
    )
    burden = Burden.on((), LoadModel((what,), config.load), tools)
    looks = Looks.into(scene, tools)
    return Merit(scene, tools, burden, looks, reach)


@pytest.fixture(scope="module")
def Ts() -> np.ndarray:
    """Poses around a good one: some fit, some hit, some miss."""
    library = PrototypeLibrary.load().select(names=NAMES[:1])
    depth = next(iter(library)).definition.T_hand_shape.p[2]
    good = SE3.from_parts(TOP_DOWN.R, [0.9, 0.0, 0.2 + depth])
    rng = np.random.default_rng(3)
    spread = rng.normal(0.0, 1.0, (60, 6)) * np.repeat([0.01, 0.1], 3)
    return (good @ SE3.exp(spread * np.linspace(0.0, 2.0, 60)[:, None])).matrix


def test_what_is_climbed_is_close_to_what_ranks(merit, Ts):
    modes, ok = merit.judged(Ts, WHICH, Ledger())
    assert 5 < ok.sum() < 55
    climbed = np.exp(merit(Ts, WHICH, NOTHING))
    # Eight looks instead of sixteen.
    assert climbed[ok] == pytest.approx(modes.score[ok], abs=0.07)


def test_sight_is_the_evidence_where_a_side_was_not_seen(merit, Ts):
    every, none = np.ones(60, dtype=bool), np.zeros(60, dtype=bool)
    seen, _ = merit.sight(Ts, WHICH, every)
    unseen, is_guess = merit.sight(Ts, WHICH, none)
    evidence = merit.fine.evidence_of_thickness(Ts, WHICH)
    assert unseen == pytest.approx(np.minimum(evidence / 0.5, 1.0))
    is_blind = merit.clearance.is_blind(Ts, WHICH)
    assert (seen[~is_blind] == 1.0).all()
    assert (is_guess == (is_blind & (unseen < 1.0))).all()


def test_what_is_ruled_out_is_worth_less(merit, Ts):
    modes, ok = merit.judged(Ts, WHICH, Ledger())
    climbed = np.exp(merit(Ts, WHICH, NOTHING))
    assert (climbed[~ok] < climbed[ok].min()).all()
    assert (modes.score[ok] > 0).all()


def test_unseen_space_costs_by_its_share(merit, Ts):
    unseen = merit.clearance.unseen(Ts, WHICH)
    assert ((unseen >= 0.0) & (unseen <= 1.0)).all()
    cost = ClearanceConfig().unknown_cost
    C = merit.clearance(Ts, WHICH, np.zeros(len(Ts)))
    assert (1.0 - cost * unseen + 1e-12 >= C).all()
    assert np.isclose(C, 1.0 - cost * unseen).any()


def test_bounds_never_lose_a_pose_that_matters(merit, Ts):
    exact = merit(Ts, WHICH, NOTHING)
    for needed in np.quantile(exact, [0.2, 0.5, 0.9]):
        quick = merit(Ts, WHICH, np.full(60, needed))
        matters = exact > needed
        assert quick[matters] == pytest.approx(exact[matters])
        assert (quick[~matters] <= needed).all()


def test_poses_are_judged_alone(merit, Ts):
    whole = merit(Ts, WHICH, NOTHING)
    parts = [merit(Ts[i : i + 1], WHICH[:1], NOTHING[:1])[0] for i in range(0, 60, 7)]
    assert whole[::7] == pytest.approx(np.array(parts))
    assert merit(Ts[:0], WHICH[:0], NOTHING[:0]).shape == (0,)


def test_the_stand_in_prefers_what_ranks_higher(merit, Ts):
    modes, ok = merit.judged(Ts, WHICH, Ledger())
    quick = merit.quick(Ts, WHICH, NOTHING)
    ranks = [np.argsort(np.argsort(value[ok])) for value in (quick, modes.score)]
    assert np.corrcoef(ranks)[0, 1] > 0.5
    factor = merit.preference(Ts, WHICH)
    assert ((factor > 0) & (factor <= 1)).all()


def test_load_of_the_search_is_that_of_the_forecast(rng):
    library = PrototypeLibrary.load().select(kind="generic")
    levers = GripLevers.on(library, LoadConfig())
    what = ObjectMass.from_surface(
        rng.uniform(0.0, 0.4, (300, 3)),
        np.full((300, 3), np.nan),
        np.array([0.0, 0.0, 2.0]),
        LoadConfig(),
        spacing=0.01,
    )
    model = LoadModel((what,), LoadConfig())
    Ts = SE3.exp(rng.normal(0.0, 1.0, (200, 6))).matrix
    which = rng.integers(len(levers.middle), size=200)
    loads = model(Ts, which, levers)
    loads = loads.limited(loads.weight, 150.0, "f").limited(loads.torque, 20.0, "t")
    wrists = np.tile([150.0, 20.0], (len(levers.middle), 1))
    found = model.expected_demand(Ts, which, levers, wrists)
    assert found == pytest.approx(loads.demand[:, 1])


@pytest.mark.parametrize("error", [0.0, 0.01, 0.1])
def test_wider_kernels_stay_within_what_a_config_may_be(error):
    config = PlannerConfig(uncertainty=PoseUncertainty(position=error))
    similarity, clearance = blurred(config)
    assert similarity.sigma == pytest.approx(min(np.hypot(0.008, error), 0.1))
    assert clearance.allowance + clearance.softness <= SPHERE_RADIUS + 1e-12
    if not error:
        assert clearance == ClearanceConfig()


def test_every_other_prototype_of_a_hand_is_tried(merit, tools, Ts, rng):
    value = merit.quick(Ts[:3], WHICH[:3], NOTHING[:3])
    start = Postures((), tools.gripper_of, rng).unknown(Walkers.at(Ts[:3], value))
    found, prototype = exchanged(start, WHICH[:3], merit.quick, tools.gripper_of)
    assert prototype.tolist() == [1, 1, 1]
    apart = found.walkers.best_Ts_base_hand[:, :3, 3] - Ts[:3, :3, 3]
    assert np.linalg.norm(apart, axis=1).max() < 0.05


def test_where_no_arm_gives_way_a_pose_is_worth_less_but_something(tools, merit, Ts):
    stiff = merit_of(tools, reach=lambda Ts, _: np.full(len(Ts), STIFF))
    none = merit_of(tools, reach=lambda Ts, _: np.zeros(len(Ts)))
    free, held = merit(Ts, WHICH, NOTHING), stiff(Ts, WHICH, NOTHING)
    assert (held < free).all()
    assert np.isfinite(held).all()
    assert (none(Ts, WHICH, NOTHING) == -np.inf).all()
    quick, quick_stiff = (
        merit.quick(Ts, WHICH, NOTHING),
        stiff.quick(Ts, WHICH, NOTHING),
    )
    good = quick > np.log(0.01)
    assert quick_stiff[good] == pytest.approx(quick[good] + np.log(STIFF))


def test_what_promises_too_little_hardly_comes_to_more(merit, Ts):
    assert merit.least(0.0) == 0.0
    assert merit.least(1.0 - 1e-9) > 1.0
    promise = np.exp(merit.quick(Ts, WHICH, NOTHING))
    modes, ok = merit.judged(Ts, WHICH, Ledger())
    for score in (0.3, 0.6, 0.9):
        is_left = promise < merit.least(score)
        assert (modes.score[ok & is_left] <= score).all()
