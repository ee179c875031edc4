"""The command line: ``debrisgrasp COMMAND ...``."""

from .main import main

__all__ = ["main"]
