"""One trial: a scene from a seed, the planner's first grasp, and whether it holds.

`run_trial` is a plain function of a record and returns a record, so that any
``concurrent.futures.Executor`` can map it over thousands of seeds.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray, require_range
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp.control import Compliance
from debrisgrasp.errors import ConfigError
from debrisgrasp.io import Capture
from debrisgrasp.pipeline import Pipeline, PlanningResult
from debrisgrasp.planning import Arm, Grasp
from debrisgrasp.segmentation import DEFAULT_POINT, PriorityPoint
from debrisgrasp.sim import (
    Flight,
    FlightConfig,
    SceneConfig,
    TierScene,
    Verdict,
    WristConfig,
    fly,
    tier_scene,
)

__all__ = [
    "NO_GRASP",
    "YIELD",
    "Trial",
    "TrialRecord",
    "TrialSpec",
    "capture_of",
    "intended_of",
    "pipeline_of",
    "run_trial",
    "trial",
    "trials",
]

NO_GRASP = "no_grasp"
"""Outcome of a trial whose plan is empty."""
_ORDERS = ("support_aware", "priority_point")
_PULLS = ("up", "retreat")
_LEVEL = 0.1
"""Retreats with less of a level part lead straight up."""
YIELD = Compliance.diagonal((1e-4,) * 3, (0.4,) * 3)
"""Compliance of a reactive lift: 5 mm under 50 N, 23 degrees under 1 N m. It turns, and
hardly gives way along: what carries the weight must not sink under it."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class TrialSpec:
    """What is tried; equal specs give equal records but for the seconds."""

    tier: str
    """One of `debrisgrasp.sim.TIERS`, or any name where the scene is given."""
    seed: int
    robot: str = "roman"
    """Robot of the pipeline; ``"none"`` plans for floating hands."""
    order: str = "support_aware"
    """In which order objects are taken: or ``"priority_point"`` (Eq. 1)."""
    pull: str = "up"
    """Way of the object out of the scene: straight up, or as the plan advises
    (``"retreat"``)."""
    lift: float = 0.25
    """How far the hand goes to pull it out [m]."""
    clear: float = 0.5
    """How far what hangs from the hand by an end is pulled then, along the level part
    of the retreat that the plan advises, or else towards the robot [m]."""
    is_lift_reactive: bool = False
    """Whether the hand gives way to the wrench during the lift."""
    scene: SceneConfig = SceneConfig()

    def __post_init__(self) -> None:
        if self.order not in _ORDERS:
            raise ConfigError(
                "order", got=repr(self.order), expected=" or ".join(_ORDERS)
            )
        if self.pull not in _PULLS:
            raise ConfigError("pull", got=repr(self.pull), expected=" or ".join(_PULLS))
        require_range("clear", self.clear, 0.05, 5.0)
        if self.seed < 0:
            raise ConfigError("seed", got=self.seed, expected="an integer of 0 or more")


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class TrialRecord:
    """What came of a trial, in plain numbers and words."""

    tier: str
    seed: int
    outcome: str
    """Value of a `Verdict`, or ``"no_grasp"``."""
    kind: str
    """Kind of the body that the grasp was for, or that was gripped; "" if neither."""
    is_as_intended: bool
    """Whether what was gripped is what the grasp was for."""
    mass: float
    """Of that body [kg]."""
    n_bodies: int
    why_empty: str = ""
    prototype: str = ""
    gripper: str = ""
    preshape: str = ""
    arm: str = ""
    score: float = 0.0
    Q: float = 0.0
    S: float = 0.0
    C: float = 0.0
    expected: float = 0.0
    coverage: float = 0.0
    support: int = 0
    opening: float = 0.0
    width: float = 0.0
    steepness: float = 0.0
    """How far downwards the hand approaches: 1 straight down, 0 level."""
    load_margin: float = 0.0
    """Smallest limit over its load that the planner forecasts."""
    probability: float = 0.0
    """Of success, as the planner forecasts it."""
    terms: tuple[float, ...] = ()
    """What that follows from, see `debrisgrasp.planning.SUCCESS_TERMS`."""
    rank: int = 0
    """Which grasp of the plan was flown; 0 the first."""
    lift_overlap: float = 0.0
    """Neighbours over the object that the planner sees, as a share of its size."""
    lever: float = 0.0
    """Horizontal distance from the palm to the body's true centre of mass [m]."""
    n_grasps: int = 0
    rise: float = 0.0
    pulled: float = 0.0
    """How far it was pulled, if it was held but did not rise enough [m]."""
    turn: float = 0.0
    slide: float = 0.0
    short_of_goal: float = 0.0
    shift_before: float = 0.0
    peak_force: float = 0.0
    peak_torque: float = 0.0
    deepest: float = 0.0
    is_through: bool = False
    moved_others: int = 0
    plan_seconds: float = 0.0
    """Computing time of the plan [s]."""
    flight_seconds: float = 0.0
    """Computing time of the flight [s]."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "terms", tuple(self.terms))

    @property
    def is_held(self) -> bool:
        """Whether the object came up with the hand and stayed in it."""
        return self.outcome == Verdict.HELD.value

    @property
    def is_success(self) -> bool:
        """Whether the object was held, or pulled clear."""
        return self.is_held or self.outcome == Verdict.PULLED_CLEAR.value

    def as_dict(self) -> dict[str, Any]:
        """Everything as JSON can take it."""
        return asdict(self)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Trial:
    """A trial with all that led to its record, for pictures."""

    scene: TierScene
    planned: PlanningResult
    grasp: Grasp | None
    flight: Flight | None
    record: TrialRecord


def run_trial(spec: TrialSpec, pipeline: Pipeline | None = None) -> TrialRecord:
    """Try the first grasp of one scene.

    Parameters
    ----------
    spec
        What to try.
    pipeline
        Plans, with its own robot and order, whatever the spec says of them; None: one
        is loaded for this trial, see `pipeline_of`.

    Raises
    ------
    UnknownNameError
        If there is no such tier or robot.
    MissingExtraError
        If MuJoCo is not installed.
    """
    return trial(spec, pipeline).record


def pipeline_of(spec: TrialSpec) -> Pipeline:
    """Load the planner that a spec asks for."""
    policy = (
        PriorityPoint(np.array(DEFAULT_POINT))
        if spec.order == "priority_point"
        else None
    )
    return Pipeline(robot=spec.robot, policy=policy)


def trial(
    spec: TrialSpec,
    pipeline: Pipeline | None = None,
    *,
    scene: TierScene | None = None,
) -> Trial:
    """Try the first grasp of one scene and keep everything; see `trials`."""
    return trials(spec, pipeline, scene=scene)[0]


@checked
def trials(
    spec: TrialSpec,
    pipeline: Pipeline | None = None,
    *,
    ranks: Sequence[int] = (0,),
    scene: TierScene | None = None,
) -> list[Trial]:
    """Try several grasps of one plan, each in the untouched scene.

    Parameters
    ----------
    ranks
        Which grasps, 0 the first; those that the plan doesn't have are left out.
    scene
        Bodies of your own (`debrisgrasp.sim.scene_of`); None: that of tier and seed.

    Returns
    -------
    list of Trial
        One for each grasp; one without a grasp if the plan is empty.

    Raises
    ------
    ConfigError
        If a rank is negative; else see `run_trial`.
    """
    for rank in ranks:
        require_range("rank", rank, 0)
    pipeline = pipeline or pipeline_of(spec)
    scene = scene or tier_scene(spec.tier, spec.seed, spec.scene)
    start = time.thread_time()
    planned = pipeline.plan(capture_of(scene), seed=spec.seed)
    plan_seconds = time.thread_time() - start
    plan = planned.plan
    intended = intended_of(scene, planned, plan.object_label)
    if not plan.grasps:
        record = TrialRecord(
            **_facts(scene, intended, None),
            outcome=NO_GRASP,
            why_empty=plan.why_empty or "",
            plan_seconds=plan_seconds,
        )
        return [
            Trial(scene=scene, planned=planned, grasp=None, flight=None, record=record)
        ]
    done = []
    for rank in [rank for rank in ranks if rank < len(plan.grasps)]:
        grasp = plan.grasps[rank]
        start = time.thread_time()
        flight = fly(
            scene.world,
            pipeline.grippers[grasp.gripper],
            grasp,
            intended=intended,
            config=_flight_config(spec, grasp, _wrist(grasp, pipeline.arms)),
        )
        record = TrialRecord(
            **_facts(scene, intended, flight),
            **_merits(grasp),
            outcome=flight.verdict.value,
            rank=rank,
            n_grasps=len(plan.grasps),
            lever=_lever(scene, grasp, flight.held or intended),
            plan_seconds=plan_seconds,
            flight_seconds=time.thread_time() - start,
        )
        done.append(
            Trial(
                scene=scene, planned=planned, grasp=grasp, flight=flight, record=record
            )
        )
    return done


def _wrist(grasp: Grasp, arms: Sequence[Arm]) -> WristConfig:
    """Wrist that bears what the arm of a grasp does; as it comes if it has none."""
    limits = [arm.wrench_limits for arm in arms if arm.name == grasp.arm]
    return WristConfig(limits=limits[0]) if limits else WristConfig()


def _flight_config(spec: TrialSpec, grasp: Grasp, wrist: WristConfig) -> FlightConfig:
    back = np.array(FlightConfig().pull)
    if grasp.retreat is not None and np.hypot(*grasp.retreat.direction[:2]) > _LEVEL:
        back = np.array([*grasp.retreat.direction[:2], 0.0])
    x, y, z = (spec.clear * back / np.linalg.norm(back)).tolist()
    config = FlightConfig(wrist=wrist, lift=(0.0, 0.0, spec.lift), pull=(x, y, z))
    if spec.is_lift_reactive:
        config = replace(config, compliance=YIELD)
    if spec.pull == "retreat" and grasp.retreat is not None:
        x, y, z = (spec.lift * part for part in grasp.retreat.direction)
        config = replace(config, lift=(x, y, z))
    return config


def capture_of(scene: TierScene) -> Capture:
    """Return what a planner gets of a scene: depth, and the pose that it believes."""
    return Capture(
        depth=scene.depth,
        intrinsics=scene.intrinsics,
        T_base_camera=scene.T_base_camera_believed,
        mask=scene.mask,
        name=f"{scene.tier}_{scene.seed}",
    )


def intended_of(scene: TierScene, planned: PlanningResult, label: int) -> str | None:
    """Name of the body that most pixels of a segment show; None if it is the ground."""
    if scene.target is not None:
        return scene.target
    shown = planned.cloud.pixels
    if shown is None or not label:
        return None
    truth = scene.labels.ravel()[shown[planned.segmentation.labels == label]]
    counts = np.bincount(truth[truth >= 0], minlength=1)
    body = int(counts.argmax())
    return scene.world.names[body - 1] if body else None


def _facts(
    scene: TierScene, intended: str | None, flight: Flight | None
) -> dict[str, Any]:
    """Collect what is known without a grasp."""
    held = None if flight is None else flight.held
    name = held or intended
    body = None if name is None else scene.world.bodies[scene.world.index(name)]
    facts: dict[str, Any] = {
        "tier": scene.tier,
        "seed": scene.seed,
        "kind": "" if body is None else body.kind,
        "mass": 0.0 if body is None else body.mass,
        "n_bodies": len(scene.world.bodies),
        "is_as_intended": held is None or held == intended,
    }
    if flight is not None:
        for field in (
            "rise", "pulled", "turn", "slide", "short_of_goal", "shift_before",
            "peak_force", "peak_torque", "deepest", "is_through", "moved_others",
        ):  # fmt: skip
            facts[field] = getattr(flight, field)
    return facts


def _merits(grasp: Grasp) -> Mapping[str, Any]:
    """Collect what the planner says of a grasp."""
    names = (
        "prototype", "gripper", "preshape", "score", "Q", "S", "C", "expected",
        "coverage", "support", "opening", "width",
    )  # fmt: skip
    merits: dict[str, Any] = {name: getattr(grasp, name) for name in names}
    merits["arm"] = grasp.arm or ""
    if grasp.load is not None:
        merits["load_margin"] = grasp.load.margin
    if grasp.retreat is not None:
        merits["lift_overlap"] = grasp.retreat.lift_overlap
    if grasp.success is not None:
        merits["probability"] = grasp.success.probability
        merits["terms"] = grasp.success.terms
    merits["steepness"] = float(-grasp.T_base_hand.R[2, 2])
    return merits


def _lever(scene: TierScene, grasp: Grasp, name: str | None) -> float:
    if name is None:
        return 0.0
    body = scene.world.bodies[scene.world.index(name)]
    center: FloatArray = body.T_base_body.apply(body.center_of_mass)
    return float(np.linalg.norm((center - grasp.T_base_hand.p)[:2]))
