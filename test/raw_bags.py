"""Bags of a raw lidar drive in every format, written with rosbags' own writers."""

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from ellipseg_ros.io.topics import CLOUD, ODOMETRY, TF_MESSAGE
from ellipseg_ros.poses.transforms import IDENTITY, compose, transform

NS = 10**9
START_NS = 1_700_000_000 * NS
OLD_TF = "tf/msg/tfMessage"
POSE = "geometry_msgs/msg/PoseStamped"
POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
LIVOX = "livox_ros_driver2/msg/CustomMsg"
LIVOX_1 = "livox_ros_driver/msg/CustomMsg"
LIVOX_POINT = "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\n"
LIVOX_POINT += "uint8 tag\nuint8 line\n"
MOUNT = transform([0.5, 0.0, 1.8], Rotation.from_euler("z", 30.0, degrees=True).as_quat())
FORMATS = (
    "sqlite3",
    "mcap",
    "sqlite3 file zstd",
    "sqlite3 message zstd",
    "mcap file zstd",
    "mcap message zstd",
    "ros1",
    "ros1 lz4",
)


class RawBag:
    """A bag under construction; a context manager. kind: one of FORMATS."""

    def __init__(self, path, kind="sqlite3"):
        self.is_ros1 = kind.startswith("ros1")
        self.types = get_typestore(Stores.ROS1_NOETIC if self.is_ros1 else Stores.ROS2_JAZZY)
        if self.is_ros1:
            self._writer = Writer1(path)
            if "lz4" in kind:
                self._writer.set_compression(Writer1.CompressionFormat.LZ4)
        else:
            storage = StoragePlugin.MCAP if "mcap" in kind else StoragePlugin.SQLITE3
            self._writer = Writer(path, version=9, storage_plugin=storage)
            if "zstd" in kind:
                mode = CompressionMode.FILE if "file" in kind else CompressionMode.MESSAGE
                self._writer.set_compression(mode, CompressionFormat.ZSTD)
        self._connections = {}

    def __enter__(self):
        self._writer.__enter__()
        return self

    def __exit__(self, *error):
        self._writer.__exit__(*error)

    def define(self, kind, definition):
        """Add a type to those of the bag."""
        if kind not in self.types.types:
            self.types.register(get_types_from_msg(definition, kind))

    def make(self, kind, *values):
        """A message of a type without its package, if it has a common one."""
        packages = ("builtin_interfaces", "std_msgs", "geometry_msgs", "sensor_msgs")
        names = [kind, *(f"{package}/msg/{kind}" for package in packages)]
        found = next(name for name in names if name in self.types.types)
        return self.types.types[found](*values)

    def header(self, stamp_ns, frame_id):
        stamp = self.make("Time", *divmod(stamp_ns, NS))
        number = (0,) if self.is_ros1 else ()
        return self.make("Header", *number, stamp, frame_id)

    def write(self, topic, kind, stamp_ns, message):
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic, kind, typestore=self.types
            )
        serialize = self.types.serialize_ros1 if self.is_ros1 else self.types.serialize_cdr
        self._writer.write(self._connections[topic], stamp_ns, serialize(message, kind))

    def cloud(self, stamp_ns, points, frame_id="lidar", topic="/points"):
        """points (n, 3) float32."""
        fields = [self.make("PointField", name, 4 * row, 7, 1) for row, name in enumerate("xyz")]
        data = np.frombuffer(points.astype("<f4").tobytes(), np.uint8)
        count = len(points)
        layout = (1, count, fields, False, 12, 12 * count, data, True)
        self.write(
            topic, CLOUD, stamp_ns, self.make(CLOUD, self.header(stamp_ns, frame_id), *layout)
        )

    def pose(self, pose):
        position = self.make("Point", *pose.position.tolist())
        return self.make("Pose", position, self.make("Quaternion", *pose.rotation.tolist()))

    def odometry(self, stamp_ns, pose, topic="/odometry", child="base"):
        zeros = np.zeros(36)
        origin = self.make("Vector3", 0.0, 0.0, 0.0)
        twist = self.make("TwistWithCovariance", self.make("Twist", origin, origin), zeros)
        at = self.make("PoseWithCovariance", self.pose(pose), zeros)
        message = self.make(ODOMETRY.type, self.header(stamp_ns, "odom"), child, at, twist)
        self.write(topic, ODOMETRY.type, stamp_ns, message)

    def stamped_pose(self, stamp_ns, pose, kind=POSE):
        at = self.pose(pose)
        if kind == POSE_WITH_COVARIANCE:
            at = self.make("PoseWithCovariance", at, np.zeros(36))
        message = self.make(kind, self.header(stamp_ns, "odom"), at)
        self.write("/pose", kind, stamp_ns, message)

    def transforms(self, stamp_ns, links, topic="/tf", kind=TF_MESSAGE):
        """links: (parent, child, pose) of each."""
        self.define(kind, "geometry_msgs/TransformStamped[] transforms")
        stamped = []
        for parent, child, pose in links:
            moved = self.make("Vector3", *pose.position.tolist())
            turned = self.make("Quaternion", *pose.rotation.tolist())
            header = self.header(stamp_ns, parent)
            stamped.append(
                self.make("TransformStamped", header, child, self.make("Transform", moved, turned))
            )
        self.write(topic, kind, stamp_ns, self.make(kind, stamped))


def vehicle(seconds):
    """Pose of the vehicle: 12 m/s on a curve."""
    turn = Rotation.from_euler("z", 0.5 * seconds)
    return transform([12.0 * seconds, seconds**2, 0.0], turn.as_quat())


def sensor(seconds):
    """Pose of the lidar."""
    return compose(vehicle(seconds), MOUNT)


def scans(count=4, points=60):
    """Stamps (s from the start) and points (n, 3) float32 in the lidar's frame."""
    rng = np.random.default_rng(5)
    for k in range(count):
        yield 0.1 * k, rng.normal(scale=8.0, size=(points, 3)).astype(np.float32)


def write_drive(path, poses, kind="sqlite3", **scene):
    """A bag of the drive with its poses as one of POSES; returns the path."""
    with RawBag(path, kind) as bag:
        if poses in ("odometry", "tf", "old tf"):
            name = OLD_TF if poses == "old tf" else TF_MESSAGE
            bag.transforms(START_NS, [("base", "lidar", MOUNT)], "/tf_static", name)
        for seconds, points in scans(**scene):
            for later in (0.0, 0.05):
                _write_pose(bag, poses, seconds + later)
            bag.cloud(START_NS + round(seconds * NS), points)
    return path


def _write_pose(bag, poses, seconds):
    stamp_ns = START_NS + round(seconds * NS)
    if poses == "odometry":
        bag.odometry(stamp_ns, vehicle(seconds))
    elif poses in ("tf", "old tf"):
        links = [("odom", "base", vehicle(seconds)), ("base", "wheel", IDENTITY)]
        bag.transforms(stamp_ns, links, kind=OLD_TF if poses == "old tf" else TF_MESSAGE)
    elif poses:
        bag.stamped_pose(stamp_ns, sensor(seconds), poses)


def truth(**scene):
    """Placed points (n, 3) of every sweep."""
    for seconds, points in scans(**scene):
        matrix = sensor(seconds).matrix
        yield points.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
