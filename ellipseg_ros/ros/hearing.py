"""Subscribing to what a segmenter publishes, as the bytes that come."""

import struct
from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.event_handler import QoSSubscriptionMatchedInfo, SubscriptionEventCallbacks
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from ellipseg_ros.data import SECOND
from ellipseg_ros.msg import LandmarkArray, SegmentArray

TOPICS = {
    "segmented_points": PointCloud2,
    "ellipsoids": MarkerArray,
    "landmarks": LandmarkArray,
    "segments": SegmentArray,
}
DEPTH = 100  # messages kept while others are dealt with


def hear(
    node: Node,
    on_message: Callable[[str, bytes], object],
    on_match: Callable[[str, int], object],
    on_diagnostics: Callable[[dict[str, str]], object],
) -> None:
    """Subscribe to all topics of the segmenter in the node's namespace.

    The callbacks get topic and bytes; topic and its number of publishers; what /diagnostics says.
    """

    def matched(topic: str, event: QoSSubscriptionMatchedInfo) -> None:
        on_match(topic, event.current_count)

    def diagnosed(msg: DiagnosticArray) -> None:
        for status in of_segmenter(node, msg):
            on_diagnostics({item.key: item.value for item in status.values})

    for topic, kind in TOPICS.items():
        node.create_subscription(
            kind,
            topic,
            lambda data, topic=topic: on_message(topic, data),
            DEPTH,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(
                matched=lambda event, topic=topic: matched(topic, event)
            ),
        )
    node.create_subscription(DiagnosticArray, "/diagnostics", diagnosed, DEPTH)


def of_segmenter(node: Node, msg: DiagnosticArray) -> list[DiagnosticStatus]:
    """What the segmenter in the node's namespace says in it, if it is of him."""
    own = f"{node.get_namespace().strip('/')}/ellipseg_segmenter:".lstrip("/")
    return [status for status in msg.status if status.name.startswith(own)]


def update_number(data: bytes) -> int:
    """`sequence` of a serialized SegmentArray, which stands behind the header."""
    order = "<" if data[1] & 1 else ">"
    (length,) = struct.unpack_from(f"{order}I", data, 12)  # of frame_id
    behind = 16 + length
    (number,) = struct.unpack_from(f"{order}I", data, behind + -behind % 4)
    return int(number)


def header_time(data: bytes) -> int:
    """Stamp of a serialized message that begins with a std_msgs/Header, ns."""
    order = "<" if data[1] & 1 else ">"
    seconds, nanoseconds = struct.unpack_from(f"{order}iI", data, 4)
    return int(seconds) * SECOND + int(nanoseconds)
