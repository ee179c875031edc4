"""The whole chain from a capture to a ranked plan, loaded once and used many times."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np

from debrisgrasp._arrays import Rng
from debrisgrasp._checked import checked
from debrisgrasp._stopwatch import Progress, Stopwatch
from debrisgrasp._words import counted
from debrisgrasp.geometry import Bounds
from debrisgrasp.io import Capture
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.planning import (
    Advice,
    Grasp,
    GraspPlan,
    GraspPlanner,
    PassedOver,
    SearchResult,
)
from debrisgrasp.prototypes import GripperModel, PrototypeLibrary
from debrisgrasp.segmentation import Segmentation, SelectionPolicy, SupportAware
from debrisgrasp.settings import Settings

from .advice import advice_on
from .config import PipelineConfig
from .inputs import (
    arms_of,
    hands_of,
    library_of,
    liftable,
    require_generic,
    require_limits,
    robot_of,
    with_hands,
)
from .notes import deadline_notes, mass_notes, pipeline_notes, warning_notes
from .perception import Perception
from .reasons import unfit, why_empty
from .result import PlanningResult
from .retreat import Retreats
from .second_look import BestSoFar
from .targets import Target, choose_targets

__all__ = ["Pipeline", "Progress"]


class Pipeline:
    """Plans with one robot and one dictionary, capture after capture.

    Parameters
    ----------
    robot
        Name of a shipped robot, the path of a robot's YAML file, a robot already
        loaded, or ``"none"`` to plan for a floating hand (R = 1).
    arm
        Use only this arm; all of the robot's arms by default.
    gripper
        Use only this hand; every hand that an arm carries by default.
    prototypes
        Folder of prototype files, or a dictionary already loaded, with its hands; the
        shipped one by default.
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
        If a file is malformed; a `ChoiceError` if no prototype fits the chosen hands.
    """

    @checked
    def __init__(
        self,
        *,
        robot: str | os.PathLike[str] | RobotModel = "roman",
        arm: str | None = None,
        gripper: str | None = None,
        prototypes: str | os.PathLike[str] | PrototypeLibrary | None = None,
        grippers: str | os.PathLike[str] | None = None,
        policy: SelectionPolicy | None = None,
        config: PipelineConfig | None = None,
    ) -> None:
        self.config = config or PipelineConfig()
        known, model = hands_of(grippers, prototypes), robot_of(robot)
        self.robot = None if model is None else with_hands(model, known)
        self.arms = arms_of(self.robot, arm, gripper)
        library = library_of(self.arms, gripper, prototypes=prototypes, known=known)
        self.library, self.grippers = library, library.grippers
        self.policy: SelectionPolicy = policy or SupportAware(openings=self._openings())
        # Without generic ones, plans need a mark, for which there is another planner.
        generic = library.select(kind="generic") or library
        self._generic = GraspPlanner(generic, self.config.planner)
        self._retreats = Retreats()

    @classmethod
    @checked
    def from_settings(
        cls, settings: Settings, config: PipelineConfig | None = None
    ) -> Pipeline:
        """Make the pipeline of a site; the robot keeps the limits of the site.

        Raises
        ------
        UnknownNameError, ConfigError
            As the constructor does.
        """
        robot = settings.robot_model()
        with settings.named():
            pipeline = cls(
                robot="none" if robot is None else robot,
                arm=settings.arm,
                gripper=settings.gripper,
                prototypes=settings.prototypes,
                grippers=settings.grippers,
                config=(config or PipelineConfig()).at(settings),
            )
        pipeline.policy = settings.selection(pipeline._openings())
        return pipeline

    def __repr__(self) -> str:
        robot = "a floating hand" if self.robot is None else self.robot.name
        arms = ", ".join(arm.name for arm in self.arms)
        hands = ", ".join(hand.name for hand in self._used_hands())
        words = f"{robot}, arms {arms}" if arms else robot
        return f"<Pipeline for {words}; hands {hands}; {len(self.library)} prototypes>"

    def _openings(self) -> tuple[float, ...]:
        """Widest opening of each hand in use [m]."""
        return tuple(hand.opening_range[1] for hand in self._used_hands())

    def _used_hands(self) -> list[GripperModel]:
        """Hands that prototypes are for."""
        used = {prototype.gripper for prototype in self.library}
        return [self.grippers[name] for name in sorted(used)]

    def standing(self, joints: Mapping[str, float]) -> Pipeline:
        """Return the same with arms that idle where some of their joints are now.

        For an arm that is not used, and that can't go where the robot's file has it
        idle. See `RobotModel.standing`; plans for a floating hand have no arms.
        """
        if self.robot is None:
            return self
        pipeline = copy(self)
        pipeline.robot = robot = self.robot.standing(joints)
        pipeline.arms = tuple(replace(arm, robot=robot) for arm in self.arms)
        return pipeline

    @checked
    def perceive(
        self,
        capture: Capture,
        *,
        segmentation: Segmentation | None = None,
        progress: Progress | None = None,
    ) -> Perception:
        """Look at a capture, so that several plans share what is seen.

        Parameters
        ----------
        segmentation
            What its objects are, for instance by `segmentation_of_labels`; by default
            they are found as the settings say.

        Raises
        ------
        CaptureError
            If the capture has no pose.
        ShapeError
            If the segmentation is of another number of points.
        """
        return self._perceive(capture, Stopwatch(None, progress), segmentation)

    def _perceive(
        self,
        capture: Capture | Perception,
        watch: Stopwatch,
        given: Segmentation | None = None,
    ) -> Perception:
        config, scene = self.config, self.config.planner.scene
        if isinstance(capture, Perception):
            return capture.with_scenes(scene)
        return Perception.of(
            capture, config.segmentation, scene, watch, config.workers, given
        )

    @checked
    def plan(
        self,
        capture: Capture | Perception,
        *,
        region: Bounds | None = None,
        object_label: int | None = None,
        seed: int = 0,
        deadline: float | None = None,
        mass: float | None = None,
        advise: bool = False,
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
            Seconds after which the search settles for what it has, and there is no
            more advice. Objects are tried until one offers a grasp all the same, each
            with the shortest search.
        mass
            What the first object that is tried weighs [kg]. Of others, and by default,
            bounds are estimated from what was seen of them; a note of the plan tells if
            another one was chosen.
        advise
            Whether to work out advice where there are grasps, too; empty plans have it.
        progress
            Called as the work goes on.

        Raises
        ------
        CaptureError
            If the capture has no pose, or the region or mask holds no measured point.
        UnknownNameError
            If ``object_label`` is not a label of the segmentation.
        ConfigError
            If the seed is negative, or deadline or mass are not above zero; a
            `ChoiceError` if all prototypes are object-specific, and nothing is marked.
        """
        require_limits(seed, deadline, mass)
        watch = Stopwatch(deadline, progress)
        seen = self._perceive(capture, watch)
        with watch.stage("selection"):
            order = seen.order(self.policy)
            targets = choose_targets(
                seen.cloud,
                seen.segmentation,
                order,
                region=region,
                object_label=object_label,
                is_marked=seen.is_marked,
                margin=self.config.region_margin,
            )
        is_specific = region is not None or seen.is_marked is not None
        if not is_specific:
            require_generic(self.library)
        planner = self._specific if is_specific else self._generic
        best = self._first_success(planner, seen, targets, seed, watch, mass)
        result, target = best.result, best.target
        notes = deadline_notes(deadline, is_cut=watch.has_cut)
        notes += mass_notes(mass, best, liftable(self.arms, self.config.planner.load))
        notes += seen.notes(target if is_specific else None)
        notes += warning_notes(order, best)
        notes += pipeline_notes(self.arms, planner.prototypes, self.config.planner)
        grasps: tuple[Grasp, ...] = ()
        advice: tuple[Advice, ...] = ()
        if target is not None:
            grasps = self._grasps(planner, seen, result, target, watch)
            if (advise or not grasps) and not watch.is_late():
                with watch.stage("advice"):
                    asked = result, planner, seen, target, self.arms
                    rng = np.random.default_rng([seed, 1])
                    advice = advice_on(*asked, rng=rng, is_late=watch.is_late)
        passed_over, least = tuple(best.passed_over), self.config.min_object_points
        plan = GraspPlan(
            grasps=grasps,
            object_label=0 if target is None else target.label,
            region=None if target is None else target.region,
            robot="none" if self.robot is None else self.robot.name,
            seed=seed,
            notes=notes,
            rejections=result.rejections,
            ruled_out=result.ruled_out,
            passed_over=passed_over,
            effective_samples=result.effective_samples,
            why_empty=None
            if grasps
            else why_empty(seen.segmentation, passed_over, least, self._used_hands()),
            advice=advice,
            seconds=dict(watch.seconds),
        )
        return PlanningResult(
            plan=plan,
            capture=seen.capture,
            cloud=seen.cloud,
            segmentation=seen.segmentation,
            is_own=seen.lifted_with(target),
            order=order,
            robot=self.robot,
            grippers=self.grippers,
            dictionary=planner.prototypes,
        )

    @cached_property
    def _specific(self) -> GraspPlanner:
        """Planner for a marked object or a region: with object-specific prototypes."""
        return GraspPlanner(self.library, self.config.planner)

    def _grasps(
        self,
        planner: GraspPlanner,
        seen: Perception,
        result: SearchResult,
        target: Target,
        watch: Stopwatch,
    ) -> tuple[Grasp, ...]:
        """Grasps of a search, with their retreats and the object's label."""
        with watch.stage("retreat"):
            found = self._retreats.added(result.grasps, planner, seen.scene(target))
        return tuple(replace(grasp, object_label=target.label) for grasp in found)

    def _first_success(
        self,
        planner: GraspPlanner,
        seen: Perception,
        targets: Iterable[Target],
        seed: int,
        watch: Stopwatch,
        mass: float | None,
    ) -> BestSoFar:
        """Try the targets in turn until one offers a grasp that is not doubtful."""
        best, n_tried = BestSoFar(self.config.doubtful, self.config.max_further), 0
        root = np.random.default_rng(seed)

        def first_look(target: Target, beyond: float, rng: Rng) -> SearchResult:
            with watch.stage("scene"):
                scene, obstacles = seen.scene(target), seen.obstacles
            return planner.first_look(
                scene,
                self.arms,
                obstacles,
                rng=rng,
                watch=watch,
                # Others weigh something else.
                mass=mass if best.first_tried is None else None,
                beyond=beyond,
            )

        def search_on() -> None:
            while best.promises_more and not watch.is_late():
                best.search_on()

        for target in targets:
            (rng,) = root.spawn(1)
            is_enough = n_tried == self.config.max_objects
            is_passed = not best.is_found and not best.is_worth_a_look(target)
            if best.has_looked or is_enough or is_passed:
                search_on()
            if best.is_found and (best.has_looked or is_enough or watch.is_late()):
                break
            if not best.is_worth_a_look(target):
                continue
            left = self._unfit(seen, target)
            if left is None and is_enough:
                limit = f"the limit of {counted(n_tried, 'object')}"
                left = PassedOver(target.label, f"not tried: {limit} was reached")
            if left is not None:
                best.pass_over(left)
                continue
            n_tried += 1
            best.take(first_look(target, best.worth_beating(target), rng), target)
        search_on()
        if not best.is_found:
            best.hope_for_anything()
            search_on()
        return best

    def _unfit(self, seen: Perception, target: Target) -> PassedOver | None:
        """Why an object isn't worth a search, or None if it is."""
        if not target.label:
            return None
        points = seen.cloud.points.take(np.flatnonzero(target.is_object), axis=0)
        chains = [arm.chain for arm in self.arms]
        report, label = seen.segmentation.ground, target.label
        return unfit(label, points, target.region, report, self.config, chains)
