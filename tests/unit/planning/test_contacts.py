"""Do pads press within the friction cones? Known faces, laws, and what wasn't seen."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3, PointCloud
from debrisgrasp.planning.contacts import ContactConfig, PadContacts, PadZones
from tests.unit.planning.pad_scenes import (
    ACROSS,
    CONFIG,
    FIRST,
    LIBRARY,
    PADS,
    PROTOTYPE,
    at,
    extruded,
    scene_of,
)


def contacts(tilts: dict[int, float], T: SE3 | None = None, n: int = 5) -> PadContacts:
    """Faces at the pads of sides (-1, 1), tilted [rad] towards the palm's far side."""
    points, normals = [], []
    spread = np.linspace(ACROSS[0], ACROSS[-1], n)
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
    scene = scene_of(cloud)
    return PadContacts(scene, PadZones.of(LIBRARY, CONFIG), CONFIG)


def test_angles_are_those_of_the_faces_thumb_side_first():
    angles = contacts({-1: 0.2, 1: 0.9}).look(np.eye(4)[None], FIRST).angles
    assert_allclose(angles, [[0.2, 0.9]], atol=1e-3)


def test_upright_faces_are_certain_and_slanted_ones_are_not():
    assert at(contacts({-1: 0.0, 1: 0.0})) == pytest.approx(1.0, abs=1e-3)
    at_the_cone = np.arctan(CONFIG.friction)
    assert at(contacts({-1: 0.0, 1: at_the_cone})) == pytest.approx(0.52, abs=0.02)
    assert at(contacts({-1: 0.9, 1: 0.9})) < CONFIG.least


def test_a_side_that_was_not_seen_is_as_the_prototype_says():
    assert at(contacts({1: 0.0})) == pytest.approx(1.0, abs=1e-3)
    assert at(contacts({-1: 0.6, 1: 0.0})) == pytest.approx(at(contacts({-1: 0.6})))
    few = contacts({-1: 1.2, 1: 1.2}, n=CONFIG.min_points - 1)
    assert at(few) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(
    ("corner", "least", "most"), [(0.0, 0.99, 1.0), (1.0, 0.0, 0.1)]
)
def test_hidden_sides_lean_as_the_outline_of_the_top_does(corner, least, most):
    x, y = np.meshgrid(np.arange(-0.06, 0.061, 0.005), np.arange(-0.04, 0.041, 0.005))
    wide = np.abs(x) <= np.where(corner > 0, corner * (y + 0.02), 0.04)
    points = np.column_stack([x[wide], y[wide], np.full(wide.sum(), 0.03)])
    normals = np.tile([0.0, 0.0, -1.0], (len(points), 1))
    cloud = PointCloud(points, normals, np.array([0.0, 0.0, -1.0]))
    found = PadContacts(scene_of(cloud), PadZones.of(LIBRARY, CONFIG), CONFIG)
    look = found.look(np.eye(4)[None], FIRST)
    assert not look.is_seen.any()
    assert least <= look.probability[0] <= most


@pytest.mark.parametrize(
    ("lean", "least", "most"), [(0.0, 0.99, 1.0), (0.8, 0.0, 0.1), (1.2, 0.0, 0.02)]
)
def test_a_flat_face_leans_below_what_was_seen_of_it_as_above(lean, least, most):
    end = PadZones.of(LIBRARY, CONFIG).lower[0, 2] - 0.005
    depth = np.linspace(0.0, 0.03, 13)
    out = 0.04 - np.tan(lean) * depth * (lean < 1.0)
    faces = []
    for side in (-1, 1):
        points = np.stack([side * out, 0 * depth, end - depth], axis=1)
        faces.append((points, [side * np.cos(lean), 0.0, -np.sin(lean)]))
    points = np.concatenate([extruded(face) for face, _ in faces])
    normals = np.repeat([normal for _, normal in faces], 5 * len(depth), axis=0)
    cloud = PointCloud(points, normals, np.array([0.0, 0.0, -2.0]))
    found = PadContacts(scene_of(cloud), PadZones.of(LIBRARY, CONFIG), CONFIG)
    look = found.look(np.eye(4)[None], FIRST)
    assert not look.is_seen.any()
    assert least <= look.causes[0, 0] <= most


@pytest.mark.parametrize(
    ("short", "least", "most"),
    # Well before they slant by the cone of a pad, for only the tips' edges hold.
    [(-0.02, 0.9, 1.0), (0.008, 0.6, 1.0), (0.024, 0.0, 0.08), (0.03, 0.0, 0.02)],
)
def test_fingertips_that_end_before_the_middle_of_a_pipe_squeeze_it_out(
    short, least, most
):
    radius, reach = 0.045, PadZones.of(LIBRARY, CONFIG).upper[0, 2]
    turn = np.linspace(-1.4, 1.4, 29)
    normals = np.stack([np.sin(turn), 0.0 * turn, -np.cos(turn)], axis=1)
    points = [0.0, PADS[:, 1].mean(), reach + short] + radius * normals
    cloud = PointCloud(
        extruded(points), np.tile(normals, (5, 1)), np.array([0.0, 0.0, -2.0])
    )
    found = PadContacts(scene_of(cloud), PadZones.of(LIBRARY, CONFIG), CONFIG)
    assert least <= at(found) <= most


def test_flat_sides_hold_however_far_below_the_fingertips_they_go_on():
    reach = PadZones.of(LIBRARY, CONFIG).upper[0, 2]
    top, depth = np.linspace(-0.04, 0.04, 17), np.linspace(-0.03, 0.06, 19)
    faces = [(np.stack([top, 0 * top, 0 * top - 0.03], 1), [0.0, 0.0, -1.0])]
    for side in (-1, 1):
        rows = np.stack([0 * depth + side * 0.04, 0 * depth, depth], axis=1)
        faces.append((rows, [float(side), 0.0, 0.0]))
    points = np.concatenate([extruded(rows) for rows, _ in faces])
    points[:, 2] += reach
    normals = np.concatenate(
        [np.tile(normal, (len(ACROSS) * len(rows), 1)) for rows, normal in faces]
    )
    cloud = PointCloud(points, normals, np.array([0.0, 0.0, -2.0]))
    found = PadContacts(scene_of(cloud), PadZones.of(LIBRARY, CONFIG), CONFIG)
    assert at(found) > 0.95


def test_a_finger_does_not_come_down_on_what_goes_on_under_it():
    half = PROTOTYPE.opening / 2
    place = np.array([0.0, PADS[:, 1].mean(), PADS[:, 2].mean() - 0.02])
    along = np.arange(-0.03, half + 0.0101, 0.005)

    def top(end: float) -> PadContacts:
        points = place + along[along < end][:, None] * [1.0, 0.0, 0.0]
        rows = np.concatenate(
            [points + np.array([0.0, y, 0.0]) for y in (-0.01, 0, 0.01)]
        )
        up = np.tile([0.0, 0.0, -1.0], (len(rows), 1))
        cloud = PointCloud(rows, up, np.array([0.0, 0.0, -2.0]))
        return PadContacts(scene_of(cloud), PadZones.of(LIBRARY, CONFIG), CONFIG)

    for end, lands_on_it in ((half - 0.01, False), (half + 0.02, True)):
        look = top(end).look(np.eye(4)[None], FIRST)
        assert look.is_too_wide.tolist() == [lands_on_it]


def test_on_a_curved_face_the_part_that_is_turned_to_the_pad_counts():
    around = contacts({-1: 0.0, 1: 0.0})
    angle = np.linspace(0.0, np.pi, 19)  # from outline to outline
    surface = np.stack([0.03 * np.cos(angle), 0 * angle, -0.03 * np.sin(angle)], 1)
    middle = np.array([0.01, PADS[:, 1].mean(), PADS[:, 2].mean()])
    points, normals = extruded(surface + middle), np.tile(surface / 0.03, (5, 1))
    cloud = PointCloud(points, normals, np.array([0.0, 0.0, 2.0]))
    scene = scene_of(cloud)
    pipe = PadContacts(scene, around._zones, CONFIG)
    assert at(pipe) == pytest.approx(1.0, abs=5e-3)


def test_points_of_other_objects_tell_nothing():
    cloud = PointCloud(np.zeros((4, 3)), np.tile([1.0, 0, 0], (4, 1)), np.ones(3))
    scene = scene_of(cloud, is_target=False)
    found = PadContacts(scene, PadZones.of(LIBRARY, CONFIG), CONFIG)
    assert at(found) == 1.0


def half_seen(shape: str, half: float, middle: float) -> PadContacts:
    """A long round or square bar between the fingers, of which no -x side was seen."""
    if shape == "pipe":
        angle = np.deg2rad(np.linspace(-30.0, 88.0, 25))
        x, depth = half * np.sin(angle), half * (1.0 - np.cos(angle))
        nx, nz = np.sin(angle), -np.cos(angle)
    else:
        across, down = np.linspace(-half, half, 13), np.linspace(0.0, half, 12)
        x = np.concatenate([across, np.full(12, half)])
        depth = np.concatenate([0.0 * across, down])
        nx, nz = (np.repeat(pair, (13, 12)) for pair in ([0.0, 1.0], [-1.0, 0.0]))
    y, level = PADS[:, 1].mean(), PADS[:, 2].mean() - half
    points = np.stack([x + middle, np.full_like(x, y), depth + level], axis=1)
    normals = np.tile(np.stack([nx, 0.0 * nx, nz], axis=1), (5, 1))
    cloud = PointCloud(extruded(points), normals, np.array([0.0, 0.0, -2.0]))
    scene = scene_of(cloud)
    return PadContacts(scene, PadZones.of(LIBRARY, CONFIG), CONFIG)


@pytest.mark.parametrize("shape", ["pipe", "box"])
@pytest.mark.parametrize(("half", "middle"), [(0.03, 0.0), (0.045, 0.005)])
def test_the_seen_part_tells_where_the_hidden_side_is(shape, half, middle):
    found = half_seen(shape, half, middle)
    thumb, pair = found.look(np.eye(4)[None], FIRST).room[0]
    assert thumb == pytest.approx(PROTOTYPE.opening / 2 - (half - middle), abs=0.008)
    assert np.isinf(pair)
    assert at(found) > 0.9
    assert not found.look(np.eye(4)[None], FIRST).is_too_wide[0]


def test_a_finger_that_would_land_on_the_hidden_side_rules_the_pose_out():
    half = 0.06
    found = half_seen("pipe", half, half - PROTOTYPE.opening / 2 - 0.02)
    assert found.look(np.eye(4)[None], FIRST).room[0, 0] < 0.0
    assert found.look(np.eye(4)[None], FIRST).is_too_wide[0]
    assert at(found) < CONFIG.least


def test_what_goes_on_to_where_a_finger_comes_down_has_no_side_before_it():
    across = np.linspace(-0.03, PROTOTYPE.opening / 2 - 1e-3, 40)
    points = np.stack(
        [across, np.full(40, PADS[:, 1].mean()), np.full(40, 0.06)], axis=1
    )
    points = extruded(points)
    cloud = PointCloud(points, np.tile([0.0, 0.0, -1.0], (200, 1)), np.zeros(3))
    scene = scene_of(cloud)
    found = PadContacts(scene, PadZones.of(LIBRARY, CONFIG), CONFIG)
    look = found.look(np.eye(4)[None], FIRST)
    assert look.room[0, 0] > 0.01 >= 0.0 >= look.room[0, 1]
    assert not look.is_seen[0]
    assert look.probability[0] < 0.5


def test_one_flat_face_tells_nothing_of_the_side_behind_it():
    assert at(contacts({1: 0.0}, n=12)) == pytest.approx(1.0, abs=1e-3)


def bar_to(end: float, hidden: float | None = None) -> float:
    """Probability on a bar that ends at y [m]; something nearer may hide that end."""
    return at(bar(end, hidden))


def bar(end: float, hidden: float | None = None) -> PadContacts:
    x, y = np.meshgrid(np.linspace(-0.04, 0.04, 9), np.arange(-0.1, end, 0.004))
    points = np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.07)], axis=1)
    which = np.ones(len(points), dtype=bool)
    if hidden is not None:
        points = np.concatenate([points, points * [1, 0, 0] + [0, end + 0.01, hidden]])
        which = np.arange(len(points)) < len(which)
    normals = np.tile([0.0, 0.0, -1.0], (len(points), 1))
    cloud = PointCloud(points, normals, np.array([0.0, 0.0, -1.0]))
    scene = scene_of(cloud)
    scene.is_target[:] = which
    return PadContacts(scene, PadZones.of(LIBRARY, CONFIG), CONFIG)


def test_a_finger_beyond_the_end_of_the_object_presses_on_nothing():
    last = float(PADS[:, 1].max())
    assert bar_to(0.1) > 0.999
    assert bar_to(last + 0.01) > 0.99
    assert bar_to(last - 0.035) < 0.1
    ends = [bar_to(last + beyond) for beyond in np.arange(-0.05, 0.03, 0.005)]
    assert (np.diff(ends) >= -1e-9).all()
    assert bar_to(last - 0.035, hidden=0.02) > 0.99


def test_the_cause_of_a_poor_hold_is_told():
    last = float(PADS[:, 1].max())
    for found, cause in ((contacts({-1: 1.2, 1: 1.2}), 0), (bar(last - 0.035), 1)):
        look = found.look(np.eye(4)[None], FIRST)
        assert look.probability[0] < 0.1
        assert look.causes[0].argmin() == cause
        assert np.delete(look.causes[0], cause).min() > 0.9


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


@pytest.mark.parametrize(("column", "goes_on"), [(637, True), (500, False)])
def test_what_the_image_cuts_off_may_go_on_to_the_finger_beyond(column, goes_on):
    across, beside = np.meshgrid(np.linspace(-0.03, 0.02, 26), 0.045 * np.arange(-1, 2))
    y, z = PADS[:, 1].mean(), np.full(across.size, 0.06)
    points = np.stack([across.ravel(), y + beside.ravel(), z], axis=1)
    columns = column - np.arange(26)[::-1]
    pixels = (640 * (200 + np.arange(3))[:, None] + columns).ravel()
    normals = np.tile([0.0, 0.0, -1.0], (len(points), 1))
    cloud = PointCloud(
        points, normals, np.zeros(3), pixels=pixels, image_shape=(480, 640)
    )
    scene = scene_of(cloud)
    found = PadContacts(scene, PadZones.of(LIBRARY, CONFIG), CONFIG)
    look = found.look(np.eye(4)[None], FIRST)
    assert look.room[0, 0] > 0.01
    assert look.is_too_wide[0] == goes_on


@pytest.mark.parametrize(("height", "may_go_on"), [(0.0, True), (0.05, False)])
def test_what_vanishes_behind_something_nearer_may_go_on(height, may_go_on):
    across, beside = np.meshgrid(np.linspace(-0.03, 0.02, 26), 0.045 * np.arange(-1, 2))
    flat = np.stack([across, PADS[:, 1].mean() + beside, 0.0 * across], axis=-1)
    target = flat.reshape(-1, 3) + np.array([0.0, 0.0, 0.06])
    hiding = flat.reshape(-1, 3) + np.array([0.05, 0.0, height])
    cloud = PointCloud(
        np.concatenate([target, hiding]),
        np.tile([0.0, 0.0, -1.0], (2 * len(target), 1)),
        np.array([0.0, 0.0, -1.0]),
    )
    scene = scene_of(cloud)
    scene.is_target[len(target) :] = False
    found = PadContacts(scene, PadZones.of(LIBRARY, CONFIG), CONFIG)
    look = found.look(np.eye(4)[None], FIRST)
    assert (look.room[0] > 0.01).tolist() == [True, not may_go_on]
    assert (look.probability[0] < 0.5) == may_go_on
    assert not look.is_too_wide[0]
