"""Bags of ROS 1 and ROS 2, read and written without ROS.

rosbags: pure Python, maintained since 2020, reads ROS 1 bags, sqlite3 and mcap. Its Readers are
used, not its AnyReader, which fails if it can't parse the definition of any type in the bag;
PointCloud2 is the same in every ROS.
"""

import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

import ellipseg_ros
from ellipseg_ros.config import NodeConfig
from ellipseg_ros.errors import InputError, reason
from ellipseg_ros.io.atomic_files import write_errors
from ellipseg_ros.io.bag_writer import BagWriter
from ellipseg_ros.io.livox import CUSTOM_CLOUDS, read_custom_cloud
from ellipseg_ros.io.pointcloud2 import read_sweep, write_sweep
from ellipseg_ros.io.pose_messages import (
    POSE_TYPES,
    TRANSFORM_TYPES,
    read_poses,
    write_odometry,
    write_transform,
)
from ellipseg_ros.io.topics import (
    BAG_TOPICS,
    CLOUD,
    ODOMETRY,
    POINTS,
    SEGMENTS,
    TF,
    TF_STATIC,
)
from ellipseg_ros.io.update_messages import UpdateMessages
from ellipseg_ros.poses.placer import Event, TransformSample
from ellipseg_ros.poses.series import PoseSample
from ellipseg_ros.records import Segmentation, Sweep

SUFFIXES = (".bag", ".mcap", ".db3")


# --- reading ---------------------------------------------------------------------------------


class BagSweeps:
    """The clouds of one topic of a bag, in the order of the bag; may be iterated several times.

    path: a .bag of ROS 1; a bag folder of ROS 2; or one .mcap or .db3 file of it.
    topic: of type PointCloud2 or Livox CustomMsg; may be empty if the bag has only one of them.
    Raises InputError, here or during iteration, if the bag or a cloud can't be read.
    """

    def __init__(self, path: Path, topic: str = "") -> None:
        self.path = _storage(path)
        self._is_ros1 = self.path.suffix == ".bag"
        # Of this bag alone, as types of one name may differ between bags.
        self._types = get_typestore(Stores.ROS1_NOETIC if self._is_ros1 else Stores.ROS2_JAZZY)
        with _opened(self.path) as reader:
            self.topic = _choose(path, reader.connections, topic)
            self.count = sum(c.msgcount for c in reader.connections if c.topic == self.topic)
            self.duration = reader.duration / 1e9  # s, of the whole bag
        first = next(iter(self), None)
        if first is None:
            raise InputError(f"{path} has no message on {self.topic}; record some", "empty")
        self.frame_id = first.frame_id

    def __iter__(self) -> Iterator[Sweep]:
        return (event for event in self.events(()) if isinstance(event, Sweep))

    def events(self, topics: tuple[str, ...]) -> Iterator[Event]:
        """The clouds with the poses and transforms of other topics, in the order of the bag."""
        with _opened(self.path) as reader:
            chosen = [c for c in reader.connections if c.topic in (self.topic, *topics)]
            number = 0  # of the next cloud
            for connection, _, raw in reader.messages(chosen):
                msg = self._decode(connection, raw)
                if connection.topic != self.topic:
                    yield from read_poses(msg, connection.topic, connection.msgtype)
                    continue
                read = read_sweep if connection.msgtype == CLOUD else read_custom_cloud
                try:
                    yield read(msg)
                except InputError as error:
                    place = f"message {number} of {self.topic} in {self.path}"
                    raise InputError(f"{place}: {error}", error.reason) from error
                number += 1

    def pose_topics(self) -> dict[str, PoseSample | None]:
        """The topics with poses of the bag, each with its first valid one; /tf, if it has that."""
        with _opened(self.path) as reader:
            found = {c.topic: c for c in reader.connections if c.msgtype in POSE_TYPES}
            topics = {topic: self._first_pose(reader, found[topic]) for topic in sorted(found)}
            transforms = [c for c in reader.connections if c.msgtype in TRANSFORM_TYPES]
            if any(c.topic == TF.name and c.msgcount for c in transforms):
                topics[TF.name] = None
        return {topic: pose for topic, pose in topics.items() if pose or topic == TF.name}

    def _first_pose(self, reader: Reader1 | Reader2, topic: Connection) -> PoseSample | None:
        for connection, _, raw in reader.messages([topic]):
            (event,) = read_poses(self._decode(connection, raw), topic.topic, topic.msgtype)
            if isinstance(event, PoseSample):
                return event
        return None

    def _decode(self, connection: Connection, raw: bytes) -> Any:
        if connection.msgtype not in self._types.types:
            _register(connection, self._types)
        if self._is_ros1:
            return self._types.deserialize_ros1(raw, connection.msgtype)
        return self._types.deserialize_cdr(raw, connection.msgtype)


def _register(connection: Connection, types: Typestore) -> None:
    """Add the type of a connection to the types, from the bag's own definition."""
    definition = connection.msgdef.data
    if connection.msgtype in TRANSFORM_TYPES:
        definition = "geometry_msgs/TransformStamped[] transforms"
    if not definition:
        problem = f"the bag lacks the definition of {connection.msgtype}"
        raise InputError(f"{problem}; record it as mcap, which holds it", "no_definition")
    types.register(get_types_from_msg(definition, connection.msgtype))


def read_messages(path: Path, topic: str) -> Iterator[tuple[bytes, Any]]:
    """Yield the messages of one of the node's topics from a ROS 2 bag: as bytes, and decoded."""
    with _opened(_storage(path)) as reader:
        chosen = [c for c in reader.connections if c.topic == topic]
        # No connections mean all of them to rosbags.
        for connection, _, raw in reader.messages(chosen) if chosen else ():
            yield bytes(raw), node_types().deserialize_cdr(raw, connection.msgtype)


def is_bag(path: Path) -> bool:
    """Whether a path is a bag by its suffix, or by the files in the folder."""
    return path.suffix in SUFFIXES or (path.is_dir() and bool(_bag_files(path)))


def _bag_files(folder: Path) -> list[Path]:
    """The storage files of a bag folder, and its metadata."""
    return sorted(p for p in folder.iterdir() if p.suffix in SUFFIXES or p.name == "metadata.yaml")


def _storage(path: Path) -> Path:
    """The path for rosbags: `path`, or the only storage file of a folder without metadata."""
    if not path.is_dir() or (path / "metadata.yaml").exists():
        return path
    files = _bag_files(path)
    if len(files) != 1:
        problem = f"{path} has no metadata.yaml, and {len(files) or 'no'} storage files"
        advice = "run `ros2 bag reindex`, or give one of the files"
        raise InputError(f"{problem}; {advice}", "bad_bag")
    return files[0]


@contextmanager
def _opened(path: Path) -> Iterator[Reader1 | Reader2]:
    """A reader of the bag; raises InputError, in one line, for any error of its own.

    The errors of rosbags have no common base, and damaged data raise those of struct, lz4 and
    sqlite3, hence `Exception`. Errors of the consumer are not raised in a generator.
    """
    try:
        with (Reader1 if path.suffix == ".bag" else Reader2)(path) as reader:
            yield reader
    except InputError:
        raise
    except Exception as error:
        problem = f"{path} can't be read as a bag ({reason(error)})"
        formats = "a complete .bag, .mcap or .db3, or a folder of `ros2 bag record`"
        raise InputError(f"{problem}; it must be {formats}", "bad_bag") from error


def _choose(path: Path, connections: list[Connection], topic: str) -> str:
    """The topic to read; InputError lists the topics of the bag."""
    clouds = sorted({c.topic for c in connections if c.msgtype in (CLOUD, *CUSTOM_CLOUDS)})
    if not clouds:
        topics = ", ".join(sorted({c.topic for c in connections})) or "no topic"
        raise InputError(f"{path} has no topic of type PointCloud2; it has {topics}", "no_topic")
    if not topic and len(clouds) == 1:
        return clouds[0]
    name = f"/{topic.lstrip('/')}"
    if topic and name in clouds:
        return name
    problem = "several PointCloud2 topics; choose one:"
    if topic:
        problem = f"no PointCloud2 topic {name}; it has"
    raise InputError(f"{path} has {problem} {', '.join(clouds)}", "no_topic")


# --- writing ---------------------------------------------------------------------------------


class BagSink:
    """Writes a ROS 2 bag (mcap, zstd) with the topics of the node; a context manager.

    The bag is complete after every update, even if the process is killed. It is removed if the
    `with` block raises. Raises InputError if the path exists or can't be written.
    """

    def __init__(self, path: Path, config: NodeConfig | None = None) -> None:
        if path.exists():
            raise InputError(f"{path} exists already; give a new path", "exists")
        self.path = path
        self._messages = UpdateMessages(config or NodeConfig())
        self._connections: dict[str, Connection] = {}

    def __enter__(self) -> "BagSink":
        with write_errors(self.path):
            self._writer = BagWriter(self.path)
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        complete = False
        try:
            if kind is None:
                with write_errors(self.path):
                    self._writer.complete()
                complete = True
        finally:
            self._writer.close_file()
            if not complete:
                shutil.rmtree(self.path, ignore_errors=True)

    def write_event(self, event: Event, time_ns: int | None = None) -> None:
        """Write a cloud on /points, a pose on /odometry, or a transform on /tf or /tf_static.

        time_ns: of recording, by which readers sort; None: the stamp.
        """
        if isinstance(event, Sweep):
            topic, stamp_ns, message = f"/{POINTS.name}", event.stamp_ns, write_sweep(event)
        elif isinstance(event, PoseSample):
            topic, stamp_ns = f"/{ODOMETRY.name}", event.time_ns
            message = write_odometry(event, node_types())
        elif isinstance(event, TransformSample):
            topic = TF_STATIC.name if event.static else TF.name
            stamp_ns, message = event.sample.time_ns, write_transform(event.sample, node_types())
        else:
            return
        self.write(topic, stamp_ns if time_ns is None else time_ns, message)

    def write_update(self, segmentation: Segmentation) -> None:
        """Write the messages of an update, at the time of its newest point."""
        for topic, write in self._messages.writers(segmentation).items():
            self.write(f"/{topic.name}", segmentation.end_ns, write())

    def write(self, topic: str, time_ns: int, message: bytes) -> None:
        """Write a serialized message of one of the BAG_TOPICS."""
        with write_errors(self.path):
            if topic not in self._connections:
                kind = BAG_TOPICS[topic].type
                self._connections[topic] = self._writer.add_connection(topic, kind, node_types())
            # Times in a bag are not negative, but those of points may be.
            self._writer.write(self._connections[topic], max(0, time_ns), message)
            if topic == f"/{SEGMENTS.name}":  # the last of an update
                self._writer.end_update()


# --- types -----------------------------------------------------------------------------------


@cache
def node_types() -> Typestore:
    """The message types of Jazzy and of this package, from its .msg files."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    folder = msg_folder(Path(ellipseg_ros.__path__[0]).resolve())
    for path in sorted(folder.glob("*.msg")):
        definition = path.read_text(encoding="utf-8")
        types |= get_types_from_msg(definition, f"ellipseg_ros/msg/{path.stem}")
    store.register(types)
    return store


def msg_folder(package: Path) -> Path:
    """The folder of the .msg files: of the checkout, or below the prefix of the installation."""
    prefixes = [*package.parents[:5], Path(sys.prefix)]
    folders = [package.parent / "msg", *(p / "share/ellipseg_ros/msg" for p in prefixes)]
    for folder in folders:
        if (folder / "SegmentArray.msg").exists():
            return folder
    raise InputError("the .msg files of ellipseg_ros are missing; install it again", "no_msg")
