"""What a search needs of dictionary and arms, whatever the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.prototypes import GraspPrototype, GripperModel, PrototypeLibrary

from .clearance import ClearanceConfig
from .config import PlannerConfig
from .contacts import PadZones
from .hands import SPHERE_RADIUS, PackedHands
from .levers import GripLevers
from .load import LoadModel
from .reach import Arm
from .similarity import SimilarityConfig
from .success import SuccessModel, success_terms
from .surfaces import VisibleSurfaces

__all__ = ["Burden", "Preference", "Tools", "blurred"]


@dataclass(frozen=True, slots=True, eq=False)
class Tools:
    """What a search needs of its dictionary, whatever the scene."""

    hands: PackedHands
    coarse: VisibleSurfaces
    fine: VisibleSurfaces
    zones: PadZones
    levers: GripLevers
    success: SuccessModel
    gripper_of: np.ndarray
    """Name of the hand of each prototype, shape (p,)."""
    config: PlannerConfig

    @classmethod
    def of(cls, library: PrototypeLibrary, config: PlannerConfig) -> Tools:
        """Collect them; those of the same prototypes and hands are not made again."""
        used = dict.fromkeys(prototype.gripper for prototype in library)
        hands = tuple((name, library.grippers[name]) for name in used)
        made = _made(library.prototypes, hands, replace(config, success=None))
        success = config.success or SuccessModel.load()
        return replace(made, success=success, config=config)


@lru_cache(maxsize=2)
def _made(
    prototypes: tuple[GraspPrototype, ...],
    hands: tuple[tuple[str, GripperModel], ...],
    config: PlannerConfig,
) -> Tools:
    """Tools of a dictionary, which take seconds to make."""
    library = PrototypeLibrary(prototypes, dict(hands))
    packed = library.packed()
    return Tools(
        hands=PackedHands.pack(
            library,
            approach=config.clearance.approach,
            tolerance=config.inspection.tolerance,
        ),
        coarse=VisibleSurfaces.pack(packed, config.search_points),
        fine=VisibleSurfaces.pack(packed, config.final_points),
        zones=PadZones.of(library, config.contact),
        levers=GripLevers.on(library, config.load),
        success=SuccessModel.load(),
        gripper_of=np.array([prototype.gripper for prototype in prototypes]),
        config=config,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Burden:
    """What the object weighs on hands and wrists."""

    model: LoadModel
    levers: GripLevers
    wrists: FloatArray
    """Largest force [N] and torque [N m] at the wrist that carries each prototype's
    hand, shape (p, 2)."""

    @classmethod
    def on(cls, arms: Sequence[Arm], model: LoadModel, tools: Tools) -> Burden:
        """Burden of an object on the arms that may carry it."""
        wrists = np.full((len(tools.gripper_of), 2), np.inf if not arms else 0.0)
        for arm in arms:
            mine = tools.gripper_of == arm.gripper
            wrists[mine] = np.maximum(wrists[mine], arm.wrench_limits)
        return cls(model, tools.levers, np.maximum(wrists, 1e-9))

    def __call__(
        self, Ts_base_hand: FloatArray, prototype: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Load over limit, and lever [m], of poses (k, 4, 4) of prototypes (k,)."""
        demand = self.model.expected_demand(
            Ts_base_hand, prototype, self.levers, self.wrists
        )
        return demand, self.model.distance(Ts_base_hand, prototype, self.levers)


@dataclass(frozen=True, slots=True, eq=False)
class Preference:
    """Factor in (0, 1] on S C that stands for load and slack of the hand.

    The success model is linear in the logs of both, so that the product grows with the
    log-odds; but S C counts for more than in the model, because what fits poorly is
    ruled out in the end.
    """

    burden: Burden
    slack: FloatArray
    """Of the hand of each prototype [m], shape (p,)."""
    weights: FloatArray
    """Log-odds that each of the terms of success gives."""
    best: float
    """Log-odds of what weighs nothing, all else as good as can be."""
    steepness: float
    """Log-odds that the stand-in gives to the log of S C."""

    @classmethod
    def of(cls, burden: Burden, tools: Tools) -> Preference:
        """Prefer what the success model prefers."""
        weights = tools.success.weights
        zero, one = np.zeros(1), np.ones(1)
        best = float((_ideal(zero, zero, one) @ weights)[0])
        steepness = max(float(weights[0]), _STEEP)
        return cls(burden, tools.hands.slack, weights, best, steepness)

    def __call__(self, Ts_base_hand: FloatArray, prototype: IntArray) -> FloatArray:
        """Factors of poses (k, 4, 4) of prototypes (k,), shape (k,)."""
        demand, lever = self.burden(Ts_base_hand, prototype)
        odds = _ideal(demand, lever, self.slack[prototype]) @ self.weights - self.best
        factor: FloatArray = np.exp(np.minimum(odds / self.steepness, 0.0))
        return factor


_STEEP = 3.0
"""At least so much: what fits poorly is ruled out, however light it is."""


def _ideal(demand: FloatArray, lever: FloatArray, slack: FloatArray) -> FloatArray:
    """Terms of k poses that but for these are as good as can be, shape (k, 9)."""
    zero, one = np.zeros(1), np.ones(1)
    return success_terms(
        expected=one, contact=one, demand=demand, lever=lever, margin=zero,
        slack=slack, sight=one, unseen=zero, missing=zero,
    )  # fmt: skip


def blurred(config: PlannerConfig) -> tuple[SimilarityConfig, ClearanceConfig]:
    """Kernels as wide as the error of the pose makes them.

    One look with these comes close to the mean of many looks around the pose: a
    Gaussian of the distance, blurred by a Gaussian error, is a wider Gaussian.
    """
    error, similarity = config.uncertainty.position, config.similarity
    clearance = config.clearance
    allowance = max(clearance.allowance - 0.6 * error, 0.0)
    softness = min(clearance.softness + error, SPHERE_RADIUS - allowance)
    return (
        replace(similarity, sigma=min(float(np.hypot(similarity.sigma, error)), 0.1)),
        replace(clearance, allowance=allowance, softness=softness),
    )
