"""Layer 5: physics that we did not write, behind the extra ``sim`` (MuJoCo)."""

from .model import Physics, build_model
from .piles import settled_pile
from .settle import Contact, SettleConfig, Settled, let_fall, settle

__all__ = [
    "Contact",
    "Physics",
    "SettleConfig",
    "Settled",
    "build_model",
    "let_fall",
    "settle",
    "settled_pile",
]
