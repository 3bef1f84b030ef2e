"""Writes what the segmenter publishes into a bag, or elsewhere, as it comes."""

from collections.abc import Callable
from typing import Protocol

from rclpy.serialization import deserialize_message
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.node.abortable_condition import AbortableCondition
from ellipseg_ros.records import Sweep
from ellipseg_ros.ros.auxiliary_node import AuxiliaryNode
from ellipseg_ros.ros.subscriptions import header_stamp_ns, sequence_number, subscribe_outputs

STAMPED = ("segmented_points", "segments", "landmarks")  # messages that begin with a header
OPTIONAL = "landmarks"  # not published if they are not looked for
SMALL = 1000  # bytes: more than one marker takes


class Sink(Protocol):
    """What takes messages, such as io.bag.BagSink."""

    def write(self, topic: str, time_ns: int, message: bytes) -> None:
        """A serialized message, and the time of the update that it tells of."""

    def write_points(self, sweep: Sweep) -> None:
        """A cloud that was sent."""


class Recorder(AuxiliaryNode):
    """Subscribes to the segmenter's topics; a context manager.

    Messages go into the bag as the bytes that came, at the time of the update that they tell of.
    args: `--ros-args ...`, for a namespace.
    """

    def __init__(self, bag: Sink, args: list[str] | None = None) -> None:
        self._bag = bag
        self._changed = AbortableCondition()  # guards the bag, too
        self._known = False
        self._time_ns: int | None = None  # of the newest update
        self._stamps: dict[str, int] = {}  # of the last message that came, by topic
        self._update: int | None = None  # its number
        self._ending = False
        self.updates = 0
        self.diagnostics: dict[str, str] = {}  # the latest
        super().__init__("ellipseg_recorder", args or [])
        subscribe_outputs(self.node, self._on_message, self._on_known, self._on_diagnostics)

    def write_points(self, sweep: Sweep) -> None:
        """Note a cloud that was sent."""
        with self._changed:
            self._bag.write_points(sweep)

    def wait_for_topics(self, timeout: float) -> None:
        """Wait until the segmenter publishes all topics to us, so that no update is lost.

        Raises EllipsegError after `timeout` s.
        """
        self._changed.wait_until(lambda: self._known, timeout, "the node publishes nothing")

    def wait_for_updates(self, count: int, timeout: float) -> None:
        """Wait until `count` updates have come, the last one on all topics that bear its time.

        Large messages overtake each other on the way: segments may come before their points.
        Raises EllipsegError after `timeout` s.
        """
        self._changed.wait_until(
            lambda: self.updates >= count,
            timeout,
            lambda: f"{count} updates were due, {self.updates} came",
        )
        self._changed.wait_until(self._is_whole, timeout, "the last update is incomplete")

    def wait_for_report(self, key: str, value: int, timeout: float) -> None:
        """Wait until /diagnostics of the segmenter say so; EllipsegError after `timeout` s."""
        text = f"/diagnostics did not come to {key!r} = {value}"
        self._changed.wait_until(lambda: self.diagnostics.get(key) == str(value), timeout, text)

    def reset_segmenter(self, timeout: float) -> None:
        """Call ~/reset, which makes an update of the points that still wait for their boundary.

        That it then takes all markers away is not recorded: the bag ends with them.
        """
        self._ending = True
        client = self.node.create_client(Trigger, "ellipseg_segmenter/reset")
        if not client.wait_for_service(timeout):
            raise EllipsegError("the node offers no service ~/reset; does it still run?")
        answers: list[Trigger.Response] = []
        future = client.call_async(Trigger.Request())
        future.add_done_callback(lambda it: self._note(lambda: answers.append(it.result())))
        self._changed.wait_until(lambda: bool(answers), timeout, "~/reset is not answered")
        if not answers[0].success:
            raise EllipsegError(f"the node refuses ~/reset: {answers[0].message}")

    def stop(self, reason: str) -> None:
        """Let everything that waits fail with `reason`; for any thread."""
        self._changed.abort(reason)

    def _on_message(self, topic: str, data: bytes) -> None:
        with self._changed:
            if topic in STAMPED:
                self._time_ns = self._stamps[topic] = header_stamp_ns(data)
            farewell = self._ending and topic == "ellipsoids" and deletes_all(data)
            again = topic == "segments" and self._is_again(data)
            # Markers have no time of their own.
            if self._time_ns is not None and not farewell and not again:
                self._bag.write(f"/{topic}", self._time_ns, data)
            self.updates += topic == "segments" and not again
            self._changed.notify_all()

    def _is_whole(self) -> bool:
        last = self._stamps.get("segments")
        return all(
            self._stamps.get(topic) == last
            for topic in STAMPED
            if topic in self._stamps or topic != OPTIONAL
        )

    def _is_again(self, data: bytes) -> bool:
        """Whether these segments came already, and come again for somebody else who is late."""
        before, self._update = self._update, sequence_number(data)
        return self._update == before

    def _on_known(self) -> None:
        with self._changed:
            self._known = True
            self._changed.notify_all()

    def _on_diagnostics(self, values: dict[str, str]) -> None:
        with self._changed:
            self.diagnostics = values
            self._changed.notify_all()

    def _note(self, change: Callable[[], object]) -> None:
        with self._changed:
            change()
            self._changed.notify_all()

    def fail(self, error: BaseException) -> None:
        """Let what waits fail with it."""
        self.stop(f"recording failed: {error}")


def deletes_all(data: bytes) -> bool:
    """Whether a serialized MarkerArray does nothing but to delete all markers."""
    if len(data) > SMALL:
        return False
    actions = [marker.action for marker in deserialize_message(data, MarkerArray).markers]
    return actions == [Marker.DELETEALL]
