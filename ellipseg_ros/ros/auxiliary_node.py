"""A node beside whatever else a process does."""

from typing import TypeVar

import rclpy
from rclpy.context import Context
from rclpy.node import Node

from ellipseg_ros.ros.process import Spinner

G = TypeVar("G", bound="Guest")


class Guest:
    """A node without parameters, in a ROS context of its own; a context manager.

    args: `--ros-args ...`, for a namespace. Callbacks run from the beginning, in another thread:
    what they need must be there before `__init__` is called.
    Raises what rclpy raises, for names that ROS does not take, and if it can't start.
    """

    def __init__(self, name: str, args: list[str]) -> None:
        self.failed: list[BaseException] = []  # what callbacks have raised
        self._context = Context()
        try:
            rclpy.init(args=args, context=self._context)
            self.node = Node(name, context=self._context, start_parameter_services=False)
        except BaseException:
            self._context.try_shutdown()
            raise
        self._spinner = Spinner(self.node, self._end)

    def __enter__(self: G) -> G:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the node and its thread."""
        self._spinner.stop()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def fail(self, error: BaseException) -> None:
        """Called, in the thread of the callbacks, with what one of them has raised."""
        self.failed.append(error)

    def _end(self, error: BaseException | None) -> None:
        if error is not None:
            self.fail(error)
