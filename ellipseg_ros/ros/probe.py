"""The segmenter's publishers inside a program that measures them: for `ellipseg bench`."""

import rclpy
from rclpy.context import Context
from rclpy.node import Node

from ellipseg_ros.config import NodeConfig
from ellipseg_ros.data import Segmentation
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.ros.outputs import Outputs
from ellipseg_ros.ros.process import Spinner


class Probe:
    """A node that publishes segmentations as the segmenter does; a context manager.

    args: `--ros-args ...`, for a namespace.
    """

    def __init__(self, args: list[str]) -> None:
        self._context = Context()
        rclpy.init(args=args, context=self._context)
        self._node = Node("ellipseg_probe", context=self._context)
        self._outputs = Outputs(self._node, lambda: None, lambda: None)
        self._failed: list[BaseException] = []
        self._spinner = Spinner(self._node, self._fail)

    def __enter__(self) -> "Probe":
        return self

    def __exit__(self, *_: object) -> None:
        self._spinner.stop()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def publish(self, found: Segmentation) -> None:
        """Build, serialize and publish one update on all topics."""
        if self._failed:
            raise EllipsegError(f"publishing failed: {self._failed[0]}")
        self._outputs.publish(found, NodeConfig())

    def _fail(self, error: BaseException | None) -> None:
        if error is not None:
            self._failed.append(error)
