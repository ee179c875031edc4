"""MuJoCo, where it is installed."""

from __future__ import annotations

from typing import Any

from debrisgrasp.errors import MissingExtraError

__all__ = ["mujoco"]

_FROM, _BELOW = "4", "5"
"""Versions that the tests know. In 3.2 the colliders can't be chosen; in 3.3 to 3.17
some piles never come to rest, and loads are off by 7 %."""


def mujoco() -> Any:
    """Import MuJoCo, or name the extra that brings it."""
    feature, extra = "physics simulation", "sim"
    try:
        import mujoco as module
    except ModuleNotFoundError as error:
        raise MissingExtraError(feature, extra) from error
    except ImportError as error:
        found = f"MuJoCo can't be loaded: {error}"
        raise MissingExtraError(feature, extra, found) from error
    if not _numbers(_FROM) <= _numbers(module.__version__) < _numbers(_BELOW):
        found = f"MuJoCo is {module.__version__}, from {_FROM} to below {_BELOW} works"
        raise MissingExtraError(feature, extra, found)
    return module


def _numbers(version: str) -> list[int]:
    """Major and minor number."""
    return [int(part) for part in version.split(".")[:2]]
