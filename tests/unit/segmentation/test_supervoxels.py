import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.segmentation import Binning, SupervoxelConfig
from debrisgrasp.segmentation.supervoxels import supervoxels

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
