"""Settings that would switch off what they are the limit of."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from debrisgrasp.control import (
    ArmResponse,
    BaselineConfig,
    BiasBound,
    Contact,
    ContactGuard,
    ControllerConfig,
    GripConfig,
    SafetyConfig,
    ServoConfig,
)
from debrisgrasp.errors import ConfigError
from debrisgrasp.executive import TaskSettings
from debrisgrasp.kinematics import DeflectionLimits
from debrisgrasp.motion import MotionConfig

USUAL = (
    ArmResponse(),
    BaselineConfig(),
    BiasBound(),
    Contact(stiffness=1e3, structure=1e3),
    ContactGuard(),
    ControllerConfig(),
    DeflectionLimits(),
    GripConfig(opening=0.1, width=0.05),
    MotionConfig(),
    SafetyConfig(motion_force=30.0, motion_torque=8.0),
    ServoConfig(),
    TaskSettings(),
)
NUMBERS = [
    pytest.param(usual, field.name, id=f"{type(usual).__name__}.{field.name}")
    for usual in USUAL
    for field in fields(usual)
    if isinstance(getattr(usual, field.name), float)
]


@pytest.mark.parametrize(("usual", "name"), NUMBERS)
def test_no_setting_is_infinite_or_no_number(usual, name):
    for bad in (np.inf, -np.inf, np.nan):
        with pytest.raises(ConfigError, match=name):
            replace(usual, **{name: bad})


@pytest.mark.parametrize(
    ("kind", "name", "off"),
    [
        (SafetyConfig, "jump_force", 1e6),
        (SafetyConfig, "jump_torque", 1e6),
        (SafetyConfig, "following_error", 10.0),
        (SafetyConfig, "following_time", 3600.0),
        (SafetyConfig, "frozen_after", 3600.0),
        (ContactGuard, "stiffness", 1e-3),
        (ContactGuard, "reaction_time", 1e-6),
        (BaselineConfig, "slack_force", 1e3),
        (BaselineConfig, "noise_torque", 1e3),
        (ControllerConfig, "lag", 1.0),
        (DeflectionLimits, "translation", 12.0),
        (DeflectionLimits, "rotation", 200.0),
        (TaskSettings, "empty_load", 1e3),
        (TaskSettings, "camera_shift", 1.0),
    ],
)
def test_a_setting_that_switches_a_test_off_is_refused_by_its_name(kind, name, off):
    with pytest.raises(ConfigError, match=rf"{name}.*got {off}"):
        kind(**{name: off})
