"""Every stage against its plain twin in naive.py."""

import naive
import numpy as np
import pytest
from clouds import grid, street
from stages import graph_of

from ellipseg_ros.core import criteria, jit
from ellipseg_ros.core.edge_sorting import EDGE, Pieces, sorted_edges
from ellipseg_ros.core.edges import edge_weight
from ellipseg_ros.core.ellipsoids import (
    COUNT,
    COVARIANCE,
    CYLINDRICALITY,
    EIGENVALUES,
    MEAN,
    PLANARITY,
    V1,
    V2,
    V3,
    WIDTH,
    neighbour_masses,
    segment_moments,
    shape,
    unite,
)
from ellipseg_ros.core.knn import kdtree
from ellipseg_ros.core.knn.invalidation import gaining, losing
from ellipseg_ros.core.knn.search import Search, nearest
from ellipseg_ros.core.linalg.eigen import eigen

UPPER = np.triu_indices(3)
CLOUDS = [(street, 150), (grid, 150), (street, 12), (street, 11), (street, 3), (grid, 40)]

pytestmark = pytest.mark.nojit


def node(moment):
    """A row as the kernels hold it."""
    count, mean, covariance = moment
    row = np.zeros((1, WIDTH))
    row[0, COUNT], row[0, MEAN : MEAN + 3] = count, mean
    row[0, COVARIANCE : COVARIANCE + 6] = covariance[UPPER]
    shape(row, 0)
    return row[0]


def random_moment(rng):
    points = rng.normal(size=(20, 3)) * 10 ** rng.uniform(-3, 1, 3) @ rng.normal(size=(3, 3))
    _, mean, covariance = naive.moments(points + rng.normal(size=3))
    return int(rng.integers(1, 1000)), mean, covariance


@pytest.mark.parametrize(("cloud", "n"), CLOUDS)
def test_neighbours_equal_the_naive_ones_to_the_last_tie(cloud, n):
    points = cloud(n, np.random.default_rng(n))
    found = graph_of(points)
    expected = naive.neighbours(points)
    assert [list(row[row >= 0]) for row in found.neighbours.rows] == [
        near or [] for near in expected
    ]
    assert list(found.isolated) == [near is None for near in expected]


def test_points_of_a_lesser_status_are_nobodys_neighbours_in_any_number_of_trees():
    points = street(100, np.random.default_rng(0))
    status = (np.arange(100) % 3 != 0).astype(np.uint8)
    trees = [kdtree.build(points, rows) for rows in np.split(np.arange(100), [60, 65, 65])]
    rows, squared = np.full((100, 10), -1, np.int32), np.full((100, 10), np.inf)
    nearest(trees, Search(status == 1, status, 1, rows, squared))
    members = list(np.flatnonzero(status))
    assert (rows[status == 0] == -1).all()
    for i in members:
        assert list(rows[i]) == naive.nearest(points, i, members, 10)


def test_equal_points_lie_in_the_leaves_in_the_order_of_their_rows():
    """So a search among thousands of them ends at the lowest rows, which win the ties."""
    rng = np.random.default_rng(2)
    points = np.zeros((200, 3))
    points[:20] = rng.random((20, 3))
    tree = kdtree.build(points, rng.permutation(200))
    equal = []
    for leaf in range(1 << tree.depth):
        rows = tree.rows[(leaf * 200) >> tree.depth : ((leaf + 1) * 200) >> tree.depth]
        assert tree.first[(1 << tree.depth) + leaf] == min(rows)
        equal += sorted(row for row in rows if row >= 20)
    assert equal == list(range(20, 200))


def test_who_gains_a_neighbour_is_found_to_the_last_tie():
    points = grid(120, np.random.default_rng(1))
    old, new = np.arange(0, 120, 2), np.arange(1, 120, 2)
    status = np.ones(120, np.uint8)
    rows, squared = np.full((120, 10), -1, np.int32), np.full((120, 10), np.inf)
    search = Search(np.arange(120) % 2 == 0, status, 1, rows, squared)
    tree = kdtree.build(points, old)
    nearest([tree], search)
    gains = gaining([tree], kdtree.build(points, new), search)
    for i in old:
        before, now = (naive.nearest(points, i, who, 10) for who in (old, range(120)))
        assert gains[i] == (before != now)


@pytest.mark.parametrize("cloud", [street, grid])
def test_who_gains_or_loses_is_found_where_little_comes_and_goes(cloud):
    """Again and again, so that what a leaf remembers of its reach would show where it is stale."""
    n, rng = 160, np.random.default_rng(4)
    points = cloud(n, rng)
    status = (np.arange(n) < 120).astype(np.uint8)
    rows, squared = np.full((n, 10), -1, np.int32), np.full((n, 10), np.inf)
    tree = kdtree.build(points, np.arange(n))
    nearest([tree], Search(status == 1, status, 1, rows, squared))
    seen = 0
    for new in np.split(np.arange(120, n), 8):
        here = list(np.flatnonzero(status))
        gone = rng.choice(here, 3, replace=False)
        lists = {i: naive.nearest(points, i, here, 10) for i in here}
        status[gone] = 0
        here = list(np.flatnonzero(status))
        search = Search(status == 1, status, 1, rows, squared)
        loses = losing([tree], kdtree.build(points, gone), search)
        assert {i for i in here if loses[i]} == {i for i in here if set(lists[i]) & set(gone)}
        nearest([tree], search._replace(wanted=loses))
        status[new] = 1
        gains = gaining([tree], kdtree.build(points, new), search)
        everybody = here + list(new)
        for i in here:
            before, now = (naive.nearest(points, i, who, 10) for who in (here, everybody))
            assert gains[i] == (before != now)
        seen += sum(gains) + sum(loses)
        again = gains.copy()
        again[new] = True
        nearest([tree], Search(again, status, 1, rows, squared))
    assert 0 < seen < 8 * len(everybody)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_the_number_of_threads_changes_nothing(threads, monkeypatch):
    size = 60 if jit.PLAIN else 3000
    points = street(size, np.random.default_rng(1))
    expected = graph_of(points).edges
    for module in ("jit", "sorting"):
        monkeypatch.setattr(f"ellipseg_ros.core.{module}.THREADS", threads)
    monkeypatch.setattr(jit, "LEAST", 10)
    for column, other in zip(graph_of(points).edges, expected, strict=True):
        assert np.array_equal(column, other)


def test_eigenvalues_and_axes_equal_those_of_lapack():
    rng = np.random.default_rng(2)
    special = [np.zeros((3, 3)), np.eye(3), np.diag([2.0, 1, 1]), np.diag([2.0, 2, 1])]
    special += [np.ones((3, 3)), np.diag([0.0, 0, 5]), 1e-12 * np.eye(3), 1e12 * np.ones((3, 3))]
    for covariance in special + [random_moment(rng)[2] for _ in range(200)]:
        row = np.zeros((1, 18))
        row[0, :6] = covariance[UPPER]
        eigen(row, 0, 0, 6, (9, 12, 15))
        values, axes = row[0, 8:5:-1], row[0, 9:].reshape(3, 3)
        expected, _ = naive.eigen(covariance)
        assert np.allclose(values, expected, rtol=0, atol=4e-15 * max(1e-300, expected[0]))
        assert np.allclose(axes @ axes.T, np.eye(3), atol=1e-14) and np.linalg.det(axes) > 0
        assert np.allclose(
            axes.T @ np.diag(values) @ axes, covariance, rtol=0, atol=4e-15 * expected[0]
        )
        assert all(axes[k][np.argmax(np.abs(axes[k]))] >= 0 for k in (0, 1))


@pytest.mark.parametrize(("cloud", "n"), CLOUDS)
def test_initial_ellipsoids_masses_and_edges_equal_the_naive_ones(cloud, n):
    points = cloud(n, np.random.default_rng(n))
    graph = graph_of(points)
    nodes = graph.nodes
    masses = np.zeros(n)
    neighbour_masses(points, graph.neighbours.rows, np.flatnonzero(~graph.isolated), masses)
    lists = naive.neighbours(points)
    models = {}
    for i in np.flatnonzero(~graph.isolated):
        models[i] = naive.initial_ellipsoid(points, i, lists[i])
        assert np.allclose(nodes[i, MEAN : MEAN + 3], models[i][1], rtol=0, atol=1e-12)
        expected = models[i][2][UPPER]
        assert np.allclose(nodes[i, COVARIANCE : COVARIANCE + 6], expected, rtol=1e-9, atol=1e-15)
        assert masses[i] == pytest.approx(naive.mass(points, i, lists[i]), rel=1e-12)
        values = nodes[i, EIGENVALUES : EIGENVALUES + 3][::-1]
        shares = naive.shape(values)
        assert np.allclose(nodes[i, [PLANARITY, CYLINDRICALITY]], shares[:2], atol=1e-12)
    found = graph.edges
    assert sorted(zip(found.i, found.j, strict=True)) == naive.edges(lists)
    assert list(zip(*found, strict=True)) == sorted(zip(*found, strict=True))
    if cloud is street:  # a grid's axes are arbitrary where eigenvalues tie
        for weight, i, j in zip(*found, strict=True):
            assert weight == pytest.approx(naive.edge_weight(models[i], models[j]), rel=1e-6)


def test_union_distances_and_aicc_equal_the_naive_ones():
    rng = np.random.default_rng(3)
    for _ in range(100):
        a, b = random_moment(rng), random_moment(rng)
        nodes = np.zeros((3, WIDTH))
        nodes[0], nodes[1] = node(a), node(b)
        unite(nodes, 0, 1, 2)
        count, mean, covariance = naive.union(a, b)
        scale = np.abs(covariance).max()
        assert nodes[2, COUNT] == count
        assert np.allclose(nodes[2, MEAN : MEAN + 3], mean, rtol=0, atol=1e-12)
        six = nodes[2, COVARIANCE : COVARIANCE + 6]
        assert np.allclose(six, covariance[UPPER], rtol=0, atol=1e-13 * scale)
        expected = naive.shape_distance(a, b)
        assert criteria.shape_distance(nodes, 0, 1, 1e-4, np.inf) == pytest.approx(expected)
        assert edge_weight(nodes, 0, 1) == pytest.approx(naive.edge_weight(a, b))
        density = naive.density_distance(a, b, 0.7)
        assert criteria.density_distance(nodes, 2, 0.7) == pytest.approx(density)
        for row, moment in enumerate((a, b, (count, mean, covariance))):
            found = criteria.segment_aicc(nodes, row, 0.01)
            assert found == pytest.approx(naive.aicc(moment), rel=1e-9)


def test_the_shape_distance_stops_early_only_above_the_limit():
    rng = np.random.default_rng(4)
    for _ in range(200):
        nodes = np.array([node(random_moment(rng)), node(random_moment(rng))])
        whole = criteria.shape_distance(nodes, 0, 1, 1e-4, np.inf)
        limit = whole * rng.uniform(0.1, 2.0)
        early = criteria.shape_distance(nodes, 0, 1, 1e-4, limit)
        assert early == whole if whole <= limit else early > limit


def test_a_volume_of_zero_is_dense_and_a_mass_of_zero_is_not():
    nodes = np.array(
        [node((5, np.zeros(3), np.diag([1.0, 1, 0]))), node((5, np.zeros(3), np.eye(3)))]
    )
    assert criteria.density_distance(nodes, 0, 0.0) == 0.0
    assert criteria.density_distance(nodes, 1, 0.0) == np.inf


def test_the_sorted_order_is_that_of_weight_then_i_then_j():
    rng = np.random.default_rng(5)
    for values in (1, 3, 50, 10**9):
        n = 400
        weight = rng.integers(0, values, n) * 1e-3
        weight[: n // 2] += rng.integers(0, 3, n // 2) * 1e-14  # equal in the upper half
        i, j = rng.integers(0, 40, n, np.int32), rng.integers(0, 40, n, np.int32)
        weight, i, j = (np.ascontiguousarray(c) for c in (weight, i, j))
        pieces = Pieces(np.array([0, 100, 250]), np.array([90, 0, 150]))
        made = np.empty(n, EDGE)
        made["weight"], made["i"], made["j"] = weight, i, j
        found = sorted_edges(made, pieces)
        meant = [k for k in range(n) if k < 90 or k >= 250]
        expected = sorted((weight[k], i[k], j[k]) for k in meant)
        assert list(zip(*found, strict=True)) == expected


def test_moments_of_labelled_points_equal_the_naive_ones():
    rng = np.random.default_rng(6)
    points, labels = street(80, rng), rng.integers(-1, 5, 80).astype(np.int32)
    nothing = np.zeros((0, WIDTH))
    anew = segment_moments(points, labels, np.full(5, -1), nothing)
    found = segment_moments(points, labels, np.array([-1, 3, -1, 2, -1]), anew[[0, 0, 3, 1]])
    assert np.array_equal(found, anew)
    for s in range(5):
        count, mean, covariance = naive.moments(points[labels == s])
        assert found[s, COUNT] == count
        assert np.allclose(found[s, MEAN : MEAN + 3], mean, rtol=0, atol=1e-12)
        six = found[s, COVARIANCE : COVARIANCE + 6]
        assert np.allclose(six, covariance[UPPER], rtol=1e-9, atol=1e-13)


def test_no_extent_is_a_sphere_with_the_identity_for_axes():
    row = node((3, np.zeros(3), np.zeros((3, 3))))
    assert (row[PLANARITY], row[CYLINDRICALITY]) == (0.0, 0.0)
    assert np.array_equal(row[[[axis, axis + 1, axis + 2] for axis in (V1, V2, V3)]], np.eye(3))
