"""Subscribing to what a segmenter publishes, as the bytes that come."""

import struct
from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.event_handler import QoSSubscriptionMatchedInfo, SubscriptionEventCallbacks
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from ellipseg_ros.msg import LandmarkArray, SegmentArray
from ellipseg_ros.records import SECOND

GREETING = "ellipsoids"  # a segmenter sends something to everybody who subscribes to it
TOPICS = {
    "segmented_points": PointCloud2,
    "landmarks": LandmarkArray,
    "segments": SegmentArray,
    GREETING: MarkerArray,  # the last: who is greeted there is known on all topics
}
DEPTH = 100  # messages kept while others are dealt with


def subscribe_outputs(
    node: Node,
    on_message: Callable[[str, bytes], object],
    on_known: Callable[[], object],
    on_diagnostics: Callable[[dict[str, str]], object],
) -> None:
    """Subscribe to all topics of the segmenter in the node's namespace.

    on_message gets topic and bytes, on_diagnostics what /diagnostics say. on_known is called once
    we know of publishers of all topics and they know of us: one learns of the other first, and
    what is published meanwhile is lost.
    """
    unknown = {*TOPICS, "greeting"}

    def know(what: str) -> None:
        if what in unknown:
            unknown.remove(what)
            if not unknown:
                on_known()

    def matched(topic: str, event: QoSSubscriptionMatchedInfo) -> None:
        if event.current_count:
            know(topic)

    def heard(topic: str, data: bytes) -> None:
        if topic == GREETING:
            know("greeting")
        on_message(topic, data)

    def diagnosed(msg: DiagnosticArray) -> None:
        for status in segmenter_statuses(node, msg):
            on_diagnostics({item.key: item.value for item in status.values})

    for topic, kind in TOPICS.items():
        node.create_subscription(
            kind,
            topic,
            lambda data, topic=topic: heard(topic, data),
            DEPTH,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(
                matched=lambda event, topic=topic: matched(topic, event)
            ),
        )
    node.create_subscription(DiagnosticArray, "/diagnostics", diagnosed, DEPTH)


def segmenter_statuses(node: Node, msg: DiagnosticArray) -> list[DiagnosticStatus]:
    """What the segmenter in the node's namespace says in it, if it is of him."""
    own = f"{node.get_namespace().strip('/')}/ellipseg_segmenter:".lstrip("/")
    return [status for status in msg.status if status.name.startswith(own)]


def sequence_number(data: bytes) -> int:
    """`sequence` of a serialized SegmentArray, which stands behind the header."""
    order = "<" if data[1] & 1 else ">"
    (length,) = struct.unpack_from(f"{order}I", data, 12)  # of frame_id
    behind = 16 + length
    (number,) = struct.unpack_from(f"{order}I", data, behind + -behind % 4)
    return int(number)


def header_stamp_ns(data: bytes) -> int:
    """Stamp of a serialized message that begins with a std_msgs/Header, ns."""
    order = "<" if data[1] & 1 else ">"
    seconds, nanoseconds = struct.unpack_from(f"{order}iI", data, 4)
    return int(seconds) * SECOND + int(nanoseconds)
