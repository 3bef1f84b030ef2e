"""Two ends of a connection, inside a program that measures: for `ellipseg bench`."""

from threading import Event

import rclpy
from rclpy.context import Context
from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from ellipseg_ros.config import NodeConfig
from ellipseg_ros.data import Segmentation
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.ros.outputs import Outputs
from ellipseg_ros.ros.process import Spinner


class Probe:
    """A node with the segmenter's publishers and a publisher of `points`; a context manager.

    args: `--ros-args ...`, for a namespace.
    """

    def __init__(self, args: list[str]) -> None:
        self._context = Context()
        rclpy.init(args=args, context=self._context)
        self._node = Node("ellipseg_probe", context=self._context)
        self._heard = Event()
        self._node.create_publisher(
            PointCloud2,
            "points",
            1,
            event_callbacks=PublisherEventCallbacks(matched=self._on_match),
        )
        self._failed: list[BaseException] = []
        self._spinner = Spinner(self._node, self._fail)

    def __enter__(self) -> "Probe":
        return self

    def __exit__(self, *_: object) -> None:
        self._spinner.stop()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def outputs(self) -> "Publisher":
        """The segmenter's own publishers, on this node."""
        return Publisher(Outputs(self._node, lambda: None))

    def wait_for_segmenter(self, timeout: float) -> None:
        """Wait until somebody subscribes to `points`; raises EllipsegError after `timeout` s."""
        if not self._heard.wait(timeout) or self._failed:
            raise EllipsegError(f"no segmenter listens to `points` within {timeout:g} s")

    def _on_match(self, event: QoSPublisherMatchedInfo) -> None:
        if event.current_count:
            self._heard.set()

    def _fail(self, error: BaseException | None) -> None:
        if error is not None:
            self._failed.append(error)
        self._heard.set()


class Publisher:
    """Publishes segmentations as the segmenter does."""

    def __init__(self, outputs: Outputs) -> None:
        self._outputs = outputs

    def publish(self, found: Segmentation) -> None:
        """Build, serialize and publish one update on all topics."""
        self._outputs.publish(found, NodeConfig())
