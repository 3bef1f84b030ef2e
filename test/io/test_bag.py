import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import random_records
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from ellipseg_ros.errors import InputError
from ellipseg_ros.io.bag import (
    BagSink,
    BagSweeps,
    msg_folder,
    node_types,
    read_messages,
)
from ellipseg_ros.io.pointcloud2 import labelled_fields, write_sweep
from ellipseg_ros.io.topics import BAG_TOPICS, CLOUD
from ellipseg_ros.records import Sweep

START_NS = 1_700_000_000 * 10**9


def sweeps(count=3, points=50):
    rng = np.random.default_rng(1)
    for k in range(count):
        xyz = rng.normal(scale=30.0, size=(points, 3)).astype(np.float32)
        fields = np.zeros(points, [(n, "f4") for n in "xyz"] + [("ring", "u2"), ("t", "u4")])
        for name, column in zip("xyz", xyz.T, strict=True):
            fields[name] = column
        fields["ring"] = rng.integers(0, 64, points)
        fields["t"] = np.arange(points) * 1000
        offsets = fields["t"].astype(np.int64)
        yield Sweep(START_NS + k * 10**8, xyz, offsets, fields, "map")


def write_ros2(path, storage=StoragePlugin.MCAP, topics=("/points",)):
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(path, version=9, storage_plugin=storage) as writer:
        connections = [writer.add_connection(t, CLOUD, typestore=store) for t in topics]
        text = "std_msgs/msg/String"
        other = writer.add_connection("/rosout", text, typestore=store)
        message = store.serialize_cdr(store.types[text](data="hello"), text)
        writer.write(other, START_NS - 1, message)
        for sweep in sweeps():
            for connection in connections:
                writer.write(connection, sweep.stamp_ns, write_sweep(sweep))
    return path


def write_ros1(path):
    store = get_typestore(Stores.ROS1_NOETIC)
    jazzy = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    with Writer1(path) as writer:
        connection = writer.add_connection("/points", CLOUD, typestore=store)
        for number, sweep in enumerate(sweeps()):
            msg = jazzy.deserialize_cdr(write_sweep(sweep), CLOUD)
            stamp = types["builtin_interfaces/msg/Time"](
                msg.header.stamp.sec, msg.header.stamp.nanosec
            )
            header = types["std_msgs/msg/Header"](number, stamp, msg.header.frame_id)
            old = types[CLOUD](
                header,
                msg.height,
                msg.width,
                [
                    types["sensor_msgs/msg/PointField"](f.name, f.offset, f.datatype, f.count)
                    for f in msg.fields
                ],
                msg.is_bigendian,
                msg.point_step,
                msg.row_step,
                msg.data,
                msg.is_dense,
            )
            writer.write(connection, sweep.stamp_ns, store.serialize_ros1(old, CLOUD))
    return path


def same(found, expected):
    found, expected = list(found), list(expected)
    assert len(found) == len(expected)
    for a, b in zip(found, expected, strict=True):
        assert (a.stamp_ns, a.frame_id) == (b.stamp_ns, b.frame_id)
        np.testing.assert_array_equal(a.points, b.points)
        np.testing.assert_array_equal(a.offsets_ns, b.offsets_ns)
        np.testing.assert_array_equal(a.fields, b.fields)
    return True


def storage_file(bag):
    (path,) = (p for p in bag.iterdir() if p.suffix in (".mcap", ".db3"))
    return path


def refused(call, reason):
    with pytest.raises(InputError) as error:
        call()
    assert error.value.reason == reason
    assert len(str(error.value).splitlines()) == 1
    return str(error.value)


@pytest.fixture(params=["ros1", "sqlite3", "mcap", "bare mcap", "bare db3", "no metadata"])
def bag(request, tmp_path):
    """The same three sweeps in every kind of bag."""
    if request.param == "ros1":
        return write_ros1(tmp_path / "old.bag")
    sqlite = request.param in ("sqlite3", "bare db3")
    path = write_ros2(tmp_path / "new", StoragePlugin.SQLITE3 if sqlite else StoragePlugin.MCAP)
    if request.param == "no metadata":
        (path / "metadata.yaml").unlink()
    return storage_file(path) if "bare" in request.param else path


def test_bags_of_every_format_can_be_iterated_repeatedly(bag):
    found = BagSweeps(bag)
    assert (found.topic, found.count, found.frame_id) == ("/points", 3, "map")
    assert found.duration == pytest.approx(0.2, abs=1e-6)
    assert same(found, sweeps())
    assert same(found, sweeps())


def test_truncated_bag_is_refused_in_one_line(bag):
    path = storage_file(bag) if bag.is_dir() else bag
    whole = path.read_bytes()
    for size in (0, 5, len(whole) // 2, len(whole) - 20):
        path.write_bytes(whole[:size])
        refused(lambda: list(BagSweeps(bag)), "bad_bag")


def test_damaged_bag_is_refused_in_one_line(bag):
    path = storage_file(bag) if bag.is_dir() else bag
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    refusals = []
    for _ in range(40):
        damaged = bytearray(whole)
        start = rng.integers(len(whole))
        damaged[start : start + 200] = rng.bytes(len(damaged[start : start + 200]))
        path.write_bytes(damaged)
        try:
            list(BagSweeps(bag))
        except InputError as error:
            refusals.append(str(error))
    assert refusals and all(len(text.splitlines()) == 1 for text in refusals)


def test_topic_must_exist_and_be_given_if_there_are_several(tmp_path):
    bag = write_ros2(tmp_path / "two", topics=("/front", "/rear"))
    assert "/front, /rear" in refused(lambda: BagSweeps(bag), "no_topic")
    assert "/front, /rear" in refused(lambda: BagSweeps(bag, "/side"), "no_topic")
    assert "/front, /rear" in refused(lambda: BagSweeps(bag, "/rosout"), "no_topic")
    assert BagSweeps(bag, "/rear").topic == BagSweeps(bag, "rear").topic == "/rear"
    none = write_ros2(tmp_path / "none", topics=())
    assert "/rosout" in refused(lambda: BagSweeps(none), "no_topic")


def test_topic_without_messages_is_refused(tmp_path):
    with Writer(tmp_path / "silent", version=9) as writer:
        writer.add_connection("/points", CLOUD, typestore=node_types())
    refused(lambda: BagSweeps(tmp_path / "silent"), "empty")


def test_invalid_cloud_is_named_by_its_number(tmp_path):
    good, bad = list(sweeps(2))
    store = get_typestore(Stores.ROS2_JAZZY)
    with BagSink(tmp_path / "bag") as sink:
        sink.write_event(good)
        msg = store.deserialize_cdr(write_sweep(bad), CLOUD)
        msg.data = msg.data[:10]
        sink.write("/points", bad.stamp_ns, bytes(store.serialize_cdr(msg, CLOUD)))
    text = refused(lambda: list(BagSweeps(tmp_path / "bag")), "short_data")
    assert text.startswith("message 1 of /points in ")


def test_folders_without_a_bag_are_refused(tmp_path):
    (tmp_path / "empty").mkdir()
    refused(lambda: BagSweeps(tmp_path / "empty"), "bad_bag")
    several = write_ros2(tmp_path / "several")
    shutil.copy(storage_file(several), several / "other.mcap")
    (several / "metadata.yaml").unlink()
    refused(lambda: BagSweeps(several), "bad_bag")
    refused(lambda: BagSweeps(tmp_path / "missing.bag"), "bad_bag")


def test_written_bag_holds_the_messages_of_the_node(tmp_path):
    found = [
        random_records.segmentation(sequence=k, end_ns=START_NS + k * 10**9) for k in range(2)
    ]
    with BagSink(tmp_path / "out") as sink:
        for sweep in sweeps():
            sink.write_event(sweep)
        for update in found:
            sink.write_update(update)
    assert os.listdir(tmp_path) == ["out"]
    assert same(BagSweeps(tmp_path / "out", "points"), sweeps())
    windows = list(BagSweeps(tmp_path / "out", "segmented_points"))
    for window, update in zip(windows, found, strict=True):
        np.testing.assert_array_equal(window.fields, labelled_fields(update))
    with Reader(tmp_path / "out") as reader:
        assert all(c.msgtype == BAG_TOPICS[c.topic].type for c in reader.connections)
        assert {c.topic: c.msgcount for c in reader.connections} == {
            "/points": 3,
            "/segmented_points": 2,
            "/ellipsoids": 2,
            "/landmarks": 2,
            "/segments": 2,
        }
        chosen = [c for c in reader.connections if c.topic == "/segments"]
        read = [
            node_types().deserialize_cdr(raw, c.msgtype) for c, _, raw in reader.messages(chosen)
        ]
    assert [message.sequence for message in read] == [0, 1]
    assert len(read[0].segments) == len(found[0].ids)


def test_bag_is_complete_after_every_update(tmp_path):
    whole = tmp_path / "out"
    with BagSink(whole) as sink:
        assert refused(lambda: BagSweeps(whole), "no_topic")
        for k in range(20):
            sink.write_update(random_records.segmentation(sequence=k, end_ns=START_NS + k * 10**9))
            seen = shutil.copytree(whole, tmp_path / f"seen_{k}")  # as a kill would leave it
            assert [m.sequence for _, m in read_messages(seen, "/segments")] == list(range(k + 1))
            assert len(list(BagSweeps(seen, "/segmented_points"))) == k + 1
            with Reader(seen) as reader:
                assert 0.8 * reader.message_count <= 4 * (k + 1) <= 1.2 * reader.message_count + 4
                assert sum(1 for _ in reader.messages()) == 4 * (k + 1)


def test_clouds_without_updates_are_flushed_every_few_megabytes(tmp_path):
    rng = np.random.default_rng(0)
    with BagSink(tmp_path / "out") as sink:
        for k in range(10):
            xyz = rng.normal(size=(100_000, 3)).astype(np.float32)
            sink.write_event(Sweep(START_NS + k, xyz, frame_id="map"))
        seen = shutil.copytree(tmp_path / "out", tmp_path / "seen")
    assert 5 <= len(list(BagSweeps(seen))) <= 10


def write_and(path, then):
    with BagSink(path) as sink:
        sink.write_event(next(sweeps()))
        then()


def test_failed_write_removes_the_bag(tmp_path):
    with pytest.raises(ZeroDivisionError):
        write_and(tmp_path / "deep" / "out", lambda: 1 / 0)
    assert os.listdir(tmp_path / "deep") == []


def test_existing_bag_is_never_overwritten(tmp_path):
    (tmp_path / "there").mkdir()
    refused(lambda: BagSink(tmp_path / "there"), "exists")


def test_unwritable_path_is_refused_in_one_line(tmp_path):
    (tmp_path / "file").touch()
    refused(lambda: BagSink(tmp_path / "file" / "out").__enter__(), "write")
    late = tmp_path / "late"
    sink = BagSink(late)
    (late / "full").mkdir(parents=True)
    refused(sink.__enter__, "write")
    assert sorted(os.listdir(tmp_path)) == ["file", "late"] and os.listdir(late) == ["full"]


def test_message_definitions_are_found_in_checkout_and_installation(tmp_path):
    assert {
        "ellipseg_ros/msg/Segment",
        "ellipseg_ros/msg/SegmentArray",
    } <= node_types().types.keys()
    checkout = Path(__file__).parents[2]
    assert msg_folder(checkout / "ellipseg_ros") == checkout / "msg"
    installed = tmp_path / "share" / "ellipseg_ros" / "msg"
    shutil.copytree(checkout / "msg", installed)
    for lib in ("lib/python3.12/site-packages", "local/lib/python3.12/dist-packages"):
        package = tmp_path / lib / "ellipseg_ros"
        assert msg_folder(package) == installed
