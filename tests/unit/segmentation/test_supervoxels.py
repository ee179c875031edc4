import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.segmentation import Binning, SupervoxelConfig
from debrisgrasp.segmentation.patch_growth import (
    _distance,
    _features,
    _patch_means,
    grown,
)
from debrisgrasp.segmentation.supervoxels import _seeds, supervoxels
from debrisgrasp.segmentation.voxels import VoxelGrid, voxelise

from .clouds import TWO_BOXES, cloud_of, plate, scene_cloud, truth_of

UP = np.array([0.0, 0.0, 1.0])


def test_every_voxel_belongs_to_a_patch(rng):
    specks = rng.uniform(0.5, 2.0, (30, 3))
    cloud = cloud_of(np.concatenate([plate((0.5, 0.8), (0.0, 0.3)), specks]), UP)
    patches = supervoxels(cloud, SupervoxelConfig())
    assert patches.owner.min() == 0
    assert set(patches.owner) == set(range(len(patches)))


@pytest.mark.parametrize("binning", list(Binning))
def test_patches_keep_to_one_box(binning):
    cloud = scene_cloud(TWO_BOXES)
    truth = truth_of(cloud, TWO_BOXES)
    cloud, truth = cloud.selected(truth > 0), truth[truth > 0]
    patches = supervoxels(cloud, SupervoxelConfig(binning=binning))
    owner = patches.owner[patches.grid.point_voxel]
    table = np.zeros((len(patches), 3))
    np.add.at(table, (owner, truth), 1)
    assert table.max(axis=1).sum() / table.sum() > 0.995


def test_patches_are_about_as_large_as_the_seed_spacing():
    cloud = cloud_of(plate((0.5, 1.0), (0.0, 0.5)), UP)
    patches = supervoxels(cloud, SupervoxelConfig(seed_resolution=0.05))
    assert 60 < len(patches) < 160


def grown_one_by_one(grid: VoxelGrid, seeds: np.ndarray, config: SupervoxelConfig):
    """Patch of each voxel if each hears all its neighbours in every sweep."""
    features = _features(grid, config)
    owner, cost = np.full(len(grid), -1), np.full(len(grid), np.inf, dtype=np.float32)
    owner[seeds], cost[seeds] = np.arange(len(seeds)), 0.0
    means = features[:, seeds]
    cuts = np.searchsorted(grid.targets, np.arange(1, len(grid)))
    neighbours = np.split(grid.sources, cuts)

    def sweep(*, only_free: bool) -> int:
        before, n_taken = owner.copy(), 0
        for voxel in range(len(grid)):
            if only_free and before[voxel] >= 0:
                continue
            patches = np.setdiff1d(before[neighbours[voxel]], [-1, before[voxel]])
            if not len(patches):
                continue
            at = np.full(len(patches), voxel)
            offers = _distance(features, means, patches, at, config)
            best = offers.argmin()
            if offers[best] < cost[voxel]:
                owner[voxel], cost[voxel] = patches[best], offers[best]
                n_taken += 1
        return n_taken

    for _ in range(int(1.8 * config.seed_resolution / config.voxel_resolution) - 1):
        if sweep(only_free=False) <= 0.002 * len(grid):
            break
        means = _patch_means(features, owner, len(seeds))
    n_late = sweep(only_free=True)
    while sweep(only_free=True):
        pass
    return owner, n_late


@pytest.mark.parametrize("pairs_at_once", [100, 1 << 16])
def test_patches_grow_as_if_each_voxel_heard_all_its_neighbours(
    rng, monkeypatch, pairs_at_once
):
    monkeypatch.setattr(
        "debrisgrasp.segmentation.patch_growth._PAIRS_AT_ONCE", pairs_at_once
    )
    config = SupervoxelConfig()
    points = plate((0.5, 0.7), (0.0, 0.2), spacing=0.008)
    cloud = cloud_of(points + rng.normal(0.0, 0.006, points.shape), UP)
    grid = voxelise(cloud, config.voxel_resolution)
    # Few seeds leave voxels that nobody reaches in time.
    seeds = _seeds(grid, cloud, config)[::3]
    expected, n_late = grown_one_by_one(grid, seeds, config)
    assert n_late > 0
    reached = expected >= 0
    numbers = np.unique(expected[reached], return_inverse=True)[1]
    np.testing.assert_array_equal(grown(grid, seeds, config)[reached], numbers)


def test_edges_join_each_pair_of_touching_patches_once():
    cloud = cloud_of(plate((0.5, 0.7), (0.0, 0.2)), UP)
    patches = supervoxels(cloud, SupervoxelConfig())
    assert (patches.edges[:, 0] < patches.edges[:, 1]).all()
    assert len(np.unique(patches.edges, axis=0)) == len(patches.edges)
    assert (patches.contacts > 0).all()


def test_colour_draws_the_border():
    points = plate((0.5, 0.7), (0.0, 0.2))
    red = (points[:, 1] > 0.1).astype(float)
    colors = np.stack([red, 0 * red, 1 - red], axis=1)
    config = SupervoxelConfig(color_importance=4.0, seed_resolution=0.05)
    patches = supervoxels(cloud_of(points, UP), config, colors)
    owner = patches.owner[patches.grid.point_voxel]
    share = np.bincount(owner, weights=red) / np.bincount(owner)
    assert np.mean((share < 0.05) | (share > 0.95)) > 0.8


def test_refinement_keeps_every_voxel_in_a_patch():
    cloud = cloud_of(plate((0.5, 0.7), (0.0, 0.2)), UP)
    patches = supervoxels(cloud, SupervoxelConfig(refinements=2))
    assert set(patches.owner) == set(range(len(patches)))


def test_patches_are_enlarged_no_further_than_they_may_be():
    cloud = cloud_of(plate((0.5, 0.6), (0.0, 0.1)), UP)
    largest = SupervoxelConfig(
        voxel_resolution=5e-4, seed_resolution=10.0, min_points_per_voxel=100.0
    )
    assert len(supervoxels(cloud, largest)) == 1


def test_weight_of_colour_needs_colours():
    cloud = cloud_of(plate((0.5, 0.6), (0.0, 0.1)), UP)
    with pytest.raises(ConfigError, match="colours"):
        supervoxels(cloud, SupervoxelConfig(color_importance=1.0))


@pytest.mark.parametrize(
    "settings",
    [
        {"voxel_resolution": 0.0},
        {"voxel_resolution": 0.1},
        {"seed_resolution": np.inf},
        {"seed_resolution": 24},
        {"voxel_resolution": 1e-6, "seed_resolution": 1e-5},
        {"normal_importance": -1.0},
        {"refinements": -1},
    ],
)
def test_settings_out_of_range_are_refused(settings):
    with pytest.raises(ConfigError):
        SupervoxelConfig(**settings)


@pytest.mark.parametrize(
    "settings",
    [{"voxel_resolution": None}, {"refinements": 1.5}, {"binning": "x"}],
)
def test_settings_of_another_type_are_refused(settings):
    with pytest.raises(InputError, match=next(iter(settings))):
        SupervoxelConfig(**settings)
