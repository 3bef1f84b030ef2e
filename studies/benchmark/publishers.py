"""The segmenter's publishers inside a program that measures them: for `ellipseg bench`."""

from threading import Event

from ellipseg_ros.config import NodeConfig
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.records import Segmentation
from ellipseg_ros.ros.auxiliary_node import AuxiliaryNode
from ellipseg_ros.ros.outputs import Outputs


class Probe(AuxiliaryNode):
    """A node that publishes segmentations as the segmenter does; a context manager.

    args: `--ros-args ...`, for a namespace.
    """

    def __init__(self, args: list[str]) -> None:
        self._made = Event()
        super().__init__("ellipseg_probe", args)
        self._outputs = Outputs(self.node, self._greet, lambda: None)
        self._made.set()

    def publish(self, found: Segmentation) -> None:
        """Build, serialize and publish one update on all topics."""
        if self.failed:
            raise EllipsegError(f"publishing failed: {self.failed[0]}")
        self._outputs.publish(found, NodeConfig())

    def _greet(self) -> None:
        """As the segmenter greets: who subscribes waits for that before anything is published."""
        self._made.wait()
        self._outputs.greet()
