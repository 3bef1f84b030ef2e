"""The topics that the segmenter publishes; no message is built for a topic without subscribers."""

from collections.abc import Callable
from threading import Lock
from typing import Any

from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo
from rclpy.node import Node
from visualization_msgs.msg import Marker, MarkerArray

from ellipseg_ros.config import NodeConfig
from ellipseg_ros.io.messages import write_segments
from ellipseg_ros.io.topics import ELLIPSOIDS, SEGMENTS, UPDATE_TOPICS, Topic
from ellipseg_ros.io.update_messages import UpdateMessages
from ellipseg_ros.records import Segmentation
from ellipseg_ros.ros.topics import create_publisher

ACKNOWLEDGE_TIMEOUT = Duration(seconds=0.2)  # for the last message before shutdown


class Outputs:
    """Publishes updates; for one thread, apart from `close` and `other_publishers`.

    on_subscriber: called in the thread of the callbacks with `ellipsoids` or `segments` when
        a subscription to it is matched; `resend` then brings the new subscriber up to date.
    """

    def __init__(self, node: Node, on_subscriber: Callable[[Topic], object]) -> None:
        self._node = node
        self._publishers = {
            topic: create_publisher(node, topic, event_callbacks=_on_match(topic, on_subscriber))
            for topic in UPDATE_TOPICS
        }
        self._messages = UpdateMessages(NodeConfig())
        self._latest: Segmentation | None = None
        self._sending = Lock()
        self._closed = False  # changes only while nothing is sent

    def publish(self, segmentation: Segmentation, config: NodeConfig) -> None:
        """Send an update on all topics, `segments` last."""
        self._latest = segmentation
        self._messages.configure(config)
        for topic, write in self._messages.writers(segmentation).items():
            self._send(topic, write)

    def resend(self, topic: Topic) -> None:
        """Send the last update again, in full, for a new subscriber of the topic.

        Markers: preceded by a deletion of all, as a viewer may still show those of a killed node.
        Segments: only if the next message may list changes, even if the last one was full.
        """
        latest = self._latest
        if topic == ELLIPSOIDS and latest is None:
            self.clear()
        elif topic == ELLIPSOIDS:
            self.refresh_markers(delete_all=True)
        elif latest is not None and self._messages.segments.sends_changes:
            self._send(SEGMENTS, lambda: write_segments(latest))

    def refresh_markers(self, delete_all: bool = False) -> None:
        """Send every marker again; delete_all: after a deletion of all markers."""
        latest, markers = self._latest, self._messages.markers
        if latest is not None:
            self._send(ELLIPSOIDS, lambda: markers.update(latest, True, delete_all))

    def clear(self) -> None:
        """Delete all markers."""
        self._latest = None
        self._send(ELLIPSOIDS, delete_all_markers)

    def other_publishers(self) -> int:
        """Number of other publishers of `segments` in this namespace.

        A killed node counts until DDS notices after 20 s.
        """
        name = self._publishers[SEGMENTS].topic_name
        return max(0, self._node.count_publishers(name) - 1)

    def close(self) -> None:
        """Delete all markers, and wait briefly until the subscribers acknowledge that.

        Thread-safe. Messages that another thread is building are not sent any more.
        """
        with self._sending:
            self._closed = True
        publisher = self._publishers[ELLIPSOIDS]
        send(publisher, delete_all_markers)
        publisher.wait_for_all_acked(ACKNOWLEDGE_TIMEOUT)

    def _send(self, topic: Topic, write: Callable[[], Any]) -> None:
        """Build and publish a message unless closed; `close` need not wait for the building."""
        publisher = self._publishers[topic]
        if self._closed or not publisher.get_subscription_count():
            return
        message = write()
        with self._sending:
            if not self._closed:
                publisher.publish(message)


def delete_all_markers() -> MarkerArray:
    """A message that deletes all markers."""
    return MarkerArray(markers=[Marker(action=Marker.DELETEALL)])


def _on_match(
    topic: Topic, on_subscriber: Callable[[Topic], object]
) -> PublisherEventCallbacks | None:
    """Events of a publisher; None for a topic whose messages don't depend on earlier ones."""

    def matched(event: QoSPublisherMatchedInfo) -> None:
        if event.current_count_change > 0:
            on_subscriber(topic)

    resent = topic in (ELLIPSOIDS, SEGMENTS)
    return PublisherEventCallbacks(matched=matched) if resent else None


def send(publisher: Any, write: Callable[[], Any]) -> None:
    """Publish the message or the bytes that `write` returns, if there are subscribers."""
    if publisher.get_subscription_count():
        publisher.publish(write())
