"""The whole task with the robot in memory: from a few words to a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np

from debrisgrasp._arrays import Rng, require_metres, require_range
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp.errors import ConfigError, InputError, UnknownNameError
from debrisgrasp.geometry import SE3, Bounds
from debrisgrasp.io import Capture
from debrisgrasp.pipeline import Pipeline
from debrisgrasp.prototypes import with_shipped
from debrisgrasp.robot import (
    INJECTABLE,
    FakeConfig,
    FakeTruth,
    InjectedRobot,
    Injection,
    fake_robot,
    inject,
)
from debrisgrasp.settings import Settings
from debrisgrasp.worlds import (
    SCENES,
    PileConfig,
    World,
    come_to_rest,
    generate_pile,
    let_down,
)
from debrisgrasp.worlds import named_scene as scene_named

from .context import Recorder
from .faults import LISTED_BY
from .grasping import require_room
from .limbs import require_drop_off, require_own_sides
from .marking import StaysMarked
from .outcome import RunResult
from .run import Executive, Observer
from .settings import TaskSettings
from .states import State, state_named

__all__ = ["Simulated", "SimulatedTask", "injections_of", "simulate"]

_CENTER = (0.98, 0.0)
"""Middle of a pile that both arms reach [m]."""
_OF_THE_RECORD = {"schema", "version", "contents"}
"""Among the inputs of a run, beside those of the task."""
_NEAREST, _HALF_WIDTH = 0.5, 0.45
"""So far ahead of the robot piles begin, as wide as the way it takes [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Simulated:
    """A run, and what was true of it."""

    result: RunResult
    truth: FakeTruth
    happened: tuple[str, ...]
    """Injected faults that were really brought about."""
    is_latched: bool
    """Whether a stop is latched on every arm."""
    missed: tuple[str, ...] = ()
    """Injected faults that were not, each with its state: it never came to that."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedTask:
    """A pile, a robot in memory, and what is to be done: equal tasks, equal runs."""

    scene: str | None = None
    """Name of a scene; None: a pile drawn by the seed."""
    objects: int | None = None
    """Bodies of a drawn pile; None: 3 to 8."""
    seed: int = 0
    site: str | None = None
    """File of settings of a site; its camera is that of captures from files, and not
    the one of the robot in memory."""
    robot: str | None = None
    """None: that of the site, or RoMan."""
    gripper: str | None = None
    """Use only this hand."""
    arms: tuple[str, ...] = ()
    """Use only these arms."""
    mask: str | None = None
    """Object-specific task: file of a capture with a mask of the object."""
    region: tuple[float, ...] | None = None
    """Object-specific task: lower and upper corner of a box, base frame [m]."""
    faults: tuple[str, ...] = ()
    """Faults to inject, each ``name`` or ``name@state``."""
    max_removals: int | None = None
    drive_over: float = 0.10
    """See `TaskSettings` [m]."""
    pushes: int = 20
    """See `TaskSettings`."""

    def __post_init__(self) -> None:
        for name in ("arms", "faults"):
            if not all(isinstance(item, str) for item in getattr(self, name)):
                raise ConfigError(name, got=getattr(self, name), expected="names")
        if self.scene is not None and self.scene not in SCENES:
            raise UnknownNameError("scene", self.scene, SCENES)
        if self.scene is not None and self.objects is not None:
            raise ConfigError(
                "objects", got=self.objects, expected="none, with a named scene"
            )
        if self.objects is not None:
            require_range("objects", self.objects, 1, 50)
        if self.max_removals is not None:
            require_range("max_removals", self.max_removals, 1, 10_000)
        require_range("drive_over [m]", self.drive_over, 0.0, 1.0)
        require_range("pushes", self.pushes, 0, 100)
        if self.seed < 0:
            raise ConfigError("seed", got=self.seed, expected="an integer of 0 or more")
        if self.mask is not None and self.region is not None:
            raise ConfigError("mask", got="a region too", expected="one of them")
        self._bounds()
        injections_of(self.faults)

    def _bounds(self) -> Bounds | None:
        if self.region is None:
            return None
        try:
            box = np.atleast_1d(np.array(self.region, dtype=np.float64))
        except (TypeError, ValueError):
            box = np.zeros(0)
        low, high = box[:3], box[3:]
        if box.shape != (6,) or not (np.isfinite(box).all() and (low < high).all()):
            raise ConfigError(
                "region",
                got=self.region,
                expected="six numbers [m], a lower corner below an upper one",
            )
        require_metres("region", box)
        return Bounds(low, high)

    def to_json(self) -> dict[str, Any]:
        """Content for the record of a run."""
        return asdict(self)

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> SimulatedTask:
        """Read what `to_json` wrote, or raise `ConfigError`."""
        known = {field.name for field in fields(cls)}
        unknown = set(content) - known - _OF_THE_RECORD
        if unknown:
            raise ConfigError(
                "inputs of a run",
                got=", ".join(sorted(unknown)),
                expected=", ".join(sorted(known)),
                mend="Correct the name, or replay with the version that wrote it.",
            )
        given: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value
            for key, value in content.items()
            if key in known
        }
        missing = {"seed", "faults"} - set(given)
        if missing:
            raise ConfigError(
                "inputs of a run",
                got=f"no {', '.join(sorted(missing))}",
                expected="a run of the robot in memory",
            )
        try:
            return cls(**given)
        except InputError as error:
            raise ConfigError.about(f"{error.what} of a task", error) from None

    def world(self) -> World:
        """Bodies at rest."""
        if self.scene is not None:
            return come_to_rest(let_down(scene_named(self.scene)).world).world
        fewest, most = (3, 8) if self.objects is None else (self.objects,) * 2
        config = PileConfig(
            n_bodies=(fewest, most), center=_CENTER, uneven_share=0.0, large_share=0.0
        )
        rng = np.random.default_rng([self.seed, 1])
        # What lay already yields to what came after.
        pile = let_down(generate_pile(rng=rng, config=config)).world
        return _before_the_robot(come_to_rest(pile).world)

    def _site(self) -> Settings:
        site = Settings() if self.site is None else Settings.load(self.site)
        robot, arm = self.robot or site.robot, site.arm
        if robot == "none":
            raise ConfigError(
                "robot",
                got="none",
                expected="a robot with arms",
                mend="Only `plan` plans for a floating hand.",
            )
        if self.robot is not None and self.robot != site.robot:
            # Arms have other names on another robot.
            site, arm = replace(site, drop_off={}), None
        if self.arms:
            arm = self.arms[0] if len(self.arms) == 1 else None
        return replace(site, robot=robot, arm=arm, gripper=self.gripper or site.gripper)

    def pipeline(self) -> Pipeline:
        """Make what the task plans with: robot, hands, limits and policy of the site.

        Raises
        ------
        ConfigError, UnknownNameError
            As `Settings.load` and `Pipeline.from_settings` do.
        """
        return Pipeline.from_settings(self._site())

    @checked
    def settings(self, pipeline: Pipeline) -> TaskSettings:
        """Return what is to be done, by this task and its site.

        Raises
        ------
        ConfigError, UnknownNameError
            If the robot has no such arm or no camera, or a drop-off of the site lies in
            the way or out of reach, or its limits leave no room to feel a touch by;
            its file and field are named.
        CaptureError
            If the file of the mask can't be read, or shows no marked object.
        """
        site, usual = self._site(), TaskSettings()
        workspace = site.workspace or usual.workspace
        known = {} if pipeline.robot is None else pipeline.robot.arms
        for name in self.arms:
            if name not in known:
                raise UnknownNameError("arm", name, known)
        if pipeline.robot is not None:
            pipeline.robot.T_base_camera()
        reaches = {arm.name: arm for arm in pipeline.arms}
        names = self.arms or tuple(reaches)
        for name, place in site.drop_off.items():
            with site.in_field(f"drop_off.{name}"):
                TaskSettings(drop_off={name: place}, workspace=workspace)
                if name in names and name in reaches:
                    require_drop_off(reaches[name], place)
        drop_off = {**usual.drop_off, **site.drop_off}
        with site.in_field("drop_off"):
            used = {name: reaches[name] for name in names if name in reaches}
            require_own_sides(used, drop_off)
        if pipeline.robot is not None:
            for name in used:
                with site.in_limits(pipeline.robot, name):
                    limits = pipeline.robot.limits(name).controller
                    require_room(limits, usual.load_share)
        return TaskSettings(
            arms=names,
            workspace=workspace,
            drop_off=drop_off,
            approach_speed=min(usual.approach_speed, site.limits.hand_speed),
            lift_speed=min(usual.lift_speed, site.limits.hand_speed),
            max_removals=self.max_removals,
            drive_over=self.drive_over,
            pushes=self.pushes,
            mark=None if self.mask is None else StaysMarked.of(Capture.load(self.mask)),
            region=self._bounds(),
        )

    @checked
    def run(
        self,
        record: Recorder | None = None,
        *,
        pipeline: Pipeline | None = None,
        settings: TaskSettings | None = None,
    ) -> Simulated:
        """Run it.

        Parameters
        ----------
        record
            Takes down what happens.
        pipeline
            To plan with; None: that of the site, or the default one for the robot.
        settings
            Of the task; None: the defaults, with what this task and its site say.
        """
        pipeline = pipeline or self.pipeline()
        return simulate(
            self.world(),
            settings or self.settings(pipeline),
            injections_of(self.faults),
            pipeline=pipeline,
            record=record,
            rng=np.random.default_rng(self.seed),
        )


def _before_the_robot(pile: World) -> World:
    """Move a pile ahead until none of it lies where the robot stands."""
    corners = [solid.bounds for body in pile.bodies for solid in body.solids]
    nearest = min(
        (
            float(box.lower[0])
            for box in corners
            if box.lower[1] < _HALF_WIDTH and box.upper[1] > -_HALF_WIDTH
        ),
        default=_NEAREST,
    )
    ahead = SE3.from_parts(p=[max(_NEAREST - nearest, 0.0), 0.0, 0.0])
    bodies = tuple(body.at(ahead @ body.T_base_body) for body in pile.bodies)
    return replace(pile, bodies=bodies)


@checked
def simulate(
    world: World,
    settings: TaskSettings,
    faults: Sequence[Injection] = (),
    *,
    pipeline: Pipeline,
    observers: Sequence[Observer] = (),
    record: Recorder | None = None,
    rng: Rng,
) -> Simulated:
    """Run the task on the robot in memory in a world, with faults injected.

    Parameters
    ----------
    world
        Bodies at rest.
    pipeline
        To plan with; it knows the robot.
    observers
        Hear of every state, before the injected faults do.

    Raises
    ------
    ConfigError
        If the pipeline plans for a floating hand.
    UnknownNameError
        If a fault is to strike at a state, or an arm, that there is not.
    """
    robot_rng, fault_rng, task_rng = rng.spawn(3)
    model = pipeline.robot
    if model is None:
        raise ConfigError("robot of the pipeline", got="none", expected="a robot")
    # Only an injected fault takes the zero of a gripper.
    config = FakeConfig(is_initialised=True)
    grippers = with_shipped(pipeline.grippers)
    fake = fake_robot(model, world, rng=robot_rng, config=config, grippers=grippers)
    states = tuple(state.value for state in State)
    injected = inject(fake.robot, faults, states=states, rng=fault_rng, world=fake)
    executive = Executive(
        injected.robot,
        settings,
        pipeline=pipeline,
        observers=(*observers, _Teller(injected)),
        record=record,
        rng=task_rng,
    )
    result = executive.run()
    is_latched = all(arm.is_stopped for arm in fake.arms.values())
    happened, missed = injected.happened, injected.missed
    return Simulated(result, fake.truth(), happened, is_latched, missed)


class _Teller:
    """Tells the injected faults which state begins."""

    def __init__(self, injected: InjectedRobot) -> None:
        self._injected = injected

    def on_state(self, state: State) -> None:
        """Pass the state on."""
        self._injected.on_state(state.value)


@checked
def injections_of(faults: Sequence[str]) -> tuple[Injection, ...]:
    """Read faults written as ``name`` or ``name@state``.

    Raises
    ------
    UnknownNameError
        If there is no such fault, or no such state.
    """
    found = []
    for text in faults:
        name, at, state = text.strip().partition("@")
        if name not in INJECTABLE:
            raise UnknownNameError("fault", name, INJECTABLE, listed_by=LISTED_BY)
        if at:
            state_named(state)
        found.append(Injection(fault=name, state=state or None))
    return tuple(found)
