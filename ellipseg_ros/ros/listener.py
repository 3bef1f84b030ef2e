"""A process that tells what arrives on the segmenter's topics, and when: for `ellipseg bench`.

One line of JSON for everything that it hears, on stdout. Its clock is the one of all processes.
"""

import json
import sys
import time

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.event_handler import QoSSubscriptionMatchedInfo, SubscriptionEventCallbacks
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from ellipseg_ros.msg import SegmentArray
from ellipseg_ros.ros.process import End, run
from ellipseg_ros.ros.recorder import header_time

TOPICS = {"segmented_points": PointCloud2, "ellipsoids": MarkerArray, "segments": SegmentArray}
STAMPED = "segments"  # the last topic of an update
DEPTH = 100


class Listener:
    """Subscribes to everything; messages stay bytes, so that it costs little."""

    def __init__(self, end: End) -> None:
        self.node = Node("ellipseg_listener")
        for topic, kind in TOPICS.items():
            self.node.create_subscription(
                kind,
                topic,
                lambda data, topic=topic: self._on_message(topic, data),
                DEPTH,
                raw=True,
                event_callbacks=SubscriptionEventCallbacks(
                    matched=lambda event, topic=topic: self._on_match(topic, event)
                ),
            )
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, DEPTH)

    def close(self) -> bool:
        """Nothing to end."""
        return True

    def _on_message(self, topic: str, data: bytes) -> None:
        now = time.monotonic_ns()
        stamp = header_time(data) if topic == STAMPED else 0
        self._tell({"topic": topic, "stamp_ns": stamp, "now_ns": now, "bytes": len(data)})

    def _on_match(self, topic: str, event: QoSSubscriptionMatchedInfo) -> None:
        self._tell({"matched": topic, "publishers": event.current_count})

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        own = f"{self.node.get_namespace().strip('/')}/ellipseg_segmenter:".lstrip("/")
        for status in msg.status:
            if status.name.startswith(own):
                self._tell({"diagnostics": {item.key: item.value for item in status.values}})

    def _tell(self, news: dict[str, object]) -> None:
        sys.stdout.write(json.dumps(news) + "\n")
        sys.stdout.flush()


def main(args: list[str] | None = None) -> int:
    """Listen until SIGINT; args: `--ros-args ...`, for a namespace."""
    return run(Listener, args)
