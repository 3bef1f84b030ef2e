"""Inspection of a running ROS graph and its clouds, for the doctor."""

import os
import time
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import GetParameters
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo
from sensor_msgs.msg import PointCloud2

from ellipseg_ros.doctor.snapshot import CloudInfo, Endpoint, GraphSnapshot, SegmenterInfo, Topic
from ellipseg_ros.errors import EllipsegError, InputError
from ellipseg_ros.io import topics
from ellipseg_ros.io.limits import nanoseconds
from ellipseg_ros.io.pointcloud2 import read_sweep
from ellipseg_ros.poses.point_times import point_times
from ellipseg_ros.records import SECOND, Sweep
from ellipseg_ros.ros.auxiliary_node import AuxiliaryNode
from ellipseg_ros.ros.input import matching_reliability
from ellipseg_ros.ros.topics import create_subscription

OUTPUT_TYPES = {topic.type for topic in (*topics.UPDATE_TOPICS, topics.TUNING_CURVE)}
POSES = {topics.ODOMETRY.type, topics.TF_MESSAGE}  # types of topics with poses
PARAMETERS = ("use_sim_time", "max_points_per_second", "max_lateness", "update_period")
DISCOVERY_TIMEOUT_S = 5.0
SETTLING_TIME_S = 0.5  # for the discovery of nodes that run already
POLL_INTERVAL_S = 0.1  # of the graph, which notifies of no change
RESPONSE_TIMEOUT_S = 2.0  # of a parameter service
DEPTH = 100  # clouds kept while earlier ones are read


class GraphProbe(AuxiliaryNode):
    """A node that inspects the graph and subscribes to clouds; a context manager.

    topic: of the clouds; empty: the one that the segmenter subscribes to, or `points`.
    namespace: of topic and segmenters; "/": segmenters of any namespace.
    Raises EllipsegError for invalid names, and if the node can't start.
    """

    def __init__(self, topic: str, namespace: str) -> None:
        self._requested_topic, self._namespace = topic, namespace
        self._clouds: list[CloudInfo] = []
        self._statuses: dict[str, dict[str, Any]] = {}  # last of /diagnostics, by segmenter
        self._name = f"ellipseg_doctor_{os.getpid()}"
        try:
            super().__init__(self._name, ["--ros-args", "-r", f"__ns:={namespace}"])
        except Exception as error:  # rcl has many
            reason = " ".join(str(error).split())
            raise EllipsegError(f"no ROS node can be started: {reason}") from error

    def _create_node(self, name: str, context: Context) -> Node:
        node = super()._create_node(name, context)
        self._topic = node.resolve_topic_name(self._requested_topic or topics.POINTS.name)
        return node

    def probe(self, seconds: float) -> GraphSnapshot:
        """Discover the graph, then receive clouds for so many seconds."""
        create_subscription(self.node, topics.DIAGNOSTICS, self._on_diagnostics, DEPTH)
        self._discover()
        qos = QoSProfile(depth=DEPTH, reliability=matching_reliability(self.node, self._topic))
        self.node.create_subscription(PointCloud2, self._topic, self._on_cloud, qos)
        time.sleep(seconds)
        snapshot = self._graph(seconds)
        if self.failed:
            raise self.failed[0]
        return snapshot

    def _discover(self) -> None:
        """Wait for a segmenter and a publisher, and adopt its topic unless one was requested."""
        end = time.monotonic() + DISCOVERY_TIMEOUT_S
        time.sleep(SETTLING_TIME_S)
        while time.monotonic() < end:
            found = self._topics()
            inputs = [topic.name for node in self._segmenters(found) for topic in node.inputs]
            if inputs and not (self._requested_topic or self._topic in inputs):
                self._topic = inputs[0]
            if inputs and _named(self._topic, found).publishers:
                break
            time.sleep(POLL_INTERVAL_S)

    def _on_cloud(self, msg: PointCloud2) -> None:
        arrival, now_ns = time.monotonic(), time.time_ns()
        stamp_ns = nanoseconds(msg.header.stamp)
        finite, times, problem = 0, "", ""
        try:
            sweep = read_sweep(msg)
            finite = int(np.isfinite(sweep.points).all(axis=1).sum())
            times = _times(sweep)
        except InputError as error:
            problem = str(error)
        self._clouds.append(
            CloudInfo(
                arrived=arrival,
                age=(now_ns - stamp_ns) / SECOND,
                stamp_ns=stamp_ns,
                frame_id=msg.header.frame_id,
                points=msg.width * msg.height,
                finite=finite,
                size=len(msg.data),
                fields=tuple(field.name for field in msg.fields),
                times=times,
                problem=problem,
            )
        )

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        for status in msg.status:
            node, colon, _ = status.name.partition(": segmentation")
            if colon:
                self._statuses[f"/{node}"] = {
                    "level": status.level[0],
                    "message": status.message,
                    "values": {item.key: item.value for item in status.values},
                }

    def _other_nodes(self) -> list[str]:
        """Full names of all nodes but this one, with duplicates."""
        pairs = self.node.get_node_names_and_namespaces()
        return sorted(f"{space.rstrip('/')}/{name}" for name, space in pairs if name != self._name)

    def _graph(self, seconds: float) -> GraphSnapshot:
        found = self._topics()
        clouds = [topic.name for topic in found if _nodes(topic.publishers, {topics.CLOUD})]
        segmenters = [
            replace(segmenter, parameters=self._parameters(segmenter.node))
            for segmenter in self._segmenters(found)
        ]
        return GraphSnapshot(
            topic=_named(self._topic, found),
            seconds=seconds,
            clouds=tuple(self._clouds),
            other_cloud_topics=tuple(name for name in clouds if name != self._topic),
            pose_topics=tuple(topic.name for topic in found if _nodes(topic.publishers, POSES)),
            segmenters=tuple(segmenters),
            nodes=tuple(self._other_nodes()),
            has_clock=bool(_named(topics.CLOCK.name, found).publishers),
            namespace=self._namespace,
        )

    def _segmenters(self, found: list[Topic]) -> list[SegmenterInfo]:
        """The nodes that publish segments and offer ~/reset, unlike a bag."""
        prefix = f"{self.node.get_namespace().rstrip('/')}/"
        services = dict(self.node.get_service_names_and_types())
        kinds = {topics.SEGMENTS.type}
        publishers = {node for topic in found for node in _nodes(topic.publishers, kinds)}
        return [
            SegmenterInfo(
                node,
                tuple(t for t in found if node in _nodes(t.subscribers, {topics.CLOUD})),
                tuple(t for t in found if node in _nodes(t.publishers, OUTPUT_TYPES)),
                **self._statuses.get(node, {}),
            )
            for node in sorted(publishers)
            if node.startswith(prefix) and topics.RESET.name.replace("~", node) in services
        ]

    def _parameters(self, node: str) -> dict[str, Any]:
        """Values of PARAMETERS; empty if the node does not respond or does not know them all."""
        client = self.node.create_client(GetParameters, f"{node}/get_parameters")
        if not client.wait_for_service(RESPONSE_TIMEOUT_S):
            return {}
        response = client.call(GetParameters.Request(names=PARAMETERS), RESPONSE_TIMEOUT_S)
        if response is None or len(response.values) != len(PARAMETERS):
            return {}
        return dict(zip(PARAMETERS, map(parameter_value_to_python, response.values), strict=True))

    def _topics(self) -> list[Topic]:
        """All topics, sorted, with the endpoints and QoS mismatches of other nodes."""
        names = sorted(name for name, _ in self.node.get_topic_names_and_types())
        return [self._read_topic(name) for name in names]

    def _read_topic(self, name: str) -> Topic:
        publishers = self._others(self.node.get_publishers_info_by_topic(name))
        subscriptions = self._others(self.node.get_subscriptions_info_by_topic(name))
        pairs = product(publishers, subscriptions)
        mismatches = dict.fromkeys(_mismatch(sender, receiver) for sender, receiver in pairs)
        return Topic(
            name,
            tuple(map(_endpoint, publishers)),
            tuple(map(_endpoint, subscriptions)),
            tuple(filter(None, mismatches)),
        )

    def _others(self, ends: list[TopicEndpointInfo]) -> list[TopicEndpointInfo]:
        return [info for info in ends if info.node_name != self._name]


def _times(sweep: Sweep) -> str:
    """How the times of points are read, or why they can't be; empty: there are none."""
    if sweep.fields is None:
        return ""
    try:
        return point_times(sweep.fields, sweep.stamp_ns).meaning
    except InputError as error:
        return f"not readable, {error}"


def _named(name: str, found: list[Topic]) -> Topic:
    return next((topic for topic in found if topic.name == name), Topic(name))


def _nodes(ends: tuple[Endpoint, ...], kinds: set[str]) -> set[str]:
    """Names of the nodes with endpoints of some types."""
    return {end.node for end in ends if end.msg_type in kinds}


def _name(info: TopicEndpointInfo) -> str:
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"


def _mismatch(sender: TopicEndpointInfo, receiver: TopicEndpointInfo) -> str:
    """Why a subscription gets nothing of a publisher; empty if their QoS are compatible."""
    fits, why = qos_check_compatible(sender.qos_profile, receiver.qos_profile)
    if fits != QoSCompatibility.ERROR:
        return ""
    # rcl: "ERROR: Best effort publisher and reliable subscription;"
    reason = " ".join(why.replace("ERROR:", "").split()).rstrip("; ").lower()
    return f"{_name(sender)} to {_name(receiver)}: {reason}"


def _endpoint(info: TopicEndpointInfo) -> Endpoint:
    profile = info.qos_profile
    qos = f"{profile.reliability.name}, {profile.durability.name}".lower()
    return Endpoint(_name(info), info.topic_type, qos)
