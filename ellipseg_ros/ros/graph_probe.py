"""Looks at a running graph, and listens to its clouds, without taking part in it."""

import os
import time
from collections import Counter
from collections.abc import Callable
from threading import Event
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import GetParameters
from rclpy.client import Client
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo
from sensor_msgs.msg import PointCloud2

from ellipseg_ros.doctor.snapshot import CloudInfo, Endpoint, GraphSnapshot, SegmenterInfo, Topic
from ellipseg_ros.errors import EllipsegError, InputError
from ellipseg_ros.io.limits import nanoseconds
from ellipseg_ros.io.pointcloud2 import read_sweep
from ellipseg_ros.records import SECOND
from ellipseg_ros.ros.auxiliary_node import AuxiliaryNode
from ellipseg_ros.ros.cloud_input import BEST_EFFORT, RELIABLE

CLOUD = "sensor_msgs/msg/PointCloud2"
SEGMENTS = "ellipseg_ros/msg/SegmentArray"
TRIGGER = "std_srvs/srv/Trigger"
SHOWN = ("use_sim_time", "max_points_per_second", "max_lateness", "update_period")
DISCOVERY = 5.0  # s that the others get to be found
SETTLED = 0.5  # s without news after which all are found that will be
LOOK = 0.1  # s between two looks at the graph: it tells of no change
DEPTH = 100  # clouds kept while others are read


class GraphProbe(AuxiliaryNode):
    """A node that looks and listens; a context manager.

    topic: of the clouds; empty: what the segmenter subscribes to, or `points`.
    namespace: in which topic and segmenters are looked for; "/": segmenters anywhere.
    Raises EllipsegError for names that ROS does not take, and if it can't start.
    """

    def __init__(self, topic: str, namespace: str) -> None:
        self._asked, self._namespace = topic, namespace
        self._clouds: list[CloudInfo] = []
        self._said: dict[str, Any] = {}  # last status of a segmenter, by the name of its node
        self._parameters: dict[str, dict[str, Any]] = {}
        self._clients: dict[str, Client] = {}  # that ask for them
        self._known: list[str] = []  # names of nodes at the last look
        self._news = time.monotonic()  # when they last changed
        self._own = f"ellipseg_doctor_{os.getpid()}"
        try:
            super().__init__(self._own, ["--ros-args", "-r", f"__ns:={namespace}"])
        except Exception as error:  # of rcl, which has many
            raise _not_started(error) from error
        try:
            self._topic = self.node.resolve_topic_name(topic or "points")
        except Exception as error:  # likewise
            self.close()
            raise _not_started(error) from error

    def observe(self, seconds: float) -> GraphSnapshot:
        """Look around, then listen for so many seconds; who is found late is met as well."""
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, DEPTH)
        self._wait(DISCOVERY, self._all_is_there)
        self._choose_topic()
        changed = True
        while changed:
            self._clouds.clear()
            clouds = self.node.create_subscription(
                PointCloud2, self._topic, self._on_cloud, self._qos()
            )
            changed = self._wait(seconds, self._meet)
            if changed:
                self.node.destroy_subscription(clouds)
        return self._graph(seconds)

    def _wait(self, seconds: float, enough: Callable[[], bool]) -> bool:
        """Look again and again; False if there was not enough in that time."""
        end = time.monotonic() + seconds
        pause = Event()
        while not enough():
            if time.monotonic() >= end:
                return False
            pause.wait(min(LOOK, max(0.0, end - time.monotonic())))
            if self.failed:
                raise self.failed[0]
        return True

    def _all_is_there(self) -> bool:
        self._choose_topic()
        if (known := self._others()) != self._known:
            self._known, self._news = known, time.monotonic()
        if time.monotonic() < self._news + SETTLED:
            return False
        return bool(self._segmenters() and self.node.get_publishers_info_by_topic(self._topic))

    def _choose_topic(self) -> bool:
        """What a segmenter subscribes to, unless the user names one; True if it is a new one."""
        inputs = [topic for name in self._segmenters() for topic in self._inputs(name)]
        if not inputs or self._asked or self._topic in inputs:
            return False
        self._topic = inputs[0]
        return True

    def _meet(self) -> bool:
        """Ask every segmenter for its parameters, once; True if clouds are on another topic."""
        for name in self._segmenters():
            if name not in self._clients:
                self._clients[name] = self.node.create_client(
                    GetParameters, f"{name}/get_parameters"
                )
            if name not in self._parameters and self._clients[name].service_is_ready():
                self._parameters[name] = {}
                self._ask(name)
        return self._choose_topic()

    def _qos(self) -> QoSProfile:
        """As the node listens: best effort only if it must be, as large clouds get lost then."""
        offered = self.node.get_publishers_info_by_topic(self._topic)
        reliable = all(one.qos_profile.reliability == RELIABLE for one in offered)
        return QoSProfile(depth=DEPTH, reliability=RELIABLE if reliable else BEST_EFFORT)

    def _on_cloud(self, msg: PointCloud2) -> None:
        arrived, now_ns = time.monotonic(), time.time_ns()
        stamp_ns = nanoseconds(msg.header.stamp)
        finite, timed, problem = 0, False, ""
        try:
            sweep = read_sweep(msg)
            finite = int(np.isfinite(sweep.points).all(axis=1).sum())
            timed = bool(np.any(sweep.offsets_ns))
        except InputError as error:
            problem = str(error)
        self._clouds.append(
            CloudInfo(
                arrived=arrived,
                age=(now_ns - stamp_ns) / SECOND,
                stamp_ns=stamp_ns,
                frame_id=msg.header.frame_id,
                points=msg.width * msg.height,
                finite=finite,
                size=len(msg.data),
                fields=tuple(field.name for field in msg.fields),
                timed=timed,
                problem=problem,
            )
        )

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        for status in msg.status:
            node, colon, _ = status.name.partition(": segmentation")
            if colon:
                self._said[f"/{node}"] = status

    def _ask(self, name: str) -> None:
        """Ask for parameters; the answer comes while we listen, or never."""

        def answered(future: Any) -> None:
            values = future.result().values
            if len(values) == len(SHOWN):  # none of what is not known to that node
                found = map(parameter_value_to_python, values)
                self._parameters[name] = dict(zip(SHOWN, found, strict=True))

        request = GetParameters.Request(names=SHOWN)
        self._clients[name].call_async(request).add_done_callback(answered)

    def _others(self) -> list[str]:
        """Full names of all nodes but this one; one that several nodes have, several times."""
        found = self.node.get_node_names_and_namespaces()
        names = [f"{space.rstrip('/')}/{name}" for name, space in found if name != self._own]
        return sorted(names)

    def _of(self, name: str, which: str, kind: str) -> list[str]:
        """Topics of a type that a node publishes or subscribes to, or services that it offers."""
        space, _, base = name.rpartition("/")
        try:
            found = getattr(self.node, f"get_{which}_names_and_types_by_node")(base, space or "/")
        except rclpy.node.NodeNameNonExistentError:  # it has ended meanwhile
            return []
        return [topic for topic, kinds in found if kind in kinds]

    def _segmenters(self) -> list[str]:
        """Nodes that publish segments and can be reset, by their full names.

        A bag that is played publishes segments as well.
        """
        names = [
            name
            for name in set(self._others())
            if self._of(name, "publisher", SEGMENTS)
            and f"{name}/reset" in self._of(name, "service", TRIGGER)
        ]
        if self._namespace.strip("/"):
            names = [name for name in names if name.startswith(f"/{self._namespace.strip('/')}/")]
        return sorted(names)

    def _inputs(self, name: str) -> list[str]:
        return self._of(name, "subscriber", CLOUD)

    def _graph(self, seconds: float) -> GraphSnapshot:
        names = Counter(self._others())
        elsewhere = [
            topic
            for topic, kinds in self.node.get_topic_names_and_types()
            if CLOUD in kinds
            and topic != self._topic
            and self.node.get_publishers_info_by_topic(topic)
        ]
        return GraphSnapshot(
            topic=self._look_at(self._topic),
            seconds=seconds,
            clouds=tuple(self._clouds),
            other_cloud_topics=tuple(sorted(elsewhere)),
            segmenters=tuple(self._segmenter(name) for name in self._segmenters()),
            duplicate_names=tuple(name for name, count in names.items() if count > 1),
            nodes=sum(names.values()),
            has_clock=bool(self.node.get_publishers_info_by_topic("/clock")),
            namespace=self._namespace,
        )

    def _segmenter(self, name: str) -> SegmenterInfo:
        status = self._said.get(name)
        outputs = [
            topic
            for kind in (SEGMENTS, CLOUD, *OTHERS)
            for topic in self._of(name, "publisher", kind)
        ]
        return SegmenterInfo(
            node=name,
            inputs=tuple(map(self._look_at, self._inputs(name))),
            outputs=tuple(map(self._look_at, outputs)),
            level=None if status is None else status.level[0],
            message="" if status is None else status.message,
            values={} if status is None else {item.key: item.value for item in status.values},
            parameters=self._parameters.get(name, {}),
        )

    def _look_at(self, topic: str) -> Topic:
        publishers = self._ends(self.node.get_publishers_info_by_topic(topic))
        subscribers = self._ends(self.node.get_subscriptions_info_by_topic(topic))
        mismatches = []
        for sender in publishers:
            for receiver in subscribers:
                fits, why = qos_check_compatible(sender.qos_profile, receiver.qos_profile)
                if fits == QoSCompatibility.ERROR:
                    mismatches.append(f"{_name(sender)} to {_name(receiver)}: {_line(why)}")
        return Topic(
            topic,
            tuple(map(_end, publishers)),
            tuple(map(_end, subscribers)),
            tuple(dict.fromkeys(mismatches)),
        )

    def _ends(self, found: list[TopicEndpointInfo]) -> list[TopicEndpointInfo]:
        return [info for info in found if info.node_name != self._own]


# Of the segmenter's outputs, beside segments and clouds.
OTHERS = (
    "ellipseg_ros/msg/LandmarkArray",
    "ellipseg_ros/msg/TuningCurve",
    "visualization_msgs/msg/MarkerArray",
)


def _not_started(error: Exception) -> EllipsegError:
    return EllipsegError(f"no ROS node can be started: {' '.join(str(error).split())}")


def _name(info: TopicEndpointInfo) -> str:
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"


def _line(why: str) -> str:
    """rcl says "ERROR: Best effort publisher and reliable subscription;"."""
    return " ".join(why.replace("ERROR:", "").split()).rstrip("; ").lower()


def _end(info: TopicEndpointInfo) -> Endpoint:
    qos = info.qos_profile
    return Endpoint(
        _name(info), info.topic_type, qos.reliability.name.lower(), qos.durability.name.lower()
    )
