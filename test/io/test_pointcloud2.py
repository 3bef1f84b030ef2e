import array
import struct
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import random_records
from hypothesis import given, settings
from hypothesis import strategies as st

from ellipseg_ros.errors import InputError
from ellipseg_ros.io.bag import node_types
from ellipseg_ros.io.pointcloud2 import read_sweep, write_cloud, write_labelled, write_sweep
from ellipseg_ros.io.topics import CLOUD
from ellipseg_ros.records import Sweep

CODES = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 8: "d"}  # of struct
STAMP = SimpleNamespace(sec=1_700_000_000, nanosec=5)
STAMP_NS = 1_700_000_000_000_000_005


def field(name, offset, datatype=7, count=1):
    return SimpleNamespace(name=name, offset=offset, datatype=datatype, count=count)


X, Y, Z = field("x", 0), field("y", 4), field("z", 8)


def cloud(fields, data, width, **changes):
    """Anything with the fields of a PointCloud2."""
    made_up = {
        "header": SimpleNamespace(stamp=STAMP, frame_id="odom"),
        "height": 1,
        "width": width,
        "fields": fields,
        "is_bigendian": False,
        "point_step": 12,
        "row_step": 12 * width,
        "data": data,
        "is_dense": True,
    }
    return SimpleNamespace(**(made_up | changes))


def xyz_cloud(points=2, **changes):
    data = np.arange(3 * points, dtype="<f4").tobytes()
    return cloud([X, Y, Z], data, points, **changes)


def serialized(message):
    return node_types().deserialize_cdr(message, CLOUD)


def test_unused_data_of_a_message_is_not_kept():
    plain = xyz_cloud(points=100)
    assert not read_sweep(plain).fields.flags.owndata  # a copy would cost time, and save nothing
    heavy = read_sweep(cloud([X, Y, Z], plain.data + bytes(10**6), 100))
    assert heavy.fields.base is None and heavy.fields.nbytes == 1200
    assert heavy.fields.tobytes() == read_sweep(plain).fields.tobytes()


# --- reading, against a reader that takes one number at a time -----------------------------------


def naive_values(msg, name):
    """The values of a field, a list per point, as PointCloud2's definition says."""
    (wanted,) = [f for f in msg.fields if f.name == name]
    code = (">" if msg.is_bigendian else "<") + CODES[wanted.datatype]
    size = struct.calcsize(code)
    return [
        [
            struct.unpack_from(
                code,
                msg.data,
                row * msg.row_step + column * msg.point_step + wanted.offset + k * size,
            )[0]
            for k in range(max(1, wanted.count))
        ]
        for row in range(msg.height)
        for column in range(msg.width)
    ]


@st.composite
def clouds(draw):
    """Any layout: order, gaps, types, counts, both byte orders, organised, padded rows."""
    others = draw(st.lists(st.sampled_from(["intensity", "ring", "rgb", "normal"]), unique=True))
    kinds = {name: (draw(st.sampled_from([7, 8])), 1) for name in "xyz"}
    kinds |= {name: (draw(st.integers(1, 8)), draw(st.integers(0, 3))) for name in others}
    fields, end = [], 0
    for name in draw(st.permutations(list(kinds))):
        datatype, count = kinds[name]
        offset = end + draw(st.integers(0, 3))
        fields.append(field(name, offset, datatype, count))
        end = offset + max(1, count) * struct.calcsize("<" + CODES[datatype])
    height, width = draw(st.integers(1, 3)), draw(st.integers(1, 5))
    point_step = end + draw(st.integers(0, 5))
    row_step = width * point_step + draw(st.integers(0, 7))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    data = rng.integers(0, 256, height * row_step, dtype=np.uint8)
    held = draw(st.sampled_from([bytes, np.array, lambda d: array.array("B", bytes(d))]))
    return cloud(
        draw(st.permutations(fields)),
        held(data),  # as tests, rosbags and rclpy hold it
        width,
        height=height,
        point_step=point_step,
        row_step=row_step,
        is_bigendian=draw(st.booleans()),
    )


@given(clouds())
@settings(max_examples=200, deadline=None)
def test_every_layout_is_read_like_by_the_naive_reader(msg):
    sweep = read_sweep(msg)
    assert sweep.stamp_ns == STAMP_NS and sweep.frame_id == "odom"
    for column, name in enumerate("xyz"):
        expected = np.array(naive_values(msg, name))[:, 0]
        np.testing.assert_array_equal(sweep.points[:, column], expected)
    for f in msg.fields:
        values = sweep.fields[f.name].reshape(len(sweep), -1)
        np.testing.assert_array_equal(values, naive_values(msg, f.name))
        kind, place = sweep.fields.dtype.fields[f.name][:2]
        assert place == f.offset and kind.base.isnative
    assert sweep.fields.dtype.itemsize == msg.point_step


def test_plain_cloud_is_not_copied():
    msg = cloud([X, Y, Z], np.arange(6, dtype="<f4").view(np.uint8), 2)
    assert np.shares_memory(read_sweep(msg).fields, msg.data)


def test_large_coordinates_keep_full_precision():
    points = np.array([[456_789.123, 5_400_000.0 + 2.0**-10, 312.5], [np.nan, np.inf, -0.0]])
    sweep = read_sweep(serialized(write_sweep(Sweep(7, points))))
    np.testing.assert_array_equal(sweep.points, points)


@pytest.mark.parametrize(
    "msg",
    [
        cloud([], b"", 0, point_step=0, row_step=0),
        cloud([], b"", 0, height=0, point_step=0, row_step=0),
        xyz_cloud(points=0),
        xyz_cloud(points=0, point_step=0),
        xyz_cloud(points=0, height=5),
    ],
)
def test_empty_cloud_is_an_empty_sweep(msg):
    sweep = read_sweep(msg)
    assert len(sweep) == 0 and sweep.stamp_ns == STAMP_NS


def test_row_step_of_a_single_row_and_padding_of_the_last_row_are_ignored():
    assert len(read_sweep(xyz_cloud(row_step=0))) == 2
    data = np.arange(7, dtype="<f4").tobytes()  # 12 + 4 + 12 bytes
    msg = cloud([field(n, 4 * k) for k, n in enumerate("xyz")], data, 1, height=2, row_step=16)
    assert read_sweep(msg).points.tolist() == [[0.0, 1.0, 2.0], [4.0, 5.0, 6.0]]


def test_fields_that_pcl_names_as_padding_are_gaps():
    fields = [
        field("x", 0),
        field("_", 4, 2, 4),
        field("y", 8),
        field("", 12, 2),
        field("", 13, 2),
    ]
    msg = cloud([*fields, field("z", 16)], bytes(20), 1, point_step=20)
    assert read_sweep(msg).fields.dtype.names == ("x", "y", "z")


@pytest.mark.parametrize(
    ("reason", "msg"),
    [
        ("no_xyz", cloud([], bytes(12), 1)),
        ("no_xyz", cloud([X, Y], bytes(12), 1)),
        ("no_xyz", cloud([X, Y], b"", 0)),
        ("xyz_type", cloud([X, Y, field("z", 8, 6)], bytes(12), 1)),
        ("xyz_type", cloud([X, field("y", 4, 3), Z], bytes(12), 1)),
        ("xyz_type", cloud([X, Y, field("z", 8, 7, 2)], bytes(16), 1, point_step=16)),
        ("field_twice", cloud([X, Y, Z, X], bytes(12), 1)),
        ("datatype", cloud([X, Y, field("z", 8, 0)], bytes(12), 1)),
        ("datatype", cloud([X, Y, Z, field("id", 0, 9)], bytes(12), 1)),
        ("point_step", cloud([X, Y, Z], bytes(12), 1, point_step=0)),
        ("point_step", cloud([X, Y, field("z", 9)], bytes(12), 1)),
        ("point_step", cloud([X, Y, Z, field("n", 0, 8, 2**32 - 1)], bytes(12), 1)),
        ("point_step", cloud([X, Y, Z, field("n", 0, 8, 2**32 - 1)], b"", 0)),
        ("point_step", cloud([X, Y, Z], b"", 0, point_step=2**32 - 1)),
        ("point_step", cloud([X, Y, Z], bytes(12), 1, point_step=2**32 - 1)),
        ("short_data", cloud([X, Y, Z], bytes(11), 1)),
        ("short_data", cloud([X, Y, Z], b"", 2**32 - 1, height=2**32 - 1, row_step=2**36)),
        ("short_data", cloud([X, Y, Z], bytes(12), 1, point_step=1000)),
        ("row_step", cloud([X, Y, Z], bytes(48), 2, height=2, row_step=12)),
    ],
)
def test_invalid_cloud_is_refused_in_one_line(reason, msg):
    with pytest.raises(InputError) as error:
        read_sweep(msg)
    assert error.value.reason == reason
    assert len(str(error.value).splitlines()) == 1


# --- times ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("t", np.array([0, 99_000_000], np.uint32)),  # Ouster
        ("time", np.array([0.0, 0.099], np.float32)),  # Velodyne
        ("time_stamp", np.array([0, 99_000_000], np.uint32)),  # Autoware
        ("offset_time", np.array([0, 99_000_000], np.uint32)),  # Livox
        ("timestamp", 1_700_000_000.0 + np.array([0.0, 0.099])),  # Hesai, RoboSense
        ("timestamp", 1.7e18 + np.array([0.0, 99e6])),  # Livox
        ("timestamp", np.array([0.0, 0.099])),
        ("timestamp", 1_700_000_000.0 + np.array([0.0, 0.099, *[0.0] * 18, 999.0, np.nan])),
    ],
)
def test_times_of_common_drivers_are_read(name, values):
    sweep = with_field(name, values)
    assert np.abs(sweep.offsets_ns[:2] - [0, 99_000_000]).max() < 1000
    assert not sweep.offsets_ns[2:].any()


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("intensity", np.array([1.0, 2.0])),
        ("t", np.array([11e9, 40e9])),
        ("t", np.array([1, 2], np.uint8)),
        ("time", np.array([np.nan, np.nan], np.float32)),
        ("time", np.array([1e38, -1e38], np.float32)),
        ("timestamp", np.array([1e308, -np.inf])),
    ],
)
def test_invalid_times_give_the_time_of_the_stamp(name, values):
    assert not with_field(name, values).offsets_ns.any()


def with_field(name, values):
    fields = np.zeros(len(values), [(n, "f4") for n in "xyz"] + [(name, values.dtype)])
    fields[name] = values
    stamp_ns = 1_700_000_000 * 10**9
    return read_sweep(serialized(write_cloud(fields, stamp_ns, "odom")))


# --- writing -------------------------------------------------------------------------------------


@given(st.integers(0, 2**32), st.booleans())
@settings(max_examples=50, deadline=None)
def test_sweep_survives_a_round_trip(seed, with_fields):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(0, 6))
    points = rng.normal(scale=100.0, size=(n, 3))
    fields = None
    if with_fields:
        points = points.astype(np.float32)
        layout = {"names": ["z", "a", "x", "y"], "formats": ["f4", ("u2", (2,)), "f4", "f4"]}
        fields = np.zeros(n, np.dtype(layout | {"offsets": [3, 9, 16, 20], "itemsize": 27}))
        for name, column in zip("xyz", points.T, strict=True):
            fields[name] = column
        fields["a"] = rng.integers(0, 99, (n, 2))
    sweep = Sweep(STAMP_NS, points, rng.integers(-(10**10), 10**10, n), fields, "map")
    back = read_sweep(serialized(write_sweep(sweep)))
    assert (back.stamp_ns, back.frame_id) == (STAMP_NS, "map")
    np.testing.assert_array_equal(back.points, sweep.points)
    np.testing.assert_array_equal(back.offsets_ns, sweep.offsets_ns)
    if with_fields:
        for name in fields.dtype.names:
            np.testing.assert_array_equal(back.fields[name], fields[name])
            assert back.fields.dtype.fields[name] == fields.dtype.fields[name]


def labelled(found):
    """The message and its points."""
    msg = serialized(write_labelled(found))
    assert msg.height == 1 and msg.width == len(found.labels)
    assert msg.row_step == msg.point_step * msg.width == len(msg.data)
    return msg, read_sweep(msg)


def test_all_points_are_written_with_id_and_colour():
    found = random_records.segmentation()
    msg, sweep = labelled(found)
    assert (msg.header.frame_id, sweep.stamp_ns) == ("odom", found.end_ns)
    np.testing.assert_array_equal(sweep.points, found.points)
    expected = [found.ids[row] if row >= 0 else 0 for row in found.labels]
    np.testing.assert_array_equal(sweep.fields["label"], expected)
    rgb = sweep.fields["rgb"].copy().view(np.uint32)
    assert [f.datatype for f in msg.fields if f.name == "rgb"] == [7]  # as RViz wants it
    grey = rgb[sweep.fields["label"] == 0]
    assert {(int(c) >> 16, int(c) >> 8 & 255, int(c) & 255) for c in grey} == {(110, 110, 110)}
    for label in (1, 2):
        (colour,) = set(rgb[sweep.fields["label"] == label])
        assert colour != grey[0]
    assert len(set(rgb)) == 21  # 20 segments differ


def test_input_fields_are_kept_and_only_reserved_names_change():
    names = ["label", "x", "y", "z", "rgb", "object", "input_rgb"]
    formats = ["f4", "f8", "f8", "f8", "f4", "u1", "u4"]
    offsets = [0, 8, 16, 24, 32, 36, 40]
    layout = {"names": names, "formats": formats, "offsets": offsets, "itemsize": 49}
    fields = np.zeros(400, np.dtype(layout))
    fields.view(np.uint8)[:] = np.random.default_rng(0).integers(0, 64, fields.nbytes)
    found = random_records.segmentation(fields=fields)
    msg, sweep = labelled(found)
    renamed = {"label": "input_label", "rgb": "input_input_rgb", "object": "input_object"}
    for name in names:
        now = renamed.get(name, name)
        np.testing.assert_array_equal(sweep.fields[now], fields[name])
        assert sweep.fields.dtype.fields[now] == fields.dtype.fields[name]
    assert sweep.fields.dtype.names[-3:] == ("label", "object", "rgb")
    raw = np.asarray(msg.data).reshape(400, -1)[:, :49]
    np.testing.assert_array_equal(raw, fields.view(np.uint8).reshape(400, 49))  # gaps, too


def test_points_without_fields_are_float32_unless_the_error_is_a_millimetre():
    near = random_records.segmentation()
    assert labelled(near)[1].fields.dtype["x"] == np.float32
    utm = replace(near, points=near.points + 5e6)
    _, sweep = labelled(utm)
    assert sweep.fields.dtype["x"] == np.float64
    np.testing.assert_array_equal(sweep.points, utm.points)


def test_cloud_with_nan_is_marked_as_not_dense():
    found = random_records.segmentation()
    assert labelled(found)[0].is_dense
    points = found.points.copy()
    points[3, 1] = np.nan
    assert not labelled(replace(found, points=points))[0].is_dense


def test_types_without_point_field_become_wider_ones():
    fields = np.zeros(2, [("x", "f2"), ("y", "f4"), ("z", "f4"), ("n", "i8"), ("ok", "?")])
    fields["n"] = [2**53, -1]
    fields["ok"] = [True, False]
    back = read_sweep(serialized(write_sweep(Sweep(0, np.zeros((2, 3)), fields=fields)))).fields
    assert back["n"].tolist() == [2**53, -1] and back["ok"].tolist() == [1, 0]
    with pytest.raises(InputError, match="name"):
        write_sweep(Sweep(0, np.zeros((1, 3)), fields=np.zeros(1, [("name", "U3")])))
