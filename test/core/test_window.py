"""The window rule against a plain model, its boundaries, and thinning."""

import numpy as np
import pytest
from clouds import SECOND, street
from streams import assert_batch, wild_stream

from ellipseg_ros.config import Config
from ellipseg_ros.core.window import Window
from ellipseg_ros.node.grouping import Grouping, updates
from ellipseg_ros.records import THINNED, Sweep
from ellipseg_ros.segmenter import Segmenter


def sweep(stamp, *times, frame_id=""):
    """One point at x = t for every time, s."""
    offsets = [round((t - stamp) * SECOND) for t in times]
    points = np.array([[t, 0.0, 0.0] for t in times]).reshape(-1, 3)
    return Sweep(round(stamp * SECOND), points, np.array(offsets, np.int64), frame_id=frame_id)


def times(found):
    return [float(x) for x in found.points[:, 0]]


@pytest.mark.parametrize("limit", [0, 7, 25])
def test_window_equals_a_plain_model(limit):
    config = Config(window_duration=0.9, max_points=limit)
    length = round(config.window_duration * SECOND)
    window, inside, end, arrived, crowded = Window(), [], None, 0, 0
    for number, s in enumerate(wild_stream(np.random.default_rng(0), 300)):
        push = window.push(s, config)
        inside += [(int(t), arrived + k) for k, t in enumerate(s.times_ns)]
        arrived += len(s)
        end = max([*([end] if number else []), *map(int, s.times_ns)], default=s.stamp_ns)
        late = sum(int(t) <= end - length for t in s.times_ns)
        inside = [(t, k) for t, k in inside if end - length < t]
        early = []
        if limit and len(inside) > limit:
            ages = sorted(inside)
            kept = [point for point in ages if point[0] > ages[-limit - 1][0]] or ages[-limit:]
            early = [point for point in inside if point not in kept]
        inside = [point for point in inside if point not in early]
        found = window.points
        assert list(zip(found.times_ns, found.arrival, strict=True)) == inside
        assert (push.late, push.evicted) == (late, len(early))
        assert window.end_ns == end and window.start_ns >= end - length
        assert (found.times_ns > window.start_ns).all()
        assert early or window.start_ns == end - length
        crowded += len(early)
    assert bool(crowded) == bool(limit)


def test_updates_equal_batch_with_evictions():
    segmenter = Segmenter(Config(window_duration=2.0, max_points=150))
    crowded = 0
    for s in wild_stream(np.random.default_rng(3), 60):
        found = segmenter.process(s)
        assert len(found.points) <= 150
        assert_batch(found, segmenter.config)
        crowded += found.evicted
    assert crowded


def test_cloud_above_max_points_keeps_its_newest_points():
    found = Segmenter(Config(max_points=3)).process(sweep(5.0, 1.0, 4.0, 2.0, 4.0, 4.0, 4.0))
    assert list(found.arrival) == [3, 4, 5] and found.evicted == 3
    assert found.start_ns < 4 * SECOND == found.end_ns


def test_point_exactly_as_old_as_the_window_expires():
    segmenter = Segmenter(Config(window_duration=1.0))
    segmenter.process(sweep(5.0, 5.0, 5.0 + 1e-9))
    assert times(segmenter.process(sweep(6.0, 6.0))) == [5.0 + 1e-9, 6.0]


def test_window_end_never_moves_back():
    segmenter = Segmenter(Config(window_duration=1.0, max_lateness=1.0))
    segmenter.process(sweep(5.0, 5.0))
    found = segmenter.process(sweep(4.5, 4.5))
    assert found.end_ns == 5 * SECOND and times(found) == [5.0, 4.5] and not found.restart


@pytest.mark.parametrize(("late", "restarts"), [(1.0, False), (1.001, True)])
def test_cloud_exactly_max_lateness_old_is_accepted(late, restarts):
    grouping = Grouping(Config(max_lateness=1.0))
    segmenter = Segmenter(Config(max_lateness=1.0))
    for stamp in (10.0, 10.0 - late):
        grouping.push(sweep(stamp, stamp))
        found = segmenter.process(sweep(stamp, stamp))
    (group,) = grouping.flush()
    assert bool(group.restart) == restarts == bool(found.restart)


def test_late_group_does_not_restart_if_earlier_points_have_offsets():
    config = Config(max_lateness=1.0)
    stamps = np.arange(10.0, 12.05, 0.1)
    drive = [*(sweep(t, t, t + 0.09) for t in stamps), sweep(11.05, 11.05)]
    segmenter = Segmenter(config)
    found = [segmenter.process(group) for group in updates(drive, config)]
    assert not any(f.restart for f in found)
    assert len(found[-1].points) == 2 * len(stamps) + 1


def test_empty_sweep_in_another_frame_restarts():
    segmenter = Segmenter()
    segmenter.process(sweep(0.0, 0.0, frame_id="map"))
    found = segmenter.process(sweep(0.1, frame_id="odom"))
    assert found.restart and not len(found.points)
    found = segmenter.process(sweep(0.2, 0.2, frame_id="odom"))
    assert not found.restart and times(found) == [0.2] and found.frame_id == "odom"


def test_results_that_the_next_update_reads_are_read_only():
    segmenter = Segmenter()
    cloud = street(100, np.random.default_rng(1))
    found = segmenter.process(Sweep(0, cloud))
    for column in (found.labels, found.ids, found.points, found.arrival, found.times_ns):
        with pytest.raises(ValueError, match="read-only"):
            column += 1
    found.origin[:] = 1000.0
    assert (segmenter.process(Sweep(SECOND, cloud)).origin == 0.0).all()


def test_points_exactly_at_the_isolation_distance_are_neighbours():
    config = Config()
    found = Segmenter(config).process(Sweep(0, np.array([[0.0, 0, 0], [2.0, 0, 0]])))
    assert found.counts.segmented == 2
    beyond = np.nextafter(2.0, 3.0)
    found = Segmenter(config).process(Sweep(0, np.array([[0.0, 0, 0], [beyond, 0, 0]])))
    assert found.counts.isolated == 2


@pytest.mark.parametrize("parts", [1, 4])
def test_thinned_streams_do_not_depend_on_message_splits(parts):
    config = Config(window_duration=1.5, update_period=0.5, max_points_per_second=200)
    whole = [s for s in wild_stream(np.random.default_rng(2), 100) if len(s)]
    grouping, split = Grouping(config), []
    for s in whole:
        closes = bool(grouping.push(s))
        cut = np.array_split(np.arange(len(s)), 1 if closes else parts)
        split += [s.keep(rows) for rows in cut]
    one, other = Segmenter(config), Segmenter(config)
    thinned = 0
    for a, b in zip(updates(whole, config), updates(split, config), strict=True):
        first, second = one.process(a), other.process(b)
        assert np.array_equal(first.labels, second.labels)
        assert np.array_equal(first.ids, second.ids)
        thinned += first.counts.thinned
        kept = first.labels != THINNED
        assert_batch_of_kept(first, kept, config)
    assert thinned > 100


def assert_batch_of_kept(found, kept, config):
    from dataclasses import replace

    part = replace(found, points=found.points[kept], labels=found.labels[kept])
    assert_batch(part, config)


def test_rejected_points_do_not_use_the_budget():
    rng = np.random.default_rng(3)
    points = street(10_000, rng)
    points[rng.random(10_000) < 0.9] = np.nan
    found = Segmenter(Config(max_points_per_second=500)).process(Sweep(0, points))
    assert found.counts.segmented + found.counts.isolated == pytest.approx(500, abs=30)


def test_gap_grants_at_most_one_period():
    config = Config(max_points_per_second=500, update_period=1.0)
    segmenter = Segmenter(config)
    cloud = street(5000, np.random.default_rng(4))
    for stamp in (0, 10 * SECOND):
        found = segmenter.process(Sweep(stamp, cloud))
    kept = found.labels[found.times_ns == 10 * SECOND] != THINNED
    assert np.count_nonzero(kept) == pytest.approx(500, abs=30)


def test_long_sweep_is_granted_its_span():
    config = Config(max_points_per_second=500, update_period=1.0)
    offsets = np.linspace(0, 4 * SECOND, 5000).astype(np.int64)
    cloud = street(5000, np.random.default_rng(5))
    found = Segmenter(config).process(Sweep(0, cloud, offsets))
    assert 5000 - found.counts.thinned == pytest.approx(2000, abs=50)


def test_fields_of_all_messages_of_a_group_are_compared():
    def with_fields(stamp, *fields):
        return Sweep(stamp, np.zeros((1, 3)), fields=np.zeros(1, list(fields)))

    drive = [
        with_fields(0, ("ring", "u2")),
        with_fields(1, ("other", "f4")),
        with_fields(2, ("ring", "u2", 2)),
    ]
    groups = list(updates(drive, Config()))
    assert [len(group) for group in groups] == [2, 1] and "ring" in groups[1].restart


def test_memory_is_returned_after_a_burst():
    segmenter = Segmenter(Config(window_duration=1.0))
    rng = np.random.default_rng(6)
    segmenter.process(Sweep(0, street(60_000, rng)))
    for second in range(1, 4):
        segmenter.process(Sweep(second * 2 * SECOND, street(100, rng)))
    assert len(segmenter._graph.state) < 10_000
