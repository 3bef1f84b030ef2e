"""Kernels against their plain twins in naive.py."""

import naive
import numpy as np
import pytest
from clouds import grid, street
from stages import graph_of

from ellipseg_ros.config import Config
from ellipseg_ros.core import criteria, jit
from ellipseg_ros.core.edge_sorting import EDGE, Pieces, sorted_edges
from ellipseg_ros.core.edges import edge_weight
from ellipseg_ros.core.ellipsoids import segment_moments
from ellipseg_ros.core.graph import ISOLATED
from ellipseg_ros.core.knn import kdtree
from ellipseg_ros.core.knn.invalidation import rows_gaining, rows_losing
from ellipseg_ros.core.knn.search import Search, search_neighbours
from ellipseg_ros.core.linalg.eigen import eigen
from ellipseg_ros.core.moments import no_moments, shape, unite

UPPER = np.triu_indices(3)
CLOUDS = [(street, 150), (grid, 150), (street, 12), (street, 11), (street, 3), (grid, 40)]

pytestmark = pytest.mark.nojit


def records(*moments):
    """Moments (count, mean, covariance) as the kernels hold them."""
    rows = no_moments(len(moments))
    for row, (count, mean, covariance) in enumerate(moments):
        rows[row]["count"], rows[row]["mean"] = count, mean
        rows[row]["covariance"] = covariance[UPPER]
        shape(rows, row)
    return rows


def random_moment(rng):
    points = rng.normal(size=(20, 3)) * 10 ** rng.uniform(-3, 1, 3) @ rng.normal(size=(3, 3))
    _, mean, covariance = naive.moments(points + rng.normal(size=3))
    return int(rng.integers(1, 1000)), mean, covariance


@pytest.mark.parametrize(("cloud", "n"), CLOUDS)
def test_neighbours_equal_naive_including_ties(cloud, n):
    points = cloud(n, np.random.default_rng(n))
    found = graph_of(points)
    expected = naive.neighbours(points)
    assert [list(row[row >= 0]) for row in found.knn_indices] == [near or [] for near in expected]
    assert list(found.state == ISOLATED) == [near is None for near in expected]


def test_points_below_min_state_are_no_neighbours_for_any_number_of_trees():
    points = street(100, np.random.default_rng(0))
    status = (np.arange(100) % 3 != 0).astype(np.uint8)
    trees = [kdtree.build(points, rows) for rows in np.split(np.arange(100), [60, 65, 65])]
    rows, squared = np.full((100, 10), -1, np.int32), np.full((100, 10), np.inf)
    search_neighbours(trees, Search(status == 1, status, 1, rows, squared))
    members = list(np.flatnonzero(status))
    assert (rows[status == 0] == -1).all()
    for i in members:
        assert list(rows[i]) == naive.nearest(points, i, members, 10)


def test_equal_points_are_in_leaves_in_row_order():
    """A search among thousands of equal points then ends at the lowest rows, which win ties."""
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


def test_rows_gaining_equal_naive_including_ties():
    points = grid(120, np.random.default_rng(1))
    old, new = np.arange(0, 120, 2), np.arange(1, 120, 2)
    status = np.ones(120, np.uint8)
    rows, squared = np.full((120, 10), -1, np.int32), np.full((120, 10), np.inf)
    search = Search(np.arange(120) % 2 == 0, status, 1, rows, squared)
    tree = kdtree.build(points, old)
    search_neighbours([tree], search)
    gains = rows_gaining([tree], kdtree.build(points, new), search)
    for i in old:
        before, now = (naive.nearest(points, i, who, 10) for who in (old, range(120)))
        assert gains[i] == (before != now)


@pytest.mark.parametrize("cloud", [street, grid])
def test_rows_gaining_and_losing_equal_naive_over_small_updates(cloud):
    """Repeatedly, so that a stale reach of a leaf would show."""
    n, rng = 160, np.random.default_rng(4)
    points = cloud(n, rng)
    status = (np.arange(n) < 120).astype(np.uint8)
    rows, squared = np.full((n, 10), -1, np.int32), np.full((n, 10), np.inf)
    tree = kdtree.build(points, np.arange(n))
    search_neighbours([tree], Search(status == 1, status, 1, rows, squared))
    seen = 0
    for new in np.split(np.arange(120, n), 8):
        here = list(np.flatnonzero(status))
        gone = rng.choice(here, 3, replace=False)
        lists = {i: naive.nearest(points, i, here, 10) for i in here}
        status[gone] = 0
        here = list(np.flatnonzero(status))
        search = Search(status == 1, status, 1, rows, squared)
        loses = rows_losing([tree], kdtree.build(points, gone), search)
        assert {i for i in here if loses[i]} == {i for i in here if set(lists[i]) & set(gone)}
        search_neighbours([tree], search._replace(queried=loses))
        status[new] = 1
        gains = rows_gaining([tree], kdtree.build(points, new), search)
        everybody = here + list(new)
        for i in here:
            before, now = (naive.nearest(points, i, who, 10) for who in (here, everybody))
            assert gains[i] == (before != now)
        seen += sum(gains) + sum(loses)
        again = gains.copy()
        again[new] = True
        search_neighbours([tree], Search(again, status, 1, rows, squared))
    assert 0 < seen < 8 * len(everybody)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_edges_do_not_depend_on_thread_count(threads, monkeypatch):
    size = 60 if jit.PLAIN else 3000
    points = street(size, np.random.default_rng(1))
    expected = graph_of(points).edges
    for module in ("jit", "edge_sorting"):
        monkeypatch.setattr(f"ellipseg_ros.core.{module}.THREADS", threads)
    monkeypatch.setattr(jit, "MIN_ROWS_PER_THREAD", 10)
    for column, other in zip(graph_of(points).edges, expected, strict=True):
        assert np.array_equal(column, other)


def test_eigenvalues_and_axes_equal_lapack():
    rng = np.random.default_rng(2)
    special = [np.zeros((3, 3)), np.eye(3), np.diag([2.0, 1, 1]), np.diag([2.0, 2, 1])]
    special += [np.ones((3, 3)), np.diag([0.0, 0, 5]), 1e-12 * np.eye(3), 1e12 * np.ones((3, 3))]
    for covariance in special + [random_moment(rng)[2] for _ in range(200)]:
        *values, axes = eigen(*covariance[UPPER])
        axes = np.reshape(axes, (3, 3))
        expected, _ = naive.eigen(covariance)
        assert np.allclose(values, expected, rtol=0, atol=4e-15 * max(1e-300, expected[0]))
        assert np.allclose(axes @ axes.T, np.eye(3), atol=1e-14) and np.linalg.det(axes) > 0
        assert np.allclose(
            axes.T @ np.diag(values) @ axes, covariance, rtol=0, atol=4e-15 * expected[0]
        )
        assert all(axes[k][np.argmax(np.abs(axes[k]))] >= 0 for k in (0, 1))


@pytest.mark.parametrize(("cloud", "n"), CLOUDS)
def test_initial_ellipsoids_masses_and_edges_equal_naive(cloud, n):
    points = cloud(n, np.random.default_rng(n))
    graph = graph_of(points)
    moments, isolated = graph.moments, graph.state == ISOLATED
    masses = np.zeros(n)
    rule = criteria.rule_of(Config(criterion="density"))
    rows = np.flatnonzero(~isolated)
    criteria.initial_values(rule, points, graph.knn_indices, moments, rows, masses)
    lists = naive.neighbours(points)
    models = {}
    for i in rows:
        models[i] = naive.initial_ellipsoid(points, i, lists[i])
        assert np.allclose(moments["mean"][i], models[i][1], rtol=0, atol=1e-12)
        expected = models[i][2][UPPER]
        assert np.allclose(moments["covariance"][i], expected, rtol=1e-9, atol=1e-15)
        assert masses[i] == pytest.approx(naive.mass(points, i, lists[i]), rel=1e-12)
        shares = naive.shape(moments["eigenvalues"][i][::-1])
        found = moments["planarity"][i], moments["cylindricality"][i]
        assert np.allclose(found, shares[:2], atol=1e-12)
    found = graph.edges
    assert sorted(zip(found.i, found.j, strict=True)) == naive.edges(lists)
    assert list(zip(*found, strict=True)) == sorted(zip(*found, strict=True))
    if cloud is street:  # a grid's axes are arbitrary where eigenvalues tie
        for weight, i, j in zip(*found, strict=True):
            assert weight == pytest.approx(naive.edge_weight(models[i], models[j]), rel=1e-6)


def test_union_distances_and_aicc_equal_naive():
    rng = np.random.default_rng(3)
    for _ in range(100):
        a, b = random_moment(rng), random_moment(rng)
        moments = records(a, b, b)
        unite(moments, 0, 1, 2)
        count, mean, covariance = naive.union(a, b)
        scale = np.abs(covariance).max()
        assert moments["count"][2] == count
        assert np.allclose(moments["mean"][2], mean, rtol=0, atol=1e-12)
        six = moments["covariance"][2]
        assert np.allclose(six, covariance[UPPER], rtol=0, atol=1e-13 * scale)
        expected = naive.shape_distance(a, b)
        assert criteria.shape_distance(moments, 0, 1, 1e-4, np.inf) == pytest.approx(expected)
        assert edge_weight(moments, 0, 1) == pytest.approx(naive.edge_weight(a, b))
        density = naive.density_distance(a, b, 0.7)
        assert criteria.density_distance(moments, 2, 0.7) == pytest.approx(density)
        for row, moment in enumerate((a, b, (count, mean, covariance))):
            found = criteria.segment_aicc(moments, row, 0.01)
            assert found == pytest.approx(naive.aicc(moment), rel=1e-9)


def test_shape_distance_is_exact_up_to_the_limit():
    rng = np.random.default_rng(4)
    for _ in range(200):
        moments = records(random_moment(rng), random_moment(rng))
        whole = criteria.shape_distance(moments, 0, 1, 1e-4, np.inf)
        limit = whole * rng.uniform(0.1, 2.0)
        early = criteria.shape_distance(moments, 0, 1, 1e-4, limit)
        assert early == whole if whole <= limit else early > limit


def test_density_distance_of_zero_volume_and_of_zero_mass():
    flat, round_ = (5, np.zeros(3), np.diag([1.0, 1, 0])), (5, np.zeros(3), np.eye(3))
    moments = records(flat, round_)
    assert criteria.density_distance(moments, 0, 0.0) == 0.0
    assert criteria.density_distance(moments, 1, 0.0) == np.inf


def test_edges_are_sorted_by_weight_then_i_then_j():
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


def test_segment_moments_equal_naive():
    rng = np.random.default_rng(6)
    points, labels = street(80, rng), rng.integers(-1, 5, 80).astype(np.int32)
    batch = segment_moments(points, labels, np.full(5, -1), no_moments())
    found = segment_moments(points, labels, np.array([-1, 3, -1, 2, -1]), batch[[0, 0, 3, 1]])
    assert np.array_equal(found, batch)
    for s in range(5):
        count, mean, covariance = naive.moments(points[labels == s])
        assert found["count"][s] == count
        assert np.allclose(found["mean"][s], mean, rtol=0, atol=1e-12)
        assert np.allclose(found["covariance"][s], covariance[UPPER], rtol=1e-9, atol=1e-13)


def test_zero_covariance_is_a_sphere_with_identity_axes():
    (row,) = records((3, np.zeros(3), np.zeros((3, 3))))
    assert (row.planarity, row.cylindricality) == (0.0, 0.0)
    assert (*row.v1, *row.v2, *row.v3) == (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
