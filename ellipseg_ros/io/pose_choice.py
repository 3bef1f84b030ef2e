"""The choice of the poses of raw clouds, from an option or from what a bag holds."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

from ellipseg_ros.config import PlacementConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.bag import BagSweeps
from ellipseg_ros.io.cloud_file import CloudSweeps
from ellipseg_ros.io.frames import looks_like_a_sensor
from ellipseg_ros.io.pose_files import read_pose_file
from ellipseg_ros.io.raw_drive import RawDrive
from ellipseg_ros.io.topics import TF, TF_STATIC
from ellipseg_ros.poses.conversion import odometry_of, read_tree
from ellipseg_ros.poses.kiss_icp import KISS_ICP, kiss_icp_poses
from ellipseg_ros.poses.placer import Event
from ellipseg_ros.poses.series import PoseSample
from ellipseg_ros.poses.tree import static_transform
from ellipseg_ros.records import Sweep

TRANSFORMS = (TF.name, TF_STATIC.name)
FIXED_FRAMES = ("odom", "map", "world")  # by REP-105; the first that tf connects to the clouds
IDENTITY = "0 0 0 0 0 0 1"  # as an extrinsic: the poses are those of the sensor, in any frame
CHOICES = (
    "--odometry with a topic, /tf, a file of poses (TUM or KITTI), kiss-icp, or registered if "
    "they are in a fixed frame"
)

Clouds: TypeAlias = BagSweeps | CloudSweeps | RawDrive


@dataclass(frozen=True)
class Poses:
    """Clouds with their poses, as events in the order of arrival."""

    events: Iterable[Event]
    placement: PlacementConfig
    about: str = ""  # where the poses come from; empty: the clouds are registered
    frame_id: str = ""  # the fixed frame; empty: that of the clouds


@dataclass(frozen=True)
class Merged:
    """Clouds and poses in the order of their stamps; a pose comes before a cloud of its time."""

    clouds: Iterable[Sweep]
    poses: list[PoseSample]

    def __iter__(self) -> Iterator[Event]:
        left = 0
        for cloud in self.clouds:
            while left < len(self.poses) and self.poses[left].time_ns <= cloud.stamp_ns:
                yield self.poses[left]
                left += 1
            yield cloud
        yield from self.poses[left:]


@dataclass(frozen=True)
class OnlyClouds:
    """The clouds among events."""

    events: Iterable[Event]

    def __iter__(self) -> Iterator[Sweep]:
        return (event for event in self.events if isinstance(event, Sweep))


@dataclass(frozen=True)
class BagEvents:
    """The clouds of a bag with the messages of pose topics."""

    bag: BagSweeps
    topics: tuple[str, ...]

    def __iter__(self) -> Iterator[Event]:
        return self.bag.events(self.topics)


def choose_poses(clouds: Clouds, odometry: str, config: PlacementConfig) -> Poses:
    """The poses that an option names, or else those that the settings and the source suggest.

    odometry: as in open_source. Raises InputError, in one line, if there are none or several.
    """
    if odometry == "registered" or (not odometry and config.pose_source == "registered"):
        return Poses(clouds, replace(config, pose_source="registered"))
    if odometry == KISS_ICP:
        return _of_sensor(clouds, kiss_icp_poses(clouds), config, "KISS-ICP, run on the clouds")
    if odometry and Path(odometry).is_file():
        samples = read_pose_file(Path(odometry), (cloud.stamp_ns for cloud in clouds))
        return _of_samples(clouds, samples, config, odometry)
    if not isinstance(clouds, BagSweeps):
        return _of_file(clouds, odometry, config)
    topic = odometry if not odometry else f"/{odometry.lstrip('/')}"
    return _of_bag(clouds, topic or _suggested_topic(clouds, config), config)


def _of_file(clouds: CloudSweeps | RawDrive, odometry: str, config: PlacementConfig) -> Poses:
    if odometry:
        problem = f"there is no file {odometry}, and a cloud file has no topics"
        raise InputError(f"{problem}; give {CHOICES}", "no_odometry")
    if isinstance(clouds, RawDrive):
        return _of_sensor(clouds, clouds.poses, config, "the poses in the file")
    return Poses(clouds, replace(config, pose_source="registered"))


def _of_sensor(
    clouds: Iterable[Sweep], samples: list[PoseSample], config: PlacementConfig, about: str
) -> Poses:
    """Poses with exact stamps, of the sensor itself."""
    exact = replace(config, odometry_stamp="exact", odometry_offset=0.0, extrinsic=IDENTITY)
    return _of_samples(clouds, samples, exact, about)


def _of_samples(
    clouds: Iterable[Sweep], samples: list[PoseSample], config: PlacementConfig, about: str
) -> Poses:
    """Poses without a frame: of the sensor, unless the settings have an extrinsic."""
    extrinsic = config.extrinsic or IDENTITY
    placement = replace(config, pose_source="odometry", extrinsic=extrinsic)
    frame_id = samples[0].frame_id if samples else ""
    return Poses(Merged(clouds, samples), placement, about, frame_id)


def _of_bag(bag: BagSweeps, topic: str, config: PlacementConfig) -> Poses:
    """Poses of a topic; empty: the clouds are registered."""
    if not topic:
        return Poses(bag, replace(config, pose_source="registered"))
    topics = bag.pose_topics()
    if topic not in topics:
        problem = (
            f"{bag.path} has no poses on {topic}; it has them on {', '.join(topics) or 'none'}"
        )
        raise InputError(f"{problem}; give {CHOICES}", "no_odometry")
    pose = topics[topic]
    if pose is None:
        frame = config.fixed_frame or _fixed_frame(bag)
        placement = replace(config, pose_source="tf", fixed_frame=frame)
        return Poses(BagEvents(bag, TRANSFORMS), placement, f"tf, in frame {frame}", frame)
    placement = replace(config, pose_source="odometry")
    events = BagEvents(bag, (topic, TF_STATIC.name))
    return Poses(events, placement, f"the topic {topic}", pose.frame_id)


def without_transforms(poses: Poses, frame_id: str) -> Poses:
    """The same poses as an odometry alone, for a node that gets no tf.

    frame_id: of the clouds. Poses of tf become an odometry; a static transform becomes the
    parameter `extrinsic`.
    """
    config, events = poses.placement, poses.events
    if config.pose_source == "tf":
        samples = odometry_of(read_tree(events, config), frame_id, config)
        merged = Merged(OnlyClouds(events), samples)
        placement = replace(config, pose_source="odometry", extrinsic="")
        return replace(poses, events=merged, placement=placement)
    first = next((event for event in events if isinstance(event, PoseSample)), None)
    if config.pose_source == "registered" or config.extrinsic or first is None:
        return poses
    path = read_tree(events, config).path(first.child_frame_id, frame_id)
    extrinsic = static_transform(path) if path else None
    if extrinsic is None or frame_id in (first.frame_id, first.child_frame_id):
        return poses
    numbers = " ".join(map(repr, (*extrinsic.position.tolist(), *extrinsic.rotation.tolist())))
    return replace(poses, placement=replace(config, extrinsic=numbers))


def _suggested_topic(bag: BagSweeps, config: PlacementConfig) -> str:
    """The topic with the poses of the clouds, if there is one choice; empty: none is needed."""
    topics = bag.pose_topics()
    if config.pose_source == "tf" or (config.fixed_frame and config.pose_source == "auto"):
        return TF.name
    poses = {topic: pose for topic, pose in topics.items() if pose is not None}
    of_sensor = [t for t, pose in poses.items() if pose.child_frame_id == bag.frame_id]
    is_raw = of_sensor or looks_like_a_sensor(bag.frame_id) or config.pose_source == "odometry"
    if not is_raw or (bag.count == 1 and not topics):  # a single cloud fits itself
        return ""
    for choice in (of_sensor, list(poses), [t for t in topics if t == TF.name]):
        if len(choice) == 1:
            return choice[0]
        if choice:
            break
    problem = f"the clouds of {bag.path} are in frame {bag.frame_id!r}, that of a sensor"
    listed = ", ".join(topics) or "none"
    raise InputError(f"{problem}; topics with poses: {listed}; give {CHOICES}", "no_odometry")


def _fixed_frame(bag: BagSweeps) -> str:
    """A fixed frame that tf connects to the clouds: by name, or else the root."""
    tree = read_tree(bag.events(TRANSFORMS), PlacementConfig())
    names = [*FIXED_FRAMES, tree.root(bag.frame_id)]
    connected = [name for name in names if name != bag.frame_id and tree.path(name, bag.frame_id)]
    if not connected:
        problem = f"tf of {bag.path} connects {bag.frame_id!r} to no other frame"
        raise InputError(f"{problem}; give {CHOICES}", "no_transform")
    return connected[0]
