"""A ROS node that runs beside other work of a process."""

from typing import TypeVar

import rclpy
from rclpy.context import Context
from rclpy.node import Node

from ellipseg_ros.ros.process import Spinner

Self = TypeVar("Self", bound="AuxiliaryNode")


class AuxiliaryNode:
    """A node without parameters, in a ROS context of its own; a context manager.

    args: `--ros-args ...`, for a namespace. domain: ROS_DOMAIN_ID; None: that of the environment.
    Callbacks run in another thread as soon as the node exists: a subclass sets what they need
    before it calls `__init__`.
    Raises rclpy's errors for invalid names and if the node can't start.
    """

    def __init__(self, name: str, args: list[str], domain: int | None = None) -> None:
        self.failed: list[BaseException] = []  # raised by callbacks
        self._context = Context()
        try:
            rclpy.init(args=args, context=self._context, domain_id=domain)
            self.node = self._create_node(name, self._context)
        except BaseException:
            self._context.try_shutdown()
            raise
        self._spinner = Spinner(self.node, self.fail)

    def _create_node(self, name: str, context: Context) -> Node:
        return Node(name, context=context, start_parameter_services=False)

    def __enter__(self: Self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Destroy the node and end its thread."""
        self._spinner.stop()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def fail(self, error: BaseException) -> None:
        """Handle an error of a callback, in the thread of the callbacks."""
        self.failed.append(error)
