"""The evidence that two regions are parts of one object."""

from __future__ import annotations

from functools import cache

from debrisgrasp.segmentation.evidence import Evidence

from .features import FEATURES

__all__ = ["fitted_evidence"]


@cache
def fitted_evidence() -> Evidence:
    """Evidence fitted to simulated piles; the file says how."""
    return Evidence.shipped(__package__, "evidence.json", FEATURES)
