"""A snapshot of a running graph as plain records; ros/graph_probe.py takes it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Endpoint:
    """A publisher or a subscription."""

    node: str  # with its namespace: "/robot/ellipseg_segmenter"
    msg_type: str  # "sensor_msgs/msg/PointCloud2"
    qos: str  # reliability and durability: "reliable, volatile"


@dataclass(frozen=True)
class Topic:
    """The endpoints of a topic."""

    name: str
    publishers: tuple[Endpoint, ...] = ()
    subscribers: tuple[Endpoint, ...] = ()
    mismatches: tuple[str, ...] = ()  # endpoints with incompatible QoS: "/a to /b: reason"


@dataclass(frozen=True)
class SegmenterInfo:
    """A running segmenter."""

    node: str
    inputs: tuple[Topic, ...] = ()  # subscribed clouds; none until the node is ready
    outputs: tuple[Topic, ...] = ()
    level: int | None = None  # of its last /diagnostics; None: none was received
    message: str = ""
    values: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, Any] = field(default_factory=dict)  # empty: no response

    @property
    def places_clouds(self) -> bool:
        """Whether it places clouds in a sensor's frame by poses."""
        return self.values.get("pose source", "registered") != "registered"


@dataclass(frozen=True)
class CloudInfo:
    """A received cloud."""

    arrived: float  # s, monotonic clock
    age: float  # s from the stamp to the system clock
    stamp_ns: int
    frame_id: str
    points: int
    finite: int  # points without NaN and Inf
    size: int  # bytes of data
    fields: tuple[str, ...]
    times: str = ""  # how the times of the points are read; empty: they have none
    problem: str = ""  # why it can't be used, in one line


@dataclass(frozen=True)
class GraphSnapshot:
    """A running graph, and the clouds received in some seconds."""

    topic: Topic  # with the clouds
    seconds: float  # of observation
    clouds: tuple[CloudInfo, ...] = ()
    other_cloud_topics: tuple[str, ...] = ()  # with a publisher
    segmenters: tuple[SegmenterInfo, ...] = ()
    nodes: tuple[str, ...] = ()  # full names, with duplicates; without the observer
    has_clock: bool = False  # /clock has a publisher
    namespace: str = "/"
    pose_topics: tuple[str, ...] = ()  # with a publisher: odometries, and /tf

    def parameter(self, name: str, default: float) -> float:
        """A parameter of the first segmenter that reports it, or `default`."""
        values = (s.parameters[name] for s in self.segmenters if name in s.parameters)
        return float(next(values, default))
