"""Do pads press within the friction cones? Known faces, laws, and what wasn't seen."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3, PointCloud
from debrisgrasp.planning.contacts import ContactConfig, PadContacts, PadZones
from debrisgrasp.prototypes import PrototypeLibrary

LIBRARY = PrototypeLibrary.load().select(names=["bar_4x4"])
PROTOTYPE = next(iter(LIBRARY))
PADS = LIBRARY.grippers[PROTOTYPE.gripper].pad_positions(
    PROTOTYPE.preshape, PROTOTYPE.width
)
CONFIG = ContactConfig()
FIRST = np.zeros(1, dtype=int)


def contacts(tilts: dict[int, float], T: SE3 | None = None, n: int = 5) -> PadContacts:
    """Faces at the pads of sides (-1, 1), tilted [rad] towards the palm's far side."""
    points, normals = [], []
    spread = np.linspace(-0.008, 0.008, n)
    for side, tilt in tilts.items():
        middle = np.array([side * 0.04, PADS[:, 1].mean(), PADS[:, 2].mean()])
        points.append(middle + spread[:, None] * [0.0, 1.0, 0.0])
        normals.append(np.tile([side * np.cos(tilt), 0.0, -np.sin(tilt)], (n, 1)))
    T = T or SE3.identity()
    cloud = PointCloud(
        T.apply(np.concatenate(points)),
        T.rotate(np.concatenate(normals)),
        np.array([0.0, 0.0, 2.0]),
    )
    scene = SimpleNamespace(cloud=cloud, is_target=np.ones(len(cloud), dtype=bool))
    return PadContacts(scene, PadZones.of(LIBRARY, CONFIG), CONFIG)


def at(found: PadContacts, T: SE3 | None = None) -> float:
    return float(found((T or SE3.identity()).matrix[None], FIRST)[0])


def test_angles_are_those_of_the_faces_thumb_side_first():
    angles = contacts({-1: 0.2, 1: 0.9}).angles(np.eye(4)[None], FIRST)
    assert_allclose(angles, [[0.2, 0.9]], atol=1e-3)


def test_upright_faces_are_certain_and_slanted_ones_are_not():
    assert at(contacts({-1: 0.0, 1: 0.0})) == pytest.approx(1.0, abs=1e-3)
    at_the_cone = np.arctan(CONFIG.friction)
    assert at(contacts({-1: 0.0, 1: at_the_cone})) == pytest.approx(0.52, abs=0.02)
    assert at(contacts({-1: 0.9, 1: 0.9})) < CONFIG.least


def test_a_side_that_was_not_seen_is_as_the_prototype_says():
    assert at(contacts({1: 0.0})) == pytest.approx(1.0, abs=1e-3)
    assert at(contacts({-1: 0.6, 1: 0.0})) == pytest.approx(at(contacts({-1: 0.6})))
    assert at(contacts({-1: 1.2, 1: 1.2}, n=CONFIG.min_points - 1)) == 1.0


def test_on_a_curved_face_the_part_that_is_turned_to_the_pad_counts():
    around = contacts({-1: 0.0, 1: 0.0})
    angle = np.linspace(0.0, 1.3, 9)
    surface = np.stack([0.03 * np.cos(angle), 0 * angle, -0.03 * np.sin(angle)], 1)
    middle = np.array([0.01, PADS[:, 1].mean(), PADS[:, 2].mean()])
    cloud = PointCloud(surface + middle, surface / 0.03, np.array([0.0, 0.0, 2.0]))
    scene = SimpleNamespace(cloud=cloud, is_target=np.ones(len(cloud), dtype=bool))
    pipe = PadContacts(scene, around._zones, CONFIG)
    assert at(pipe) == pytest.approx(1.0, abs=1e-3)


def test_points_of_other_objects_tell_nothing():
    cloud = PointCloud(np.zeros((4, 3)), np.tile([1.0, 0, 0], (4, 1)), np.ones(3))
    scene = SimpleNamespace(cloud=cloud, is_target=np.zeros(4, dtype=bool))
    found = PadContacts(scene, PadZones.of(LIBRARY, CONFIG), CONFIG)
    assert at(found) == 1.0


TILT = st.floats(0.0, 1.3)


@settings(max_examples=40, deadline=None)
@given(TILT, TILT, TILT)
def test_more_slant_never_helps(tilt, more, other):
    less, slanted = sorted((tilt, more))
    before, after = (at(contacts({-1: t, 1: other})) for t in (less, slanted))
    assert 0.0 <= after <= before + 1e-6 <= 1.0 + 1e-6


@settings(max_examples=40, deadline=None)
@given(TILT, TILT, st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6))
def test_moving_everything_changes_nothing(tilt, other, motion):
    T = SE3.exp(np.array(motion))
    here = at(contacts({-1: tilt, 1: other}))
    there = at(contacts({-1: tilt, 1: other}, T), T)
    assert there == pytest.approx(here, abs=2e-3)


@pytest.mark.parametrize(
    "bad", [{"friction": 0.0}, {"angle_error": 0.0}, {"least": 0.9}, {"min_points": 0}]
)
def test_senseless_settings_are_refused(bad):
    with pytest.raises(ConfigError):
        ContactConfig(**bad)
