"""What a claw squeezes, and what it only closes over."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.geometry import SE3, PointCloud, so3
from debrisgrasp.planning.contacts import PadContacts, PadZones
from debrisgrasp.prototypes import PrototypeLibrary
from tests.unit.planning.pad_scenes import (
    ACROSS,
    CONFIG,
    FIRST,
    extruded,
    scene_of,
)


@pytest.mark.parametrize(
    ("radius", "seen", "n", "askew", "least", "most"),
    [
        (0.05, 1.4, 29, 0.0, 0.5, 1.0),
        (0.015, 1.4, 29, 0.0, 0.0, 0.02),
        (0.006, 1.0, 4, 0.4, 0.0, 0.05),
    ],
)
def test_a_claw_can_not_squeeze_what_is_thinner_than_it_closes(
    radius, seen, n, askew, least, most
):
    """Nor what lies askew, and ends in a corner of few points on each side."""
    claw = PrototypeLibrary.load().select(names=["claw_bar_4x4"])
    zones = PadZones.of(claw, CONFIG)
    turn = np.linspace(-seen, seen, n)
    normals = np.stack([np.sin(turn), 0.0 * turn, -np.cos(turn)], axis=1)
    beside = (zones.lower[0] + zones.upper[0])[1] / 2
    points = [0.0, beside, float(zones.upper[0, 2]) - 0.055] + radius * normals
    T = SE3.from_parts(so3.exp([0.0, 0.0, askew]))
    cloud = PointCloud(
        T.apply(extruded(points)),
        T.rotate(np.tile(normals, (5, 1))),
        np.array([0.0, 0.0, -2.0]),
    )
    found = PadContacts(scene_of(cloud), zones, CONFIG)
    assert least <= found.look(np.eye(4)[None], FIRST).squeezed[0] <= most


@pytest.mark.parametrize(
    ("height", "least", "most"), [(0.03, 0.0, 0.3), (0.06, 0.7, 1.0)]
)
def test_a_thin_wall_is_squeezed_where_it_goes_down_to_the_fingertips(
    height, least, most
):
    """One of 30 mm, or a handle near the palm, where closed fingers leave 50 mm."""
    claw = PrototypeLibrary.load().select(names=["claw_cylinder_080"])
    zones = PadZones.of(claw, CONFIG)
    across = np.linspace(0.0, 0.03, 13)
    top = np.stack([across, 0 * across, 0 * across], axis=1)
    side = np.stack([0 * across, 0 * across, height / 0.03 * across], axis=1)
    tilt = so3.exp([0.0, -0.25, 0.0])
    faces = [(top, [0.0, 0.0, -1.0]), (side, [-1.0, 0.0, 0.0])]

    def squeezed(seen):
        points = np.concatenate([extruded(rows @ tilt.T) for rows, _ in seen])
        normals = np.concatenate(
            [np.tile(tilt @ n, (len(ACROSS) * len(rows), 1)) for rows, n in seen]
        )
        points += [-0.02, 0.0, 0.028]
        cloud = PointCloud(points, normals, np.array([-1.0, 0.0, -2.0]))
        found = PadContacts(scene_of(cloud), zones, CONFIG)
        return found.look(np.eye(4)[None], FIRST).squeezed[0]

    assert least <= squeezed(faces) <= most
    assert 0.3 < squeezed(faces[:1]) < 0.7  # nothing tells how far it goes down


@pytest.mark.parametrize("askew", [0.0, 0.25])
@pytest.mark.parametrize("noise", [0, 6])
def test_a_claw_closes_over_a_thin_bar_that_it_has_too_near_to_its_palm(askew, noise):
    """However it lies, and whatever the camera makes up between it and the ground."""
    claw = PrototypeLibrary.load().select(names=["claw_bar_2x4_flat"])
    zones = PadZones.of(claw, CONFIG)
    turn = np.linspace(-1.5, 1.5, 13)
    normals = np.stack([np.sin(turn), 0.0 * turn, -np.cos(turn)], axis=1)
    beside = (zones.lower[0] + zones.upper[0])[1] / 2
    T = SE3.from_parts(so3.exp([0.0, 0.0, askew]))

    def squeezed(height: float) -> float:
        points = extruded([0.0, beside, height] + 0.015 * normals)
        flying = np.tile([0.01, beside, height + 0.025], (noise, 1))
        flying[:, 2] += 0.01 * np.arange(noise)
        up = np.tile([0.0, 0.0, -1.0], (noise, 1))
        cloud = PointCloud(
            T.apply(np.concatenate([points, flying])),
            T.rotate(np.concatenate([np.tile(normals, (5, 1)), up])),
            np.array([0.0, 0.0, -2.0]),
        )
        found = PadContacts(scene_of(cloud), zones, CONFIG)
        return float(found.look(np.eye(4)[None], FIRST).squeezed[0])

    assert squeezed(0.055) < 0.4
    assert squeezed(0.075) > 0.8


@pytest.mark.parametrize("smoothed", [0.0, 0.5])
@pytest.mark.parametrize(
    ("height", "least", "most"), [(0.055, 0.0, 0.4), (0.075, 0.8, 1.0)]
)
def test_normals_that_are_smoothed_over_a_thin_bar_do_not_hide_leaning_fingers(
    smoothed, height, least, most
):
    """Seen from the side; their normals turn less than the bar does."""
    claw = PrototypeLibrary.load().select(names=["claw_bar_2x4_flat"])
    zones = PadZones.of(claw, CONFIG)
    turn = np.linspace(-1.2, 2.4, 19)
    beside = (zones.lower[0] + zones.upper[0])[1] / 2
    rows = np.stack([np.sin(turn), 0.0 * turn, -np.cos(turn)], axis=1)
    turn = 0.6 + (1.0 - smoothed) * (turn - 0.6)
    normals = np.stack([np.sin(turn), 0.0 * turn, -np.cos(turn)], axis=1)
    cloud = PointCloud(
        extruded([0.0, beside, height] + 0.015 * rows),
        np.tile(normals, (5, 1)),
        np.array([0.0, 0.0, -2.0]),
    )
    found = PadContacts(scene_of(cloud), zones, CONFIG)
    squeezed = float(found.look(np.eye(4)[None], FIRST).squeezed[0])
    assert least <= squeezed <= most


@pytest.mark.parametrize(
    ("off", "least", "most"), [(0.0, 0.95, 1.0), (0.008, 0.9, 1.0), (0.035, 0.0, 0.1)]
)
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_what_is_all_on_one_side_of_the_middle_meets_the_fingers_of_that_only(
    off, least, most, side
):
    """A bar of 30 mm between fingers that close to the middle, and not beyond."""
    hand = PrototypeLibrary.load().select(names=["bar_2x4_flat_tip"])
    zones = PadZones.of(hand, CONFIG)
    turn = np.linspace(-1.5, 1.5, 25)
    normals = np.stack([np.sin(turn), 0.0 * turn, -np.cos(turn)], axis=1)
    beside = (zones.lower[0] + zones.upper[0])[1] / 2
    points = extruded([side * off, beside, 0.105] + 0.015 * normals)
    cloud = PointCloud(
        points, np.tile(normals, (5, 1)), np.array([side * off, 0.0, -2.0])
    )
    found = PadContacts(scene_of(cloud), zones, CONFIG)
    squeezed = float(found.look(np.eye(4)[None], FIRST).squeezed[0])
    assert least <= squeezed <= most
