"""A publisher of messages as bytes, whatever they hold: for `ellipseg soak`."""

from threading import Condition
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.msg import LandmarkArray
from ellipseg_ros.ros.process import Spinner

TYPES: dict[str, Any] = {"points": PointCloud2, "landmarks": LandmarkArray}
DEPTH = 1000  # messages kept for a slow subscriber


class Sender:
    """A node with one reliable publisher, in a ROS context of its own; a context manager.

    topic: one of TYPES. args: `--ros-args ...`, for a namespace.
    """

    def __init__(self, topic: str, args: list[str]) -> None:
        self._context = Context()
        rclpy.init(args=args, context=self._context)
        self._node = Node("ellipseg_sender", context=self._context)
        self._changed = Condition()
        self._listeners = 0
        events = PublisherEventCallbacks(matched=self._on_match)
        self._publisher = self._node.create_publisher(
            TYPES[topic], topic, DEPTH, event_callbacks=events
        )
        self._spinner = Spinner(self._node, lambda _: None)

    def __enter__(self) -> "Sender":
        return self

    def __exit__(self, *_: object) -> None:
        self._spinner.stop()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def wait_for_listener(self, timeout: float) -> None:
        """Wait until somebody listens; raises EllipsegError after `timeout` s."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._listeners > 0, timeout):
                raise EllipsegError(f"nobody listens within {timeout:g} s")

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
