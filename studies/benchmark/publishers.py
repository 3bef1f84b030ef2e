"""The publishers of the segmenter node, in a program that measures them."""

from threading import Event

from ellipseg_ros.config import NodeConfig
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.topics import Topic
from ellipseg_ros.records import Segmentation
from ellipseg_ros.ros.auxiliary_node import AuxiliaryNode
from ellipseg_ros.ros.outputs import Outputs


class SegmentationPublisher(AuxiliaryNode):
    """A node that publishes segmentations as the segmenter does; a context manager.

    args: `--ros-args ...`, for a namespace.
    """

    def __init__(self, args: list[str]) -> None:
        self._created = Event()
        super().__init__("ellipseg_probe", args)
        self._outputs = Outputs(self.node, self._resend)
        self._created.set()

    def publish(self, segmentation: Segmentation) -> None:
        """Build, serialize and publish one update on all topics."""
        if self.failed:
            raise EllipsegError(f"publishing failed: {self.failed[0]}")
        self._outputs.publish(segmentation, NodeConfig())

    def _resend(self, topic: Topic) -> None:
        """Send a new subscriber what the segmenter sends first; may be called while creating."""
        self._created.wait()
        self._outputs.resend(topic)
