"""Subscriptions to everything that a segmenter publishes, as serialized messages."""

import struct
from collections.abc import Callable
from functools import partial

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.event_handler import QoSSubscriptionMatchedInfo, SubscriptionEventCallbacks
from rclpy.node import Node

from ellipseg_ros.io.topics import DIAGNOSTICS, ELLIPSOIDS, SEGMENTER, UPDATE_TOPICS, Topic
from ellipseg_ros.records import SECOND
from ellipseg_ros.ros.topics import create_subscription

DEPTH = 100  # messages kept while earlier ones are processed


def subscribe_outputs(
    node: Node,
    on_message: Callable[[str, bytes], object],
    on_ready: Callable[[], object],
    on_diagnostics: Callable[[dict[str, str]], object],
) -> None:
    """Subscribe to all topics of the segmenter in the node's namespace.

    on_message: gets the name of the topic and the bytes. on_diagnostics: gets the values of
    /diagnostics by key. on_ready: called once, when both sides know each other on all topics: a
    subscription matches first on one side, and messages sent meanwhile are lost. The segmenter
    sends markers to every new subscriber of `ellipsoids`; that topic is subscribed to last, so
    they show that the segmenter knows all subscriptions.
    """
    pending = {*UPDATE_TOPICS, "markers"}

    def arrived(item: Topic | str) -> None:
        if item in pending:
            pending.remove(item)
            if not pending:
                on_ready()

    def matched(topic: Topic, event: QoSSubscriptionMatchedInfo) -> None:
        if event.current_count:
            arrived(topic)

    def received(topic: Topic, data: bytes) -> None:
        if topic == ELLIPSOIDS:
            arrived("markers")
        on_message(topic.name, data)

    def diagnosed(msg: DiagnosticArray) -> None:
        for status in segmenter_statuses(node, msg):
            on_diagnostics({item.key: item.value for item in status.values})

    for topic in sorted(UPDATE_TOPICS, key=lambda topic: topic == ELLIPSOIDS):
        events = SubscriptionEventCallbacks(matched=partial(matched, topic))
        callback = partial(received, topic)
        create_subscription(node, topic, callback, DEPTH, raw=True, event_callbacks=events)
    create_subscription(node, DIAGNOSTICS, diagnosed, DEPTH)


def segmenter_statuses(node: Node, msg: DiagnosticArray) -> list[DiagnosticStatus]:
    """The statuses of the segmenter in the node's namespace."""
    name = f"{node.get_namespace().strip('/')}/{SEGMENTER}:".lstrip("/")
    return [status for status in msg.status if status.name.startswith(name)]


def sequence_number(data: bytes) -> int:
    """`sequence` of a serialized SegmentArray, the field after the header."""
    order = "<" if data[1] & 1 else ">"
    (length,) = struct.unpack_from(f"{order}I", data, 12)  # of frame_id
    end = 16 + length
    (number,) = struct.unpack_from(f"{order}I", data, end + -end % 4)
    return int(number)


def header_stamp_ns(data: bytes) -> int:
    """Stamp of a serialized message that begins with a std_msgs/Header, ns."""
    order = "<" if data[1] & 1 else ">"
    seconds, nanoseconds = struct.unpack_from(f"{order}iI", data, 4)
    return int(seconds) * SECOND + int(nanoseconds)
