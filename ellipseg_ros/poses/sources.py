"""Where the poses of clouds come from: an odometry, or the tree of coordinate transforms."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from ellipseg_ros.config import PlacementConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.poses.series import POSE, PoseSample, PoseSeries, other_clock
from ellipseg_ros.poses.transforms import IDENTITY, Transform, transform
from ellipseg_ros.poses.tree import Step, TransformTree, composed, static_transform
from ellipseg_ros.records import SECOND, Array


class Query(NamedTuple):
    """The times at which a cloud needs poses, on the clock of the poses."""

    frame_id: str
    epoch: int  # of the clouds: number of jumps back of their stamps
    begin_ns: int
    end_ns: int


class Track(NamedTuple):
    """The poses of a cloud's sensor."""

    frame_id: str  # the fixed frame
    poses: Array  # (p,) of POSE; empty: not known, and not needed
    extrinsic: Transform  # from the sensor to the frame of the poses
    registered: bool  # the cloud is in the fixed frame already


class Waiting(NamedTuple):
    """There is no pose yet; the reason counts if none comes."""

    reason: str
    text: str


class PoseSource(Protocol):
    """A source of poses for clouds."""

    def track(self, query: Query) -> Track | Waiting:
        """The poses of a cloud; InputError if it can never have one."""

    def last_epoch(self, frame_id: str) -> int:
        """Number of jumps back of the stamps of the poses of a frame."""

    def newest_ns(self, frame_id: str) -> int | None:
        """Time up to which poses of a frame are known."""

    def jumps(self, frame_id: str) -> list[str]:
        """Descriptions of the last jump of each moving transform of a frame."""


NO_POSES = np.zeros(0, POSE)


@dataclass
class OdometryPoses:
    """Poses of nav_msgs/Odometry or the like: one child frame in one fixed frame.

    tree: for static transforms between the child frame and those of the clouds.
    """

    config: PlacementConfig
    tree: TransformTree

    def __post_init__(self) -> None:
        self._series = _new_series(self.config)
        self._extrinsics = {
            name.lstrip("/"): transform(numbers[:3], numbers[3:])
            for name, numbers in self.config.extrinsics.items()
        }
        self.frame_id = ""
        self.child_frame_id = ""
        self._started = False

    def add(self, sample: PoseSample) -> None:
        """Take a pose; InputError if its frames are others than before, or it is older."""
        frame_id, child_frame_id = (name.lstrip("/") for name in sample[1:3])  # "/" as in ROS 1
        if not self._started:
            self.frame_id, self.child_frame_id = frame_id, child_frame_id
            self._started = True
        for name, was, now in (
            ("frame", self.frame_id, frame_id),
            ("child frame", self.child_frame_id, child_frame_id),
        ):
            if was != now:
                problem = f"the {name} of the odometry changed from {was!r} to {now!r}"
                raise InputError(f"{problem}; one odometry has one", "odometry_frame")
        self._series.add(sample.time_ns, sample.pose)

    def track(self, query: Query) -> Track | Waiting:
        """The poses of a cloud; InputError if it can never have one."""
        if not self._started:
            return Waiting("no_poses", "no odometry has arrived")
        extrinsic = self._extrinsic(query.frame_id.lstrip("/"))
        if isinstance(extrinsic, Waiting):
            return extrinsic
        poses = self._series.stretch(query.epoch, query.begin_ns, query.end_ns)
        if poses is None:
            return _late(self._series.newest_ns, query.end_ns)
        registered = extrinsic is None
        return Track(self.frame_id, poses, extrinsic or IDENTITY, registered)

    def _extrinsic(self, frame_id: str) -> Transform | Waiting | None:
        """From the cloud's frame to the child frame; None: the cloud is in the fixed frame."""
        given = self._extrinsics.get(frame_id, self._extrinsics.get(""))
        if given is not None:
            return given
        if frame_id == self.frame_id:
            return None
        if self.child_frame_id in (frame_id, ""):  # none: the poses are those of the sensor
            return IDENTITY
        path = self.tree.path(self.child_frame_id, frame_id)
        found = None if path is None else static_transform(path)
        if found is not None:
            return found
        return Waiting(
            "no_extrinsic",
            f"the odometry is that of {self.child_frame_id!r}, the clouds are in {frame_id!r}; "
            "set the parameter extrinsic, or publish a static transform between them",
        )

    def last_epoch(self, frame_id: str) -> int:
        """Number of jumps back of the stamps."""
        return self._series.last_epoch

    def newest_ns(self, frame_id: str) -> int | None:
        """Time of the newest pose."""
        return self._series.newest_ns

    def jumps(self, frame_id: str) -> list[str]:
        """Description of the last jump."""
        return [self._series.jump] if self._series.jump else []


@dataclass
class TransformPoses:
    """Poses from a tree of coordinate transforms (tf); `fixed_frame` must be given."""

    config: PlacementConfig
    tree: TransformTree

    def track(self, query: Query) -> Track | Waiting:
        """The poses of a cloud; InputError if it can never have one."""
        fixed = self.config.fixed_frame
        path = self.tree.path(fixed, query.frame_id)
        if path is None:
            above = ", ".join(self.tree.frames_above(query.frame_id))
            problem = f"tf does not connect {query.frame_id!r} to {fixed!r}"
            return Waiting("no_transform", f"{problem}; it leads to {above}")
        if not path:
            return Track(fixed, NO_POSES, IDENTITY, True)
        extrinsic, path = _split(path)
        if not path:
            return Track(fixed, _fixed_pose(query, extrinsic), IDENTITY, False)
        stretches: list[Array | Transform] = []
        for step in path:
            if isinstance(step.moving, Transform):
                stretches.append(step.moving)
                continue
            poses = step.moving.stretch(query.epoch, query.begin_ns, query.end_ns)
            if poses is None:
                return _late(step.moving.newest_ns, query.end_ns)
            stretches.append(poses)
        poses = composed(stretches, [step.inverted for step in path])
        return Track(fixed, poses, extrinsic, False)

    def _moving(self, frame_id: str) -> list[PoseSeries]:
        path = self.tree.path(self.config.fixed_frame, frame_id) or []
        return [step.moving for step in path if isinstance(step.moving, PoseSeries)]

    def last_epoch(self, frame_id: str) -> int:
        """Number of jumps back of the stamps, of the link with the fewest."""
        return min((series.last_epoch for series in self._moving(frame_id)), default=0)

    def newest_ns(self, frame_id: str) -> int | None:
        """Time up to which all moving links are known."""
        newest = [series.newest_ns for series in self._moving(frame_id)]
        return min((time for time in newest if time is not None), default=None)

    def jumps(self, frame_id: str) -> list[str]:
        """Description of the last jump of each link."""
        return [series.jump for series in self._moving(frame_id) if series.jump]


def _split(path: list[Step]) -> tuple[Transform, list[Step]]:
    """The static links next to the sensor, as one transform, and the path without them."""
    end = len(path)
    while end and isinstance(path[end - 1].moving, Transform):
        end -= 1
    extrinsic = static_transform(path[end:])
    return (IDENTITY if extrinsic is None else extrinsic), path[:end]


def _fixed_pose(query: Query, pose: Transform) -> Array:
    return np.array([(query.begin_ns, pose.position, pose.rotation, 0)], POSE)


def _new_series(config: PlacementConfig) -> PoseSeries:
    return PoseSeries(config.odometry_jump, round(config.max_pose_gap * SECOND))


def new_tree(config: PlacementConfig) -> TransformTree:
    """An empty tree with the limits of the settings."""
    return TransformTree(config.odometry_jump, round(config.max_pose_gap * SECOND))


def _late(newest_ns: int | None, needed_ns: int) -> Waiting:
    if newest_ns is None:
        return Waiting("no_poses", "no pose has arrived")
    behind = (needed_ns - newest_ns) / SECOND
    if behind <= 0.0:
        return Waiting(
            "late_poses", "the stamps of the clouds jumped back, those of the poses not"
        )
    text = f"the newest pose is {behind:.3f} s older than the cloud"
    return Waiting("late_poses", text + other_clock(behind))
