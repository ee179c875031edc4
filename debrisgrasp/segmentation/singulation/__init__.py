"""Singulation of debris in organised clouds: planar patches joined by evidence."""

from .method import SingulationConfig, singulate

__all__ = ["SingulationConfig", "singulate"]
