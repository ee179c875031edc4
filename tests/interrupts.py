"""Processes that are to be interrupted."""

from __future__ import annotations

import signal

__all__ = ["take_interrupts"]


def take_interrupts() -> None:
    """Before a program starts: jobs in the background of a shell are deaf to them."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
