"""The topics that the segmenter publishes; nothing is built for one without subscribers."""

from collections.abc import Callable
from threading import Lock
from typing import Any

from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import Marker, MarkerArray

from ellipseg_ros.config import NodeConfig
from ellipseg_ros.io.messages import Markers, write_landmarks, write_segments
from ellipseg_ros.io.pointcloud2 import write_labelled
from ellipseg_ros.io.segment_stream import SegmentStream
from ellipseg_ros.msg import LandmarkArray, SegmentArray
from ellipseg_ros.records import Segmentation

DEPTH = 10  # messages kept for a slow subscriber; all topics are reliable
FAREWELL = Duration(seconds=0.2)  # that subscribers get to acknowledge the last message


class Outputs:
    """Publishes what was found; for one thread, but for `farewell` and `rivals`.

    new_viewer, new_listener: called, in the thread of the callbacks, when somebody subscribes to
    `ellipsoids`, and to `segments`.
    """

    def __init__(
        self, node: Node, new_viewer: Callable[[], object], new_listener: Callable[[], object]
    ) -> None:
        self._node = node
        self._points = node.create_publisher(PointCloud2, "segmented_points", DEPTH)
        self._ellipsoids = node.create_publisher(
            MarkerArray,
            "ellipsoids",
            DEPTH,
            event_callbacks=_when_matched(new_viewer),
        )
        self._segments = node.create_publisher(
            SegmentArray, "segments", DEPTH, event_callbacks=_when_matched(new_listener)
        )
        self._landmarks = node.create_publisher(LandmarkArray, "landmarks", DEPTH)
        self._markers = Markers(NodeConfig())
        self._stream = SegmentStream(NodeConfig())
        self._latest: Segmentation | None = None
        self._sending = Lock()
        self._closed = False  # changes while nothing is sent

    def publish(self, found: Segmentation, shown: NodeConfig) -> None:
        """Send an update; `segments` comes last, so that it tells that all is sent."""
        self._latest = found
        self._markers.configure(shown)
        self._stream.configure(shown)
        self._send(self._points, lambda: write_labelled(found))
        self._send(self._ellipsoids, lambda: self._markers.update(found))
        landmarks = found.landmarks
        if landmarks is not None:
            self._send(self._landmarks, lambda: write_landmarks(found, landmarks))
        self._send(self._segments, lambda: self._stream.update(found))

    def greet(self) -> None:
        """Somebody new looks: show all, and take away what a node left that was killed."""
        if self._latest is None:
            self.clear()
        else:
            self.show_all(anew=True)

    def rivals(self) -> int:
        """How many other publishers of `segments` there are, in this namespace.

        One that was killed counts until DDS misses it, 20 s later.
        """
        return max(0, self._node.count_publishers(self._segments.topic_name) - 1)

    def show_all(self, anew: bool = False) -> None:
        """Send every marker again; anew: behind a marker that takes all away."""
        found = self._latest
        if found is not None:
            self._send(
                self._ellipsoids, lambda: self._markers.update(found, everything=True, anew=anew)
            )

    def list_all(self) -> None:
        """Send the last update on `segments` again, if the next may come as changes.

        In full, also if it went out so: a newcomer has come too late for it.
        """
        found = self._latest
        if found is not None and self._stream.repeats:
            self._send(self._segments, lambda: write_segments(found))

    def clear(self) -> None:
        """Take all markers away."""
        self._latest = None
        self._send(self._ellipsoids, delete_all_markers)

    def farewell(self) -> None:
        """Take all markers away, and wait a moment for the subscribers to hear of it.

        For any thread. What another one is about to send is not sent any more.
        """
        with self._sending:
            self._closed = True
        send(self._ellipsoids, delete_all_markers)
        self._ellipsoids.wait_for_all_acked(FAREWELL)

    def _send(self, publisher: Any, write: Callable[[], Any]) -> None:
        """Like `send`, until the farewell; that needn't wait for the writing."""
        if self._closed or not publisher.get_subscription_count():
            return
        message = write()
        with self._sending:
            if not self._closed:
                publisher.publish(message)


def delete_all_markers() -> MarkerArray:
    """A message that takes all markers away."""
    return MarkerArray(markers=[Marker(action=Marker.DELETEALL)])


def _when_matched(newcomer: Callable[[], object]) -> PublisherEventCallbacks:
    def matched(event: QoSPublisherMatchedInfo) -> None:
        if event.current_count_change > 0:
            newcomer()

    return PublisherEventCallbacks(matched=matched)


def send(publisher: Any, write: Callable[[], Any]) -> None:
    """Publish what `write` makes, a message or its bytes, if somebody listens."""
    if publisher.get_subscription_count():
        publisher.publish(write())
