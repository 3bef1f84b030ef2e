import numpy as np
import pytest

from ellipseg_ros.errors import InputError
from ellipseg_ros.io.cloud_file import read_fields
from ellipseg_ros.poses.point_times import TimeField, point_times, time_offsets

NS = 10**9
STAMP_NS = 1_700_000_000 * NS + 123_456_789
COUNT = 3000


def times_ns(rng, begin_ns=0, span_ns=NS // 10):
    """(COUNT,) int64: offsets of a sweep, ascending."""
    offsets = np.sort(rng.integers(0, span_ns, COUNT))
    offsets[[0, -1]] = 0, span_ns - 1
    return begin_ns + offsets


def cloud(name, values):
    fields = np.zeros(len(values), [(n, "f4") for n in "xyz"] + [(name, values.dtype)])
    fields[name] = values
    return fields


def read(name, values, chosen=None, stamp_ns=STAMP_NS):
    return point_times(cloud(name, values), stamp_ns, *([chosen] if chosen else []))


def refused(*args):
    with pytest.raises(InputError) as error:
        read(*args)
    assert error.value.reason == "point_times" and len(str(error.value).splitlines()) == 1
    return str(error.value)


RELATIVE = [  # field, type, ns in a unit
    ("t", "u4", 1),  # Ouster
    ("offset_time", "u4", 1),  # Livox
    ("time_stamp", "u4", 1),  # Autoware
    ("t", "u4", 1000),
    ("timestamp", "u4", 1000),
    ("t", "i4", 1000),
    ("t", "f4", 10**6),
    ("time", "f4", NS),  # Velodyne
    ("time", "f8", NS),
    ("time_offset", "f8", 10**6),
]


@pytest.mark.parametrize(
    ("name", "kind", "unit", "begin_ns"),
    [(*case, 0) for case in RELATIVE]
    + [(*case, -(NS // 10) + 1) for case in RELATIVE if case[1] != "u4"],
)
def test_times_from_the_stamp_at_begin_and_at_end(name, kind, unit, begin_ns):
    offsets = times_ns(np.random.default_rng(0), begin_ns)
    units = offsets / unit
    found = read(name, (np.rint(units) if kind[0] in "iu" else units).astype(kind))
    assert np.abs(found.offsets_ns - offsets).max() <= max(unit / 2 if kind[0] != "f" else 10, 0.5)
    assert found.valid.all() and found.meaning.startswith(name)
    assert found.meaning.endswith("from the stamp")


ABSOLUTE = [
    ("timestamp", "f8", NS),  # Hesai, RoboSense
    ("timestamp", "f8", 1),  # Livox
    ("timestamp", "f8", 1000),
    ("timestamp", "i8", 1),
    ("t", "u8", 1000),
]


@pytest.mark.parametrize(("name", "kind", "unit"), ABSOLUTE)
@pytest.mark.parametrize("begin_ns", [0, -(NS // 10)])
def test_absolute_times(name, kind, unit, begin_ns):
    offsets = times_ns(np.random.default_rng(1), begin_ns)
    absolute = STAMP_NS + offsets
    values = (absolute // unit if kind[0] in "iu" else absolute / unit).astype(kind)
    found = read(name, values)
    assert np.abs(found.offsets_ns - offsets).max() <= max(unit if kind[0] != "f" else 500, 1)
    assert found.valid.all() and found.meaning.endswith("absolute")


@pytest.mark.parametrize(("kind", "unit"), [("f8", NS), ("f8", 1), ("i8", 1), ("u4", 1000)])
def test_times_of_another_clock_count_from_the_first_point(kind, unit):
    """The lidar counts from its start, not from 1970."""
    offsets = times_ns(np.random.default_rng(2))
    offsets[:2] = offsets[1::-1]  # not in order
    values = ((3600 * NS + offsets) / unit).astype(kind)
    found = read("timestamp", values)
    assert np.abs(found.offsets_ns - offsets).max() <= max(1000, unit)
    assert found.meaning.endswith("from the first point")


@pytest.mark.parametrize(("unit", "name"), [(1, "ns"), (1000, "us")])
def test_counter_of_32_bits_may_overflow_within_a_sweep(unit, name):
    offsets = times_ns(np.random.default_rng(3))
    ticks = (2**32 - 30_000_000 // unit + offsets // unit) % 2**32
    chosen = TimeField("", "" if unit == 1 else name)
    found = read("t", ticks.astype(np.uint32), chosen)
    assert np.abs(found.offsets_ns - offsets).max() <= unit
    assert found.meaning == f"t [{name}] from the first point"


@pytest.mark.parametrize("value", [0, 5000])
def test_equal_times_are_read(value):
    found = read("t", np.full(COUNT, value, np.uint32))
    assert found.valid.all() and (found.offsets_ns == found.offsets_ns[0]).all()
    seconds = read("timestamp", np.full(COUNT, STAMP_NS / NS))
    assert seconds.valid.all() and np.abs(seconds.offsets_ns).max() < 500


def test_times_may_run_backwards():
    offsets = times_ns(np.random.default_rng(4))[::-1]
    np.testing.assert_array_equal(read("t", offsets.astype(np.uint32)).offsets_ns, offsets)


def test_a_cloud_of_12_s_is_refused():
    offsets = times_ns(np.random.default_rng(5), span_ns=12 * NS)
    text = refused("t", offsets.astype(np.uint64))
    assert "'t'" in text and "0 to 1.2e+10" in text and "time_unit" in text
    assert "100 to 112" in refused("time", offsets / NS + 100.0, TimeField("", "s"))


@pytest.mark.parametrize(
    ("values", "seen"),
    [
        (np.full(5, np.nan, np.float32), "not finite"),
        (np.array([np.nan, np.inf, 1e38, -1e38], np.float32), "-1e+38 to 1e+38"),
    ],
)
def test_impossible_times_are_refused_with_their_values(values, seen):
    assert seen in refused("time", values)


@pytest.mark.parametrize("missing", [np.nan, 0.0])
@pytest.mark.parametrize("share", [0.1, 0.8])
@pytest.mark.parametrize("clock_ns", [0, -STAMP_NS + 3600 * NS])
def test_missing_times_keep_the_others_right(missing, share, clock_ns):
    """Organized clouds have NaN or 0 where there was no return: often of most points."""
    rng = np.random.default_rng(6)
    offsets = times_ns(rng)
    values = (STAMP_NS + clock_ns + offsets) / NS
    gone = rng.random(COUNT) < share
    gone[[0, -1]] = False
    values[gone] = missing
    found = read("timestamp", values)
    np.testing.assert_array_equal(found.valid, ~gone)
    assert np.abs(found.offsets_ns - offsets)[~gone].max() < 500
    assert not found.offsets_ns[gone].any()


def test_chosen_field_and_unit_decide():
    offsets = times_ns(np.random.default_rng(7))[:100] // 1000 * 1000
    values = (offsets // 1000).astype(np.uint32)  # few points: could as well be ns
    table = np.zeros(100, [("t", "f4"), ("when", "u4"), ("u2", "u2"), ("pair", "u4", 2)])
    table["when"] = values
    found = point_times(table, STAMP_NS, TimeField("when", "us"))
    np.testing.assert_array_equal(found.offsets_ns, offsets)
    assert found.meaning == "when [us] from the stamp"
    for name in ("gone", "pair"):
        with pytest.raises(InputError, match=name) as error:
            point_times(table, STAMP_NS, TimeField(name, ""))
        assert "t, when, u2" in str(error.value)


def test_unit_decides_between_relative_and_absolute_seconds_near_time_0():
    seconds = np.linspace(0.0, 0.1, COUNT)
    found = read("time", seconds, TimeField("", "s"), NS // 20)
    np.testing.assert_allclose(found.offsets_ns, seconds * NS, atol=1)


def test_clouds_without_times_have_no_meaning():
    table = np.zeros(3, [("x", "f4"), ("t", "u1"), ("time", "f4", 2)])
    found = point_times(table, STAMP_NS)
    assert found.meaning == "" and found.valid.all() and not found.offsets_ns.any()
    assert not len(point_times(cloud("t", np.zeros(0, np.uint32)), STAMP_NS).offsets_ns)


def test_unreadable_times_are_zeros_for_registered_clouds():
    assert not time_offsets(cloud("time", np.full(5, np.nan)), STAMP_NS).any()


def test_real_sweep_with_the_times_of_its_packets_is_refused(shared_data):
    path = shared_data / "raw" / "nebula_vlp16.pcd"
    if not path.exists():
        pytest.skip(f"needs {path}")
    with pytest.raises(InputError, match="'time_stamp' restart 149 times within 1.30 ms"):
        point_times(read_fields(path), STAMP_NS)


def test_times_that_restart_with_every_packet_are_refused():
    packet = np.linspace(2_000, 1_300_000, 100)
    fields = np.zeros(15_000, [("time_stamp", "u4")])
    fields["time_stamp"] = np.tile(packet, 150)
    with pytest.raises(InputError, match="restart 149 times"):
        point_times(fields, STAMP_NS)
    ring = np.linspace(0, 99_000_000, 2000)  # of a sweep that is stored ring by ring
    fields["time_stamp"] = np.resize(ring, 15_000)
    assert np.ptp(point_times(fields, STAMP_NS).offsets_ns) == 99_000_000


def test_real_times_in_seconds_are_read(shared_data):
    path = shared_data / "raw" / "newer_college_deskew.npz"
    if not path.exists():
        pytest.skip(f"needs {path}")
    with np.load(path) as file:
        for number in range(3):
            values = file[f"times_{number}"]
            found = read("time", values)
            np.testing.assert_allclose(found.offsets_ns, values * 1e9, atol=1)
            assert found.meaning == "time [s] from the stamp"
