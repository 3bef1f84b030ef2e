"""The doctor and its graph probe with real nodes."""

import json
import time
from contextlib import contextmanager
from dataclasses import replace

import pytest
from node_kit import SECOND, peer, running, wall
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from ellipseg_ros.cli.main import main
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.pointcloud2 import write_sweep
from ellipseg_ros.msg import SegmentArray
from ellipseg_ros.ros.graph_probe import GraphProbe

NODE = "/ellipseg_segmenter"


@pytest.fixture(scope="module")
def domain(session_ros_domain):
    return session_ros_domain


@contextmanager
def stream(domain, topic, reliability=ReliabilityPolicy.RELIABLE, frame_id="odom"):
    """Somebody publishes ten clouds per second, with stamps of now."""
    with peer(domain) as me:
        qos = QoSProfile(depth=10, reliability=reliability)
        publisher = me.node.create_publisher(PointCloud2, topic, qos)
        sweep = wall(0.0, frame_id=frame_id)

        def send():
            publisher.publish(write_sweep(replace(sweep, stamp_ns=time.time_ns())))

        me.node.create_timer(0.1, send)
        yield me


@pytest.fixture
def examine(capsys):
    """Run the doctor; what it says of the graph, and its exit code."""

    def run(*words):
        code = main(["doctor", "--json", "--no-speed", *words])
        rows = json.loads(capsys.readouterr().out)
        return code, [row for row in rows if row["section"] == "graph"]

    return run


def told(rows, text):
    (row,) = [row for row in rows if text in row["text"]]
    return row["level"]


def test_empty_graph_is_reported(domain, examine):
    code, rows = examine("--seconds", "0.2")
    assert code == 1
    assert told(rows, "there is no other node") == "warn"
    assert told(rows, "/points has no publisher") == "error"


def test_sensor_clouds_on_another_topic(domain, examine):
    with stream(domain, "/velodyne_points", ReliabilityPolicy.BEST_EFFORT, "velodyne"):
        code, rows = examine("--seconds", "0.2")
        assert code == 1
        (nobody,) = [row for row in rows if "/points has no publisher" in row["text"]]
        assert "-r points:=/velodyne_points" in nobody["remedy"]

        code, rows = examine("--seconds", "1.5", "--topic", "velodyne_points")
        assert code == 0
        assert told(rows, "frame velodyne is probably that of a sensor") == "warn"
        assert told(rows, "fields x, y, z") == "ok"
        assert told(rows, "clouds per second") in ("ok", "warn")  # as busy as the machine is
        assert told(rows, "no segmenter runs") == "warn"


def test_topic_of_another_type(domain, examine):
    with peer(domain) as me:
        me.node.create_publisher(String, "/points", 10)
        code, rows = examine("--seconds", "0.2")
    assert code == 1
    assert told(rows, "/points is published as std_msgs/msg/String") == "error"


def test_played_bag_is_not_a_segmenter(domain, examine):
    with stream(domain, "/points") as me:
        me.node.create_publisher(SegmentArray, "/segments", 10)
        _, rows = examine("--seconds", "0.5")
    assert told(rows, "no segmenter runs") == "warn"


def test_working_node(domain, examine, tmp_path):
    names = ["-r", "points:=cloud_registered"]
    with (
        running("segmenter_node", names, tmp_path / "log") as process,
        stream(domain, "/cloud_registered") as me,
    ):
        segments = me.subscribe(SegmentArray, "/segments", raw=True)
        segments.wait_for(1)
        code, rows = examine("--seconds", "6")
        assert told(rows, "/cloud_registered is published by /peer") == "ok"
        assert told(rows, f"{NODE} reports: ") in ("ok", "warn")
        assert told(rows, f"subscribers of {NODE}: segments by /peer") == "ok"
        assert code == 0, rows

        _, rows = examine("--seconds", "0.2", "--namespace", "/elsewhere")
        assert told(rows, "no segmenter runs in the namespace /elsewhere") == "warn"
        with running("segmenter_node", names, tmp_path / "twin"):
            wait_for_nodes(me, 2)
            code, rows = examine("--seconds", "3")
        assert code == 1
        assert told(rows, "several nodes are named") == "error"
        assert process.alive()


def wait_for_nodes(me, count):
    """Wait until so many nodes have the segmenter's name."""
    end = time.monotonic() + 60.0
    while me.node.get_node_names().count(NODE[1:]) < count:
        assert time.monotonic() < end, "no second node"
        time.sleep(0.05)  # the graph tells of no change


def test_incompatible_qos(domain, examine, tmp_path):
    reliable = ["-p", "input_reliability:=reliable"]
    with (
        running("segmenter_node", reliable, tmp_path / "log"),
        stream(domain, "/points", ReliabilityPolicy.BEST_EFFORT) as me,
    ):
        end = time.monotonic() + 120.0
        while not me.node.count_subscribers("/points"):
            assert time.monotonic() < end, "the node is not ready"
            time.sleep(0.05)  # of a subscriber that does not match, no event tells
        code, rows = examine("--seconds", "2.5")
    assert code == 1
    (row,) = [row for row in rows if "incompatible QoS" in row["text"]]
    assert f"/peer to {NODE}: " in row["text"] and "best effort" in row["text"]
    assert told(rows, "no cloud yet") == "warn"


def test_snapshot_describes_the_received_clouds(domain):
    with stream(domain, "/front/points"), GraphProbe("", "/front") as observer:
        graph = observer.probe(4.0)
    assert graph.topic.name == "/front/points"
    assert [end.qos for end in graph.topic.publishers] == ["reliable, volatile"]
    assert len(graph.clouds) >= 5
    for cloud in graph.clouds:
        assert (cloud.frame_id, cloud.points, cloud.finite) == ("odom", 400, 400)
        assert -0.1 < cloud.age < 5.0 and not cloud.problem
        assert cloud.stamp_ns // SECOND == pytest.approx(time.time(), abs=60)
    message = deserialize_message(write_sweep(wall(0.0)), PointCloud2)
    message.width += 1
    observer._on_cloud(message)
    assert "bytes" in observer._clouds[-1].problem or "row_step" in observer._clouds[-1].problem


@pytest.mark.parametrize("names", [("", "no slash"), ("a//b", "/")])
def test_invalid_names_are_an_error(domain, names):
    with pytest.raises(EllipsegError, match="no ROS node can be started"):
        GraphProbe(*names)
