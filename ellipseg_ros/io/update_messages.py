"""The messages of an update, for the node and for bags."""

from collections.abc import Callable

from ellipseg_ros.config import NodeConfig
from ellipseg_ros.io.messages import MarkerStream, write_landmarks
from ellipseg_ros.io.pointcloud2 import write_labelled
from ellipseg_ros.io.segment_stream import SegmentStream
from ellipseg_ros.io.topics import ELLIPSOIDS, LANDMARKS, SEGMENTED_POINTS, SEGMENTS, Topic
from ellipseg_ros.records import Segmentation


class UpdateMessages:
    """Serializes update after update; markers and segments depend on the earlier ones."""

    def __init__(self, config: NodeConfig) -> None:
        self.markers = MarkerStream(config)
        self.segments = SegmentStream(config)

    def configure(self, config: NodeConfig) -> None:
        """Apply new settings from the next update on."""
        self.markers.configure(config)
        self.segments.configure(config)

    def writers(self, segmentation: Segmentation) -> dict[Topic, Callable[[], bytes]]:
        """Functions that serialize an update, by topic, in the order of publishing.

        `segments` is last: when it arrives, the whole update has been sent.
        """
        landmarks = segmentation.landmarks
        writers: dict[Topic, Callable[[], bytes]] = {
            SEGMENTED_POINTS: lambda: write_labelled(segmentation),
            ELLIPSOIDS: lambda: self.markers.update(segmentation),
        }
        if landmarks is not None:
            writers[LANDMARKS] = lambda: write_landmarks(segmentation, landmarks)
        writers[SEGMENTS] = lambda: self.segments.update(segmentation)
        return writers
