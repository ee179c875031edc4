"""What a search needs of its dictionary is made once."""

from __future__ import annotations

from dataclasses import replace

from debrisgrasp.planning import LoadConfig, PlannerConfig
from debrisgrasp.planning.tools import Tools
from debrisgrasp.prototypes import PrototypeLibrary

NAMES = ["bar_4x4", "cylinder_060_tip"]


def test_tools_are_shared_by_equal_dictionaries_and_settings_alone():
    library, config = PrototypeLibrary.load().select(names=NAMES), PlannerConfig()
    tools = Tools.of(library, config)
    again = Tools.of(PrototypeLibrary.load().select(names=NAMES), PlannerConfig())
    assert again.hands is tools.hands
    fewer = Tools.of(library.select(names=NAMES[:1]), config)
    assert len(fewer.gripper_of) == 1
    rough = LoadConfig(patch=2.0 * config.load.patch)
    other = Tools.of(library, replace(config, load=rough))
    assert other.levers is not tools.levers
    assert other.config.load == rough
    assert (other.levers.lever > tools.levers.lever).any()
