"""The subscription of `points`: as reliable as its publishers are; lost clouds are noticed."""

from collections.abc import Callable
from threading import Lock
from typing import Any

from rclpy.event_handler import (
    QoSMessageLostInfo,
    QoSSubscriptionMatchedInfo,
    SubscriptionEventCallbacks,
)
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import PointCloud2

from ellipseg_ros.config import NodeConfig
from ellipseg_ros.ros.limits import throttled

RELIABLE, BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
FIXED = {"reliable": RELIABLE, "best_effort": BEST_EFFORT}
OVERLAP = 20  # clouds after which the old subscription goes in any case


class CloudInput:
    """Hands every cloud over, and tells how many were lost, in the thread of the callbacks.

    It may be made in another one while callbacks run already.
    take: gets each cloud. lost: gets how many are missing, whenever some are. Reliability `auto`:
    that of the publishers, best effort if one of them offers no other: large clouds sent best
    effort lose parts of themselves on the way, and best effort matches every publisher.
    """

    def __init__(
        self,
        node: Node,
        shown: NodeConfig,
        take: Callable[[PointCloud2], None],
        lost: Callable[[int], None],
    ) -> None:
        self._node = node
        self._shown = shown
        self._take = take
        self._tell_lost = lost
        self._topic = node.resolve_topic_name("points")
        self._number: int | None = None  # of the last cloud, by its publisher
        self._several = False  # publishers, at the last gap
        self._old: Subscription[Any] | None = None  # until the new one is known to hear all
        self._both: list[tuple[int, int | None]] = []  # what they have heard since, by any of them
        # A publisher may be found, and `_adapt` called, before `_subscribe` has returned.
        self._choice = Lock()  # of reliability and subscription
        with self._choice:
            self.reliability = self._wanted()
            self._subscription = self._subscribe()

    @property
    def _is_given(self) -> bool:
        return self._shown.input_reliability in FIXED

    def _wanted(self) -> ReliabilityPolicy:
        if self._is_given:
            return FIXED[self._shown.input_reliability]
        publishers = self._node.get_publishers_info_by_topic(self._topic)
        offered = [publisher.qos_profile.reliability for publisher in publishers]
        return RELIABLE if all(one == RELIABLE for one in offered) else BEST_EFFORT

    def _subscribe(self) -> "Subscription[Any]":
        qos = QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=self._shown.input_depth,
            reliability=self.reliability,
        )
        events = SubscriptionEventCallbacks(
            message_lost=self._on_lost,
            matched=self._on_match,
            incompatible_qos=None if self._is_given else lambda _: self._adapt(),  # None: warns
        )
        return self._node.create_subscription(
            PointCloud2,
            "points",
            self._on_cloud,
            qos,
            event_callbacks=events,
        )

    def _on_match(self, event: QoSSubscriptionMatchedInfo) -> None:
        if event.current_count_change > 0:
            self._adapt()

    def _adapt(self) -> None:
        """Subscribe anew if the publishers of now ask for another reliability."""
        with self._choice:
            wanted = self._wanted()
            if wanted == self.reliability:
                return
            self.reliability = wanted
            if self._old is not None:
                self._node.destroy_subscription(self._old)
            self._old, self._subscription = self._subscription, self._subscribe()
        name = wanted.name.lower().replace("_", " ")
        self._node.get_logger().info(
            f"{self._topic}: {name}, as its publishers are", **throttled(1.0)
        )

    def _on_cloud(self, msg: PointCloud2, info: dict[str, Any]) -> None:
        number = info["publication_sequence_number"]
        if self._old is not None and self._is_twice((info["source_timestamp"], number)):
            return
        self._look_for_a_gap(number)
        self._take(msg)

    def _is_twice(self, cloud: tuple[int, int | None]) -> bool:
        """Whether both subscriptions have heard a cloud: from it on, the new one misses none."""
        twice = cloud in self._both
        self._both.append(cloud)
        if twice or len(self._both) == OVERLAP:
            self._node.destroy_subscription(self._old)
            self._old = None
            self._both.clear()
        return twice

    def _look_for_a_gap(self, number: int | None) -> None:
        """Count what the publisher has sent and the node has not got, by the publisher's numbers.

        Lost on the way, or pushed out of a full queue of input_depth, which DDS tells nobody. Of
        several publishers the numbers can't be told apart.
        """
        before, self._number = self._number, number
        if number is None or before is None or number == before + 1:
            return
        if self._node.count_publishers(self._topic) != 1:
            self._several = True
        elif self._several:  # the number before may be of one that has gone
            self._several = False
        elif number > before:
            self._tell_lost(number - before - 1)

    def _on_lost(self, event: QoSMessageLostInfo) -> None:
        if self._number is None:  # else the numbers tell
            self._tell_lost(event.total_count_change)
