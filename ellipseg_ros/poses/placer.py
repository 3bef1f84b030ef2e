"""From clouds, poses and transforms in the order of arrival to placed sweeps: live and offline."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np

from ellipseg_ros.config import PlacementConfig
from ellipseg_ros.errors import ConfigError, InputError
from ellipseg_ros.poses.placement import Placement, Unplaced
from ellipseg_ros.poses.series import PoseSample
from ellipseg_ros.poses.sources import OdometryPoses, PoseSource, TransformPoses, new_tree
from ellipseg_ros.poses.transforms import IDENTITY
from ellipseg_ros.records import SECOND, Sweep


class TransformSample(NamedTuple):
    """One transform of /tf or /tf_static."""

    sample: PoseSample
    static: bool


class RefusedPose(NamedTuple):
    """A pose or a transform that could not be used."""

    reason: str  # a short key to count by
    text: str  # one line


RawEvent: TypeAlias = Sweep | PoseSample | TransformSample
Event: TypeAlias = RawEvent | RefusedPose
Outcome: TypeAlias = Sweep | Unplaced | RefusedPose


def stamp_of(event: RawEvent) -> int:
    """The stamp of a cloud, pose or transform, ns."""
    if isinstance(event, Sweep):
        return event.stamp_ns
    return event.sample.time_ns if isinstance(event, TransformSample) else event.time_ns


@dataclass
class Placer:
    """Takes what arrives, and returns the clouds that are placed or decided to be unplaced.

    config: its `pose_source` must be decided; with `registered` clouds pass unchanged.
    """

    config: PlacementConfig

    def __post_init__(self) -> None:
        if self.config.pose_source == "tf" and not self.config.fixed_frame:
            problem = "pose_source is tf, but fixed_frame is empty"
            raise ConfigError(f"{problem}; it must be a frame of tf, such as odom or map")
        self.registered = self.config.pose_source in ("auto", "registered")
        self._tree = new_tree(self.config)
        self._start()

    def reset(self) -> None:
        """Forget the clouds that wait and all poses; static transforms stay.

        Those are sent once: a latched topic does not repeat them.
        """
        self._tree = self._tree.static_part()
        self._start()

    def _start(self) -> None:
        self._odometry = OdometryPoses(self.config, self._tree)
        source: PoseSource = self._odometry
        if self.config.pose_source == "tf":
            source = TransformPoses(self.config, self._tree)
        self.source = source
        self.placement = Placement(self.config, source)

    def take(self, event: Event) -> list[Outcome]:
        """Process what has arrived; returns what is decided by it."""
        if isinstance(event, Sweep):
            return [event] if self.registered else [*self.placement.add(event)]
        if isinstance(event, RefusedPose):
            return [event]
        if self.registered:
            return []
        try:
            if isinstance(event, TransformSample):
                self._tree.add(event.sample, event.static)
            else:
                self._odometry.add(event)
        except InputError as error:
            return [RefusedPose(error.reason, str(error))]
        return [*self.placement.take()]

    def flush(self) -> list[Outcome]:
        """Decide all clouds that still wait, at the end of the input."""
        return [*self.placement.flush()]


def warm_up() -> None:
    """Compile the kernels, or load them from the cache."""
    placer = Placer(PlacementConfig(pose_source="odometry"))
    fields = np.zeros(2, [("t", "u4")])
    fields["t"] = 0, SECOND // 10
    cloud = Sweep(0, np.ones((2, 3)), fields=fields, frame_id="lidar")
    tree = Placer(PlacementConfig(pose_source="tf", fixed_frame="odom"))
    for time_ns in (0, SECOND):
        pose = PoseSample(time_ns, "odom", "lidar", IDENTITY)
        placer.take(pose)
        tree.take(TransformSample(pose, static=False))
    placer.take(cloud)
    placer.take(replace(cloud, frame_id="odom"))
    tree.take(cloud)


def outcomes(events: Iterable[Event], placer: Placer) -> Iterator[Outcome]:
    """Yield what becomes of the events, to their end."""
    for event in events:
        yield from placer.take(event)
    yield from placer.flush()
