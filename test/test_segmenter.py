"""The whole method: against its plain twin, against facts about the world, and on odd input."""

from dataclasses import replace

import naive
import numpy as np
import pytest
import simple_shapes
from clouds import grid, stream, street
from stages import graph_of

from ellipseg_ros.config import Config
from ellipseg_ros.node.grouping import updates
from ellipseg_ros.records import ISOLATED, REJECTED, THINNED, State, Sweep
from ellipseg_ros.segmenter import Segmenter, segment

CRITERIA = [("shape", 4.0), ("shape", 20.0), ("density", 0.5), ("parsimony", 5.0)]


def walked_edges(points):
    """The edges in the order of the walk, which must ascend for the naive weights too."""
    walk = graph_of(points).edges
    lists = naive.neighbours(points)
    models = [near and naive.initial_ellipsoid(points, i, near) for i, near in enumerate(lists)]
    order = list(zip(walk.i.tolist(), walk.j.tolist(), strict=True))
    weights = np.array([naive.edge_weight(models[i], models[j]) for i, j in order])
    assert np.allclose(weights, walk.weight, rtol=1e-9, atol=1e-12)
    assert (np.diff(weights) > -1e-12 - 1e-9 * weights[1:]).all()
    return order


def assert_equal_to_naive(points, criterion, tau):
    found = segment(points, Config(criterion=criterion, threshold=tau), origin=np.zeros(3))
    expected, isolated = naive.segment(points, criterion, tau, walked_edges(points))
    members = [list(np.flatnonzero(found.labels == s)) for s in range(len(found.ellipsoids))]
    assert members == [rows for rows, _ in expected]
    assert list(np.flatnonzero(found.labels == ISOLATED)) == isolated
    aicc = np.array([naive.aicc(model) for _, model in expected])
    assert abs(found.aicc - aicc.sum()) <= 1e-9 * np.abs(aicc).sum()
    for s, (rows, (_, mean, covariance)) in enumerate(expected):
        assert np.allclose(found.ellipsoids.model_mean[s], mean, rtol=0, atol=1e-9)
        assert np.allclose(found.ellipsoids.model_covariance[s], covariance, rtol=0, atol=1e-9)
        count, mean, covariance = naive.moments(points[rows])
        assert found.ellipsoids.count[s] == count
        assert np.allclose(found.ellipsoids.mean[s], mean, rtol=0, atol=1e-9)
        assert np.allclose(found.ellipsoids.covariance[s], covariance, rtol=0, atol=1e-9)


@pytest.mark.nojit
@pytest.mark.parametrize(("criterion", "tau"), CRITERIA)
def test_segments_equal_naive(criterion, tau):
    assert_equal_to_naive(street(150, np.random.default_rng(0)), criterion, tau)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("criterion", "tau"), CRITERIA)
def test_segments_of_more_points_equal_naive(criterion, tau, seed):
    assert_equal_to_naive(street(300, np.random.default_rng(seed)), criterion, tau)


@pytest.mark.parametrize(("criterion", "tau"), CRITERIA)
@pytest.mark.parametrize("scene", ["oakland_part3_an", "kitti_2011_09_26_drive_0001"])
def test_segments_of_real_scans_equal_naive(shared_data, scene, criterion, tau):
    points = np.load(shared_data / f"{scene}.npz")["xyz"].astype(np.float64)
    distance = np.linalg.norm(points - points[len(points) // 3], axis=1)
    assert_equal_to_naive(points[np.sort(np.argsort(distance)[:500])], criterion, tau)


def normals_off(found, rows, direction):
    """Degrees between the normals of the segments of `rows` and a direction."""
    axes = found.ellipsoids.axes[found.labels[rows], :, 2]
    return np.degrees(np.arccos(np.clip(np.abs(axes @ direction), 0.0, 1.0)))


def test_a_wall_is_one_to_three_flat_ellipsoids_at_a_coarse_threshold():
    sweep, _ = simple_shapes.wall(np.random.default_rng(0))
    found = segment(sweep.points, Config(threshold=12.0))
    large = found.ellipsoids.count >= 12
    assert 1 <= large.sum() <= 3
    assert (found.ellipsoids.eigenvalues[large, 2] < 0.02**2).all()
    assert found.ellipsoids.count[large].sum() > 0.98 * len(sweep)
    rows = np.flatnonzero(large[found.labels])
    assert (normals_off(found, rows, [1.0, 0.0, 0.0]) < 5.0).all()


def test_a_wall_is_flat_nearly_everywhere_at_the_default_threshold():
    sweep, _ = simple_shapes.wall(np.random.default_rng(0))
    found = segment(sweep.points)
    rows = np.flatnonzero(found.ellipsoids.count[found.labels] >= 12)
    flat = normals_off(found, rows, [1.0, 0.0, 0.0]) < 5.0
    assert flat.sum() >= 0.9 * len(sweep)


@pytest.mark.parametrize("seed", range(5))
def test_trunk_is_one_to_three_long_upright_ellipsoids_and_remnants(seed):
    sweep, _ = simple_shapes.trunk(np.random.default_rng(seed))
    found = segment(sweep.points, Config(threshold=12.0))
    large = found.ellipsoids.count >= 0.05 * len(sweep)
    assert 1 <= large.sum() <= 3
    assert found.ellipsoids.count[large].sum() > 0.95 * len(sweep)
    assert (found.ellipsoids.cylindricality[large] > 0.9).all()
    assert (np.abs(found.ellipsoids.axes[large, 2, 0]) > np.cos(np.radians(5.0))).all()


def test_no_segment_holds_points_of_two_boxes_a_metre_apart():
    sweep, truth = simple_shapes.boxes(gap=1.0, rng=np.random.default_rng(7))
    found = segment(sweep.points)
    for s in range(len(found.ellipsoids)):
        assert len(set(truth[found.labels == s])) == 1


@pytest.mark.nojit
@pytest.mark.parametrize("criterion", ["shape", "density", "parsimony"])
@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3)),
        np.zeros((1, 3)),
        np.array([[0.0, 0, 0], [0, 0, 1]]),
        np.random.default_rng(0).random((11, 3)),
        np.zeros((50, 3)),
        np.arange(40.0)[:, None] * [[0.1, 0.2, 0.0]],
        grid(60, np.random.default_rng(1)) * [1.0, 1.0, 0.0],
        np.full((5, 3), np.nan),
    ],
    ids=["none", "one", "two", "eleven", "equal", "collinear", "coplanar", "nan"],
)
def test_degenerate_clouds_give_valid_results(points, criterion):
    found = segment(points, Config(criterion=criterion))
    ellipsoids = found.ellipsoids
    assert len(found.labels) == len(points)
    counts = found.counts
    assert counts.segmented == ellipsoids.count.sum() == (found.labels >= 0).sum()
    total = counts.segmented + counts.isolated + counts.rejected + counts.thinned
    assert total == len(points)
    for column in (ellipsoids.mean, ellipsoids.covariance, ellipsoids.axes, ellipsoids.aicc):
        assert np.isfinite(column).all()
    shares = ellipsoids.planarity + ellipsoids.cylindricality + ellipsoids.sphericity
    assert np.allclose(shares, 1.0)


def test_non_finite_and_far_points_are_rejected_without_effect():
    points = street(200, np.random.default_rng(3))
    bad = np.array([[np.nan, 0, 0], [0, np.inf, 0], [0, 0, -np.inf], [1e30, 0, 0]])
    places = [0, 50, 120, 200]
    mixed = np.insert(points, places, bad, axis=0)
    rejected = np.isnan(mixed).any(axis=1) | (np.abs(mixed) > 1e8).any(axis=1)
    found, clean = segment(mixed), segment(points)
    assert (found.labels[rejected] == REJECTED).all() and found.counts.rejected == 4
    assert np.array_equal(found.labels[~rejected], clean.labels)
    assert np.array_equal(found.ellipsoids.covariance, clean.ellipsoids.covariance)


@pytest.mark.parametrize(("criterion", "tau"), CRITERIA)
def test_merge_does_not_depend_on_thread_count(criterion, tau, monkeypatch):
    points = street(4000, np.random.default_rng(15))
    config = Config(criterion=criterion, threshold=tau)
    alone = segment(points, config)
    monkeypatch.setattr("ellipseg_ros.core.merge.SLAB_MIN_VERTICES", 0)
    for threads in (1, 2, 3, 7, 200):
        monkeypatch.setattr("ellipseg_ros.core.merge.THREADS", threads)
        shared = segment(points, config)
        assert np.array_equal(alone.labels, shared.labels)
        assert np.array_equal(
            alone.ellipsoids.model_covariance, shared.ellipsoids.model_covariance
        )


@pytest.mark.nojit
def test_merge_of_a_small_cloud_does_not_depend_on_slabs(monkeypatch):
    points = street(150, np.random.default_rng(16))
    alone = segment(points)
    monkeypatch.setattr("ellipseg_ros.core.merge.SLAB_MIN_VERTICES", 0)
    monkeypatch.setattr("ellipseg_ros.core.merge.THREADS", 2)
    assert np.array_equal(alone.labels, segment(points).labels)


def test_large_coordinates_lose_no_precision():
    points = np.round(street(2000, np.random.default_rng(4)) * 1024) / 1024
    near, far = segment(points), segment(points + 5e6)
    assert np.array_equal(near.labels, far.labels)
    assert np.array_equal(near.ellipsoids.covariance, far.ellipsoids.covariance)
    assert near.aicc == far.aicc
    assert (far.origin - near.origin == 5e6).all()


def test_segments_are_invariant_to_rigid_motion():
    points = street(1000, np.random.default_rng(5))
    turn = np.linalg.qr(np.random.default_rng(6).normal(size=(3, 3)))[0]
    still, moved = segment(points), segment(points @ turn.T + [10.0, -20.0, 3.0])
    assert np.array_equal(still.labels, moved.labels)
    assert np.allclose(still.ellipsoids.eigenvalues, moved.ellipsoids.eigenvalues, atol=1e-9)


def test_segments_are_invariant_to_point_order():
    points = street(1000, np.random.default_rng(7))
    order = np.random.default_rng(8).permutation(1000)
    one, other = segment(points), segment(points[order])
    together = {frozenset(np.flatnonzero(one.labels == s)) for s in range(len(one.ellipsoids))}
    shuffled = {frozenset(order[other.labels == s]) for s in range(len(other.ellipsoids))}
    assert together == shuffled


def test_every_update_equals_the_batch_result_of_its_window():
    config = Config(window_duration=1.0, update_period=0.25)
    segmenter = Segmenter(config)
    for group in updates(stream(np.random.default_rng(9)), config):
        found = segmenter.process(group)
        assert ((found.times_ns > found.start_ns) & (found.times_ns <= found.end_ns)).all()
        again = segment(found.points, config, origin=found.origin)
        assert np.array_equal(found.labels, again.labels)
        assert np.array_equal(found.ellipsoids.covariance, again.ellipsoids.covariance)
        assert np.array_equal(found.ellipsoids.aicc, again.ellipsoids.aicc)


def test_segments_are_numbered_by_lowest_point_and_carry_times():
    found = Segmenter().process(next(stream(np.random.default_rng(10), size=400)))
    firsts = [np.flatnonzero(found.labels == s)[0] for s in range(len(found.ellipsoids))]
    assert firsts == sorted(firsts)
    for s in range(len(found.ellipsoids)):
        times = found.times_ns[found.labels == s]
        assert (found.first_seen_ns[s], found.last_seen_ns[s]) == (times.min(), times.max())


def test_jump_back_restarts_the_window_and_ids_continue():
    sweep = Sweep(10_000_000_000, street(200, np.random.default_rng(11)))
    segmenter = Segmenter()
    before = segmenter.process(sweep)
    after = segmenter.process(replace(sweep, stamp_ns=1_000_000_000))
    assert "jumped back by 9.000 s" in after.restart and before.restart == ""
    assert len(after.points) == 200 and after.arrival[0] == 0
    assert after.ids.min() == before.ids.max() + 1
    assert list(after.removed) == sorted(before.ids)
    assert after.sequence == before.sequence + 1


def test_changed_frame_or_field_count_restarts_the_window():
    fields = np.zeros(5, [("x", "f4"), ("ring", "u2")])
    other = np.zeros(5, [("x", "f4"), ("ring", "u2", 2)])
    sweep = Sweep(0, np.eye(5, 3), fields=fields, frame_id="map")
    segmenter = Segmenter()
    assert segmenter.process(sweep).restart == ""
    assert "frame" in segmenter.process(replace(sweep, frame_id="odom")).restart
    assert "ring" in segmenter.process(replace(sweep, frame_id="odom", fields=other)).restart


def test_a_gap_longer_than_the_window_expires_everything():
    sweep = Sweep(0, street(100, np.random.default_rng(12)))
    segmenter = Segmenter()
    before = segmenter.process(sweep)
    after = segmenter.process(replace(sweep, stamp_ns=60_000_000_000))
    assert after.restart == "" and len(after.points) == 100
    assert list(after.removed) == sorted(before.ids) and (after.state == State.NEW).all()


def test_thinning_keeps_the_rate_and_accounts_for_all_points():
    config = Config(max_points_per_second=1000)
    points = street(5000, np.random.default_rng(13))
    whole = Segmenter(config).process(Sweep(0, points))
    assert whole.counts.thinned == pytest.approx(4000, abs=30)
    assert (whole.point_ids[whole.labels == THINNED] == 0).all()
    kept = segment(points[whole.labels != THINNED])
    assert np.array_equal(kept.labels, whole.labels[whole.labels != THINNED])


def test_settings_apply_from_the_next_update():
    sweep = Sweep(0, street(300, np.random.default_rng(14)))
    segmenter = Segmenter(Config(threshold=1.0))
    fine = segmenter.process(sweep)
    segmenter.configure(Config(threshold=30.0))
    coarse = segmenter.process(Sweep(1, np.zeros((0, 3))))
    assert len(coarse.ellipsoids) < len(fine.ellipsoids)
    assert np.array_equal(coarse.labels, segment(sweep.points, Config(threshold=30.0)).labels)
