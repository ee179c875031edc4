"""What a search returns: grasps, best first, or the reasons why there are none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from debrisgrasp._words import arm_called
from debrisgrasp.geometry import SE3, Bounds

from .advice import Advice
from .ledger import Rejections
from .load_forecast import LoadForecast
from .success import SuccessForecast

__all__ = ["Grasp", "GraspPlan", "PassedOver", "Retreat"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Retreat:
    """How the object comes out of the pile, and how far hand and object are free."""

    direction: tuple[float, float, float]
    """Unit vector in base along which the object meets the fewest neighbours."""
    overlap: float
    """Neighbours that it meets there over 15 cm, as a share of its own size."""
    hand_free: float
    """How far the hand gets along it without touching a neighbour [m]."""
    lift_overlap: float
    """The same as ``overlap`` for the lift straight up."""
    lift_hand_free: float
    """The same as ``hand_free`` for the lift straight up [m]."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Grasp:
    """One way to grip the object, in the base frame."""

    T_base_hand: SE3
    """Palm pose when the fingers close."""
    T_base_pregrasp: SE3
    """Palm pose at which the straight approach starts."""
    gripper: str
    preshape: str
    opening: float
    """Distance between the finger pads during the approach [m]."""
    width: float
    """Distance between the finger pads when closed on the object [m]."""
    prototype: str
    S: float
    """Shape suitability in [0, 1] (Eq. 5)."""
    C: float
    """Freedom from collision in [0, 1]: 1 clear, 0 in collision."""
    R: float
    """Reachability: 1 if the arm takes the pose without collision, else 0."""
    coverage: float
    """Share of the prototype's visible surface that was seen; the rest of S is
    guesswork."""
    support: int
    """How many walkers of the search ended at this grasp: agreement between chains."""
    expected: float
    """Quality expected when the hand ends up a little beside the pose (see
    `PoseUncertainty`), in [0, 1]."""
    score: float
    """The probability that it holds, from ``expected``, the load, the faces at the pads
    and the room around the hand (see `SuccessModel`). The list is sorted by it, but for
    what is overloaded (see `LoadForecast`): that comes last."""
    arm: str | None = None
    joints: Mapping[str, float] | None = None
    """Joint positions [rad or m] that take the pose; None for a floating hand."""
    object_label: int = 0
    """Label of the object in the segmentation."""
    load: LoadForecast | None = None
    """What lifting the object will demand; None in files of earlier versions."""
    retreat: Retreat | None = None
    """Which way to pull; None where that was not asked."""
    success: SuccessForecast | None = None
    """How likely it holds; None in files of earlier versions."""

    def __repr__(self) -> str:
        x, y, z = self.T_base_hand.p.tolist()
        arm = "" if self.arm is None else f", {arm_called(self.arm)}"
        words = (
            f"{self.prototype} by {self.gripper}{arm}, at ({x:.2f}, {y:.2f}, {z:.2f})"
        )
        return f"<Grasp {words}, score {self.score:.2f}>"

    @property
    def Q(self) -> float:
        """Grasp quality Q = S R C (Eq. 2)."""
        return self.S * self.R * self.C

    @property
    def success_probability(self) -> float | None:
        """Probability that it holds, in [0, 1]; None in files of earlier versions."""
        return None if self.success is None else self.success.probability

    @property
    def rank(self) -> float:
        """What grasps are sorted by: the score, but what is overloaded comes last."""
        is_beyond = self.load is not None and self.load.is_overloaded
        return self.score - is_beyond

    @property
    def approach_distance(self) -> float:
        """Length of the straight approach [m]."""
        step = self.T_base_hand.p - self.T_base_pregrasp.p
        return float((step @ step) ** 0.5)


@dataclass(frozen=True, slots=True)
class PassedOver:
    """An object that was tried and left, and why."""

    label: int
    reason: str
    n_cells: int | None = None
    """Cells of surface seen of what is too small; not part of the saved plan."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GraspPlan:
    """Ranked grasps on one object, or why there are none."""

    grasps: tuple[Grasp, ...]
    """Best first; empty when nothing was found."""
    object_label: int
    """The object that the grasps are for; 0 if none was chosen."""
    region: Bounds | None
    """The volume V in which grasps were sought, base frame."""
    robot: str
    """Name of the robot, or ``"none"`` for a floating hand."""
    seed: int
    rejections: Mapping[str, int] = field(default_factory=dict)
    """How many candidate poses each reason ruled out."""
    ruled_out: Rejections = field(default_factory=Rejections)
    """Those poses themselves; not part of the saved plan."""
    notes: tuple[str, ...] = ()
    """What the reader should know of how it came about: that the deadline cut it short,
    say, or that a mask covers several objects."""
    passed_over: tuple[PassedOver, ...] = ()
    """Objects that were tried first, in order, each with its reason."""
    effective_samples: float = 0.0
    """Walkers of the search, weighted by the quality that they found: close to their
    number where many places are as good, close to 1 where one was found by luck."""
    why_empty: str | None = None
    """One sentence that says why there is no grasp; None if there is one."""
    advice: tuple[Advice, ...] = ()
    """What would free the poses that were ruled out, what frees most first; found where
    the plan is empty, or asked for."""
    seconds: Mapping[str, float] = field(default_factory=dict)
    """Time spent in each stage; not part of the saved plan."""

    def __repr__(self) -> str:
        if not self.grasps:
            return f"<GraspPlan without a grasp: {self.why_empty}>"
        n, best = len(self.grasps), self.grasps[0]
        where = f"on object {self.object_label}" if self.object_label else "in a region"
        return f"<GraspPlan of {n} {where}, first {best!r}>"
