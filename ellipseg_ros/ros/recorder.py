"""Recording of what the segmenter publishes into a bag or another sink."""

from collections.abc import Callable
from typing import Protocol

from rclpy.serialization import deserialize_message
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.topics import ELLIPSOIDS, LANDMARKS, RESET, SEGMENTER, SEGMENTS, UPDATE_TOPICS
from ellipseg_ros.node.abortable_condition import AbortableCondition
from ellipseg_ros.poses.placer import Event
from ellipseg_ros.ros.auxiliary_node import AuxiliaryNode
from ellipseg_ros.ros.subscriptions import header_stamp_ns, sequence_number, subscribe_outputs

STAMPED = [topic.name for topic in UPDATE_TOPICS if topic != ELLIPSOIDS]  # begin with a header
OPTIONAL = LANDMARKS.name  # not published if landmarks are disabled


class Sink(Protocol):
    """A consumer of recorded messages, such as io.bag.BagSink."""

    def write(self, topic: str, time_ns: int, message: bytes) -> None:
        """Take a serialized message, and the time of its update."""

    def write_event(self, event: Event) -> None:
        """Take a cloud or a pose that was sent."""


class Recorder(AuxiliaryNode):
    """Subscribes to the segmenter's topics; a context manager.

    Messages reach the sink as the bytes received, at the time of their update.
    args: `--ros-args ...`, for a namespace.
    """

    def __init__(self, sink: Sink, args: list[str] | None = None) -> None:
        self._sink = sink
        self._changed = AbortableCondition()  # guards the sink, too
        self._ready = False
        self._time_ns: int | None = None  # of the newest update
        self._stamps: dict[str, int] = {}  # of the last message, by topic
        self._sequence: int | None = None  # of the last segments
        self._resetting = False
        self.updates = 0
        self.diagnostics: dict[str, str] = {}  # the latest
        super().__init__("ellipseg_recorder", args or [])
        subscribe_outputs(
            self.node,
            on_message=lambda topic, data: self._update(self._record, topic, data),
            on_ready=lambda: self._update(setattr, self, "_ready", True),
            on_diagnostics=lambda values: self._update(setattr, self, "diagnostics", values),
        )

    def write_event(self, event: Event) -> None:
        """Record a cloud or a pose that was sent."""
        with self._changed:
            self._sink.write_event(event)

    def wait_for_topics(self, timeout: float) -> None:
        """Wait until all topics are connected, so that no update is lost.

        Raises EllipsegError after `timeout` s.
        """
        self._changed.wait_until(lambda: self._ready, timeout, "the node publishes nothing")

    def wait_for_updates(self, count: int, timeout: float) -> None:
        """Wait for `count` updates, the last one complete on all stamped topics.

        Large messages overtake each other in transport: segments may arrive before their points.
        Raises EllipsegError after `timeout` s.
        """
        self._changed.wait_until(
            lambda: self.updates >= count,
            timeout,
            lambda: f"{count} updates were expected, {self.updates} received",
        )
        self._changed.wait_until(self._is_complete, timeout, "the last update is incomplete")

    def wait_for_report(self, key: str, value: int, timeout: float) -> None:
        """Wait until /diagnostics report a value; raises EllipsegError after `timeout` s."""
        text = f"/diagnostics did not come to {key!r} = {value}"
        self._changed.wait_until(lambda: self.diagnostics.get(key) == str(value), timeout, text)

    def reset_segmenter(self, timeout: float) -> None:
        """Call ~/reset, which closes the open group of clouds and so makes the last update.

        The deletion of all markers that follows is not recorded.
        """
        self._resetting = True
        client = self.node.create_client(Trigger, RESET.name.replace("~", SEGMENTER))
        if not client.wait_for_service(timeout):
            raise EllipsegError("the node offers no service ~/reset; does it still run?")
        future = client.call_async(Trigger.Request())
        future.add_done_callback(lambda _: self._update(lambda: None))
        self._changed.wait_until(future.done, timeout, "~/reset is not answered")
        if not (answer := future.result()).success:
            raise EllipsegError(f"the node refuses ~/reset: {answer.message}")

    def stop(self, reason: str) -> None:
        """Make all waits fail with `reason`; thread-safe."""
        self._changed.abort(reason)

    def fail(self, error: BaseException) -> None:
        """Make all waits fail with an error of a callback."""
        self.stop(f"recording failed: {error}")

    def _record(self, topic: str, data: bytes) -> None:
        if topic in STAMPED:
            self._time_ns = self._stamps[topic] = header_stamp_ns(data)
        if topic == SEGMENTS.name:
            sequence = sequence_number(data)
            if sequence == self._sequence:  # sent again for another, new subscriber
                return
            self._sequence = sequence
            self.updates += 1
        if self._resetting and topic == ELLIPSOIDS.name and deletes_all(data):
            return
        if self._time_ns is not None:  # markers take the time of the last stamped message
            self._sink.write(f"/{topic}", self._time_ns, data)

    def _is_complete(self) -> bool:
        required = {*STAMPED} - {OPTIONAL} | self._stamps.keys()
        return len({self._stamps.get(topic) for topic in required}) == 1

    def _update(self, change: Callable[..., object], *args: object) -> None:
        """Change the guarded state and notify the waiting threads."""
        with self._changed:
            change(*args)
            self._changed.notify_all()


def deletes_all(data: bytes) -> bool:
    """Whether a serialized MarkerArray only deletes all markers."""
    actions = [marker.action for marker in deserialize_message(data, MarkerArray).markers]
    return actions == [Marker.DELETEALL]
