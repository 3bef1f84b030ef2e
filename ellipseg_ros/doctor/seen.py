"""What was seen of a running graph, as plain records: ros/observing.py makes them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class End:
    """A publisher or a subscription."""

    node: str  # with its namespace: "/robot/ellipseg_segmenter"
    kind: str  # "sensor_msgs/msg/PointCloud2"
    reliability: str  # "reliable", "best_effort"
    durability: str  # "volatile", "transient_local"


@dataclass(frozen=True)
class Topic:
    """Both ends of a topic."""

    name: str
    publishers: tuple[End, ...] = ()
    subscribers: tuple[End, ...] = ()
    mismatches: tuple[str, ...] = ()  # pairs that never talk: "/a to /b: why"


@dataclass(frozen=True)
class SegmenterSeen:
    """A running segmenter."""

    node: str
    inputs: tuple[Topic, ...] = ()  # the clouds that it subscribes to; none until it is ready
    outputs: tuple[Topic, ...] = ()
    level: int | None = None  # of its last /diagnostics; None: none came
    message: str = ""
    values: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, Any] = field(default_factory=dict)  # empty: it did not answer


@dataclass(frozen=True)
class Cloud:
    """A cloud that came, or what could be learnt of it."""

    arrived: float  # s, monotonic clock
    age: float  # s by which the stamp is behind the clock of the system
    stamp_ns: int
    frame_id: str
    points: int
    finite: int  # points without NaN and Inf
    size: int  # bytes of data
    fields: tuple[str, ...]
    timed: bool = False  # its points have their own times
    problem: str = ""  # why it can't be used, in one line


@dataclass(frozen=True)
class Graph:
    """A running graph, and what came within some seconds of listening."""

    topic: Topic  # with the clouds
    seconds: float  # that were listened to it
    clouds: tuple[Cloud, ...] = ()
    elsewhere: tuple[str, ...] = ()  # other topics on which somebody publishes clouds
    segmenters: tuple[SegmenterSeen, ...] = ()
    twins: tuple[str, ...] = ()  # names that several nodes have
    nodes: int = 0  # that were found, but for the observer
    clock: bool = False  # somebody publishes /clock
    namespace: str = "/"
