"""A program that subscribes to a segmenter and reports every message in a line of JSON.

Its times are those of the monotonic clock, which all processes of a machine share.
"""

import json
import sys
import time

from ellipseg_ros.ros.process import End, Runnable, run
from ellipseg_ros.ros.subscriptions import header_stamp_ns, subscribe_outputs

STAMPED = "segments"  # the last topic of an update


class Subscriber(Runnable):
    """Subscribes to all topics of a segmenter; messages stay bytes, to cost little time."""

    def __init__(self, end: End) -> None:
        super().__init__("ellipseg_measuring_subscriber")
        subscribe_outputs(
            self.node,
            self._on_message,
            lambda: print_line({"connected": True}),
            lambda values: print_line({"diagnostics": values}),
        )

    def _on_message(self, topic: str, data: bytes) -> None:
        now = time.monotonic_ns()
        stamp = header_stamp_ns(data) if topic == STAMPED else 0
        print_line({"topic": topic, "stamp_ns": stamp, "now_ns": now, "bytes": len(data)})


def print_line(report: dict[str, object]) -> None:
    """Print a line of JSON immediately."""
    sys.stdout.write(json.dumps(report) + "\n")
    sys.stdout.flush()


def main(args: list[str] | None = None) -> int:
    """Report until SIGINT; args: `--ros-args ...`, for a namespace."""
    return run(Subscriber, args)
