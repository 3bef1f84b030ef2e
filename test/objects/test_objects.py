"""Objects against their plain twin, and of scenes whose objects are known."""

from dataclasses import replace

import naive
import numpy as np
import pytest
from clouds import grid, street
from stages import graph_of

from ellipseg_ros.config import Config, ObjectsConfig
from ellipseg_ros.core import jit
from ellipseg_ros.core.adjacency import segment_adjacency
from ellipseg_ros.core.ellipsoids import segment_moments
from ellipseg_ros.core.graph import ISOLATED
from ellipseg_ros.core.linalg.eigen import least_eigenvalue
from ellipseg_ros.core.moments import no_moments, shape
from ellipseg_ros.objects.agglomeration import merge_segments
from ellipseg_ros.objects.finder import find_objects, segment_features
from ellipseg_ros.objects.indexed_heap import empty_heap, remove, set_cost
from ellipseg_ros.records import Hierarchy, SegmentAdjacency, Sweep
from ellipseg_ros.segmenter import Segmenter, segment
from ellipseg_ros.simulation import simulator

UPPER = np.triu_indices(3)


def labelled(cloud, n, seed=0):
    """Points, their graph, and labels of a coarse grid, -1 for isolated points."""
    points = cloud(n, np.random.default_rng(seed))
    graph = graph_of(points)
    cells = np.unique(np.floor(points / 1.3), axis=0, return_inverse=True)[1].reshape(-1)
    cells[graph.state == ISOLATED] = -1
    first = {}
    labels = [first.setdefault(cell, len(first)) if cell >= 0 else -1 for cell in cells]
    return points, graph, np.array(labels, np.int32), len(first)


def moments_of(points, labels, segments):
    """Moments of the points of every segment."""
    return segment_moments(points, labels, np.full(segments, -1), no_moments())


def lists_of(graph):
    return [None if alone else list(row[row >= 0]) for row, alone in rows_of(graph)]


def rows_of(graph):
    return zip(graph.knn_indices, graph.state == ISOLATED, strict=True)


@pytest.mark.nojit
@pytest.mark.parametrize(("cloud", "n"), [(street, 150), (grid, 120), (street, 3)])
def test_adjacency_counts_the_edges_between_segments(cloud, n):
    _, graph, labels, segments = labelled(cloud, n)
    found = segment_adjacency(graph.knn_indices, labels, segments)
    expected = naive.boundaries(lists_of(graph), labels)
    assert list(zip(found.a, found.b, strict=True)) == sorted(expected)
    assert list(found.edge_count) == [expected[pair] for pair in sorted(expected)]


@pytest.mark.nojit
@pytest.mark.parametrize(("cloud", "n"), [(street, 150), (grid, 120)])
def test_segment_features_are_means_over_the_points(cloud, n):
    points, graph, labels, segments = labelled(cloud, n)
    lists = lists_of(graph)
    found = segment_features(graph.moments, labels, segments)
    for s in range(segments):
        mine = [
            naive.features(naive.initial_ellipsoid(points, i, lists[i])[2])
            for i in np.flatnonzero(labels == s)
        ]
        # A flat or straight neighbourhood has its rounding errors under a square root.
        np.testing.assert_allclose(found[s], np.mean(mine, axis=0), atol=1e-6)


@pytest.mark.nojit
@pytest.mark.parametrize("thickness", [0.0, 0.05, 0.3])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_merges_equal_the_plain_twin(thickness, seed):
    points, graph, labels, segments = labelled(street, 80 if jit.PLAIN else 250, seed)
    # Thickened a little: which of two perfectly flat ones is thinner is a matter of rounding.
    extra = np.random.default_rng(seed).uniform(1e-4, 2e-3, segments)
    own, moments = moments_of(points, labels, segments), {}
    for s in range(segments):
        count, mean, covariance = naive.moments(points[labels == s])
        moments[s] = count, mean, covariance + extra[s] * np.eye(3)
        own["covariance"][s] = moments[s][2][UPPER]
        shape(own, s)
    features = segment_features(graph.moments, labels, segments)
    adjacency = segment_adjacency(graph.knn_indices, labels, segments)
    found = merge_segments(own, features, adjacency, thickness)
    lengths = naive.boundaries(lists_of(graph), labels)
    expected = naive.hierarchy(moments, dict(enumerate(features)), lengths, thickness)
    assert thickness == 0.0 or (found.cost == 0.0).any()
    merges = list(zip(found.parent, found.child, strict=True))
    assert merges == [(a, b) for a, b, _ in expected]
    np.testing.assert_allclose(found.cost, [cost for *_, cost in expected], rtol=1e-9, atol=1e-12)
    for scale in (0.0, 0.1, 1.0, 10.0):
        objects = found.labels_after(found.merges_up_to(scale))
        assert list(objects) == naive.cut(expected, segments, scale)


@pytest.mark.nojit
def test_equal_costs_merge_the_lower_segments_first():
    own = no_moments(4)
    for name in ("count", "xx", "yy", "zz", "e1", "e2", "e3"):
        own[name] = 1.0
    pairs = SegmentAdjacency(*np.array([[0, 0, 1, 2], [2, 3, 3, 3], [1, 1, 1, 1]], np.int32))
    found = merge_segments(own, np.zeros((4, 4)), pairs, 0.02)
    assert list(zip(found.parent, found.child, strict=True)) == [(0, 2), (0, 3), (0, 1)]


@pytest.mark.nojit
def test_heap_order_survives_changes_and_removals():
    rng = np.random.default_rng(0)
    heap, alive = empty_heap(60), {}
    for _ in range(500):
        number = int(rng.integers(60))
        if number in alive and rng.random() < 0.3:
            remove(heap, number)
            del alive[number]
        else:
            alive[number] = (float(rng.integers(5)), int(rng.integers(3)) * 100 + number)
            set_cost(heap, number, *alive[number])
        assert heap.size[0] == len(alive)
        if alive:
            assert heap.item[0] == min(alive, key=alive.__getitem__)


@pytest.mark.nojit
def test_smallest_eigenvalue_equals_lapack():
    rng = np.random.default_rng(1)
    for k in range(400):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        values = 10.0 ** rng.uniform(-6, 2, 3)
        values[1] = values[0] if k % 4 == 0 else values[1]
        values[2] = 0.0 if k % 4 == 1 else values[2]
        matrix = turn * values @ turn.T
        found = least_eigenvalue(*matrix[UPPER])
        expected = max(0.0, np.linalg.eigvalsh(matrix)[0])
        assert abs(found - expected) <= 1e-8 * values.max()
    assert least_eigenvalue(0.0, 0.0, 0.0, 0.0, 0.0, 0.0) == 0.0


def test_hierarchy_can_be_cut_at_any_count_or_cost():
    hierarchy = Hierarchy(np.array([1, 0, 0]), np.array([3, 2, 1]), np.array([0.0, 2.0, 1.0]), 5)
    assert list(hierarchy.labels_after(0)) == [0, 1, 2, 3, 4]
    assert list(hierarchy.labels_after(hierarchy.merges_for_count(3))) == [0, 1, 0, 1, 2]
    assert list(hierarchy.labels_after(hierarchy.merges_for_count(1))) == [
        0,
        0,
        0,
        0,
        1,
    ]  # no more merges
    assert list(hierarchy.labels_after(hierarchy.merges_for_count(99))) == [0, 1, 2, 3, 4]
    assert hierarchy.merges_up_to(1.5) == 1  # cut before the first merge that costs more
    assert hierarchy.merges_up_to(2.0) == 3


def corner(rng):
    """A ground and a wall on it, 6 m long, and a post of 2 m in front."""
    u, v = rng.uniform(-3.0, 3.0, 4000), rng.uniform(0.0, 3.0, 4000)
    half = np.arange(4000) < 2000
    sheet = np.where(
        half[:, None], np.column_stack([u, v, 0 * u]), np.column_stack([u, 0 * u + 3.0, v])
    )
    post = np.column_stack([np.zeros(150), np.full(150, 1.0), rng.uniform(0.1, 2.0, 150)])
    points = np.vstack([sheet, post]) + rng.normal(scale=0.008, size=(4150, 3))
    return points, np.repeat([0, 1, 2], [2000, 2000, 150])


def test_ground_wall_and_post_are_one_object_each():
    points, thing = corner(np.random.default_rng(0))
    found = segment(points)
    ids = found.point_object_ids
    mine = [np.bincount(ids[(thing == k) & (ids > 0)]).argmax() for k in range(3)]
    assert len(set(mine)) == 3
    for k in range(3):
        assert np.mean(ids[thing == k] == mine[k]) > 0.9
    assert len(found.objects) < len(found.ellipsoids) / 2


def test_object_records_describe_the_points_of_their_segments():
    points, _ = corner(np.random.default_rng(1))
    found = segment(points + [4e5, 5e6, 100.0])
    objects = found.objects
    labels = np.where(found.labels >= 0, objects.segment_labels[found.labels], -1)
    for o in range(len(objects)):
        mine = found.points[labels == o]
        assert objects.count[o] == len(mine)
        np.testing.assert_allclose(objects.mean[o], mine.mean(axis=0), atol=1e-6)
        np.testing.assert_allclose(objects.box_min[o], mine.min(axis=0), atol=1e-8)
        np.testing.assert_allclose(objects.box_max[o], mine.max(axis=0), atol=1e-8)
        expected = np.cov(mine.T, bias=True)
        np.testing.assert_allclose(objects.covariance[o], expected, atol=1e-6)
        assert (found.object_ids[objects.members[o]] == objects.ids[o]).all()
        values = np.linalg.eigvalsh(expected)
        assert objects.sphericity[o] == pytest.approx(3 * values[0] / values.sum(), abs=1e-6)
    assert sum(len(objects.members[o]) for o in range(len(objects))) == len(found.ellipsoids)


def test_scale_and_thickness_control_the_number_of_objects():
    points, _ = corner(np.random.default_rng(2))
    config = Config()
    found = {
        (scale, thickness): segment(
            points, replace(config, objects=ObjectsConfig(scale=scale, thickness=thickness))
        ).objects
        for scale in (0.0, 1e9)
        for thickness in (0.0, 0.02)
    }
    assert len(found[1e9, 0.0]) == len(found[1e9, 0.02]) == 1  # all segments are connected
    assert 1 < len(found[0.0, 0.02]) < len(found[0.0, 0.0])
    assert segment(points, replace(config, objects=ObjectsConfig(enabled=False))).objects is None


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.zeros((1, 3)), np.zeros((50, 3))])
def test_few_or_equal_points_give_objects(points):
    found = segment(points)
    assert len(found.objects) == len(set(found.point_object_ids[found.labels >= 0]))
    assert len(found.objects.members) == len(found.objects)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_objects_do_not_depend_on_the_number_of_threads(threads, monkeypatch):
    points, graph, labels, segments = labelled(street, 3000)
    own = moments_of(points, labels, segments)
    adjacency = segment_adjacency(graph.knn_indices, labels, segments)
    what = (points, graph.moments, labels, own, adjacency, ObjectsConfig())
    expected = find_objects(*what)
    monkeypatch.setattr(jit, "THREADS", threads)
    monkeypatch.setattr(jit, "MIN_ROWS_PER_THREAD", 10)
    found = find_objects(*what)
    assert np.array_equal(found.segment_labels, expected.segment_labels)
    assert np.array_equal(found.moments, expected.moments)
    assert np.array_equal(found.boxes, expected.boxes)
    for name in ("parent", "child", "cost"):
        ours, theirs = (getattr(level.hierarchy, name) for level in (found, expected))
        assert np.array_equal(ours, theirs), name


def test_object_ids_persist_while_the_window_moves():
    sweeps = list(simulator.Scene("roadway", duration=6.0))
    segmenter = Segmenter(Config(window_duration=4.0))
    before = None
    for k in range(0, len(sweeps), 5):
        points = np.vstack([sweep.points for sweep in sweeps[k : k + 5]])
        found = segmenter.process(Sweep(sweeps[k].stamp_ns, points))
        objects = found.objects
        assert len(set(objects.ids)) == len(objects)
        if before is not None:
            ended = np.setdiff1d(before.objects.ids, objects.ids)
            assert np.array_equal(found.removed_objects, ended)
            large = before.objects.count > 500
            stayed = np.isin(before.objects.ids[large], objects.ids)
            assert stayed.mean() > 0.7
        before = found
    segmenter.reset()
    last = segmenter.process(Sweep(0, np.zeros((0, 3))))
    assert np.array_equal(last.removed_objects, np.sort(before.objects.ids))
