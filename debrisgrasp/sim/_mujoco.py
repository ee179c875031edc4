"""MuJoCo, where it is installed."""

from __future__ import annotations

from typing import Any

from debrisgrasp.errors import MissingExtraError

__all__ = ["mujoco"]


def mujoco() -> Any:
    """Import MuJoCo, or name the extra that brings it."""
    try:
        import mujoco as module
    except ImportError as error:
        raise MissingExtraError("physics simulation", "sim") from error
    return module
