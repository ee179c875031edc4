"""The whole chain from a capture to a ranked plan, loaded once and used many times."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from debrisgrasp._reasons import is_ground, too_large, too_small, why_empty
from debrisgrasp._stopwatch import Progress, Stopwatch
from debrisgrasp._targets import Target, choose_targets
from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.geometry import (
    Bounds,
    PointCloud,
)
from debrisgrasp.io import Capture
from debrisgrasp.io.plan_json import save_plan
from debrisgrasp.kinematics import ArmReach, RobotModel
from debrisgrasp.perception import Perception
from debrisgrasp.planning import (
    GraspPlan,
    GraspPlanner,
    PassedOver,
    PlannerConfig,
    SearchResult,
)
from debrisgrasp.prototypes import GripperModel, PrototypeLibrary, load_grippers
from debrisgrasp.segmentation import (
    Candidate,
    GroundReport,
    Segmentation,
    SegmentationConfig,
    SelectionPolicy,
    SupportAware,
)

__all__ = ["Perception", "Pipeline", "PipelineConfig", "PlanningResult", "Progress"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PipelineConfig:
    """Settings of the whole chain; each stage has its own."""

    segmentation: SegmentationConfig = SegmentationConfig()
    planner: PlannerConfig = PlannerConfig()
    region_margin: float = 0.05
    """How far the region V reaches beyond the visible points of the object [m]."""
    max_objects: int = 5
    """How many objects to try before giving up."""
    min_object_points: int = 80
    """Fewer thinned points (one per cell of the planner's grid) than this are a crumb
    of segmentation, not an object to grip."""

    def __post_init__(self) -> None:
        if self.max_objects < 1 or self.region_margin < 0:
            raise ConfigError(
                "max_objects, region_margin",
                got=(self.max_objects, self.region_margin),
                expected="at least 1, and 0 m or more",
            )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PlanningResult:
    """A plan together with all that led to it."""

    plan: GraspPlan
    capture: Capture
    cloud: PointCloud
    segmentation: Segmentation
    order: tuple[Candidate, ...]
    robot: RobotModel | None
    grippers: Mapping[str, GripperModel]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the grasps as JSON (docs/formats.md)."""
        save_plan(self.plan, path)


class Pipeline:
    """Plans with one robot and one dictionary, capture after capture.

    Parameters
    ----------
    robot
        Name of a shipped robot, the path of a robot's YAML file, or ``"none"`` to plan
        for a floating hand (R = 1).
    arm
        Use only this arm; all of the robot's arms by default.
    gripper
        Use only this hand; every hand that an arm carries by default.
    prototypes
        Folder of prototype files; the shipped dictionary by default.
    grippers
        Folder of files of further hands; only the shipped hands by default.
    policy
        In which order to take the objects; `SupportAware` by default, `PriorityPoint`
        for the paper's (Eq. 1).
    config
        Settings of the stages.

    Raises
    ------
    UnknownNameError
        If the robot, arm or gripper is not known; the known ones are listed.
    ConfigError
        If a file is malformed, or no prototype fits the chosen hands.
    """

    def __init__(
        self,
        *,
        robot: str = "roman",
        arm: str | None = None,
        gripper: str | None = None,
        prototypes: str | os.PathLike[str] | None = None,
        grippers: str | os.PathLike[str] | None = None,
        policy: SelectionPolicy | None = None,
        config: PipelineConfig | None = None,
    ) -> None:
        self.config = config or PipelineConfig()
        if not isinstance(robot, str):
            raise ConfigError(
                "robot",
                got=repr(robot),
                expected="the name of a robot, the path of its file, or 'none'",
            )
        self.robot = None if robot == "none" else RobotModel.load(robot)
        self.arms = _arms(self.robot, arm, gripper)
        library = PrototypeLibrary.load(
            prototypes, grippers=load_grippers(grippers)
        ).select(gripper=gripper)
        if self.arms:
            hands = {a.gripper for a in self.arms}
            library = library.select(
                names=[p.name for p in library if p.gripper in hands]
            )
        generic = library.select(kind="generic")
        if not len(generic):
            raise ConfigError(
                "prototypes",
                got="no generic one for a hand that is in use",
                expected="at least one",
                mend="`debrisgrasp prototype list` shows which hand each is for.",
            )
        self.grippers: Mapping[str, GripperModel] = library.grippers
        openings = tuple(hand.opening_range[1] for hand in self.grippers.values())
        self.policy = policy or SupportAware(openings=openings)
        self._generic = GraspPlanner(generic, self.config.planner)
        self._library = library

    def perceive(
        self, capture: Capture, *, progress: Progress | None = None
    ) -> Perception:
        """Look at a capture, so that several plans share what is seen.

        Raises
        ------
        CaptureError
            If the capture has no pose.
        """
        return self._perceive(capture, Stopwatch(None, progress or _in_silence))

    def _perceive(self, capture: Capture, watch: Stopwatch) -> Perception:
        config = self.config
        return Perception.of(capture, config.segmentation, config.planner.scene, watch)

    def plan(
        self,
        capture: Capture | Perception,
        *,
        region: Bounds | None = None,
        object_label: int | None = None,
        seed: int = 0,
        deadline: float | None = None,
        progress: Progress | None = None,
    ) -> PlanningResult:
        """Plan grasps on the first object of the order that offers one.

        Parameters
        ----------
        capture
            One depth image or cloud with its pose in the base frame, or what `perceive`
            made of it.
        region
            Seek grasps only inside this box (base frame), on whatever object is there.
        object_label
            Seek grasps only on this object of the segmentation.
        seed
            The same seed gives the same plan.
        deadline
            Seconds after which the search settles for what it has.
        progress
            Called as the work goes on.

        Raises
        ------
        CaptureError
            If the capture has no pose, or the region or mask holds no measured point.
        UnknownNameError
            If ``object_label`` is not a label of the segmentation.
        ConfigError
            If the seed is negative, or the deadline is not a positive time.
        """
        _require_limits(seed, deadline)
        watch = Stopwatch(deadline, progress or _in_silence)
        seen = capture
        if not isinstance(seen, Perception):
            seen = self._perceive(seen, watch)
        cloud, segmentation = seen.cloud, seen.segmentation
        with watch.stage("selection"):
            order = seen.order(self.policy)
            targets = choose_targets(
                cloud,
                segmentation,
                order,
                region=region,
                object_label=object_label,
                is_marked=seen.is_marked,
                margin=self.config.region_margin,
            )
        result, target, passed_over = self._first_success(seen, targets, seed, watch)
        label = 0 if target is None else target.label
        found = () if result is None else result.grasps
        grasps = tuple(replace(grasp, object_label=label) for grasp in found)
        plan = GraspPlan(
            grasps=grasps,
            object_label=label,
            region=None if target is None else target.region,
            robot="none" if self.robot is None else self.robot.name,
            seed=seed,
            rejections={} if result is None else result.rejections,
            passed_over=tuple(passed_over),
            effective_samples=0.0 if result is None else result.effective_samples,
            why_empty=None if grasps else why_empty(segmentation, passed_over),
            seconds=dict(watch.seconds),
        )
        return PlanningResult(
            plan=plan,
            capture=seen.capture,
            cloud=cloud,
            segmentation=segmentation,
            order=order,
            robot=self.robot,
            grippers=self.grippers,
        )

    @cached_property
    def _specific(self) -> GraspPlanner:
        """Planner for where a mask marks an object: with object-specific prototypes."""
        return GraspPlanner(self._library, self.config.planner)

    def _first_success(
        self,
        seen: Perception,
        targets: Sequence[Target],
        seed: int,
        watch: Stopwatch,
    ) -> tuple[SearchResult | None, Target | None, list[PassedOver]]:
        """Try the targets in turn until one offers a grasp."""
        planner = self._generic if seen.is_marked is None else self._specific
        passed_over: list[PassedOver] = []
        rngs = np.random.default_rng(seed).spawn(max(1, len(targets)))
        tried: tuple[SearchResult, Target] | None = None
        n_tried = 0
        for target, rng in zip(targets, rngs, strict=False):
            reason = self._unfit(seen.cloud, target, seen.segmentation.ground)
            if reason is None and n_tried == self.config.max_objects:
                reason = f"not tried: the limit of {n_tried} objects was reached"
            if reason is None and n_tried and watch.is_late():
                reason = "not tried: the deadline had passed"
            if reason is not None:
                passed_over.append(PassedOver(target.label, reason))
                continue
            n_tried += 1
            with watch.stage("scene"):
                scene, obstacles = seen.scene(target), seen.obstacles
            result = planner.plan(scene, self.arms, obstacles, rng=rng, watch=watch)
            if result.grasps:
                return result, target, passed_over
            tried = tried or (result, target)
            passed_over.append(PassedOver(target.label, result.why_empty() or ""))
        return (*tried, passed_over) if tried else (None, None, passed_over)

    def _unfit(
        self, cloud: PointCloud, target: Target, ground: GroundReport
    ) -> str | None:
        """Why an object isn't worth a search, or None if it is."""
        if not target.label:
            return None
        config, points = self.config, cloud.points[target.is_object]
        scene, least = config.planner.scene, config.min_object_points
        return (
            too_small(points, scene.spacing, least)
            or too_large(target.region, scene)
            or is_ground(points, ground, config.segmentation.ground)
        )


def _require_limits(seed: int, deadline: float | None) -> None:
    """Raise unless seed and deadline mean something."""
    if seed < 0:
        raise ConfigError("seed", got=seed, expected="an integer of 0 or more")
    if deadline is not None and not deadline > 0:
        raise ConfigError(
            "deadline",
            got=f"{deadline} s",
            expected="a positive number of seconds, or none",
        )


def _arms(
    robot: RobotModel | None, arm: str | None, gripper: str | None
) -> tuple[ArmReach, ...]:
    """Arms of the robot that are in use."""
    if robot is None:
        if arm is not None:
            raise ConfigError(
                "arm",
                got=repr(arm),
                expected="no arm, because the robot is 'none'",
                mend="Name a robot, or choose the hand by its gripper.",
            )
        return ()
    if arm is not None and arm not in robot.arms:
        raise UnknownNameError("arm", arm, robot.arms)
    carried = {name: spec.gripper for name, spec in robot.arms.items()}
    if gripper is not None and gripper not in carried.values():
        raise UnknownNameError(
            f"gripper of {robot.name}", gripper, sorted(carried.values())
        )
    if arm is not None and gripper not in (None, carried[arm]):
        raise ConfigError(
            f"gripper of the {arm} arm",
            got=repr(gripper),
            expected=f"{carried[arm]!r}, which it carries",
            mend="Choose the arm or the gripper; one follows from the other.",
        )
    return tuple(
        ArmReach(robot, name)
        for name in carried
        if arm in (None, name) and gripper in (None, carried[name])
    )


def _in_silence(_stage: str, _share: float) -> None:
    """Tell nobody."""
