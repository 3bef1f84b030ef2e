"""The segmenter in a process of its own, over DDS: outputs, parameters, services, shutdown."""

import itertools
import signal
from contextlib import contextmanager
from dataclasses import replace
from functools import reduce
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from node_kit import LIMIT, SECOND, nanoseconds, parameters, peer, running, wall
from rcl_interfaces.msg import ParameterType
from rclpy.qos import ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import PointCloud2, PointField
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from ellipseg_ros.config import Config, NodeConfig, PlacementConfig
from ellipseg_ros.io.messages import write_segments
from ellipseg_ros.io.pointcloud2 import read_fields, write_labelled, write_sweep
from ellipseg_ros.io.topics import ELLIPSOIDS
from ellipseg_ros.msg import SegmentArray
from ellipseg_ros.node.grouping import updates
from ellipseg_ros.ros import segmenter_node
from ellipseg_ros.ros.process import Spinner
from ellipseg_ros.ros.replayer import Replayer, ReplayOptions
from ellipseg_ros.ros.segmenter_node import SegmenterNode
from ellipseg_ros.segmenter import Segmenter
from ellipseg_ros.settings import iterate_settings
from ellipseg_ros.simulation.simulator import simulate

NODE = "/ellipseg_segmenter"
STOP_WITHIN = 10.0  # s; it takes less than one on an idle machine


def actions(array):
    return [marker.action for marker in array.markers]


@pytest.fixture(scope="module")
def domain(session_ros_domain):
    return session_ros_domain


# --- a replay, and the same clouds offline ---------------------------------------------------


@pytest.fixture(scope="module")
def drive():
    """A drive, the same again (its stamps jump back), and once more in another frame."""
    sweeps = list(simulate("industrial", duration=4.0))
    return [*sweeps, *sweeps, *(replace(sweep, frame_id="map") for sweep in sweeps)]


@pytest.fixture(scope="module")
def replayed(domain, drive, tmp_path_factory):
    """What a node in a namespace publishes of the drive, on topics with other names."""
    names = ["-r", "__ns:=/car_1", "-r", "points:=cloud_registered"]
    settings = {
        "max_backlog": 0,
        "input_reliability": "reliable",
        "input_depth": 1000,
        "update_period": 0.5,
        "window_duration": 3,  # an integer for a double
    }
    log = tmp_path_factory.mktemp("replayed") / "log"
    with (
        running("segmenter_node", [*names, *parameters(**settings)], log) as process,
        peer(domain) as me,
    ):
        segments = me.subscribe(SegmentArray, "/car_1/segments", raw=True)
        clouds = me.subscribe(PointCloud2, "/car_1/segmented_points", raw=True)
        markers = me.subscribe(MarkerArray, "/car_1/ellipsoids")
        me.publish(PointCloud2, "/car_1/cloud_registered")  # waits until the node is ready
        markers.wait_for(1)  # of its greeting: it knows of us
        options = ReplayOptions(rate=0.0, ahead=1.0, update_period=0.5, update_timeout=60.0)
        with Replayer(drive, options, ["--ros-args", *names], domain=domain) as replayer:
            summary = replayer.run()
        for inbox in (segments, clouds, markers):
            inbox.wait_for(summary.updates)
        process.signal(signal.SIGINT)
        code = process.wait(STOP_WITHIN)
        markers.wait(lambda m: actions(m) == [Marker.DELETEALL], start=1)
        return SimpleNamespace(
            summary=summary,
            segments=segments.messages,
            clouds=clouds.messages,
            markers=markers.messages,
            code=code,
            output=process.output,
        )


@pytest.fixture(scope="module")
def offline(drive):
    """The segmentation of every update, without a node; the last one is not closed by a stamp."""
    config = Config(update_period=0.5, window_duration=3.0)
    segmenter = Segmenter(config)
    return [segmenter.process(group) for group in updates(drive, config)][:-1]


def test_node_makes_the_offline_updates(replayed, offline):
    assert len(replayed.segments) == len(offline) == replayed.summary.updates
    assert len(replayed.clouds) == len(offline)
    assert replayed.summary.missed == 0


def test_segments_equal_the_offline_ones_bit_for_bit(replayed, offline):
    assert replayed.segments == [write_segments(found) for found in offline]
    messages = [deserialize_message(data, SegmentArray) for data in replayed.segments]
    for message, found in zip(messages, offline, strict=True):
        assert [segment.id for segment in message.segments] == sorted(found.ids)
        assert message.segmented == found.counts.segmented > 0


def test_clouds_equal_the_offline_ones_bit_for_bit(replayed, offline):
    assert replayed.clouds == [write_labelled(found) for found in offline]
    for data, found in zip(replayed.clouds, offline, strict=True):
        points = read_fields(deserialize_message(data, PointCloud2))
        assert np.array_equal(points["label"], found.point_ids)
        for name in found.fields.dtype.names:
            assert np.array_equal(points[name], found.fields[name])


def test_ids_are_not_reused_after_a_restart_and_old_ones_are_removed(replayed, offline):
    messages = [deserialize_message(data, SegmentArray) for data in replayed.segments]
    restarts = [k for k, found in enumerate(offline) if found.restart]
    assert len(restarts) == 2
    for k in restarts:
        before, after = messages[k - 1 : k + 1]
        assert {segment.id for segment in before.segments} == set(after.removed)
        assert min(s.id for s in after.segments) > max(s.id for s in before.segments)


def test_restart_and_shutdown_delete_all_markers(replayed, offline):
    restarts = [found.end_ns for found in offline if found.restart]
    cleared = [m.markers[0].header for m in replayed.markers if Marker.DELETEALL in actions(m)]
    assert set(restarts) <= {nanoseconds(header.stamp) for header in cleared}
    assert actions(replayed.markers[-1]) == [Marker.DELETEALL]


def test_restarts_are_said_once_each_with_the_reason(replayed):
    assert replayed.output.count("the window restarts") == 2
    assert "the stamps jumped back by 3.900 s" in replayed.output
    assert "the frame changed from 'odom' to 'map'" in replayed.output


def test_an_interrupt_ends_the_node_in_peace(replayed):
    assert replayed.code == 0
    assert "Traceback" not in replayed.output


# --- a node with its defaults ----------------------------------------------------------------


@pytest.fixture(scope="module")
def node(domain, tmp_path_factory):
    """A node with its defaults, and a peer that hears it all."""
    log = tmp_path_factory.mktemp("node") / "log"
    with running("segmenter_node", [], log) as process, peer(domain) as me:
        yield SimpleNamespace(
            process=process,
            me=me,
            segments=me.subscribe(SegmentArray, "/segments"),
            clouds=me.subscribe(PointCloud2, "/segmented_points"),
            markers=me.subscribe(MarkerArray, "/ellipsoids"),
            diagnostics=me.subscribe(DiagnosticArray, "/diagnostics"),
            points=me.publish(PointCloud2, "/points"),
        )


_starts = itertools.count(1000, 1000)


@pytest.fixture
def start(node):
    """A stamp, s, for the first cloud of a test; the node's window is empty."""
    assert node.me.call(Trigger, f"{NODE}/reset").success
    return float(next(_starts))


def send(node, *stamps, **options):
    for stamp in stamps:
        node.points.send(wall(stamp, **options))


def update(node, stamp):
    """The segments of the update that the cloud of this stamp has closed."""
    return node.segments.wait_for_stamp(stamp)


def test_wall_is_published_on_every_topic(node, start):
    send(node, start, start + 1.0)
    found = update(node, start + 1.0)
    assert found.segmented + found.isolated == 800
    assert sum(segment.count for segment in found.segments) == found.segmented
    assert found.header.frame_id == "odom" and found.full
    stamp = found.header.stamp
    cloud = node.clouds.wait(lambda message: message.header.stamp == stamp)
    labels = read_fields(cloud)["label"]
    counts = {segment.id: segment.count for segment in found.segments}
    assert {label: np.sum(labels == label) for label in set(labels) - {0}} == counts
    array = node.markers.wait(lambda m: m.markers and m.markers[-1].header.stamp == stamp)
    drawn = {marker.id for marker in array.markers if marker.action == Marker.ADD}
    assert drawn == {number for number, count in counts.items() if count >= 12}
    assert {marker.ns for marker in array.markers if marker.action == Marker.ADD} == {"ellipsoids"}


def test_best_effort_publisher_is_received(node, start, domain):
    def heard(message):
        return nanoseconds(message.header.stamp) >= start * SECOND and message.segmented > 0

    with peer(domain) as other:
        points = other.publish(PointCloud2, "/points", ReliabilityPolicy.BEST_EFFORT)
        for second in range(0, 30, 2):  # such a publisher sends nothing twice: some may get lost
            points.send(wall(start + second))
            points.send(wall(start + second + 1.0))
            if node.segments.arrives(heard, 5.0):
                break
        assert node.segments.arrives(heard, 0.0)


def test_points_that_are_not_finite_are_counted(node, start):
    broken = wall(start + 1.0)
    broken.points[:7] = np.nan
    node.points.send(wall(start))
    node.points.send(broken)
    found = update(node, start + 1.0)
    assert found.rejected == 7
    assert found.segmented + found.isolated == 793


def test_every_setting_is_a_parameter_with_a_description(node):
    records = (Config(), NodeConfig(), PlacementConfig())
    settings = [setting for record in records for setting in iterate_settings(record)]
    names = [name for name, _, _ in settings]
    described = node.me.describe(NODE, *names)
    for (name, value, about), found in zip(settings, described, strict=True):
        assert about.about in found.description and about.unit in found.description
        assert found.read_only == (not about.live), name
        kinds = {str: "STRING", float: "DOUBLE", int: "INTEGER", bool: "BOOL"}
        assert found.type == getattr(ParameterType, f"PARAMETER_{kinds[type(value)]}")
        ranges = [*found.floating_point_range, *found.integer_range]
        assert [(r.from_value, r.to_value) for r in ranges] == (
            [] if about.low is None else [(about.low, about.high)]
        )


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("threshold", -0.5, "threshold is -0.5; it must be 0 or more, or -1 for the default"),
        ("graph__neighbours", 2, "Min: 3, Max: 64"),
        ("graph__neighbours", 10.5, "expected 'Type.INTEGER' got 'Type.DOUBLE'"),
        ("criterion", "shapes", "it must be one of shape, density, parsimony"),
        ("window_duration", "long", "expected 'Type.DOUBLE' got 'Type.STRING'"),
        ("input_depth", 5, "read-only parameter: input_depth"),
        ("max_points", 0, "read-only parameter: max_points"),
        ("max_backlog", 0, "read-only parameter: max_backlog"),
    ],
)
def test_invalid_value_is_refused_with_a_reason(node, name, value, reason):
    (before,) = node.me.get(NODE, name.replace("__", "."))
    (answer,) = node.me.set(NODE, **{name: value})
    assert not answer.successful
    assert reason in answer.reason and "\n" not in answer.reason
    assert node.me.get(NODE, name.replace("__", ".")) == [before]


def test_parameter_takes_effect_at_the_next_update(node, start):
    send(node, start, start + 1.0)
    assert update(node, start + 1.0).threshold == Config().tau
    (answer,) = node.me.set(NODE, threshold=6)  # an integer for a double
    assert answer.successful, answer.reason
    assert node.me.get(NODE, "threshold")[0].double_value == 6.0
    send(node, start + 2.0)
    assert update(node, start + 2.0).threshold == 6.0
    for answer in node.me.set(NODE, threshold=-1, criterion="density"):
        assert answer.successful, answer.reason
    send(node, start + 3.0)
    found = update(node, start + 3.0)
    assert (found.criterion, found.threshold) == ("density", Config(criterion="density").tau)
    assert node.me.set(NODE, criterion="shape")[0].successful


def test_marker_settings_take_effect_at_the_next_update(node, start):
    send(node, start, start + 1.0)
    seen = {segment.id for segment in update(node, start + 1.0).segments if segment.count >= 12}
    assert node.me.set(NODE, marker_min_count=1_000_000)[0].successful
    send(node, start + 2.0)
    stamp = update(node, start + 2.0).header.stamp
    array = node.markers.wait(lambda m: m.markers and m.markers[-1].header.stamp == stamp)
    assert set(actions(array)) == {Marker.DELETE}
    assert {marker.id for marker in array.markers} == seen
    assert node.me.set(NODE, marker_min_count=NodeConfig().marker_min_count)[0].successful


def test_reset_empties_the_window_and_ids_are_not_reused(node, start):
    send(node, start, start + 1.0)
    before = update(node, start + 1.0)
    heard = len(node.markers.messages)
    assert "ids are not reused" in node.me.call(Trigger, f"{NODE}/reset").message
    node.markers.wait(lambda m: actions(m) == [Marker.DELETEALL], start=heard)
    send(node, start + 2.0, start + 3.0)
    after = update(node, start + 3.0)
    assert after.segmented + after.isolated == 800
    assert set(after.removed) == {segment.id for segment in before.segments}
    assert min(s.id for s in after.segments) > max(s.id for s in before.segments)


def test_jump_back_restarts_the_window_and_deletes_markers(node, start):
    send(node, start, start + 1.0)
    update(node, start + 1.0)
    heard = len(node.markers.messages)
    send(node, start - 500.0, start - 499.0)
    after = update(node, start - 499.0)
    assert after.segmented + after.isolated == 800
    node.markers.wait(lambda m: Marker.DELETEALL in actions(m), start=heard)
    assert "the stamps jumped back by 501.000 s" in node.process.output
    assert int(node.diagnostics.wait_for_values(lambda *_: True)["restarts"]) > 0


def no_y(stamp):
    message = deserialize_message(write_sweep(wall(stamp)), PointCloud2)
    message.fields = [field for field in message.fields if field.name != "y"]
    return message


def too_short(stamp):
    message = deserialize_message(write_sweep(wall(stamp)), PointCloud2)
    message.data = message.data[:-1]
    return message


def integers(stamp):
    message = deserialize_message(write_sweep(wall(stamp)), PointCloud2)
    message.fields[0].datatype = PointField.INT32
    return message


def test_invalid_clouds_are_counted_by_reason(node, start):
    for bad in (no_y, too_short, integers, too_short):
        node.points.send(bad(start))
    send(node, start, start + 1.0)
    assert update(node, start + 1.0).segmented > 0
    found = node.diagnostics.wait_for_values(
        lambda _, values: values.get("clouds rejected") == "4"
    )
    assert found["clouds rejected: no_xyz"] == "1"
    assert found["clouds rejected: short_data"] == "2"
    assert found["clouds rejected: xyz_type"] == "1"
    assert "cloud rejected: the cloud has no field y" in node.process.output
    assert node.process.alive()


def test_only_invalid_clouds_is_an_error(node, start):
    node.points.send(no_y(start))
    node.diagnostics.wait_for_values(lambda level, _: level == DiagnosticStatus.ERROR)


def test_diagnostics_report_the_update(node, start):
    send(node, start, start + 1.0)
    found = update(node, start + 1.0)
    told = node.diagnostics.wait_for_values(
        lambda _, values: values["AICc"] == f"{found.aicc:.1f}"
    )
    assert told["points segmented"] == str(found.segmented)
    assert told["points isolated"] == str(found.isolated)
    assert told["segments"] == str(len(found.segments))
    assert (told["criterion"], told["threshold"]) == ("shape", f"{Config().tau:g}")
    assert told["updates in backlog"] == "0"
    for name in ("latency", "processing"):
        assert 0.0 < float(told[f"{name} median [s]"]) <= float(told[f"{name} p99 [s]"])
    assert float(told["latency median [s]"]) > float(told["processing median [s]"])


def test_sensor_frame_is_processed_with_one_warning(node, start):
    stamps = [start, start + 1.0, start + 2.0]
    send(node, *stamps, frame_id="velodyne")
    assert update(node, start + 2.0).segmented > 0
    assert node.process.output.count("PROBABLY THAT OF A SENSOR") == 1
    node.diagnostics.wait_for_values(lambda level, _: level == DiagnosticStatus.WARN)
    send(node, start + 3.0, start + 4.0)  # odom again
    assert update(node, start + 4.0).segmented > 0
    node.diagnostics.wait_for_values(lambda level, _: level == DiagnosticStatus.OK)


def test_late_subscriber_gets_every_marker(node, start, domain):
    send(node, start, start + 1.0)
    wanted = {s.id for s in update(node, start + 1.0).segments if s.count >= 12}
    with peer(domain) as late:
        array = late.subscribe(MarkerArray, "/ellipsoids").wait(lambda m: m.markers)
    assert array.markers[0].action == Marker.DELETEALL  # it may show those of a killed node
    assert {marker.id for marker in array.markers if marker.action == Marker.ADD} == wanted


def test_sigterm_deletes_markers_and_ends_cleanly(node, start):
    send(node, start, start + 1.0)
    update(node, start + 1.0)
    heard = len(node.markers.messages)
    node.process.signal(signal.SIGTERM)
    assert node.process.wait(STOP_WITHIN) == 0
    node.markers.wait(lambda m: actions(m) == [Marker.DELETEALL], start=heard)
    assert "Traceback" not in node.process.output


# --- a node in this process ------------------------------------------------------------------


@pytest.fixture
def inside(domain):
    """A node in this process, whose callbacks only run while a Spinner runs them."""
    ended = []
    names = ["-r", "__ns:=/inside", "-p", "input_depth:=5"]
    arguments = ["--ros-args", *names, "--log-level", "warn"]
    rclpy.init(args=arguments, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    running = SegmenterNode(ended.append)
    yield running
    assert running.close()
    running.node.destroy_node()
    rclpy.shutdown()
    assert ended == []


@contextmanager
def spinning(running):
    spinner = Spinner(running.node, lambda error: None)
    try:
        yield
    finally:
        spinner.stop()


def test_clouds_dropped_from_a_full_queue_are_counted(inside, domain):
    def clouds(values):
        return int(values["clouds received"]), int(values["clouds lost by DDS"])

    with peer(domain, "/inside") as me:
        points = me.publish(PointCloud2, "points")
        diagnostics = me.subscribe(DiagnosticArray, "/diagnostics")
        with spinning(inside):
            points.send(wall(1.0))
            diagnostics.wait_for_values(lambda _, values: clouds(values)[0] == 1)
        for _ in range(50):  # while the node is too busy to take them
            points.send(wall(1.0))
        with spinning(inside):
            values = diagnostics.wait_for_values(lambda _, values: sum(clouds(values)) == 51)
    assert clouds(values)[1] > 0


@pytest.mark.parametrize(
    "late", ["_worker._segmenter.process", "_outputs._messages.markers.update"]
)
def test_update_finished_after_shutdown_publishes_no_markers(late, inside, domain, monkeypatch):
    *path, name = late.split(".")
    owner = reduce(getattr, path, inside)
    begun, may_end, work = Event(), Event(), getattr(owner, name)

    def slow(*args, **options):
        begun.set()
        assert may_end.wait(LIMIT)
        return work(*args, **options)

    monkeypatch.setattr(owner, name, slow)
    with peer(domain, "/inside") as me:
        points = me.publish(PointCloud2, "points")
        markers, segments = (
            me.subscribe(MarkerArray, "ellipsoids"),
            me.subscribe(SegmentArray, "segments"),
        )
        with spinning(inside):
            points.send(wall(1.0))
            points.send(wall(2.0))
            assert begun.wait(LIMIT)
        assert not inside.close()
        may_end.set()
        inside._thread.join(LIMIT)
        inside._outputs._publishers[ELLIPSOIDS].publish(MarkerArray())  # the last
        markers.wait(lambda message: not message.markers)
    drawn = [actions(message) for message in markers.messages]
    assert [Marker.DELETEALL] in drawn and not any(Marker.ADD in one for one in drawn)
    assert segments.messages == []


def test_close_waits_for_the_tuner(inside, monkeypatch):
    close, waited = inside._tuner.close, []
    monkeypatch.setattr(inside._tuner, "close", lambda s: (waited.append(s), close(s))[1])
    assert inside.close()
    assert waited == [segmenter_node.TUNER_TIMEOUT_S]
    monkeypatch.undo()


# --- starting and stopping -------------------------------------------------------------------


def test_invalid_initial_value_is_one_line_and_exit_code_2(domain, tmp_path):
    with running("segmenter_node", ["-p", "graph.neighbours:=2"], tmp_path / "log") as process:
        assert process.wait() == 2
        (line,) = process.output.splitlines()
    assert "neighbours is 2; it must be from 3 to 64" in line


def test_misspelt_parameter_is_logged_and_early_sigint_ends_cleanly(domain, tmp_path):
    arguments = ["-p", "treshold:=3.0", "-p", "use_sim_time:=true"]
    with running("segmenter_node", arguments, tmp_path / "log") as process, peer(domain) as me:
        me.subscribe(DiagnosticArray, "/diagnostics")  # compiling may have only begun
        process.signal(signal.SIGINT)
        process.signal(signal.SIGINT)
        assert process.wait(STOP_WITHIN) == 0
        assert "there is no parameter treshold; there are criterion, threshold" in process.output
        assert "use_sim_time" not in process.output
        assert "Traceback" not in process.output
