"""Subscriptions to clouds and poses: they adapt their reliability, and count lost messages."""

from collections.abc import Callable
from threading import Lock
from typing import Any, NamedTuple

from rclpy import event_handler as events
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from ellipseg_ros.io.topics import Topic
from ellipseg_ros.ros.limits import throttled
from ellipseg_ros.ros.topics import create_subscription

RELIABLE, BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
FIXED = {"reliable": RELIABLE, "best_effort": BEST_EFFORT}
MAX_OVERLAP = 20  # messages after which a replaced subscription is destroyed in any case


class Qos(NamedTuple):
    """Quality of service of an input."""

    depth: int
    reliability: str = "auto"  # or reliable, best_effort


class Input:
    """Passes on every message and the number of lost ones, in the thread of the callbacks.

    It may be created in another thread while callbacks already run.
    on_message: gets each message. on_lost: gets the number of those missing before the next one.

    Reliability `auto`: that of the publishers; best effort if one of them offers nothing else.
    Best effort matches every publisher, but large messages are lost if one of their fragments is,
    and a lost pose changes where clouds are placed.
    """

    def __init__(
        self,
        node: Node,
        topic: Topic,
        on_message: Callable[[Any], object],
        on_lost: Callable[[int], object],
        qos: Qos | None = None,
    ) -> None:
        self._node = node
        self._declared = topic
        self._depth, reliability = qos or Qos(topic.depth)
        self._fixed = FIXED.get(reliability)  # None: that of the publishers
        self._pass_on = on_message
        self._report_lost = on_lost
        self.topic = node.resolve_topic_name(topic.name)
        self._number: int | None = None  # of the last message, assigned by its publisher
        self._several = False  # publishers, at the last gap
        # After a change of reliability both subscriptions live on, until a message arrives on
        # both; those that are queued then may arrive twice as well.
        self._replaced: Subscription[Any] | None = None
        self._overlap: set[tuple[int, int | None]] | None = None  # messages since; None: none
        self._overlap_end = 0  # number of those after which the replaced one is destroyed
        # A publisher may match, and `_adapt` run, before `_subscribe` has returned.
        self._lock = Lock()  # for reliability and subscription
        with self._lock:
            self.reliability = self._required_reliability()
            self._subscription = self._subscribe()

    def _required_reliability(self) -> ReliabilityPolicy:
        return self._fixed or matching_reliability(self._node, self.topic)

    def _subscribe(self) -> "Subscription[Any]":
        qos = QoSProfile(depth=self._depth, reliability=self.reliability)
        if self._declared.latched:
            qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
        callbacks = events.SubscriptionEventCallbacks(
            message_lost=self._on_lost,
            matched=self._on_match,
            incompatible_qos=None if self._fixed else lambda _: self._adapt(),  # None: warns
        )
        return create_subscription(
            self._node, self._declared, self._on_message, qos, event_callbacks=callbacks
        )

    def _on_match(self, event: events.QoSSubscriptionMatchedInfo) -> None:
        if event.current_count_change > 0:
            self._adapt()

    def _adapt(self) -> None:
        """Replace the subscription if the present publishers require another reliability."""
        with self._lock:
            required = self._required_reliability()
            if required == self.reliability:
                return
            self.reliability = required
            if self._replaced is not None:
                self._node.destroy_subscription(self._replaced)
            self._overlap = self._overlap or set()
            self._overlap_end = len(self._overlap) + MAX_OVERLAP
            self._replaced, self._subscription = self._subscription, self._subscribe()
        name = required.name.lower().replace("_", " ")
        self._node.get_logger().info(
            f"{self.topic}: {name}, as its publishers are", **throttled(1.0)
        )

    def _on_message(self, msg: Any, info: dict[str, Any]) -> None:
        number = info["publication_sequence_number"]
        message = info["source_timestamp"], number
        if self._overlap is not None and self._is_duplicate(message, self._overlap):
            return
        self._check_gap(number)
        self._pass_on(msg)

    def _is_duplicate(
        self, message: tuple[int, int | None], overlap: set[tuple[int, int | None]]
    ) -> bool:
        """Whether the message has arrived on both subscriptions; the new one is complete then."""
        duplicate = message in overlap
        overlap.add(message)
        if self._replaced is not None and (duplicate or len(overlap) >= self._overlap_end):
            self._node.destroy_subscription(self._replaced)
            self._replaced = None
        if self._replaced is None and len(overlap) > self._overlap_end + self._depth:
            self._overlap = None  # no message of the old subscription is queued any more
        return duplicate

    def _check_gap(self, number: int | None) -> None:
        """Report a gap in the publisher's numbers.

        Messages are lost in transport, or evicted from the full queue, which DDS does not report.
        With several publishers the numbers can't be attributed.
        """
        before, self._number = self._number, number
        if number is None or before is None or number == before + 1:
            return
        if self._node.count_publishers(self.topic) != 1:
            self._several = True
        elif self._several:  # the number before may be of a publisher that has left
            self._several = False
        elif number > before:
            self._report_lost(number - before - 1)

    def _on_lost(self, event: events.QoSMessageLostInfo) -> None:
        if self._number is None:  # else the numbers show it
            self._report_lost(event.total_count_change)


def matching_reliability(node: Node, topic: str) -> ReliabilityPolicy:
    """Reliable, unless a publisher of the topic offers best effort only."""
    publishers = node.get_publishers_info_by_topic(topic)
    reliable = all(info.qos_profile.reliability == RELIABLE for info in publishers)
    return RELIABLE if reliable else BEST_EFFORT
