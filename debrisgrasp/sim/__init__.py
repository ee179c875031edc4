"""Layer 5: physics that we did not write, behind the extra ``sim`` (MuJoCo)."""

from .fingers import HandPhysics
from .flight import Flight, FlightConfig, FlownGrasp, Moment, Verdict
from .flying import fly
from .model import Physics, build_model
from .piles import settled_pile
from .scenes import SceneConfig, TierScene, scene_of, seen_again
from .settle import Contact, SettleConfig, Settled, let_fall, settle
from .tiers import TIERS, tier_scene
from .wrist import WristConfig

__all__ = [
    "TIERS",
    "Contact",
    "Flight",
    "FlightConfig",
    "FlownGrasp",
    "HandPhysics",
    "Moment",
    "Physics",
    "SceneConfig",
    "SettleConfig",
    "Settled",
    "TierScene",
    "Verdict",
    "WristConfig",
    "build_model",
    "fly",
    "let_fall",
    "scene_of",
    "seen_again",
    "settle",
    "settled_pile",
    "tier_scene",
]
