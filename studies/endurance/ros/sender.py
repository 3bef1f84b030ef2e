"""A publisher of messages as bytes, whatever they hold: for `ellipseg soak`."""

from typing import Any

from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo
from sensor_msgs.msg import PointCloud2

from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.msg import LandmarkArray
from ellipseg_ros.node.abortable_condition import AbortableCondition
from ellipseg_ros.ros.auxiliary_node import AuxiliaryNode

TYPES: dict[str, Any] = {"points": PointCloud2, "landmarks": LandmarkArray}
DEPTH = 1000  # messages kept for a slow subscriber


class Sender(AuxiliaryNode):
    """A node with one reliable publisher; a context manager.

    topic: one of TYPES. args: `--ros-args ...`, for a namespace.
    """

    def __init__(self, topic: str, args: list[str]) -> None:
        self._changed = AbortableCondition()
        self._listeners = 0
        super().__init__("ellipseg_sender", args)
        events = PublisherEventCallbacks(matched=self._on_match)
        self._publisher = self.node.create_publisher(
            TYPES[topic], topic, DEPTH, event_callbacks=events
        )

    def wait_for_listener(self, timeout: float) -> None:
        """Wait until somebody listens; raises EllipsegError after `timeout` s."""
        self._changed.wait_until(lambda: self._listeners > 0, timeout, "nobody listens")

    def send(self, message: bytes) -> None:
        """Publish a serialized message."""
        self._publisher.publish(message)

    def wait_for_arrival(self, timeout: float) -> None:
        """Wait until all is received; raises EllipsegError after `timeout` s."""
        if not self._publisher.wait_for_all_acked(Duration(seconds=timeout)):
            raise EllipsegError(f"what was sent is not received within {timeout:g} s")

    def _on_match(self, event: QoSPublisherMatchedInfo) -> None:
        with self._changed:
            self._listeners = event.current_count
            self._changed.notify_all()
