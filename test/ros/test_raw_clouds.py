"""A node that places raw clouds by an odometry, over DDS; and its poses from messages of tf."""

from types import SimpleNamespace

import pytest
import raw_rooms
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from node_kit import parameters, peer, running
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from ellipseg_ros.config import Config, PlacementConfig
from ellipseg_ros.errors import ConfigError
from ellipseg_ros.io.bag import node_types
from ellipseg_ros.io.messages import write_segments
from ellipseg_ros.io.pose_messages import write_odometry
from ellipseg_ros.msg import SegmentArray
from ellipseg_ros.node.grouping import updates
from ellipseg_ros.poses.placer import Placer, RefusedPose, outcomes
from ellipseg_ros.records import Sweep
from ellipseg_ros.ros import pose_input
from ellipseg_ros.ros.pose_input import PoseInput, decided
from ellipseg_ros.segmenter import Segmenter

NODE = "/ellipseg_segmenter"
ODOMETRY = "/kiss/odometry"
SWEEPS = 21  # 2 s, which is less than clouds wait for poses
CLOUDS, POSES = raw_rooms.clouds(SWEEPS), raw_rooms.odometry(SWEEPS)
ORDERS = {
    "poses first": [*POSES, *CLOUDS],
    "clouds first": [*CLOUDS, *POSES],
    "alternating": raw_rooms.in_order(CLOUDS, POSES),
}
SETTINGS = {"update_period": 0.5, "window_duration": 1.5}


@pytest.fixture(scope="module")
def node(session_ros_domain, tmp_path_factory):
    """A node with a remapped odometry, and a peer with a lidar and that odometry."""
    log = tmp_path_factory.mktemp("raw") / "log"
    names = ["-r", f"odometry:={ODOMETRY}"]
    settings = {**SETTINGS, "max_backlog": 0, "input_depth": 1000}
    with (
        running("segmenter_node", [*names, *parameters(**settings)], log) as process,
        peer(session_ros_domain) as me,
    ):
        yield SimpleNamespace(
            process=process,
            me=me,
            segments=me.subscribe(SegmentArray, "/segments", raw=True),
            diagnostics=me.subscribe(DiagnosticArray, "/diagnostics"),
            odometry=me.publish(Odometry, ODOMETRY),
            points=me.publish(PointCloud2, "/points"),
            values={},
        )


def send(node, events):
    """Send clouds and poses, and wait until all have arrived."""
    for event in events:
        if isinstance(event, Sweep):
            node.points.send(event)
        else:
            node.odometry.send(write_odometry(event, node_types()))
    clouds = sum(isinstance(event, Sweep) for event in events)
    poses = len(events) - clouds
    before = node.values
    node.values = node.diagnostics.wait_for_values(
        lambda _, values: (
            gain(before, values, "clouds received") == clouds
            and gain(before, values, "poses received") == poses
        )
    )
    return before


def gain(before, values, key):
    return int(values.get(key, 0)) - int(before.get(key, 0))


def reset(node):
    assert node.me.call(Trigger, f"{NODE}/reset").success


def offline(order, segmenter):
    config = PlacementConfig(pose_source="odometry")
    placed = list(outcomes(order, Placer(config)))
    assert all(isinstance(outcome, Sweep) for outcome in placed)
    found = [segmenter.process(group) for group in updates(placed, Config(**SETTINGS))]
    segmenter.reset("~/reset was called")
    return [write_segments(segmentation) for segmentation in found]


def test_any_order_of_clouds_and_poses_gives_the_offline_segments_bit_for_bit(node):
    """The first test of the node: numbers of updates and ids continue over the resets."""
    node.me.wait_until_known()
    segmenter, expected = Segmenter(Config(**SETTINGS)), []
    for order in ORDERS.values():
        send(node, order)
        reset(node)
        expected += offline(order, segmenter)
        node.segments.wait_for(len(expected))
    assert node.segments.messages == expected
    assert len(expected) == 12
    values = node.values
    assert (
        values["clouds unplaced"] == values["poses refused"] == values["poses lost by DDS"] == "0"
    )
    assert values["pose source"] == "odometry" and values["odometry_stamp"] == "exact"
    assert (values["cloud frame"], values["fixed frame"]) == ("lidar", "odom")
    assert (values["child frame"], values["deskew"]) == ("lidar", "yes")
    assert values["point times"] == "t [ns] from the stamp"
    assert "clouds are placed by poses from /kiss/odometry" in node.process.output
    assert "input: cloud frame lidar, point times t [ns] from the stamp" in node.process.output


def test_clouds_without_odometry_wait_with_a_warning_and_are_counted(node):
    reset(node)
    send(node, CLOUDS[:3])
    message = node.diagnostics.wait(
        lambda m: "clouds wait for poses" in m.status[0].message, len(node.diagnostics.messages)
    )
    assert message.status[0].level == DiagnosticStatus.WARN
    assert (
        "no odometry has arrived on /kiss/odometry: is it published" in message.status[0].message
    )
    assert node.values["clouds waiting for poses"] == "3"
    before = node.values
    start = len(node.diagnostics.messages)
    reset(node)
    message = node.diagnostics.wait(lambda m: "unplaced" in m.status[0].message, start)
    assert message.status[0].level == DiagnosticStatus.ERROR
    assert "every cloud is unplaced: no odometry has arrived" in message.status[0].message
    node.values = node.diagnostics.wait_for_values(
        lambda _, values: gain(before, values, "clouds unplaced") == 3
    )
    assert gain(before, node.values, "points unplaced") == 3 * len(CLOUDS[0])
    assert gain(before, node.values, "clouds unplaced: no_poses") == 3


def test_odometry_of_another_child_frame_places_nothing_and_says_what_is_missing(node):
    reset(node)
    later = [Sweep(c.stamp_ns + 6 * 10**9, c.points, frame_id="lidar") for c in CLOUDS[:1]]
    body = raw_rooms.odometry(SWEEPS, child="body")
    start = len(node.diagnostics.messages)
    before = send(node, [*body, *CLOUDS[:2], *later])
    message = node.diagnostics.wait(lambda m: "unplaced: the" in m.status[0].message, start)
    assert gain(before, node.values, "clouds unplaced: no_extrinsic") == 2
    assert node.values["clouds waiting for poses"] == "1"
    assert "the odometry is that of 'body', the clouds are in 'lidar'" in message.status[0].message
    reset(node)


def test_invalid_pose_is_refused_and_counted(node):
    reset(node)
    nothing = POSES[1].pose._replace(rotation=0.0 * POSES[1].pose.rotation)
    before = send(node, [POSES[0]._replace(pose=nothing), *POSES[:2], POSES[0]])
    assert gain(before, node.values, "poses refused") == 2
    assert gain(before, node.values, "poses refused: quaternion") == 1
    assert gain(before, node.values, "poses refused: pose_order") == 1
    assert "pose refused: a quaternion has norm 0" in node.process.output


# --- in this process -----------------------------------------------------------------------------


class Remapped:
    """Of a node: its names; `odometry` may be remapped."""

    def __init__(self, remapped=False):
        self.remapped = remapped

    def resolve_topic_name(self, name, only_expand=False):
        return ODOMETRY if self.remapped and not only_expand else f"/{name}"


@pytest.mark.parametrize(
    ("settings", "remapped", "source"),
    [
        ({}, False, "registered"),
        ({}, True, "odometry"),
        ({"fixed_frame": "map"}, True, "tf"),
        ({"pose_source": "registered", "fixed_frame": "map"}, True, "registered"),
        ({"pose_source": "odometry"}, False, "odometry"),
    ],
)
def test_automatic_pose_source(settings, remapped, source, monkeypatch):
    monkeypatch.setattr(pose_input, "tf_is_available", lambda: True)
    assert decided(PlacementConfig(**settings), Remapped(remapped)).pose_source == source


def test_missing_tf2_msgs_is_an_error_in_one_line(monkeypatch):
    monkeypatch.setattr(pose_input, "tf_is_available", lambda: False)
    with pytest.raises(ConfigError, match=r"tf2_msgs is not installed; install it .*odometry:="):
        decided(PlacementConfig(fixed_frame="odom"), Remapped())


def stamped(parent, child, stamp_s=0, w=1.0):
    """A transform of tf."""
    msg = TransformStamped(child_frame_id=child)
    msg.header.frame_id, msg.header.stamp.sec = parent, stamp_s
    msg.transform.rotation.w = w
    return msg


def test_messages_of_tf_place_clouds_and_invalid_transforms_are_refused_alone():
    config = PlacementConfig(pose_source="tf", fixed_frame="odom")
    placer, decisions = Placer(config), []
    poses = PoseInput(
        Remapped(), "registered", lambda event: decisions.extend(placer.take(event)), None
    )
    still = [stamped("base", "lidar"), stamped("base", "imu", w=0.0), stamped("lidar", "base")]
    poses.on_transforms(True, SimpleNamespace(transforms=still))
    decisions += placer.take(CLOUDS[0])
    for stamp_s in (5000, 5001):
        poses.on_transforms(False, SimpleNamespace(transforms=[stamped("odom", "base", stamp_s)]))
    *refused, placed = decisions
    assert [r.reason for r in refused] == ["quaternion", "tf_cycle"]
    assert all(isinstance(r, RefusedPose) and "\n" not in r.text for r in refused)
    assert placed.frame_id == "odom" and len(placed) == len(CLOUDS[0])
    placer.reset()  # static transforms stay
    assert placer.take(CLOUDS[0]) == []
    for stamp_s in (5000, 5001):
        poses.on_transforms(False, SimpleNamespace(transforms=[stamped("odom", "base", stamp_s)]))
    assert len(decisions) == 4 and decisions[-1].frame_id == "odom"
