"""Trees, edges and shortcuts in the plane, where everything can be seen."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from debrisgrasp.errors import MissingExtraError
from debrisgrasp.motion import EdgeTest, PathQuery, connect, connect_by_ompl
from debrisgrasp.motion.known import reached
from debrisgrasp.motion.shorten import path_cost, shortened

ENGINES = [
    connect,
    pytest.param(
        connect_by_ompl,
        marks=pytest.mark.skipif(
            importlib.util.find_spec("ompl") is None, reason="no extra 'motion'"
        ),
    ),
]


def gap(q):
    """A wall along x = 0 with a gap at the top."""
    return (np.abs(q[:, 0]) > 0.1) | (q[:, 1] > 0.8)


def wall(q):
    return np.abs(q[:, 0]) > 0.1


def query(is_free, *, max_rounds=200, is_late=lambda: False, d=2):
    ends = np.zeros((2, d))
    ends[:, 0] = -0.5, 0.5
    return PathQuery(
        q_start=ends[0],
        q_goals=np.stack([ends[1], 0.9 * np.ones(d)]),
        lower=-np.ones(d),
        upper=np.ones(d),
        edges=EdgeTest(is_free, 0.02),
        max_rounds=max_rounds,
        is_late=is_late,
    )


def densely(path, n=400):
    share = np.linspace(0.0, 1.0, n)[:, None]
    return np.concatenate([a + share * (b - a) for a, b in pairwise(path)])


@pytest.mark.parametrize("engine", ENGINES)
def test_goes_through_the_gap_to_one_of_the_goals(engine, rng):
    asked = query(gap)
    found = engine(asked, rng=rng)
    np.testing.assert_array_equal(found.path[0], asked.q_start)
    assert (found.path[-1] == asked.q_goals).all(axis=1).any()
    assert gap(densely(found.path)).all()


@pytest.mark.parametrize("engine", ENGINES)
def test_a_closed_wall_ends_with_the_budget(engine, rng):
    found = engine(query(wall, max_rounds=20), rng=rng)
    assert found.path is None


def test_same_seed_same_path():
    one, other = (connect(query(gap), rng=np.random.default_rng(3)) for _ in "ab")
    np.testing.assert_array_equal(one.path, other.path)
    assert one.n_rounds == other.n_rounds


def test_a_deadline_that_has_passed_stops_the_search(rng):
    assert connect(query(gap, is_late=lambda: True), rng=rng).n_rounds == 0


def test_share_of_an_edge_equals_a_walk_along_it(rng):
    edges = EdgeTest(gap, 0.02)
    a, b = rng.uniform(-1, 1, (2, 200, 2))
    a = np.where(gap(a)[:, None], a, [-1.0, 0.0])
    share = edges.free_share(a, b)
    for i in range(len(a)):
        n = max(1, int(np.ceil(np.abs(b[i] - a[i]).max() / 0.02 - 1e-9)))
        free = gap(a[i] + np.arange(1, n + 1)[:, None] / n * (b[i] - a[i]))
        steps = n if free.all() else int(free.argmin())
        assert share[i] == pytest.approx(steps / n)


def test_shortcuts_only_make_a_path_quicker_and_keep_it_free(rng):
    path = np.array(
        [[-0.5, 0], [-0.9, 0.9], [-0.2, 0.95], [0, 0.9], [0.9, 0], [0.5, 0]]
    )
    speed = np.ones(2)
    short = shortened(
        path, speed, EdgeTest(gap, 0.02), rounds=12, rng=rng, is_late=lambda: False
    )
    assert path_cost(short, speed) < 0.75 * path_cost(path, speed)
    np.testing.assert_array_equal(short[[0, -1]], path[[0, -1]])
    assert gap(densely(short)).all()


@pytest.mark.skipif(importlib.util.find_spec("ompl") is not None, reason="installed")
def test_without_ompl_its_engine_names_the_extra(rng):
    with pytest.raises(MissingExtraError, match=r"debrisgrasp\[motion\]"):
        connect_by_ompl(query(gap), rng=rng)


def test_ways_that_repeat_postures_are_entered_in_order(rng):
    asked = query(gap)
    # Only the last of those that are the same is joined to what is near the start.
    same = np.tile([-0.5, 0.9], (8, 1))
    beside = asked.q_start + 0.01 * rng.normal(size=(8, 2))
    known = np.concatenate([same, beside])
    nodes, parents = reached(asked.q_start[None], known, asked.edges)
    entered = {0}
    for node, parent in zip(nodes.tolist(), parents.tolist(), strict=True):
        assert parent in entered
        entered.add(node)
    assert len(nodes) == len(known)
    found = connect(replace(asked, known=known), rng=rng)
    assert gap(densely(found.path)).all()
