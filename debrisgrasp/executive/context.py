"""What a run knows while it goes on: devices, what was seen, what is held."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, Rng
from debrisgrasp.calibration import DriftMonitor
from debrisgrasp.control import Body, GripController, GripState
from debrisgrasp.errors import DriverError
from debrisgrasp.geometry import SE3, DepthSight
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.robot import Arm, Base, DepthFrame, Head, Robot
from debrisgrasp.robot.kinds import odd_image

from .limb_state import LimbState
from .marks import Marks
from .obstacle_memory import ObstacleMemory
from .result import FaultFound, FaultRaised
from .settings import TaskSettings
from .states import State

if TYPE_CHECKING:
    from debrisgrasp.io import Capture
    from debrisgrasp.pipeline import GraspMotion, Perception, Pipeline, PlanningResult

    from .triage import Triage

__all__ = ["Context", "Cycle", "Held", "Recorder"]


class Recorder(Protocol):
    """Takes down what happens."""

    def write(self, kind: str, facts: Mapping[str, object]) -> None:
        """Add one line."""
        ...

    def keep(self, capture: Capture, name: str) -> None:
        """Store a capture."""
        ...


@dataclass(eq=False, kw_only=True)
class Held:
    """What a hand holds, or is about to."""

    arm: str
    grip: GripController
    """Ticked at every period, while the arm stands."""
    watch: GripController
    """The same, ticked every `TaskSettings.finger_ticks`, while it moves."""
    state: GripState
    begun: FloatArray | None = None
    """Where the hand was when it began to lift, base frame [m], shape (3,)."""
    is_lifted: bool = False
    is_watched: bool = True
    """Whether a loss counts as a fault; not while it is put down."""
    payload: Body = field(default_factory=Body)
    points_hand: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    """Surface of the object, in the frame of the palm [m], shape (2 n, 3): what was
    seen of it, and then its underside."""


@dataclass(eq=False, kw_only=True)
class Cycle:
    """One try at one object."""

    number: int
    reached: list[State] = field(default_factory=list)
    capture: Capture | None = None
    seen: Perception | None = None
    gaze: FloatArray | None = None
    """Looked at instead of the pile, frame of the way [m], shape (3,)."""
    label: int | None = None
    look: int | None = None
    """In which the object has that label, see `Context.n_looks`."""
    triage: Triage | None = None
    plan: PlanningResult | None = None
    motion: GraspMotion | None = None
    around: FloatArray | None = None
    """All but the object, as it was seen when that had been lifted, or when the hand
    had touched something, base frame [m], shape (n, 3); None: nobody looked."""
    is_removed: bool = False
    pushed: float = 0.0
    """How far the object was pushed aside [m]."""
    is_marked: bool = False
    """Whether it has been counted as a try in vain."""
    speed: float = 1.0
    """Share of the usual speed; lower after something swung."""
    hung: FloatArray | None = None
    """Posture (d,) in which the object was lifted, before it was carried away."""
    place: FloatArray | None = None
    """Where the object was let go, base frame [m], shape (3,)."""
    peak_force: float = 0.0
    peak_torque: float = 0.0
    centroid: tuple[float, float, float] | None = None

    @property
    def is_own(self) -> BoolArray | None:
        """Which points of the look are lifted with the chosen object, shape (n,).

        Of an object that is marked, or gripped in a region, more than that is lifted.
        """
        if self.plan is not None:
            return self.plan.is_own
        if self.seen is None or self.label is None:
            return None
        is_own: BoolArray = self.seen.segmentation.labels == self.label
        return is_own


@dataclass(eq=False, kw_only=True)
class Context:
    """Everything that passes from step to step of one run."""

    robot: Robot
    model: RobotModel
    settings: TaskSettings
    pipeline: Pipeline
    record: Recorder
    rng: Rng
    limbs: Mapping[str, LimbState]
    begun: float | None = None
    """When the run began, by the robot's clock [s]; None: it has not."""
    state: State = State.SELF_TEST
    cycle: Cycle = field(default_factory=lambda: Cycle(number=1))
    held: Held | None = None
    released: Held | None = None
    """What was let go last, until that is verified."""
    is_in_pile: str | None = None
    """Arm whose hand is at, or in front of, an object; None: all hands are away."""
    is_closed: bool = False
    """Whether its fingers were sent to close."""
    marks: Marks = field(default_factory=Marks)
    n_looks: int = 0
    """How many images of the workspace were taken; labels of objects go by them."""
    shown: list[DepthSight] = field(default_factory=list)
    """Captures from which it is to be seen that the way is clear."""
    n_removed: int = 0
    n_moves: int = 0
    """How often the base drove to where the arms reach better."""
    n_pushes: int = 0
    """How often it was tried to push something aside ..."""
    n_pushed: int = 0
    """... and how often that came."""
    missing: float = 1.0
    """Share of the workspace in no picture when the base last drove back to see it."""
    in_vain: list[tuple[int, float]] = field(default_factory=list)
    """How many objects were removed, and how far ahead the base stood [m], whenever no
    other could be got."""
    T_base_way: SE3 = field(default_factory=SE3.identity)
    """Where the base stood when the task began: in that frame the workspace is."""
    last_seen: Perception | None = None
    """The last look, until the base moves; a new cycle has none of its own at first."""
    memory: ObstacleMemory = field(default_factory=ObstacleMemory)
    dragged: SE3 | None = None
    """How far the base has moved with an object, ``T_before_now``; None: not at all, or
    it is back."""
    camera_watch: DriftMonitor | None = None
    """Looks at the hand so far; None: none yet."""
    trace: list[tuple[float, float, float]] = field(default_factory=list)
    """Since the state began, of every `TaskSettings.finger_ticks` the time of the first
    [s], and the largest force and torque at the hand [N, N m]."""
    left: dict[str, str] = field(default_factory=dict)
    """Objects that stay, and why, by the last look."""

    @property
    def n_changes(self) -> int:
        """How often something changed that may let a try succeed that failed."""
        return self.n_removed + self.n_moves + self.n_pushed

    @contextmanager
    def fingers_as_they_are(self) -> Iterator[None]:
        """Squeeze and watch nothing for a while, whatever is held."""
        held, self.held = self.held, None
        try:
            yield
        finally:
            self.held = held

    def is_in_way(self, points: FloatArray, beside: float = 0.0) -> BoolArray:
        """Which points (..., 3), base frame [m], lie in the workspace.

        Parameters
        ----------
        beside
            So far beside it counts, too [m].
        """
        T_way_base = self.T_base_way.inverse()
        return self.settings.bounds.grown(beside).contains(T_way_base.apply(points))

    def count_removal(self) -> None:
        """Count the object of this cycle, which lies at the drop-off, once."""
        self.n_removed += not self.cycle.is_removed
        self.cycle.is_removed = True

    def stands_elsewhere(self, T_now_before: SE3) -> None:
        """Take note that the base moved: all that is known was seen from elsewhere."""
        self.T_base_way = T_now_before @ self.T_base_way
        if self.dragged is not None:
            self.dragged = self.dragged @ T_now_before.inverse()
        self.memory.moved(T_now_before)
        self.marks.moved(T_now_before)
        cycle = self.cycle
        if cycle.centroid is not None:
            x, y, z = T_now_before.apply(np.array(cycle.centroid)).tolist()
            cycle.centroid = x, y, z
        if cycle.place is not None:
            cycle.place = T_now_before.apply(cycle.place)
        cycle.hung = None
        for limb in self.limbs.values():
            limb.trail.clear()  # it leads through other places
        self.forget()

    def forget(self) -> None:
        """Forget what was seen: it was seen from elsewhere."""
        self.cycle.seen = self.cycle.around = self.cycle.gaze = self.last_seen = None

    @property
    def base(self) -> Base | None:
        """What drives; None: the robot stands fast."""
        return self.robot.base if self.model.drives else None

    def sure_since(self, limb: LimbState) -> float:
        """Tell when the zero of an arm's sensor was known, by the robot's clock [s].

        Before the first baseline it is what it was when the run began, whatever the
        clock said then.
        """
        return limb.baseline_time or self.begun or 0.0

    def now(self) -> float:
        """Time by the robot's clock [s]."""
        return self.robot.clock.now()

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        clock = self.robot.clock
        clock.wait_until(clock.now() + seconds)

    def frame(self) -> DepthFrame:
        """Take an image; `DriverError` if the camera sends none."""
        frame = self.robot.camera.capture()
        if odd := odd_image(frame):
            raise DriverError("camera", odd)
        return frame

    def joint_values(self) -> dict[str, float]:
        """Measured joints of all arms and the head, by name [rad or m].

        Also of arms that the task does not use: the camera sees them, too.
        """
        devices: list[Arm | Head] = [limb.arm for limb in self.robot.limbs.values()]
        if self.robot.head is not None:
            devices.append(self.robot.head)
        values: dict[str, float] = {}
        for device in devices:
            q = np.asarray(device.read().q, dtype=np.float64).tolist()
            values.update(zip(device.joint_names, q, strict=True))
        return values

    def posture(self, limb: LimbState) -> FloatArray:
        """Measured joints of one arm, shape (d,).

        Raises
        ------
        FaultRaised
            If they are no numbers: nothing is known then of where the arm is.
        """
        q = np.asarray(limb.limb.arm.read().q, dtype=np.float64)
        if not np.isfinite(q).all():
            words = f"joints read {q.tolist()}"
            raise FaultRaised(FaultFound("encoder_jump", words, limb.name))
        return q
