import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from debrisgrasp.segmentation.evidence import Evidence
from debrisgrasp.segmentation.singulation.camera import InverseDepthImage
from debrisgrasp.segmentation.singulation.cells import cell_image
from debrisgrasp.segmentation.singulation.evidence import fitted_evidence
from debrisgrasp.segmentation.singulation.features import FEATURES
from debrisgrasp.segmentation.singulation.graph import (
    BorderSum,
    RegionGraph,
    RegionSum,
)
from debrisgrasp.segmentation.singulation.patches import (
    fitted_planes,
    merged_into,
    planar_patches,
)
from debrisgrasp.segmentation.singulation.refine import pixel_patches


def image_of(values: np.ndarray) -> InverseDepthImage:
    """Inverse depth seen by a camera with 600 pixels of focal length."""
    height, width = values.shape
    x = ((np.arange(width) - width / 2) / 600).astype(np.float32)
    y = ((np.arange(height) - height / 2) / 600).astype(np.float32)
    return InverseDepthImage(
        values=values.astype(np.float32),
        x=np.broadcast_to(x, values.shape),
        y=np.broadcast_to(y[:, None], values.shape),
        R_base_camera=np.diag([1.0, -1.0, -1.0]),
        focal=600.0,
    )


def two_steps(height: int = 480, width: int = 640, edge: int = 301) -> np.ndarray:
    values = np.full((height, width), 0.5)
    values[:, edge:] = 0.8
    return values


def test_cells_take_the_nearer_surface_and_not_the_mean():
    image = image_of(two_steps())
    cells = cell_image(image, image.values > 0, 0.013)
    assert cells.edge == 2
    assert set(np.unique(cells.values)) == {np.float32(0.5), np.float32(0.8)}
    # Column 150 of the cells holds pixels 300 and 301, on either side.
    assert (cells.values[:, 150] == np.float32(0.8)).all()


def test_a_single_flying_pixel_does_not_speak_for_its_cell():
    values = np.full((480, 640), 0.5)
    values[100, 200] = 0.7
    cells = cell_image(image_of(values), values > 0, 0.013)
    assert (cells.values == np.float32(0.5)).all()


@pytest.mark.parametrize("shape", [(37, 53), (481, 641), (960, 1280)])
def test_images_of_any_size_become_cells(shape):
    values = np.full(shape, 0.5)
    cells = cell_image(image_of(values), values > 0, 0.013)
    assert cells.values.shape == tuple(-(-n // cells.edge) for n in shape)
    assert cells.standing.all()
    assert cells.values.shape[1] < 480


def test_pixels_at_a_border_choose_their_side():
    image = image_of(two_steps())
    pixels = np.flatnonzero(image.values > 0)
    cells = cell_image(image, image.values > 0, 0.013)
    patches = planar_patches(
        cells, max_gap=0.013, max_increase=30.0, sweeps=2, min_cells=10
    )
    assert len(patches) == 2
    own = pixel_patches(image, cells, patches, pixels, 0.013).reshape(480, 640)
    assert len(np.unique(own[:, :301])) == len(np.unique(own[:, 301:])) == 1
    assert own[0, 0] != own[0, -1]


def test_planes_are_recovered_from_moments(rng):
    x, y = rng.uniform(-0.4, 0.4, (2, 500))
    d = 0.2 * x - 0.1 * y + 0.6
    terms = (np.ones(500), x, y, d, x * x, x * y, y * y, x * d, y * d, d * d)
    moments = np.array([[np.sum(t)] for t in terms])
    planes, error = fitted_planes(moments, 1e-12)
    np.testing.assert_allclose(planes[:, 0], [0.2, -0.1, 0.6], atol=1e-9)
    assert error[0] < 1e-9


pairs = st.lists(
    st.tuples(st.integers(0, 11), st.integers(0, 11), st.floats(0, 1)), max_size=40
)


@given(pairs)
def test_best_pairs_merge_and_only_along_gains(drawn):
    drawn = [(a, b, g) for a, b, g in drawn if a != b]
    edges = np.array([d[:2] for d in drawn], dtype=int).reshape(-1, 2).T
    gain = np.array([d[2] for d in drawn])
    size = np.arange(1.0, 13.0)
    into = merged_into(edges, gain, size, 0.3)
    if into is None:
        # Something always merges while a gain is large enough.
        assert not (gain > 0.3).any()
        return
    assert sorted(set(into)) == list(range(into.max() + 1))
    for region in range(into.max() + 1):
        members = set(np.flatnonzero(into == region))
        reached = {min(members)}
        for _ in members:
            for (a, b), g in zip(edges.T, gain, strict=True):
                if g > 0.3 and {a, b} <= members and {a, b} & reached:
                    reached |= {a, b}
        assert reached == members


def random_graph(rng: np.random.Generator) -> RegionGraph:
    ends = rng.integers(0, 8, (60, 2))
    ends = ends[ends[:, 0] != ends[:, 1]]
    return RegionGraph.of_pairs(
        regions=rng.uniform(0, 1, (8, RegionSum.COUNT)),
        ends=ends,
        sums=rng.uniform(0, 1, (len(ends), BorderSum.COUNT)),
        labels=rng.integers(-2, 8, (5, 6)),
    )


def test_merging_in_two_rounds_equals_merging_at_once(rng):
    graph = random_graph(rng)
    first = np.array([0, 1, 2, 1, 3, 4, 0, 5])
    second = np.array([0, 1, 0, 2, 1, 3])
    stepwise = graph.merged(first).merged(second)
    at_once = graph.merged(second[first])
    np.testing.assert_array_equal(stepwise.edges, at_once.edges)
    np.testing.assert_allclose(stepwise.borders, at_once.borders)
    np.testing.assert_allclose(stepwise.regions, at_once.regions)
    np.testing.assert_array_equal(stepwise.labels, at_once.labels)
    assert stepwise.regions.sum() == pytest.approx(graph.regions.sum())


def test_what_points_from_a_to_b_turns_with_the_pair():
    sums = np.zeros((2, BorderSum.COUNT))
    sums[:, [BorderSum.A_NEARER, BorderSum.RISE]] = [[3.0, 0.5], [1.0, 0.2]]
    graph = RegionGraph.of_pairs(
        np.zeros((2, RegionSum.COUNT)),
        np.array([[0, 1], [1, 0]]),
        sums,
        np.zeros((1, 1), dtype=int),
    )
    assert graph.edges.tolist() == [[0, 1]]
    assert graph.borders[0, BorderSum.A_NEARER] == 3.0
    assert graph.borders[0, BorderSum.B_NEARER] == 1.0
    assert graph.borders[0, BorderSum.RISE] == pytest.approx(0.3)


def test_evidence_adds_what_each_answer_is_worth():
    evidence = Evidence.from_terms(
        FEATURES,
        0.5,
        [
            {"questions": [["step", 0.01], ["angle", 1.0]], "log_odds": [0, 1, 2, 4]},
            {"questions": [["angle", 2.0], ["angle", 0.0]], "log_odds": [8, 0, 16, 0]},
        ],
    )
    features = np.full((3, len(FEATURES)), np.nan)
    features[1, FEATURES.index("step")] = 0.02
    features[2, FEATURES.index("angle")] = 1.5
    assert evidence.log_odds_of(features).tolist() == [8.5, 9.5, 18.5]


def test_fitted_evidence_names_known_features_and_is_finite():
    evidence = fitted_evidence()
    assert evidence.features.max() < len(FEATURES)
    assert np.isfinite(evidence.log_odds).all()
    nothing = np.full((1, len(FEATURES)), np.nan)
    assert 0 < evidence.probability(nothing)[0] < 1
