"""A subscriber that remembers what a segmenter says: for trials in which nodes come and go."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray
from visualization_msgs.msg import Marker, MarkerArray

from ellipseg_ros.io.limits import nanoseconds
from ellipseg_ros.io.segment_mirror import SegmentMirror
from ellipseg_ros.msg import SegmentArray
from ellipseg_ros.node.abortable_condition import AbortableCondition
from ellipseg_ros.ros.auxiliary_node import AuxiliaryNode
from ellipseg_ros.ros.subscriptions import segmenter_statuses

DEPTH = 100  # messages kept while others are dealt with


@dataclass(frozen=True)
class Heard:
    """One message of `segments`."""

    time: float  # s, monotonic clock
    stamp_ns: int
    sequence: int
    frame_id: str
    full: bool
    in_step: bool  # whether the mirror was, after it


class Witness(AuxiliaryNode):
    """Subscribes to `segments`, `ellipsoids` and /diagnostics; a context manager.

    args: `--ros-args ...`, for a namespace. Its lists only grow.
    """

    def __init__(self, args: list[str]) -> None:
        self._changed = AbortableCondition()
        self._mirror = SegmentMirror()
        self.heard: list[Heard] = []
        self.shown: set[int] = set()  # markers, as a viewer has them that never forgets
        self.drawn: list[tuple[int, bool]] = []  # ns, the update; whether others stayed on show
        self.lifetimes: set[int] = set()  # s, of all markers
        self.said: list[tuple[float, str]] = []  # s; the one line of a segmenter's health
        super().__init__("ellipseg_witness", args)
        for kind, topic, call in (
            (SegmentArray, "segments", self._on_segments),
            (MarkerArray, "ellipsoids", self._on_markers),
            (DiagnosticArray, "/diagnostics", self._on_diagnostics),
        ):
            self.node.create_subscription(kind, topic, call, DEPTH)

    def wait(self, done: Callable[[], bool], timeout: float, otherwise: str) -> None:
        """Wait until a message makes it true; raises EllipsegError after `timeout` s."""
        self._changed.wait_until(done, timeout, otherwise)

    def fail(self, error: BaseException) -> None:
        """Let what waits fail with it."""
        super().fail(error)
        self._changed.abort(f"listening failed: {error}")

    def since(self, moment: float) -> list[Heard]:
        """What has come on `segments` since then."""
        return [one for one in self.heard if one.time > moment]

    def _on_segments(self, message: SegmentArray) -> None:
        in_step = self._mirror.update(message)
        heard = Heard(
            time.monotonic(),
            nanoseconds(message.header.stamp),
            message.sequence,
            message.header.frame_id,
            message.full,
            in_step,
        )
        with self._changed:
            self.heard.append(heard)
            self._changed.notify_all()

    def _on_markers(self, message: MarkerArray) -> None:
        with self._changed:
            for marker in message.markers:
                if marker.action == Marker.DELETEALL:
                    self.shown.clear()
                elif marker.action == Marker.DELETE:
                    self.shown.discard(marker.id)
                else:
                    self.shown.add(marker.id)
                    self.lifetimes.add(marker.lifetime.sec)
            drawn = {m.id for m in message.markers if m.action == Marker.ADD}
            for marker in message.markers[-1:]:
                self.drawn.append((nanoseconds(marker.header.stamp), bool(self.shown - drawn)))
            self._changed.notify_all()

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        now = time.monotonic()
        with self._changed:
            self.said += [
                (now, status.message) for status in segmenter_statuses(self.node, message)
            ]
            self._changed.notify_all()
