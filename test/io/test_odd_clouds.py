"""Odd clouds through the conversion and the segmenter: an update or a short reason, no more."""

import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ellipseg_ros.config import Config
from ellipseg_ros.core import window
from ellipseg_ros.core.fields import MAX_FIELDS_BYTES
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.bag import node_types
from ellipseg_ros.io.limits import MAX_STAMP_S
from ellipseg_ros.io.messages import write_segments
from ellipseg_ros.io.pointcloud2 import read_sweep, write_cloud, write_labelled
from ellipseg_ros.io.topics import CLOUD
from ellipseg_ros.node.grouping import Grouping
from ellipseg_ros.poses.point_times import time_offsets
from ellipseg_ros.records import SECOND, Sweep
from ellipseg_ros.segmenter import Segmenter, segment
from studies.endurance import conversion, update_check
from studies.endurance.cloud_messages import Header, Time, large_cloud, serialized
from studies.endurance.odd_clouds import odd_cloud


@pytest.mark.parametrize("seed", [1, 2])
def test_odd_clouds_give_an_update_or_a_short_reason_without_losing_points(seed):
    tally = conversion.convert(seed, range(300))
    assert not tally.faults
    assert tally.cases == 300 and tally.accepted > 150 and tally.updates > 30
    assert len(tally.rejected) >= 6  # of the reasons that there are


def test_cases_do_not_depend_on_earlier_ones():
    assert odd_cloud(3, 17) == odd_cloud(3, 17) != odd_cloud(4, 17)


def test_serialized_odd_cloud_equals_its_message():
    for case in range(200):
        cloud = odd_cloud(0, case)
        if not all(f.name.isprintable() for f in cloud.fields):
            continue
        msg = node_types().deserialize_cdr(serialized(cloud), CLOUD)
        told = [(f.name, f.offset, f.datatype, f.count) for f in msg.fields]
        assert told == [(f.name, f.offset, f.datatype, f.count) for f in cloud.fields]
        assert (msg.width, msg.height, bytes(msg.data)) == (cloud.width, cloud.height, cloud.data)


# --- the account of points --------------------------------------------------------------------


@pytest.fixture(scope="module")
def update():
    """An update of a wall, a stray point and one that is none."""
    rng = np.random.default_rng(5)
    wall = rng.uniform(0.0, 2.0, (300, 3)) * (1.0, 1.0, 0.01)
    points = np.vstack([wall, [[500.0, 0.0, 0.0], [np.nan, 0.0, 0.0]]])
    sweep = Sweep(SECOND, points, frame_id="odom")
    return sweep, Segmenter().process(sweep)


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (lambda f: {"labels": np.where(f.labels == -2, -1, f.labels)}, "rejected points"),
        (lambda f: {"labels": np.append(f.labels[1:], np.int32(-1))}, "counts of the segments"),
        (lambda f: {"labels": f.labels + 10_000}, "labels of segments that do not exist"),
        (lambda f: {"late": 1}, "should be in the window"),
        (lambda f: {"evicted": -1}, "should be in the window"),
        (lambda f: {"aicc": np.nan}, "AICc"),
        (
            lambda f: {"ellipsoids": replace(f.ellipsoids, mean=f.ellipsoids.mean * np.inf)},
            "mean of the ellipsoids",
        ),
    ],
)
def test_account_reports_wrong_updates(update, change, fault):
    sweep, found = update
    assert not list(update_check.contradictions(None, sweep, found, Config()))
    wrong = replace(found, **change(found))
    assert any(fault in told for told in update_check.contradictions(None, sweep, wrong, Config()))


def test_exceptions_and_warnings_are_faults(monkeypatch):
    def odd(cloud):
        if cloud.width % 2:
            raise ZeroDivisionError("that was not expected")
        return read_sweep(cloud)

    monkeypatch.setattr(conversion, "read_sweep", odd)
    assert any(
        "that was not expected" in fault for fault in conversion.convert(0, range(40)).faults
    )


# --- regressions -------------------------------------------------------------------------------


def odom(points, second=0, **changes):
    return Sweep(second * SECOND, np.asarray(points, float), frame_id="odom", **changes)


def with_fields(count, *fields, second=0):
    """A sweep of random points whose fields are x, y, z and others."""
    xyz = np.random.default_rng(0).uniform(0.0, 3.0, (count, 3))
    table = np.zeros(count, [("x", "f4"), ("y", "f4"), ("z", "f4"), *fields])
    for name, column in zip("xyz", xyz.T, strict=True):
        table[name] = column
    return odom(xyz, second, fields=table)


def test_segment_that_spans_the_earth_takes_no_longer():
    """Each of the points has a neighbour, and those next to it are thousands of km away."""
    rng = np.random.default_rng(3)
    pairs = np.repeat(np.outer(rng.uniform(-1e8, 1e8, 40), [1.0, 0.3, -0.2]), 2, axis=0)
    points = pairs + rng.uniform(0.0, 0.1, pairs.shape)
    segment(points, Config("parsimony", 1e9))  # whatever has to be loaded
    started = time.process_time()
    found = segment(points, Config("parsimony", 1e9))
    assert np.sqrt(found.ellipsoids.eigenvalues.max()) > 1e7
    assert time.process_time() - started < 1.0


@pytest.mark.parametrize(
    ("sec", "nanosec"),
    [(-1, 0), (2**31 - 1, 0), (0, SECOND), (0, 2**32 - 1), (MAX_STAMP_S + 1, 0)],
)
def test_invalid_stamp_is_refused(sec, nanosec):
    cloud = replace(large_cloud(3), header=Header(Time(sec, nanosec), "odom"))
    with pytest.raises(InputError) as error:
        read_sweep(cloud)
    assert error.value.reason == "stamp"


def test_largest_stamp_with_all_offsets_fits_a_message():
    cloud = replace(large_cloud(50), header=Header(Time(MAX_STAMP_S, SECOND - 1), "odom"))
    sweep = read_sweep(cloud)
    late = replace(sweep, offsets_ns=np.full(50, 10 * SECOND))
    found = Segmenter(Config(window_duration=86400.0)).process(late)
    msg = node_types().deserialize_cdr(write_segments(found), "ellipseg_ros/msg/SegmentArray")
    assert msg.window_end.sec == MAX_STAMP_S + 10


@pytest.mark.parametrize("name", ["n" * 256, "two\nlines", "nul\0", "\ud800"])
def test_unprintable_names_are_refused(name):
    cloud = large_cloud(3)
    frame = replace(cloud, header=Header(cloud.header.stamp, name))
    field = replace(cloud, fields=[*cloud.fields[:3], replace(cloud.fields[3], name=name)])
    for odd in (frame, field):
        with pytest.raises(InputError) as error:
            read_sweep(odd)
        assert error.value.reason == "name" and len(str(error.value)) < 200


def test_overlapping_fields_are_limited_by_the_size_of_a_point():
    cloud = large_cloud(3)
    more = [replace(cloud.fields[3], name=f"f{k}") for k in range(MAX_FIELDS_BYTES // 4)]
    with pytest.raises(InputError) as error:
        read_sweep(replace(cloud, fields=[*cloud.fields, *more]))
    assert error.value.reason == "fields"
    assert (
        len(read_sweep(replace(cloud, fields=[*cloud.fields, *more[: MAX_FIELDS_BYTES // 4 - 4]])))
        == 3
    )


def test_cloud_with_many_fields_restarts_the_window():
    plain, wide = with_fields(500), with_fields(1, ("a", "u1", (600,)), second=1)
    wider = with_fields(1, ("b", "u1", (600,)), second=2)
    segmenter, grouping = Segmenter(), Grouping(Config())
    for sweep, anew in ((plain, False), (wide, False), (wider, True), (plain, False)):
        sweep = replace(sweep, stamp_ns=max(2, sweep.stamp_ns // SECOND) * SECOND)
        grouping.push(sweep)
        found = segmenter.process(sweep)
        assert found.fields.dtype.itemsize <= MAX_FIELDS_BYTES
        assert ("take more than" in found.restart) == anew


def test_points_of_many_bytes_are_evicted(monkeypatch):
    monkeypatch.setattr(window, "MAX_WINDOW_BYTES", 100_000)
    config = Config(max_points=2000)
    segmenter = Segmenter(config)
    first = segmenter.process(with_fields(500))
    second = segmenter.process(with_fields(100, ("more", "u1", (300,)), second=1))
    assert (first.evicted, len(first.points)) == (0, 500)
    assert (second.evicted, len(second.points)) == (
        500,
        100,
    )  # room for 320; one time, one fate
    unlimited = Segmenter(replace(config, max_points=0))
    assert len(unlimited.process(with_fields(500)).points) == 500


def test_message_above_four_gigabytes_is_refused(monkeypatch):
    monkeypatch.setattr("ellipseg_ros.io.pointcloud2.MAX_DATA_BYTES", 1000)
    found = Segmenter().process(with_fields(500))
    with pytest.raises(InputError) as error:
        write_labelled(found)
    assert error.value.reason == "bytes"
    assert write_cloud(with_fields(10).fields, 0, "odom")


def test_smallest_integer_is_no_valid_time():
    table = np.zeros(2, [("timestamp", "i8")])
    table["timestamp"] = -(2**63)
    assert not time_offsets(table, SECOND).any()


def test_signalling_nan_is_rejected_without_a_warning():
    cloud = large_cloud(40)
    fields = [replace(f, datatype=8, offset=8 * k) for k, f in enumerate(cloud.fields)]
    numbers = np.ones((40, 4))
    numbers.view(np.uint64)[7, 0] = 0x7FF0000000000001
    odd = replace(cloud, fields=fields, point_step=32, row_step=1280, data=numbers.tobytes())
    with np.errstate(invalid="raise"):
        assert Segmenter().process(read_sweep(odd)).counts.rejected == 1


def test_sizes_above_64_bits_are_refused():
    cloud = replace(large_cloud(3), width=2**32 - 1, height=2**32 - 1, row_step=2**32 - 1)
    with pytest.raises(InputError):
        read_sweep(cloud)
    assert len(read_sweep(SimpleNamespace(**vars(large_cloud(3))))) == 3
