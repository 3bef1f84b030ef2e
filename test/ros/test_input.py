"""An input adapts to the reliability of its publishers and counts losses."""

from contextlib import contextmanager
from threading import Thread
from types import SimpleNamespace

import pytest
import rclpy
from node_kit import Inbox, peer, wall
from rclpy.context import Context
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy
from sensor_msgs.msg import PointCloud2

from ellipseg_ros.io.topics import POINTS
from ellipseg_ros.ros.input import MAX_OVERLAP, Input, Qos
from ellipseg_ros.ros.process import Spinner

RELIABLE, BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
LARGE = 60_000  # points of a cloud, 0.7 MB


@pytest.fixture
def me(ros_domain):
    with peer(ros_domain) as found:
        yield found


@contextmanager
def listening(domain, reliability="auto"):
    """An Input in a node of its own: the numbers of the clouds that come."""
    context = Context()
    rclpy.init(args=[], context=context, domain_id=domain)
    node = Node("listener", context=context)
    came, lost, failed = Inbox(), [], []

    def take(msg):
        came.put(msg.header.stamp.sec)

    points = Input(node, POINTS, take, lost.append, Qos(100, reliability))
    spinner = Spinner(node, failed.append)
    yield SimpleNamespace(came=came, lost=lost, points=points)
    spinner.stop()
    node.destroy_node()
    rclpy.shutdown(context=context)
    assert failed == []


def send(outbox, here, numbers, points=10):
    """Send numbered clouds, each when the last one has come."""
    for number in numbers:
        outbox.send(wall(number, points=points))
        here.came.wait(lambda one, number=number: one == number)


@pytest.mark.parametrize("first", ["publisher", "subscriber"])
def test_reliable_publisher_is_received_reliably_and_each_cloud_once(first, me, ros_domain):
    numbers = list(range(MAX_OVERLAP + 5))
    if first == "publisher":
        outbox = me.publisher(PointCloud2, "/points")
        with listening(ros_domain) as here:
            send(outbox.wait_for_subscriber(), here, numbers)
    else:
        with listening(ros_domain) as here:
            send(me.publish(PointCloud2, "/points"), here, numbers)
    assert here.came.messages == numbers and here.lost == []
    assert here.points.reliability == RELIABLE


def test_large_clouds_of_a_reliable_publisher_are_complete(me, ros_domain):
    with listening(ros_domain) as here:
        outbox = me.publish(PointCloud2, "/points")
        send(outbox, here, range(2))
        large = range(2, 22)
        for number in large:
            outbox.send(wall(number, points=LARGE))
        here.came.wait_for(2 + len(large))
    assert here.came.messages == list(range(22)) and here.lost == []


def test_best_effort_publisher_beside_a_reliable_one_is_received(me, ros_domain):
    with listening(ros_domain) as here:
        reliable = me.publish(PointCloud2, "/points")
        send(reliable, here, range(MAX_OVERLAP + 1))
        assert here.points.reliability == RELIABLE
        careless = me.publish(PointCloud2, "/points", BEST_EFFORT)
        for number in range(100, 200):  # such a publisher sends nothing twice
            careless.send(wall(number, points=10))
            if here.came.arrives(lambda one: one >= 100, 0.5):
                break
        assert here.points.reliability == BEST_EFFORT
        send(reliable, here, range(200, 205))
    assert len(set(here.came.messages)) == len(here.came.messages)


@pytest.mark.parametrize("given", ["best_effort", "reliable"])
def test_fixed_reliability_does_not_adapt(given, me, ros_domain):
    with listening(ros_domain, reliability=given) as here:
        outbox = me.publish(PointCloud2, "/points")
        for number in range(100):  # best effort, what comes before both ends match is lost
            outbox.send(wall(number, points=10))
            if here.came.arrives(lambda _: True, 0.5):
                break
        assert here.came.messages and here.points.reliability.name.lower() == given


class Counted:
    """Of a node: how many publishers it knows."""

    publishers = 1

    def resolve_topic_name(self, name):
        return name

    def get_publishers_info_by_topic(self, topic):
        return []

    def count_publishers(self, topic):
        return self.publishers

    def __init__(self):
        self.destroyed = []

    def create_subscription(self, *_, **__):
        return None

    def destroy_subscription(self, subscription):
        self.destroyed.append(subscription)

    def get_logger(self):
        return get_logger("counted")


def test_departure_of_a_publisher_is_not_a_loss():
    node, lost = Counted(), []
    points = Input(node, POINTS, lambda _: None, lost.append)

    def come(*numbers):
        for number in numbers:
            points._on_message(
                None, {"publication_sequence_number": number, "source_timestamp": 0}
            )

    come(1, 2, 5)
    assert lost == [2]
    node.publishers = 2
    come(5001, 6, 5002, 7)
    node.publishers = 1
    come(5003, 5004)  # the other has gone
    assert lost == [2]
    come(5006)
    assert lost == [2, 1]


def test_messages_that_are_queued_on_both_subscriptions_are_passed_on_once():
    node, came = Counted(), []
    points = Input(node, POINTS, came.append, lambda _: None, Qos(100))
    points._replaced, points._overlap, points._overlap_end = 1, set(), MAX_OVERLAP
    for number in [1, 2, 3, 1, 2, 3, 4, 5]:  # three of the replaced one, then the new one
        info = {"publication_sequence_number": number, "source_timestamp": 0}
        points._on_message(number, info)
    assert came == [1, 2, 3, 4, 5]
    assert points._replaced is None and node.destroyed == [1]


class Early:
    """Of a node: its publisher is found while `create_subscription` runs, in another thread."""

    def __init__(self):
        self.offered = RELIABLE
        self.made = []
        self.found = Thread(target=self._find)

    def resolve_topic_name(self, name):
        return name

    def get_logger(self):
        return get_logger("early")

    def get_publishers_info_by_topic(self, topic):
        return [SimpleNamespace(qos_profile=SimpleNamespace(reliability=self.offered))]

    def create_subscription(self, kind, topic, callback, qos, event_callbacks):
        self.made.append(qos.reliability)
        if len(self.made) == 1:
            self.offered, self._events = BEST_EFFORT, event_callbacks
            self.found.start()
            self.found.join(0.2)  # it may have to wait for us
        return len(self.made)

    def _find(self):
        self._events.matched(SimpleNamespace(current_count_change=1))


@pytest.mark.filterwarnings("error::pytest.PytestUnhandledThreadExceptionWarning")
def test_publisher_matched_during_subscription_is_adapted_to():
    node = Early()
    points = Input(node, POINTS, None, None)
    node.found.join()
    assert node.made == [RELIABLE, BEST_EFFORT]
    assert points.reliability == BEST_EFFORT
    assert (points._replaced, points._subscription) == (1, 2)
