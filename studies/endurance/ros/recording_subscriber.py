"""A subscriber that keeps what segmenters publish, for tests in which nodes start and end."""

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

QUEUE_DEPTH = 100  # messages kept while others are processed


@dataclass(frozen=True)
class ReceivedUpdate:
    """Header and flags of one message of `segments`."""

    time: float  # s, monotonic clock
    stamp_ns: int
    sequence: int
    frame_id: str
    full: bool
    in_sync: bool  # whether the mirror was complete after it


class RecordingSubscriber(AuxiliaryNode):
    """Subscribes to `segments`, `ellipsoids` and /diagnostics; a context manager.

    args: `--ros-args ...`, for a namespace. Its lists only grow.
    """

    def __init__(self, args: list[str]) -> None:
        self._changed = AbortableCondition()
        self._mirror = SegmentMirror()
        self.updates: list[ReceivedUpdate] = []
        self.displayed: set[int] = set()  # markers that a viewer would display, without lifetimes
        # By message of markers: stamp in ns; whether markers of other messages stay displayed.
        self.marker_updates: list[tuple[int, bool]] = []
        self.lifetimes_s: set[int] = set()  # of all markers
        self.health: list[tuple[float, str]] = []  # s; message of the segmenter's /diagnostics
        super().__init__("ellipseg_recording_subscriber", args)
        for kind, topic, callback in (
            (SegmentArray, "segments", self._on_segments),
            (MarkerArray, "ellipsoids", self._on_markers),
            (DiagnosticArray, "/diagnostics", self._on_diagnostics),
        ):
            self.node.create_subscription(kind, topic, callback, QUEUE_DEPTH)

    def wait(self, done: Callable[[], bool], timeout_s: float, problem: str) -> None:
        """Wait until `done` is true after a message; raises EllipsegError at the timeout."""
        self._changed.wait_until(done, timeout_s, problem)

    def fail(self, error: BaseException) -> None:
        """Let everything that waits fail with `error`."""
        super().fail(error)
        self._changed.abort(f"receiving failed: {error}")

    def since(self, moment: float) -> list[ReceivedUpdate]:
        """Updates received after `moment`, s."""
        return [update for update in self.updates if update.time > moment]

    def _on_segments(self, message: SegmentArray) -> None:
        in_sync = self._mirror.update(message)
        update = ReceivedUpdate(
            time.monotonic(),
            nanoseconds(message.header.stamp),
            message.sequence,
            message.header.frame_id,
            message.full,
            in_sync,
        )
        with self._changed:
            self.updates.append(update)
            self._changed.notify_all()

    def _on_markers(self, message: MarkerArray) -> None:
        with self._changed:
            for marker in message.markers:
                if marker.action == Marker.DELETEALL:
                    self.displayed.clear()
                elif marker.action == Marker.DELETE:
                    self.displayed.discard(marker.id)
                else:
                    self.displayed.add(marker.id)
                    self.lifetimes_s.add(marker.lifetime.sec)
            added = {m.id for m in message.markers if m.action == Marker.ADD}
            for marker in message.markers[-1:]:
                stale = bool(self.displayed - added)
                self.marker_updates.append((nanoseconds(marker.header.stamp), stale))
            self._changed.notify_all()

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        now = time.monotonic()
        with self._changed:
            self.health += [
                (now, status.message) for status in segmenter_statuses(self.node, message)
            ]
            self._changed.notify_all()
