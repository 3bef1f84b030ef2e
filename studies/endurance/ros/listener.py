"""A process that tells what arrives on the segmenter's topics, and when.

For `ellipseg bench` and `ellipseg soak`. One line of JSON for everything that it hears, on stdout.
Its clock is the one of all processes.
"""

import json
import sys
import time

from rclpy.node import Node

from ellipseg_ros.ros.process import End, run
from ellipseg_ros.ros.subscriptions import header_stamp_ns, subscribe_outputs

STAMPED = "segments"  # the last topic of an update


class Listener:
    """Subscribes to everything; messages stay bytes, so that it costs little."""

    pauses = None

    def __init__(self, end: End) -> None:
        self.node = Node("ellipseg_listener")
        subscribe_outputs(
            self.node,
            self._on_message,
            lambda: self._tell({"known": True}),
            lambda values: self._tell({"diagnostics": values}),
        )

    def close(self) -> bool:
        """Nothing to end."""
        return True

    def _on_message(self, topic: str, data: bytes) -> None:
        now = time.monotonic_ns()
        stamp = header_stamp_ns(data) if topic == STAMPED else 0
        self._tell({"topic": topic, "stamp_ns": stamp, "now_ns": now, "bytes": len(data)})

    def _tell(self, news: dict[str, object]) -> None:
        sys.stdout.write(json.dumps(news) + "\n")
        sys.stdout.flush()


def main(args: list[str] | None = None) -> int:
    """Listen until SIGINT; args: `--ros-args ...`, for a namespace."""
    return run(Listener, args)
