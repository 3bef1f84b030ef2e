"""Helpers for tests with real nodes: a node process, and a peer node with clients and inboxes."""

import signal
import subprocess
import sys
from contextlib import contextmanager
from threading import Condition, Thread

import numpy as np
import rclpy
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rclpy.context import Context
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from visualization_msgs.msg import MarkerArray

from ellipseg_ros.io.pointcloud2 import write_sweep
from ellipseg_ros.records import Sweep

SECOND = 1_000_000_000  # ns
SHUTDOWN_TIMEOUT_S = 10.0
LIMIT = 120.0  # s, for an answer: kernels may have to be compiled first


class Process:
    """A node process and its output."""

    def __init__(self, module, arguments, log):
        command = f"import sys; from ellipseg_ros.ros.{module} import main; sys.exit(main())"
        self._log = log
        with log.open("w") as file:
            self._process = subprocess.Popen(
                [sys.executable, "-c", command, "--ros-args", *arguments], stdout=file, stderr=file
            )

    @property
    def output(self):
        """Everything that it has printed."""
        return self._log.read_text()

    def alive(self):
        """Whether it is running."""
        return self._process.poll() is None

    def signal(self, number=signal.SIGINT):
        """Send a signal."""
        self._process.send_signal(number)

    def wait(self, seconds=LIMIT):
        """Wait for the exit code."""
        return self._process.wait(seconds)

    def end(self):
        """End it if it is running; by SIGINT if possible, as SIGKILL leaves DDS's files behind."""
        if self.alive():
            self.signal(signal.SIGCONT)
            self.signal()
            try:
                self.wait(SHUTDOWN_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
        print(f"{self.output}\nexit code {self.wait()}")  # pytest shows it if the test fails


@contextmanager
def running(module, arguments, log):
    """A node process that is ended with the block."""
    process = Process(module, arguments, log)
    try:
        yield process
    finally:
        process.end()


class Inbox:
    """The messages of a topic, in the order of arrival."""

    def __init__(self):
        self.messages = []
        self._changed = Condition()
        self._publishers = 0

    def put(self, message):
        """Append a message."""
        with self._changed:
            self.messages.append(message)
            self._changed.notify_all()

    def matched(self, event):
        """Store the number of publishers."""
        with self._changed:
            self._publishers = event.current_count
            self._changed.notify_all()

    def wait_for_publisher(self):
        """Wait until a publisher is connected."""
        self._wait(lambda: self._publishers > 0, "no publisher")
        return self

    def wait(self, predicate, start=0):
        """Wait for the first message from index `start` on with predicate(message); return it."""
        matching = []

        def arrived():
            matching[:] = [m for m in self.messages[start:] if predicate(m)][:1]
            return matching

        self._wait(arrived, f"{len(self.messages) - start} messages, none of them matching")
        return matching[0]

    def arrives(self, predicate, seconds):
        """Whether a message with predicate(message) arrives within so many seconds."""
        with self._changed:
            return self._changed.wait_for(lambda: any(map(predicate, self.messages)), seconds)

    def wait_for_values(self, predicate):
        """Wait for new diagnostics with predicate(level, values); return the values by key."""
        values = {}

        def matches(message):
            status = message.status[0]
            values.clear()
            values.update((item.key, item.value) for item in status.values)
            return predicate(status.level, values)

        self.wait(matches, start=len(self.messages))
        return values

    def wait_for_stamp(self, seconds):
        """Wait for a message with this stamp in its header."""
        stamp_ns = round(seconds * SECOND)
        return self.wait(lambda message: nanoseconds(message.header.stamp) == stamp_ns)

    def wait_for(self, count):
        """Wait for so many messages in total."""
        self._wait(lambda: len(self.messages) >= count, f"less than {count} messages")

    def _wait(self, condition, complaint):
        with self._changed:
            assert self._changed.wait_for(condition, LIMIT), complaint


class Outbox:
    """A publisher that counts its subscribers."""

    def __init__(self):
        self.publisher = None
        self._subscribers = 0
        self._changed = Condition()

    def matched(self, event):
        """Store the number of subscribers."""
        with self._changed:
            self._subscribers = event.current_count
            self._changed.notify_all()

    def wait_for_subscriber(self):
        """Wait until a subscriber is connected."""
        with self._changed:
            assert self._changed.wait_for(lambda: self._subscribers > 0, LIMIT), "no subscriber"
        return self

    def send(self, message):
        """Publish a message, a sweep, or bytes."""
        self.publisher.publish(write_sweep(message) if isinstance(message, Sweep) else message)


class Peer:
    """A node in this process whose callbacks run in a thread."""

    def __init__(self, domain, namespace=""):
        self.context = Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        self.node = Node("peer", context=self.context, namespace=namespace)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._clients = {}
        self._open = True
        self._thread = Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self):
        while self._open:
            self._executor.spin_once()

    def close(self):
        """Destroy the node and end the thread."""
        self._open = False
        self._executor.create_task(lambda: None)  # something to do, so that spin_once ends
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def subscribe(self, kind, topic, raw=False):
        """Subscribe, and wait for a publisher; raw: messages as bytes."""
        inbox = Inbox()
        events = SubscriptionEventCallbacks(matched=inbox.matched)
        self.node.create_subscription(
            kind, topic, inbox.put, 1000, event_callbacks=events, raw=raw
        )
        return inbox.wait_for_publisher()

    def wait_until_known(self, namespace=""):
        """Wait until the segmenter knows all subscriptions of this node."""
        self.subscribe(MarkerArray, f"{namespace}/ellipsoids").wait_for(1)

    def publish(self, kind, topic, reliability=ReliabilityPolicy.RELIABLE):
        """Create a publisher, and wait for a subscriber."""
        return self.publisher(kind, topic, reliability).wait_for_subscriber()

    def publisher(self, kind, topic, reliability=ReliabilityPolicy.RELIABLE):
        """Create a publisher."""
        outbox = Outbox()
        events = PublisherEventCallbacks(matched=outbox.matched)
        qos = QoSProfile(depth=1000, reliability=reliability)
        outbox.publisher = self.node.create_publisher(kind, topic, qos, event_callbacks=events)
        return outbox

    def call(self, kind, name, request=None):
        """Call a service and return its answer."""
        if name not in self._clients:  # kept: destroying one while the other thread waits for it
            self._clients[name] = self.node.create_client(kind, name)  # may crash rclpy
        client = self._clients[name]
        assert client.wait_for_service(LIMIT), f"there is no service {name}"
        answered = Inbox()
        client.call_async(request or kind.Request()).add_done_callback(answered.put)
        return answered.wait(lambda _: True).result()

    def set(self, node, **values):
        """Set parameters (`__` for a dot) one by one; return the results in the same order."""
        request = SetParameters.Request()
        for name, value in values.items():
            parameter = Parameter(name.replace("__", "."), value=value)
            request.parameters.append(parameter.to_parameter_msg())
        return self.call(SetParameters, f"{node}/set_parameters", request).results

    def get(self, node, *names):
        """Values of parameters, as messages."""
        request = GetParameters.Request(names=names)
        return self.call(GetParameters, f"{node}/get_parameters", request).values

    def describe(self, node, *names):
        """Descriptors of parameters."""
        request = DescribeParameters.Request(names=names)
        return self.call(DescribeParameters, f"{node}/describe_parameters", request).descriptors


@contextmanager
def peer(domain, namespace=""):
    """A peer for the time of a `with`."""
    found = Peer(domain, namespace)
    try:
        yield found
    finally:
        found.close()


def parameters(**values):
    """ROS arguments that set parameters."""
    return [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]


def nanoseconds(time):
    """A builtin_interfaces/Time in ns."""
    return time.sec * SECOND + time.nanosec


def wall(stamp, frame_id="odom", points=400, seed=0):
    """A sweep: a wall of 4 x 4 m; stamp in s."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform([0.0, 0.0, -0.01], [4.0, 4.0, 0.01], (points, 3)).astype(np.float32)
    return Sweep(round(stamp * SECOND), xyz, frame_id=frame_id)
