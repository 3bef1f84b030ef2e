"""A node that publishes serialized messages, valid or not."""

from typing import Any

from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo
from sensor_msgs.msg import PointCloud2

from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.msg import LandmarkArray
from ellipseg_ros.node.abortable_condition import AbortableCondition
from ellipseg_ros.ros.auxiliary_node import AuxiliaryNode

TYPES: dict[str, Any] = {"points": PointCloud2, "landmarks": LandmarkArray}
QUEUE_DEPTH = 1000  # messages kept for a slow subscriber


class RawPublisher(AuxiliaryNode):
    """A node with one reliable publisher; a context manager.

    topic: one of TYPES. args: `--ros-args ...`, for a namespace. Waiting methods raise
    EllipsegError at their timeout (s).
    """

    def __init__(self, topic: str, args: list[str]) -> None:
        self._changed = AbortableCondition()
        self._subscribers = 0
        super().__init__("ellipseg_raw_publisher", args)
        events = PublisherEventCallbacks(matched=self._on_match)
        self._publisher = self.node.create_publisher(
            TYPES[topic], topic, QUEUE_DEPTH, event_callbacks=events
        )

    def wait_for_subscriber(self, timeout_s: float) -> None:
        """Wait until a subscriber is connected."""
        self._changed.wait_until(
            lambda: self._subscribers > 0, timeout_s, "there is no subscriber"
        )

    def send(self, message: bytes) -> None:
        """Publish a serialized message."""
        self._publisher.publish(message)

    def wait_for_acknowledgement(self, timeout_s: float) -> None:
        """Wait until all messages are received."""
        if not self._publisher.wait_for_all_acked(Duration(seconds=timeout_s)):
            raise EllipsegError(f"some messages are not received within {timeout_s:g} s")

    def _on_match(self, event: QoSPublisherMatchedInfo) -> None:
        with self._changed:
            self._subscribers = event.current_count
            self._changed.notify_all()
