"""Singulation of debris in organised clouds: planar patches, borders, structure."""

from .assemblies import AssemblyConfig
from .completion import CompletionConfig
from .enclosure import EnclosureConfig
from .frames import FrameConfig
from .method import SingulationConfig, singulate
from .tapers import TaperConfig

__all__ = [
    "AssemblyConfig",
    "CompletionConfig",
    "EnclosureConfig",
    "FrameConfig",
    "SingulationConfig",
    "TaperConfig",
    "singulate",
]
