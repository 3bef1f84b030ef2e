"""Representatives against a plain twin, however the stream is cut; the window equals a batch."""

from dataclasses import replace

import naive
import numpy as np
import pytest
from clouds import SECOND, street
from streams import assert_batch, wild_stream

from ellipseg_ros.config import Config
from ellipseg_ros.core import jit
from ellipseg_ros.errors import ConfigError
from ellipseg_ros.records import LATE, REJECTED, Sweep
from ellipseg_ros.segmenter import Segmenter, segment

CONFIG = Config(window_duration=0.9, resolution=0.5, resolution_range=5.0)


def stream(rng, count):
    """A wild stream with ranges, some unknown, and times up to 0.8 s out of order."""
    for sweep in wild_stream(rng, count, street):
        ranges = np.linalg.norm(sweep.points, axis=1)
        ranges[rng.random(len(sweep)) < 0.1] = np.nan
        offsets = sweep.offsets_ns - rng.integers(0, 8 * SECOND // 10, len(sweep))
        yield replace(sweep, offsets_ns=offsets, ranges=ranges)


def joined(sweeps):
    """All points of some sweeps, each with its own time."""
    return [
        (point, time, distance)
        for sweep in sweeps
        for point, time, distance in zip(sweep.points, sweep.times_ns, sweep.ranges, strict=True)
    ]


def cut(points, sizes):
    """Sweeps of the given sizes from a stream of points."""
    start = 0
    for size in sizes:
        part = points[start : start + size]
        start += size
        xyz = np.array([point for point, _, _ in part]).reshape(-1, 3)
        times = np.array([time for _, time, _ in part], np.int64)
        stamp = int(times.max(initial=0))
        ranges = np.array([distance for _, _, distance in part])
        yield Sweep(stamp, xyz, times - stamp, ranges=ranges)


@pytest.mark.nojit
def test_representatives_equal_the_naive_ones():
    rng = np.random.default_rng(3)
    segmenter, twin = Segmenter(CONFIG), naive.Representatives(0.5, 5.0, 9 * SECOND // 10)
    for sweep in stream(rng, 10 if jit.PLAIN else 120):
        found = segmenter.process(sweep)
        slots = twin.push(sweep, found.origin)
        assert np.array_equal(found.points, [r.position for r in twin.alive()] or np.zeros((0, 3)))
        assert np.array_equal(found.hits, [r.hits for r in twin.alive()])
        mean = [r.mean + found.origin for r in twin.alive()] or np.zeros((0, 3))
        assert np.array_equal(found.means, mean)
        expected = twin.rows(slots)
        assert np.array_equal(found.sweep_rows, expected)


@pytest.mark.parametrize("seed", range(4))
def test_set_does_not_depend_on_how_the_stream_is_cut(seed):
    rng = np.random.default_rng(seed)
    points = joined(stream(rng, 60))
    config = replace(CONFIG, max_lateness=3600.0)
    results = []
    for size in (1 if len(points) < 400 else 7, 50, len(points)):
        sizes = [size] * -(-len(points) // size)
        segmenter = Segmenter(config)
        for sweep in cut(points, sizes):
            found = segmenter.process(sweep)
        results.append(found)
    for found in results[1:]:
        for name in ("points", "arrival", "hits", "means", "labels", "aicc"):
            assert np.array_equal(getattr(found, name), getattr(results[0], name)), name


@pytest.mark.parametrize("criterion", ["shape", "density", "parsimony"])
def test_every_update_equals_a_batch_of_the_representatives(criterion):
    config = replace(CONFIG, criterion=criterion, max_points=400)
    segmenter = Segmenter(config)
    for sweep in stream(np.random.default_rng(5), 120):
        assert_batch(segmenter.process(sweep), config)


def test_every_point_of_an_update_is_accounted_for():
    segmenter = Segmenter(replace(CONFIG, max_points=150))
    evicted = 0
    for sweep in stream(np.random.default_rng(8), 120):
        found = segmenter.process(sweep)
        labels = found.sweep_labels
        rejected = ~np.isfinite(sweep.points).all(axis=1)
        assert len(labels) == len(sweep)
        assert np.array_equal(labels == REJECTED, rejected)
        rows = found.sweep_rows
        inside = rows >= 0
        assert np.array_equal(labels[inside], found.labels[rows[inside]])
        assert (labels[~inside & ~rejected] == LATE).all()
        distance = np.linalg.norm(found.points[rows[inside]] - sweep.points[inside], axis=1)
        assert (distance <= 8 * 0.5 * np.sqrt(3.0)).all()  # in the same cell of the last level
        assert found.counts.segmented + found.counts.isolated == len(found.points) <= 150
        evicted += found.evicted
    assert evicted > 0


def test_labels_of_all_points_without_representatives_are_those_of_the_window():
    rng = np.random.default_rng(2)
    segmenter = Segmenter(Config(window_duration=2.0))
    for second in range(4):
        points = street(300, rng)
        points[::40] = np.nan
        found = segmenter.process(Sweep(second * SECOND, points))
        assert np.array_equal(found.sweep_labels, found.labels[-300:])
        assert np.array_equal(found.points[found.sweep_rows], points, equal_nan=True)
        assert (found.hits == 1).all()


def test_slots_are_reused_in_a_long_stream():
    segmenter = Segmenter(replace(CONFIG, window_duration=0.3))
    rng = np.random.default_rng(4)
    for k in range(60):
        points = street(400, rng) + [3.0 * k, 0.0, 0.0]
        found = segmenter.process(Sweep(k * SECOND // 10, points))
    cells = segmenter._window._cells
    assert len(cells.slots) < 8 * len(found.points) + 4096


def test_changed_resolution_restarts_the_window():
    segmenter = Segmenter(CONFIG)
    points = street(200, np.random.default_rng(1))
    first = segmenter.process(Sweep(SECOND, points))
    segmenter.configure(replace(CONFIG, resolution=0.2))
    second = segmenter.process(Sweep(SECOND + 1, points))
    assert second.restart == "the resolution changed"
    assert np.array_equal(np.sort(second.removed), np.sort(first.ids))
    assert len(second.points) > len(first.points)


def test_batch_of_a_cloud_keeps_every_point():
    points = np.repeat(street(50, np.random.default_rng(1)), 3, axis=0)
    assert len(segment(points, replace(CONFIG)).points) == 150


def test_negative_resolution_is_refused():
    with pytest.raises(ConfigError, match="resolution is -1"):
        Config(resolution=-1.0)
