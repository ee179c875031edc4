"""Constants of nature."""

from __future__ import annotations

__all__ = ["GRAVITY"]

GRAVITY = 9.81
"""Acceleration of free fall [m/s^2]."""
